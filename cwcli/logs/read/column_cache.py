"""A cache of loaded columns, which the next stage or the metrics may ask for again."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cwcli.signals.columns import Columns, OutputChannel

MAX_CACHED_ROWS = 20_000
"""The greatest number of cached rows of a file, all topics together. Topics beyond it are decoded again by each stage,
so that a long log does not stay in memory. Chosen by hand."""


class ColumnCache:
    """The loaded columns of a log's topics; callers must not change them."""

    def __init__(self) -> None:
        self._of_file: dict[tuple[str, frozenset[str]], Columns] = {}
        self._n_rows = 0
        self._of_channel: dict[int, tuple[OutputChannel, Columns]] = {}

    def find_file_columns(self, topic: str, fields: Collection[str] | None) -> Columns | None:
        """Return a cached topic of the file with exactly these fields, else None.

        Other fields may decode another set of messages, if messages are cut off.
        """
        return None if fields is None else self._of_file.get((topic, frozenset(fields)))

    def store_file_columns(self, columns: Columns, fields: Collection[str] | None) -> None:
        """Store a topic of the file, unless it is large or was loaded with all fields (it may hold images)."""
        if fields is not None and self._n_rows + len(columns) <= MAX_CACHED_ROWS:
            self._n_rows += len(columns)
            self._of_file[columns.topic, frozenset(fields)] = columns

    def columns_of_channel(self, channel: OutputChannel, fields: Collection[str] | None) -> Columns:
        """Return the columns of a channel in memory; those of a flat type are cached, because they cost no memory."""
        from cwcli.logs.read.added_channels import columns_of_added_channel, is_flat_message_type
        from cwcli.signals.columns import StreamedChannel

        if fields is not None or isinstance(channel, StreamedChannel) or not is_flat_message_type(channel.schema_name):
            return columns_of_added_channel(channel, fields)
        known = self._of_channel.get(id(channel))
        if known is None:  # the channel is stored too, so that no other object gets its id
            known = self._of_channel[id(channel)] = channel, columns_of_added_channel(channel, None)
        return known[1]
