"""Building the canonical signal of a role from a channel's columns."""

from __future__ import annotations

from collections.abc import Sequence

from cwcli.errors import DataError, MissingSignalError
from cwcli.signals.builders.base import Reading
from cwcli.signals.canonical import Signal
from cwcli.signals.clocks import Clock
from cwcli.signals.columns import Columns
from cwcli.signals.inputs import find_input_for_role
from cwcli.signals.mapped_signals import build_mapped_signal
from cwcli.signals.mapping import MAPPED_QUANTITIES_BY_ROLE, FieldMapping
from cwcli.signals.quality import Quality
from cwcli.signals.role import Role
from cwcli.signals.v2x_codec import OTHER_STATION_REASON


def build_signal(
    role: Role,
    columns: Columns,
    clock: Clock = "stamp",
    *,
    ego_station: str | None = None,
    is_override: bool = False,
    mapping: FieldMapping | None = None,
    parts: Sequence[tuple[Columns, FieldMapping]] = (),
) -> tuple[Signal, Quality]:
    """Build the canonical signal of a role from a channel.

    The kind of signal follows from role and schema, except: a twist becomes a `VelocitySignal` or a `SpeedSignal` by
    its frame_id, and EGO_POSITION and TRUTH give a `PositionSignal` (WGS84) or a `PoseSignal` (Cartesian).

    Args:
        role: The role that the channel is bound to.
        columns: The channel, with at least the fields of the registry row (`find_input_for_role`) that the file has.
        clock: Take a row's time from its message (`stamp`) or from the log (`log`).
        ego_station: Station whose V2X messages are the ego's own. They are left out of REMOTE.
        is_override: The user named the channel for this role.
        mapping: The user's mapping of its fields to the role's quantities, or None.
        parts: Channels that hold the quantities behind these, and which of their fields they are.

    Returns:
        The signal, its rows sorted by stamp, and what happened to the messages.

    Raises:
        ValueError: The schema can't fill the role, or the role has no canonical signal (a bug of the caller).
        UsageError: A mapping, or a DBC file, does not fit the messages.
    """
    entry = find_input_for_role(
        role, columns.schema_name if mapping is None else MAPPED_QUANTITIES_BY_ROLE[role].schema
    )
    reading = Reading(role, clock, ego_station, is_override)
    if mapping is not None and entry is not None and entry.build is not None:
        return build_mapped_signal(columns, reading, mapping, parts, build=entry.build)
    if entry is None or entry.build is None:
        raise ValueError(f"{columns.topic}: no builder for {columns.schema_name} as {role}")
    return entry.build(columns, reading)


def require_usable_rows(quality: Quality, *, where: str = "", is_cut: bool = False) -> None:
    """Raise when a channel that the command needs has no row left.

    Args:
        quality: The counts of the channel in its role.
        where: Log name for the message.
        is_cut: The user asked for a part of the log only.

    Raises:
        DataError: Its messages were all rejected; the reasons are named.
        MissingSignalError: It has no messages, or none that is the ego's.
    """
    if quality.n_rows:
        return
    prefix = f"{where}: {quality.source}" if where else quality.source
    if quality.rejected:
        reasons = ", ".join(f"{count} {reason}" for reason, count in quality.rejected.items())
        raise DataError(f"none of its {quality.read} messages can be used as {quality.role} ({reasons})", where=prefix)
    nothing = "there is none between --start and --end" if is_cut else "the channel is empty"
    reasons = ", ".join(f"{count} {reason}" for reason, count in quality.set_aside.items()) or nothing
    hint = "name the ego's station with --ego-station ID" if OTHER_STATION_REASON in quality.set_aside else ""
    raise MissingSignalError(f"the channel has no message for {quality.role} ({reasons})", where=prefix, hint=hint)
