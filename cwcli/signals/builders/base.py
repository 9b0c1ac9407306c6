"""The arguments of a builder, and a builder's row in the registry of inputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.role import Role

if TYPE_CHECKING:  # binding channels to roles takes no numpy
    from cwcli.signals.canonical import Signal
    from cwcli.signals.clocks import Clock
    from cwcli.signals.columns import Columns
    from cwcli.signals.quality import Quality


@dataclass(frozen=True)
class Reading:
    """The settings with which a channel is read.

    Attributes:
        role: The role it is bound to.
        clock: `stamp` or `log`.
        ego_station: Station id whose V2X messages are the ego's own, or None.
        is_override: The user named the channel for this role; then the role decides where the data leave a choice.
    """

    role: Role
    clock: Clock = "stamp"
    ego_station: str | None = None
    is_override: bool = False


Build = Callable[["Columns", Reading], "tuple[Signal, Quality]"]
Fields = Mapping[str, tuple[str, ...]]


@dataclass(frozen=True)
class Input:
    """One row of the registry: a schema that can fill a role.

    Attributes:
        role: The role.
        fields: Leaf fields to load, by message encoding (`cdr`, `protobuf`, `json`). JSON lists hold every spelling
            that cwcli knows; a file has some of them.
        build: Makes the canonical signal; None where the stage reads the columns or the frames itself.
        rank: 0 for a sensor made for the role. A channel of higher rank is bound only when there is none of a lower
            one. None: only when the user names it.
        needs_ego_station: Bound by itself only when the user says which station is the ego.
        fits_topic: Whether a topic's name suits the role; asked only where the user names no channel.
        is_additive: It holds other objects or events, and is bound in addition to the chosen channel, whatever its
            rank.
        says_what_it_is: The schema alone distinguishes truth from measurement; the topic's name does not count.
    """

    role: Role
    fields: Fields
    build: Build | None
    rank: int | None = 0
    needs_ego_station: bool = False
    fits_topic: Callable[[str], bool] = lambda topic: True
    says_what_it_is: bool = False
    is_additive: bool = False
