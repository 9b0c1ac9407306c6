"""Columns that were loaded once and are asked for again: by the next stage, and by the metrics behind the last one."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cwcli.signals.columns import Columns, OutputChannel

MAX_ROWS = 20_000
"""Of the file, all topics together: of a longer log each stage decodes its own, and nothing of it stays in memory."""


class ColumnCache:
    """What is known of a log's topics; nobody changes columns that were handed out."""

    def __init__(self) -> None:
        self._of_file: dict[tuple[str, frozenset[str]], Columns] = {}
        self._n_rows = 0
        self._of_channel: dict[int, tuple[OutputChannel, Columns]] = {}

    def of_file(self, topic: str, fields: Collection[str] | None) -> Columns | None:
        """A topic of the file with exactly these fields: more could be decoded of a message that is cut off."""
        return None if fields is None else self._of_file.get((topic, frozenset(fields)))

    def keep(self, columns: Columns, fields: Collection[str] | None) -> None:
        """Keep a topic of the file, unless it is large or was asked for whole (it may hold images)."""
        if fields is not None and self._n_rows + len(columns) <= MAX_ROWS:
            self._n_rows += len(columns)
            self._of_file[columns.topic, frozenset(fields)] = columns

    def of_channel(self, channel: OutputChannel, fields: Collection[str] | None) -> Columns:
        """A channel in memory. A flat one's columns are the channel's own arrays: keeping them costs nothing."""
        from cwcli.logs.read.added_channels import is_flat, memory_columns
        from cwcli.signals.columns import StreamedChannel

        if fields is not None or isinstance(channel, StreamedChannel) or not is_flat(channel.schema_name):
            return memory_columns(channel, fields)
        known = self._of_channel.get(id(channel))
        if known is None:  # the channel is kept too, so that no other one gets its id
            known = self._of_channel[id(channel)] = channel, memory_columns(channel, None)
        return known[1]
