"""Sources of new messages: columns that are encoded when needed, or messages that are encoded already."""

from __future__ import annotations

from cwcli.logs.encoders.byte_rows import ByteRows
from cwcli.logs.encoders.column_tree import ColumnError
from cwcli.logs.encoders.output_schema import find_output_schema
from cwcli.logs.write.message_merge import MessageFeed
from cwcli.signals.columns import Int64Array, OutputChannel, StreamedChannel, slice_column

N_PROBE_ROWS_OF_STREAM = 2
"""The number of rows of a streamed channel that are encoded to learn the mean size of a message. Chosen by hand: each
row may be an image."""


def feed_from_columns(channel: OutputChannel, channel_id: int, first_sequence: int = 0) -> MessageFeed:
    """Return the messages of a channel given as columns; their publish time is their log time.

    Raises:
        KeyError: The schema is unknown.
        ColumnError: A column has not as many rows as there are log times.
        ValueError: The log times go back.
    """
    if isinstance(channel, StreamedChannel):
        return _feed_from_stream(channel, channel_id, first_sequence)
    n = len(channel)
    for path, column in channel.fields.items():
        if len(column) != n:
            raise ColumnError(f"{channel.topic}: {path} has {len(column)} rows instead of {n}")
    schema = find_output_schema(channel.schema_name)

    def encode(start: int, stop: int) -> ByteRows:
        rows = {path: slice_column(column, start, stop) for path, column in channel.fields.items()}
        return schema.encode(rows, stop - start)

    times = channel.log_time_ns
    return MessageFeed(channel_id, times, times, encode, first_sequence)


def _feed_from_stream(channel: StreamedChannel, channel_id: int, first_sequence: int) -> MessageFeed:
    """Return the messages of a channel whose columns are computed when needed."""
    schema = find_output_schema(channel.schema_name)

    def encode(start: int, stop: int) -> ByteRows:
        return schema.encode(channel.make_rows(start, stop), stop - start)

    times = channel.log_time_ns
    return MessageFeed(channel_id, times, times, encode, first_sequence, probe_rows=N_PROBE_ROWS_OF_STREAM)


def feed_from_encoded_messages(
    channel_id: int,
    messages: ByteRows,
    log_time_ns: Int64Array,
    publish_time_ns: Int64Array,
    first_sequence: int = 0,
) -> MessageFeed:
    """Return messages that are encoded already, with their times (n,) in ns.

    Raises:
        ValueError: The numbers of messages and times differ, or the log times go back.
    """
    if not len(messages) == len(log_time_ns) == len(publish_time_ns):
        raise ValueError(
            f"{len(messages)} messages, {len(log_time_ns)} log times and {len(publish_time_ns)} publish times"
        )
    return MessageFeed(channel_id, log_time_ns, publish_time_ns, messages.slice_rows, first_sequence)
