"""Sources of new messages: columns that are encoded when needed, or messages that are encoded already."""

from __future__ import annotations

from cwcli.logs.write.byte_rows import ByteRows
from cwcli.logs.write.column_tree import ColumnError
from cwcli.logs.write.message_merge import Feed
from cwcli.logs.write.written_schema import written_schema
from cwcli.signals.columns import Int64Array, OutputChannel, StreamedChannel, column_rows

PROBED_STREAM_ROWS = 2
"""The number of rows of a streamed channel that are encoded to learn the mean size of a message. Chosen by hand: each
row may be an image."""


def column_feed(channel: OutputChannel, channel_id: int, first_sequence: int = 0) -> Feed:
    """Return the messages of a channel given as columns; their publish time is their log time.

    Raises:
        KeyError: The schema is unknown.
        ColumnError: A column has not as many rows as there are log times.
        ValueError: The log times go back.
    """
    if isinstance(channel, StreamedChannel):
        return _streamed_feed(channel, channel_id, first_sequence)
    n = len(channel)
    for path, column in channel.fields.items():
        if len(column) != n:
            raise ColumnError(f"{channel.topic}: {path} has {len(column)} rows instead of {n}")
    schema = written_schema(channel.schema_name)

    def encode(start: int, stop: int) -> ByteRows:
        rows = {path: column_rows(column, start, stop) for path, column in channel.fields.items()}
        return schema.encode(rows, stop - start)

    times = channel.log_time_ns
    return Feed(channel_id, times, times, encode, first_sequence)


def _streamed_feed(channel: StreamedChannel, channel_id: int, first_sequence: int) -> Feed:
    """Return the messages of a channel whose columns are computed when needed."""
    schema = written_schema(channel.schema_name)

    def encode(start: int, stop: int) -> ByteRows:
        return schema.encode(channel.rows(start, stop), stop - start)

    times = channel.log_time_ns
    return Feed(channel_id, times, times, encode, first_sequence, probe_rows=PROBED_STREAM_ROWS)


def row_feed(
    channel_id: int,
    messages: ByteRows,
    log_time_ns: Int64Array,
    publish_time_ns: Int64Array,
    first_sequence: int = 0,
) -> Feed:
    """Return messages that are encoded already, with their times (n,) in ns.

    Raises:
        ValueError: The numbers of messages and times differ, or the log times go back.
    """
    if not len(messages) == len(log_time_ns) == len(publish_time_ns):
        raise ValueError(
            f"{len(messages)} messages, {len(log_time_ns)} log times and {len(publish_time_ns)} publish times"
        )
    return Feed(channel_id, log_time_ns, publish_time_ns, messages.rows, first_sequence)
