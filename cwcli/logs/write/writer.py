"""Writes a new MCAP log from columns and messages, with the official library."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from heapq import merge
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import IO, Self, cast

import numpy as np
from mcap.writer import Writer

from cwcli.logs.encoders.byte_rows import ByteRows, join_rows
from cwcli.logs.encoders.output_schema import find_output_schema
from cwcli.logs.write.message_merge import (
    BYTES_OF_FULL_NEW_CHUNK,
    MessageFeed,
    feed_from_columns,
    feed_from_encoded_messages,
)
from cwcli.output import open_output
from cwcli.output_stream import OutputStream
from cwcli.signals.columns import Int64Array, OutputChannel
from cwcli.text import escape_surrogates
from cwcli.version import __version__
from cwcli.work_share import report_work

LIBRARY_NAME = f"cwcli {__version__}"
"""The library name in the header of new logs."""
MESSAGES_PER_PROGRESS_REPORT = 1 << 14
"""Number of messages that are written between two reports of progress. Chosen by hand: a tenth of a second."""


class LogWriter:
    """Collects channels and writes them as one log, all messages in log-time order, in compressed and indexed chunks.

    A context manager: the file appears when the block ends without an error. The given arrays are used only then and
    must not change before. The same calls give the same bytes.

        with LogWriter("drive.mcap") as log:
            log.write_columns(channel)

    Args:
        target: File name, `-` for standard output, or an open output, which stays open.
        profile: MCAP profile, e.g. `ros2`.

    Raises:
        OutputError, UsageError: As `cwcli.output.open_output`.
    """

    def __init__(self, target: str | Path | OutputStream, *, profile: str = "", force: bool = False) -> None:
        self._schema_ids: dict[tuple[str, str, bytes], int] = {}
        self._feeds: list[MessageFeed] = []
        self._counts: dict[int, int] = {}
        self._open = ExitStack()
        self._is_closed = False
        if isinstance(target, OutputStream):
            output = target
        else:
            output = self._open.enter_context(open_output(target, force=force))
        self._writer = Writer(cast("IO[bytes]", output), chunk_size=BYTES_OF_FULL_NEW_CHUNK)
        self._writer.start(escape_surrogates(profile), LIBRARY_NAME)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is not None:
            self._open.__exit__(kind, error, traceback)
        else:
            self.close()

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Add a schema and return its id; an equal schema is used again."""
        key = name, encoding, data
        if key not in self._schema_ids:
            self._schema_ids[key] = self._writer.register_schema(name, encoding, data)
        return self._schema_ids[key]

    def add_channel(
        self, topic: str, message_encoding: str, schema_id: int = 0, metadata: Mapping[str, str] | None = None
    ) -> int:
        """Add a channel and return its id; schema id 0 means that it has no schema."""
        return self._writer.register_channel(
            escape_surrogates(topic), message_encoding, schema_id, _encodable_texts(metadata or {})
        )

    def write_columns(self, channel: OutputChannel) -> int:
        """Add a channel with all its messages and return its id.

        Raises:
            KeyError: Its schema is unknown.
            ValueError: A column does not fit the schema, or the log times go back.
        """
        schema = find_output_schema(channel.schema_name)
        schema_id = self.add_schema(schema.name, schema.encoding, schema.data)
        channel_id = self.add_channel(channel.topic, schema.message_encoding, schema_id)
        self._add_feed(feed_from_columns(channel, channel_id))
        return channel_id

    def write_messages(
        self,
        channel_id: int,
        log_time_ns: Int64Array,
        messages: Sequence[bytes] | ByteRows,
        *,
        publish_time_ns: Int64Array | None = None,
    ) -> None:
        """Add messages that are encoded already.

        Args:
            channel_id: From `add_channel`.
            log_time_ns: Shape (n,), int64, non-decreasing.
            messages: n encoded messages.
            publish_time_ns: Shape (n,), int64; the log times when not given.

        Raises:
            ValueError: The lengths differ, or the log times go back.
        """
        rows = messages if isinstance(messages, ByteRows) else join_rows(list(messages))
        log_time_ns = np.asarray(log_time_ns, np.int64)
        publish_time_ns = log_time_ns if publish_time_ns is None else np.asarray(publish_time_ns, np.int64)
        self._add_feed(
            feed_from_encoded_messages(channel_id, rows, log_time_ns, publish_time_ns, self._counts.get(channel_id, 0))
        )

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Add a metadata record: named texts."""
        self._writer.add_metadata(escape_surrogates(name), _encodable_texts(values))

    def close(self) -> None:
        """Write the messages and the summary; a second call does nothing.

        Raises:
            OutputError: The target can't be written.
        """
        if self._is_closed:
            return
        self._is_closed = True
        with self._open:
            feeds = [feed.iter_mergeable_messages(position) for position, feed in enumerate(self._feeds)]
            merged, n_all, n_written = merge(*feeds), sum(self._counts.values()), 0
            while n_written < n_all:
                before = n_written
                for log_time_ns, position, publish_time_ns, sequence, data in islice(
                    merged, MESSAGES_PER_PROGRESS_REPORT
                ):
                    channel_id = self._feeds[position].channel_id
                    self._writer.add_message(channel_id, log_time_ns, data, publish_time_ns, sequence)
                    n_written += 1
                if n_written == before:
                    break
                report_work("messages", n_written, n_all)
            self._writer.finish()  # type: ignore[no-untyped-call]

    def _add_feed(self, feed: MessageFeed) -> None:
        self._counts[feed.channel_id] = self._counts.get(feed.channel_id, 0) + len(feed)
        self._feeds.append(feed)


def _encodable_texts(values: Mapping[str, str]) -> dict[str, str]:
    """Return texts by name, each one such that UTF-8 can encode it."""
    return {escape_surrogates(name): escape_surrogates(text) for name, text in values.items()}
