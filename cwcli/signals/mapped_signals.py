"""Building the signal of a channel whose fields the user has mapped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from cwcli.signals.builders.base import Build, Reading
from cwcli.signals.canonical import Signal
from cwcli.signals.columns import Columns
from cwcli.signals.input_rows import CAN_FRAME_SCHEMAS
from cwcli.signals.inputs import normalise_schema_name
from cwcli.signals.mapped_columns import add_quantities_of_channel, apply_mapping_and_tell_if_stamped
from cwcli.signals.mapping import FieldMapping
from cwcli.signals.quality import Quality

if TYPE_CHECKING:
    from cwcli.signals.can import DecodedFrames


def build_mapped_signal(
    columns: Columns,
    reading: Reading,
    mapping: FieldMapping,
    parts: Sequence[tuple[Columns, FieldMapping]] = (),
    *,
    build: Build,
) -> tuple[Signal, Quality]:
    """Build the signal of a channel whose fields the user has mapped.

    Args:
        columns: The channel, with the fields of the mapping or those of CAN frames.
        parts: Further channels with the user's mappings of them.
        build: The builder of the message that the channel is converted to.

    Raises:
        UsageError: The mapping, or a DBC file, does not fit the messages.
    """
    columns, mapping, frames = _decode_if_can_frames(columns, mapping)
    made, is_stamped = apply_mapping_and_tell_if_stamped(columns, mapping)
    notes = []
    for each, of_part in parts:
        further, said, of_frames = _decode_if_can_frames(each, of_part)
        made, note = add_quantities_of_channel(made, is_stamped, further, said)
        notes += [note, *(of_frames.notes if of_frames is not None else ())]
    how = replace(reading, is_override=True, clock=reading.clock if is_stamped else "log")
    signal, quality = build(made, how)
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
