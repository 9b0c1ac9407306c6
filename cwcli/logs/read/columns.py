"""Loads topics as columns, in one pass over the chunks that hold them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np

from cwcli.errors import DataError, InputError
from cwcli.logs.codecs.column_buffers import Payloads
from cwcli.logs.codecs.decoder import Decoder
from cwcli.logs.codecs.registry import make_decoder
from cwcli.logs.codecs.ros2msg import SchemaError
from cwcli.logs.format.faults import Faults
from cwcli.logs.read.channels import ChannelInfo
from cwcli.logs.read.message_reader import MessageBatch, MessageReader
from cwcli.signals.columns import Columns

MAX_DECODE_BATCH_BYTES = 4 << 20
"""The size in bytes of the payloads that a decoder gets at once: its buffers for sequences are several times as large.
Chosen by hand."""
MAX_COLUMN_BASE_BYTES = 1 << 28
"""Memory in bytes that the columns of a topic may take, plus `MAX_COLUMN_BYTES_PER_MESSAGE_BYTE` for each byte of its
messages. Chosen by hand."""
MAX_COLUMN_BYTES_PER_MESSAGE_BYTE = 16
"""Bytes of columns allowed per byte of messages: if fields may be absent, a short message can become a long row. Chosen
by hand."""


class _TopicCollector:
    """Collects the messages of one topic."""

    def __init__(self, channels: Sequence[ChannelInfo], decoder: Decoder, name: str) -> None:
        self.channels = channels
        self.decoder = decoder
        self.name = name
        self.batches: list[MessageBatch] = []
        self.n_rows = 0
        self.n_bytes = 0

    def add_batch(self, batch: MessageBatch) -> None:
        """Decode a batch, and store its times and channel ids.

        Raises:
            InputError: The columns would take too much memory.
        """
        for payloads in split_payloads_by_bytes(batch.payloads):
            self.n_rows += len(payloads)
            self.n_bytes += payloads.n_bytes
            needed_bytes = self.n_rows * self.decoder.empty_row_bytes
            if needed_bytes > MAX_COLUMN_BASE_BYTES + MAX_COLUMN_BYTES_PER_MESSAGE_BYTE * self.n_bytes:
                what = f"{self.channels[0].topic}: {self.n_rows} messages of {self.n_bytes} bytes would fill "
                raise InputError(f"{what}{needed_bytes / 1e9:.1f} GB with fields that they leave out", where=self.name)
            self.decoder.decode_batch(payloads)
        empty = np.zeros(0, np.int64)
        nothing = Payloads(np.zeros(0, np.uint8), empty, empty)
        self.batches.append(
            MessageBatch(nothing, batch.channel_id, batch.sequence, batch.log_time_ns, batch.publish_time_ns)
        )

    def miscounted_channel_ids(self) -> set[int]:
        """Return the ids of channels with another number of messages than the file says."""
        ids = np.concatenate([np.zeros(0, np.uint16), *(each.channel_id for each in self.batches)])
        found = np.bincount(ids, minlength=1)
        return {
            each.id
            for each in self.channels
            if each.message_count is not None and each.message_count != (found[each.id] if each.id < len(found) else 0)
        }

    def build_columns(self, faults: Faults) -> Columns:
        """Return the columns in log-time order, in file order where times are equal."""
        log_time_ns = np.concatenate([np.zeros(0, np.int64), *(each.log_time_ns for each in self.batches)])
        publish_time_ns = np.concatenate([np.zeros(0, np.int64), *(each.publish_time_ns for each in self.batches)])
        sequence = np.concatenate([np.zeros(0, np.uint32), *(each.sequence for each in self.batches)])
        outcome = self.decoder.outcome()
        order = np.argsort(log_time_ns, kind="stable")
        rows = order[outcome.is_ok[order]]
        channel = self.channels[0]
        if outcome.reasons:
            faults.undecodable[channel.topic] = dict(outcome.reasons)
        return Columns(
            topic=channel.topic,
            schema_name=channel.schema_name,
            message_encoding=channel.message_encoding,
            log_time_ns=log_time_ns[rows],
            publish_time_ns=publish_time_ns[rows],
            sequence=sequence[rows],
            fields=self.decoder.build_columns(rows),
            n_undecodable=len(log_time_ns) - len(rows),
        )


def load_columns(
    reader: MessageReader,
    channels: Mapping[str, Sequence[ChannelInfo]],
    fields_by_topic: Mapping[str, Collection[str] | None],
    faults: Faults,
    name: str,
    logged: tuple[int, int] | None = None,
) -> dict[str, Columns]:
    """Read topics as columns.

    Args:
        channels: Topic -> its channels, at least one each.
        fields_by_topic: Topic -> leaf fields, or None for all.
        name: The file's name, for messages.
        logged: Read only chunks with messages logged in [start, end) ns; undecodable messages in them are not counted.

    Raises:
        InputError: An encoding or a schema is unknown or unusable, or the file is damaged and `recover` is off.
        DataError: A topic has several schemas.
    """
    if logged is not None:
        reader.distrust_indexes_if_miscounted([each.id for own in channels.values() for each in own])
    loaded, miscounted = _load_columns_and_miscounts(reader, channels, fields_by_topic, faults, name, logged)
    was_damaged = faults.chunks_lost or faults.bytes_lost or faults.truncated
    if miscounted and not was_damaged and reader.distrust_indexes_if_not_yet():  # an index may leave a channel out
        loaded, miscounted = _load_columns_and_miscounts(reader, channels, fields_by_topic, faults, name, logged)
    if not was_damaged:
        faults.miscounted_channel_ids |= miscounted
    return loaded


def _load_columns_and_miscounts(
    reader: MessageReader,
    channels: Mapping[str, Sequence[ChannelInfo]],
    fields_by_topic: Mapping[str, Collection[str] | None],
    faults: Faults,
    name: str,
    logged: tuple[int, int] | None,
) -> tuple[dict[str, Columns], set[int]]:
    """Load columns once; return them and the ids of channels with another number of messages than the file says."""
    topics: list[_TopicCollector] = []
    topic_of = np.zeros(1 << 16, np.int64)
    for topic_name, fields in fields_by_topic.items():
        own = channels[topic_name]
        check_single_schema(own, name)
        n_expected = sum(channel.message_count or 0 for channel in own) if logged is None else 0
        decoder = make_channel_decoder(
            own[0],
            fields,
            name,
            n_expected=min(n_expected, reader.max_message_count_by_file_size(), MAX_PREALLOCATED_ROWS),
        )
        topic_of[[channel.id for channel in own]] = len(topics)
        topics.append(_TopicCollector(own, decoder, name))
    for batch in reader.iter_batches([channel.id for topic in topics for channel in topic.channels], *(logged or ())):
        index = topic_of[batch.channel_id]
        for k, topic in enumerate(topics):
            rows = np.flatnonzero(index == k)
            if len(rows):
                topic.add_batch(batch if len(rows) == len(batch) else batch.select_messages(rows))
    counted = faults if logged is None else Faults()
    loaded = {topic.channels[0].topic: topic.build_columns(counted) for topic in topics}
    was_damaged = faults.chunks_lost or faults.bytes_lost or faults.truncated
    if logged is None and topics and was_damaged and not any(len(topic.batches) for topic in topics):
        raise InputError(f"nothing of {', '.join(loaded)} can be read", where=name, found=format_faults(faults))
    return loaded, set().union(*(topic.miscounted_channel_ids() for topic in topics)) if logged is None else set()


def return_freed_memory_to_system(loaded: Mapping[str, Columns]) -> None:
    """Return memory that the decoders have freed to the system, if the C library can (glibc).

    Its allocator keeps freed large blocks: 150 MB after a ten-minute JSON log. For a short log it is not worth the
    time.
    """
    if sum(map(len, loaded.values())) < MIN_ROWS_TO_RETURN_FREED_MEMORY:
        return
    import ctypes

    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def format_faults(faults: Faults) -> tuple[str, ...]:
    """Format the faults of a file for an error message."""
    return tuple(f"{reason}: {count}" for reason, count in faults.counts_by_reason().items())


MIN_ROWS_TO_RETURN_FREED_MEMORY = 20_000
"""The number of decoded rows from which freed memory is returned to the system. Chosen by hand."""
MAX_PREALLOCATED_ROWS = 1 << 22
"""The greatest number of rows for which memory is allocated before they are read, whatever the file says. Chosen by
hand."""


def make_channel_decoder(
    channel: ChannelInfo,
    fields: Collection[str] | None,
    name: str,
    *,
    blobs: Collection[str] = (),
    n_expected: int = 0,
) -> Decoder:
    """Return a decoder for a channel.

    Raises:
        InputError: Its encoding or its schema is unknown or unusable.
    """
    try:
        return make_decoder(channel, fields, blobs=blobs, n_expected=n_expected)
    except SchemaError as error:
        what = f"the channel {channel.topic} ({channel.schema_name or 'no schema'}) can't be read: {error}"
        raise InputError(what, where=name) from error


def check_single_schema(channels: Sequence[ChannelInfo], name: str) -> None:
    """Check that the channels of one topic have the same schema.

    Raises:
        DataError: They have different schemas.
    """
    first = channels[0]
    for other in channels[1:]:
        if _schema_identity(other) != _schema_identity(first):
            one, two = (
                f"{each.schema_name or 'no schema'} ({each.message_encoding}, channel {each.id})"
                for each in (first, other)
            )
            raise DataError(f"the topic {first.topic} has two schemas: {one} and {two}", where=name)


def split_payloads_by_bytes(payloads: Payloads) -> Iterator[Payloads]:
    """Yield pieces of about `MAX_DECODE_BATCH_BYTES`, at least one message each."""
    sizes = payloads.ends - payloads.starts
    total = np.cumsum(sizes)
    if not len(total) or total[-1] <= MAX_DECODE_BATCH_BYTES:
        yield payloads
        return
    start = 0
    while start < len(total):
        before = int(total[start - 1]) if start else 0
        stop = max(int(np.searchsorted(total, before + MAX_DECODE_BATCH_BYTES, side="right")), start + 1)
        yield payloads.slice_messages(start, stop)
        start = stop


def _schema_identity(channel: ChannelInfo) -> tuple[str, str, str, bytes]:
    """Return encodings, name and data of a channel's schema, for comparison."""
    return channel.message_encoding, channel.schema_encoding, channel.schema_name, channel.schema_data
