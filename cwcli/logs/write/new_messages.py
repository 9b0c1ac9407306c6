"""Where new messages come from: columns that are encoded on the way, or messages that are there already."""

from __future__ import annotations

from cwcli.logs.write.byte_rows import ByteRows
from cwcli.logs.write.column_tree import ColumnError
from cwcli.logs.write.message_merge import Feed
from cwcli.logs.write.written_schema import written_schema
from cwcli.signals.columns import Int64Array, OutputChannel, StreamedChannel, column_rows

PROBED_STREAM_ROWS = 2


def column_feed(channel: OutputChannel, channel_id: int, first_sequence: int = 0) -> Feed:
    """The messages of a channel that is given as columns; their publish time is their log time.

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
    """The messages of a channel whose columns are made on the way."""
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
    """Messages that are encoded already.

    Raises:
        ValueError: The numbers of messages and times differ, or the log times go back.
    """
    if not len(messages) == len(log_time_ns) == len(publish_time_ns):
        raise ValueError(
            f"{len(messages)} messages, {len(log_time_ns)} log times and {len(publish_time_ns)} publish times"
        )
    return Feed(channel_id, log_time_ns, publish_time_ns, messages.rows, first_sequence)
