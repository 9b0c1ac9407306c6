"""Building the canonical signal of a role from a channel's columns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from cwcli.errors import DataError, MissingSignalError
from cwcli.lazy_dataclass import replace
from cwcli.signals.builders.base import Build, Input, Reading
from cwcli.signals.canonical import Signal
from cwcli.signals.clocks import Clock
from cwcli.signals.columns import Columns
from cwcli.signals.input_rows import CAN_FRAME_SCHEMAS
from cwcli.signals.inputs import find_input_for_role, normalise_schema_name
from cwcli.signals.mapped_columns import add_other_channel_interpolated_and_note, apply_mapping_and_tell_if_stamped
from cwcli.signals.mapping import FieldMapping
from cwcli.signals.quality import Quality
from cwcli.signals.role import Role
from cwcli.signals.v2x_codec import OTHER_STATION_REASON

if TYPE_CHECKING:
    from cwcli.signals.can import DecodedFrames


def build_signal(
    role: Role, columns: Columns, clock: Clock = "stamp", *, ego_station: str | None = None, is_override: bool = False
) -> tuple[Signal, Quality]:
    """Build the canonical signal of a role from a channel, by the registry's row of its schema.

    The kind of signal follows from role and schema, except: a twist becomes a `VelocitySignal` or a `SpeedSignal` by
    its frame_id, and EGO_POSITION and TRUTH give a `PositionSignal` (WGS84) or a `PoseSignal` (Cartesian).

    Args:
        role, columns: The channel with the role that it is bound to, and at least the fields of the registry's row.
        clock, ego_station, is_override: As in `Reading`.

    Returns:
        The signal, its rows sorted by stamp, and what happened to the messages.

    Raises:
        ValueError: The schema can't fill the role, or the role has no canonical signal (a bug of the caller).
    """
    entry = find_input_for_role(role, columns.schema_name)
    return build_bound_signal(entry, columns, Reading(role, clock, ego_station, is_override))


def build_bound_signal(
    entry: Input | None,
    columns: Columns,
    reading: Reading,
    mapping: FieldMapping | None = None,
    further_channels: Sequence[tuple[Columns, FieldMapping]] = (),
) -> tuple[Signal, Quality]:
    """Build the canonical signal of a bound channel.

    Args:
        entry: The registry's row that reads the channel, or the message that a mapping makes of it.
        mapping: The user's mapping of its fields to the role's quantities, or None.
        further_channels: Channels that hold the quantities behind these, and which of their fields they are.

    Raises:
        ValueError: There is no row, or no builder in it (a bug of the caller).
        UsageError: A mapping, or a DBC file, does not fit the messages.
    """
    if entry is None or entry.build is None:
        raise ValueError(f"{columns.topic}: no builder for {columns.schema_name} as {reading.role}")
    if mapping is not None:
        return _build_mapped_signal(columns, reading, mapping, further_channels, build=entry.build)
    return entry.build(columns, reading)


def _build_mapped_signal(
    columns: Columns,
    reading: Reading,
    mapping: FieldMapping,
    further_channels: Sequence[tuple[Columns, FieldMapping]] = (),
    *,
    build: Build,
) -> tuple[Signal, Quality]:
    """Build the signal of a channel whose fields the user has mapped; `build` builds it of the converted messages."""
    columns, mapping, frames = _decode_if_can_frames(columns, mapping)
    mapped, is_stamped = apply_mapping_and_tell_if_stamped(columns, mapping)
    notes = []
    for each, of_part in further_channels:
        further, said, of_frames = _decode_if_can_frames(each, of_part)
        mapped, note = add_other_channel_interpolated_and_note(mapped, is_stamped, further, said)
        notes += [note, *(of_frames.notes if of_frames is not None else ())]
    how = replace(reading, is_override=True, clock=reading.clock if is_stamped else "log")
    signal, quality = build(mapped, how)
    quality.notes += tuple(notes)
    if frames is not None:
        quality.read += sum(frames.set_aside.values()) + sum(frames.rejected.values())
        quality.set_aside |= frames.set_aside
        quality.rejected |= frames.rejected
        quality.notes += frames.notes
    return signal, quality


def _decode_if_can_frames(
    columns: Columns, mapping: FieldMapping
) -> tuple[Columns, FieldMapping, DecodedFrames | None]:
    """Return columns and mapping; CAN frames are decoded first, with a record of what became of them."""
    if normalise_schema_name(columns.schema_name) not in CAN_FRAME_SCHEMAS:
        return columns, mapping, None
    from cwcli.signals.can import decode_can_signals_and_add_units

    frames, mapping = decode_can_signals_and_add_units(columns, mapping)
    return frames.columns, mapping, frames


def require_usable_rows(quality: Quality, *, where: str = "", is_cut: bool = False) -> None:
    """Raise when a channel that the command needs has no row left.

    Args:
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
