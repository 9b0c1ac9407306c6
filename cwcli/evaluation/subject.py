"""A log whose headline metrics are asked for: what the evaluation of every stage is given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from cwcli.channels.vehicle_state import VehicleStates
from cwcli.evaluation.system.topics import System
from cwcli.logs.read.reader import Log
from cwcli.metrics.headline import Headline
from cwcli.metrics.table import Table
from cwcli.signals.columns import FloatArray, Int64Array

AUTO, NO_TRUTH = "auto", "none"


@dataclass(frozen=True)
class EgoTruth:
    """The truth of the ego in the map frame.

    Attributes:
        topic: Its channel.
        stamp_ns, xy: Stamps (n,) and positions (n, 2), m.
        speed_mps, heading_rad, yaw_rate_radps: Shape (n,), or None where the channel does not tell them.
    """

    topic: str
    stamp_ns: Int64Array
    xy: FloatArray
    speed_mps: FloatArray | None = None
    heading_rad: FloatArray | None = None
    yaw_rate_radps: FloatArray | None = None


@dataclass(frozen=True)
class Ego:
    """What later metrics need of the ego.

    Attributes:
        states: Its states in stamp order, or None where the log has none.
        truth: Its truth, or None.
        notes: Why channels were not used, for the user.
    """

    states: VehicleStates | None = None
    truth: EgoTruth | None = None
    notes: tuple[str, ...] = ()


@dataclass
class Subject:
    """A log and its metrics.

    Attributes:
        log: An annotated log.
        truth: `auto`, `none`, or the topic of the ego's truth.
        tables: Tables by name of the stages that have just made the channels.
        headline: Gets the rows.
        ego: From the evaluation of `estimate`, which comes first.
        system: Another system in the log, that is judged too.
        notes: For the user.
    """

    log: Log
    truth: str = AUTO
    tables: Mapping[str, Table] = field(default_factory=dict)
    headline: Headline = field(default_factory=Headline)
    ego: Ego = Ego()
    system: System = field(default_factory=System)
    notes: list[str] = field(default_factory=list)

    @property
    def with_truth(self) -> bool:
        """Whether truth channels are used."""
        return self.truth != NO_TRUTH
