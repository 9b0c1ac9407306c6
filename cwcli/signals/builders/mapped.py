"""The signal of a channel whose fields the user has named."""

from __future__ import annotations

from dataclasses import replace

from cwcli.signals.builders.base import Build, Reading
from cwcli.signals.canonical import Signal
from cwcli.signals.columns import Columns
from cwcli.signals.mapped_columns import mapped
from cwcli.signals.mapping import FieldMapping
from cwcli.signals.quality import Quality


def build_mapped(
    columns: Columns, reading: Reading, mapping: FieldMapping, *, build: Build, is_can: bool
) -> tuple[Signal, Quality]:
    """Build what the mapping makes of a channel.

    Args:
        columns: With the fields of the mapping, or those of CAN frames.
        reading: How it is read.
        mapping: What the user said.
        build: The builder of the message that it becomes.
        is_can: They are CAN frames.

    Raises:
        UsageError: The mapping, or a DBC file, does not fit the messages.
    """
    frames = None
    if is_can:
        from cwcli.signals.can import decoded

        frames, mapping = decoded(columns, mapping)
        columns = frames.columns
    made, is_stamped = mapped(columns, mapping)
    how = replace(reading, is_override=True, clock=reading.clock if is_stamped else "log")
    signal, quality = build(made, how)
    if frames is not None:
        quality.read += sum(frames.set_aside.values()) + sum(frames.rejected.values())
        quality.set_aside |= frames.set_aside
        quality.rejected |= frames.rejected
        quality.notes += frames.notes
    return signal, quality
