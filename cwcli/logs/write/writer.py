"""Writes a new MCAP log from columns and messages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

import cwcli
from cwcli.logs.format.records import Channel, Schema
from cwcli.logs.write.byte_rows import ByteRows, join_rows
from cwcli.logs.write.message_merge import MessageFeed, MessageMerge
from cwcli.logs.write.new_messages import feed_from_columns, feed_from_encoded_messages
from cwcli.logs.write.output_schema import find_output_schema
from cwcli.logs.write.record_writer import RecordWriter
from cwcli.output import open_output
from cwcli.signals.columns import Int64Array, OutputChannel

LIBRARY_NAME = f"cwcli {cwcli.__version__}"
"""The library name in the header of new logs."""


class LogWriter:
    """Collects channels and writes them as one log, all messages in log-time order, in compressed and indexed chunks.

    A context manager: the file appears when the block ends without an error. The given arrays are used only then and
    must not change before. The same calls give the same bytes.

        with LogWriter("drive.mcap") as log:
            log.write_columns(channel)

    Args:
        target: File name, or `-` for standard output.
        profile: MCAP profile, e.g. `ros2`.
        library: Name of the program that writes the log.
        force: Overwrite a file that exists.

    Raises:
        OutputError, UsageError: As `cwcli.output.open_output`.
    """

    def __init__(
        self, target: str | Path, *, profile: str = "", library: str = LIBRARY_NAME, force: bool = False
    ) -> None:
        self._profile = profile
        self._library = library
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._feeds: list[MessageFeed] = []
        self._counts: dict[int, int] = {}
        self._attachments: list[tuple[int, int, str, str, bytes]] = []
        self._metadata: list[tuple[str, Mapping[str, str]]] = []
        self._open = ExitStack()
        self._output = self._open.enter_context(open_output(target, force=force))

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
        for schema in self._schemas:
            if (schema.name, schema.encoding, schema.data) == (name, encoding, data):
                return schema.id
        self._schemas.append(Schema(len(self._schemas) + 1, name, encoding, data))
        return len(self._schemas)

    def add_channel(
        self, topic: str, message_encoding: str, schema_id: int = 0, metadata: Mapping[str, str] | None = None
    ) -> int:
        """Add a channel and return its id; schema id 0 means that it has no schema."""
        channel_id = len(self._channels) + 1
        self._channels.append(Channel(channel_id, schema_id, topic, message_encoding, dict(metadata or {})))
        return channel_id

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

    def add_attachment(
        self, name: str, media_type: str, data: bytes, *, log_time_ns: int = 0, create_time_ns: int = 0
    ) -> None:
        """Add an attachment: a file inside the log."""
        self._attachments.append((log_time_ns, create_time_ns, name, media_type, data))

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Add a metadata record: named texts."""
        self._metadata.append((name, values))

    def close(self) -> None:
        """Write everything.

        Raises:
            OutputError: The target can't be written.
        """
        with self._open:
            writer = RecordWriter(self._output)
            writer.write_header(self._profile, self._library)
            for schema in self._schemas:
                writer.write_schema(schema)
            for channel in self._channels:
                writer.write_channel(channel)
            for payload in MessageMerge(self._feeds).iter_chunk_payloads_until(None):
                writer.write_chunk(payload)
            for attachment in self._attachments:
                writer.write_attachment(*attachment)
            for name, values in self._metadata:
                writer.write_metadata(name, values)
            writer.finish()

    def _add_feed(self, feed: MessageFeed) -> None:
        self._counts[feed.channel_id] = self._counts.get(feed.channel_id, 0) + len(feed)
        self._feeds.append(feed)
