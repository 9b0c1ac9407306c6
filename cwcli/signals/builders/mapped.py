"""Building the signal of a channel whose fields the user has mapped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from cwcli.signals.builders.base import Build, Reading
from cwcli.signals.canonical import Signal
from cwcli.signals.columns import Columns
from cwcli.signals.input_rows import CAN_SCHEMAS
from cwcli.signals.inputs import normalise
from cwcli.signals.mapped_columns import mapped, with_part
from cwcli.signals.mapping import FieldMapping
from cwcli.signals.quality import Quality

if TYPE_CHECKING:
    from cwcli.signals.can import Decoded


def build_mapped(
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
        reading: The settings for reading it.
        mapping: The user's mapping.
        parts: Further channels with the user's mappings of them.
        build: The builder of the message that the channel is converted to.

    Raises:
        UsageError: The mapping, or a DBC file, does not fit the messages.
    """
    columns, mapping, frames = _decoded(columns, mapping)
    made, is_stamped = mapped(columns, mapping)
    notes = []
    for each, of_part in parts:
        further, said, of_frames = _decoded(each, of_part)
        made, note = with_part(made, is_stamped, further, said)
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


def _decoded(columns: Columns, mapping: FieldMapping) -> tuple[Columns, FieldMapping, Decoded | None]:
    """Return columns and mapping; CAN frames are decoded first, with a record of what became of them."""
    if normalise(columns.schema_name) not in CAN_SCHEMAS:
        return columns, mapping, None
    from cwcli.signals.can import decoded

    frames, mapping = decoded(columns, mapping)
    return frames.columns, mapping, frames
