"""Merges new messages of several channels in log-time order into the contents of MCAP chunks.

Format: https://mcap.dev/spec
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import field

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.logs.encoders.byte_rows import ByteArray, ByteRows, copy_rows, offsets_from_sizes, sliding_byte_windows
from cwcli.logs.encoders.column_tree import ColumnError
from cwcli.logs.encoders.output_schema import find_output_schema
from cwcli.logs.format.records import RECORD_PREFIX, Opcode
from cwcli.signals.columns import Int64Array, OutputChannel, StreamedChannel, slice_column

MESSAGE_RECORD_DTYPE = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel_id", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
"""The bytes of a message record before its payload (MCAP specification)."""
INDEX_ENTRY_DTYPE = np.dtype([("log_time", "<u8"), ("offset", "<u8")])
"""An entry of a message index: log time in ns, and offset in the chunk (MCAP specification)."""

BYTES_OF_FULL_NEW_CHUNK = 1 << 20
"""The size in bytes at which a new chunk is full, in copies the expected one. Chosen by hand."""
ENCODE_BLOCK_BYTES = 4 << 20
"""Bytes of messages that are encoded at a time. Chosen by hand."""
N_ROWS_TO_MEASURE_MESSAGE_SIZE = 64
"""The number of rows that are encoded to learn the mean size of a message. Chosen by hand."""
N_STREAMED_ROWS_TO_MEASURE_MESSAGE_SIZE = 2
"""The number of rows of a streamed channel that are encoded to learn the mean size of a message. Chosen by hand: each
row may be an image."""
MAX_ROWS_ENCODED_AT_ONCE = 512
"""The number of rows up to which a channel is encoded as a whole at once. Chosen by hand."""
MIN_BYTES_OF_SHARED_CHUNK, MIN_BYTES_OF_OWN_CHUNK = 1 << 16, 1 << 18
"""The bytes of new messages that are worth a chunk for several channels, and for one; fewer wait for the source's next
chunk, because tiny chunks are slow to read. Chosen by hand."""
MIN_NEW_BYTES_SHARE_OF_CHANNEL_WITH_OWN_CHUNKS = 1 / 16
"""The share of the bytes of all new messages from which a channel that fills a chunk has chunks of its own. Chosen by
hand: its chunks then span no more time than 4 MB of all new messages."""
MAX_MESSAGES_OF_NEW_CHUNK = 1 << 16
"""The greatest number of messages in a new chunk. Chosen by hand."""


@dataclass
class MessageFeed:
    """The messages of one channel, encoded when they are needed.

    Attributes:
        channel_id: Id in the file that is written.
        log_time_ns, publish_time_ns: Shape (n,), int64; log times non-decreasing.
        encode: Rows `start` to `stop` of the channel as messages.
        first_sequence: Sequence number of row 0.
        probe_rows: Rows that are encoded to learn how long a message is.

    Raises:
        ValueError: The log times go back, or are negative.
    """

    channel_id: int
    log_time_ns: Int64Array
    publish_time_ns: Int64Array
    encode: Callable[[int, int], ByteRows]
    first_sequence: int = 0
    probe_rows: int = N_ROWS_TO_MEASURE_MESSAGE_SIZE
    _next: int = 0
    _block_start: int = 0
    _block: ByteRows | None = field(default=None, repr=False)
    _mean_size: float = 0.0

    def __post_init__(self) -> None:
        if len(self) and (self.log_time_ns[0] < 0 or (np.diff(self.log_time_ns) < 0).any()):
            raise ValueError(f"log times of channel {self.channel_id} are negative or go back")

    def __len__(self) -> int:
        return len(self.log_time_ns)

    def mean_message_bytes(self) -> float:
        """Return the mean size in bytes of a message with its header, from the first messages."""
        if not self._mean_size and len(self):
            is_short = self.probe_rows == N_ROWS_TO_MEASURE_MESSAGE_SIZE and len(self) <= MAX_ROWS_ENCODED_AT_ONCE
            probe = self.encode(0, len(self) if is_short else min(self.probe_rows, len(self)))
            if is_short:
                self._block = probe
            self._mean_size = float(probe.sizes[: self.probe_rows].mean()) + MESSAGE_RECORD_DTYPE.itemsize
        return self._mean_size

    def take_rows_and_bytes_of_next_messages(self, n: int) -> tuple[slice, ByteRows]:
        """Take the next n messages; return their rows and bytes."""
        start, stop = self._next, self._next + n
        self._next = stop
        if self._block is None or stop > self._block_start + len(self._block):
            ahead = max(int(ENCODE_BLOCK_BYTES / max(self.mean_message_bytes(), 1.0)), n)
            self._block_start, self._block = start, self.encode(start, min(start + ahead, len(self)))
        return slice(start, stop), self._block.slice_rows(start - self._block_start, stop - self._block_start)

    def iter_mergeable_messages(self, position: int) -> Iterator[tuple[int, int, int, int, bytes]]:
        """Yield log time in ns, the given number, publish time in ns, sequence number and bytes of each message.

        Args:
            position: Orders messages of equal log time in a merge of several feeds.
        """
        n_ahead = max(int(ENCODE_BLOCK_BYTES / max(self.mean_message_bytes(), 1.0)), 1)
        for start in range(0, len(self), n_ahead):
            rows = slice(start, min(start + n_ahead, len(self)))
            block = self.encode(rows.start, rows.stop)
            data, offsets = block.data.data, block.offsets.tolist()
            times = zip(self.log_time_ns[rows].tolist(), self.publish_time_ns[rows].tolist(), strict=True)
            for k, (log_time_ns, publish_time_ns) in enumerate(times):
                message = bytes(data[offsets[k] : offsets[k + 1]])
                yield log_time_ns, position, publish_time_ns, self.first_sequence + start + k, message


def feed_from_columns(channel: OutputChannel, channel_id: int) -> MessageFeed:
    """Return the messages of a channel given as columns; their publish time is their log time.

    Raises:
        KeyError: The schema is unknown.
        ColumnError: A column has not as many rows as there are log times.
        ValueError: The log times go back.
    """
    n, times = len(channel), channel.log_time_ns
    schema = find_output_schema(channel.schema_name)
    if isinstance(channel, StreamedChannel):
        make_rows = channel.make_rows
        return MessageFeed(
            channel_id,
            times,
            times,
            lambda start, stop: schema.encode(make_rows(start, stop), stop - start),
            probe_rows=N_STREAMED_ROWS_TO_MEASURE_MESSAGE_SIZE,
        )
    for path, column in channel.fields.items():
        if len(column) != n:
            raise ColumnError(f"{channel.topic}: {path} has {len(column)} rows instead of {n}")

    def encode_rows(start: int, stop: int) -> ByteRows:
        rows = {path: slice_column(column, start, stop) for path, column in channel.fields.items()}
        return schema.encode(rows, stop - start)

    return MessageFeed(channel_id, times, times, encode_rows)


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


@dataclass(frozen=True)
class ChunkPayload:
    """The content of a chunk, uncompressed.

    Attributes:
        data: Message records grouped by channel, each channel's in log-time order.
        start_ns, end_ns: First and last log time.
        entries: Channel id -> (log time, offset in `data`) of its messages, dtype `INDEX_ENTRY_DTYPE`.
    """

    data: ByteArray
    start_ns: int
    end_ns: int
    entries: dict[int, npt.NDArray[np.void]]


class MessageMerge:
    """The messages of all feeds in chunks that follow each other in log-time order.

    Inside a chunk the messages are grouped by channel, each channel's in log-time order: similar messages are then
    neighbours, which saves a twentieth of the compressed size. Message indexes give the time order.

    Args:
        min_waiting_bytes: Bytes of new messages that are worth a chunk; fewer wait.

    Attributes:
        log_time_ns: Shape (n,), non-decreasing.
    """

    def __init__(self, feeds: Sequence[MessageFeed], min_waiting_bytes: int) -> None:
        self._min_waiting_bytes = min_waiting_bytes
        self._feeds = [feed for feed in feeds if len(feed)]
        times = [feed.log_time_ns for feed in self._feeds]
        all_times = np.concatenate([np.zeros(0, np.int64), *times])
        order = np.argsort(all_times, kind="stable")
        self.log_time_ns: Int64Array = all_times[order]
        self._feed_of = np.repeat(np.arange(len(times), dtype=np.int32), [len(each) for each in times])[order]
        self._position = 0

    def __len__(self) -> int:
        return len(self.log_time_ns)

    def iter_chunk_payloads_until(self, time_ns: int | None, *, is_last: bool = False) -> Iterator[ChunkPayload]:
        """Yield chunk contents of the remaining messages up to a log time.

        Args:
            time_ns: Last log time; None for all messages.
            is_last: Leave none for the next call, however few they are.
        """
        min_waiting_bytes = 0 if is_last else self._min_waiting_bytes
        stop = len(self.log_time_ns)
        if time_ns is not None:
            stop = int(np.searchsorted(self.log_time_ns, time_ns, side="right"))
        mean_sizes = np.array([feed.mean_message_bytes() for feed in self._feeds])
        while self._position < stop:
            ahead = self._feed_of[self._position : min(stop, self._position + MAX_MESSAGES_OF_NEW_CHUNK)]
            expected_bytes = np.cumsum(mean_sizes[ahead])
            if expected_bytes[-1] < min_waiting_bytes:
                return
            n = max(int(np.searchsorted(expected_bytes, BYTES_OF_FULL_NEW_CHUNK, side="right")), 1)
            yield self._build_next_payload(ahead[:n])
            min_waiting_bytes = 0

    def _build_next_payload(self, feed_of: npt.NDArray[np.int32]) -> ChunkPayload:
        """Build the content of a chunk from the next messages; `feed_of` is the feed number of each."""
        n = len(feed_of)
        log_time_ns = self.log_time_ns[self._position : self._position + n]
        start_ns, end_ns = int(log_time_ns[0]), int(log_time_ns[-1])
        self._position += n
        order = np.argsort(feed_of, kind="stable")
        feed_of, log_time_ns = feed_of[order], log_time_ns[order]
        header = np.zeros(n, MESSAGE_RECORD_DTYPE)
        header["opcode"] = Opcode.MESSAGE
        header["log_time"] = log_time_ns
        rows_and_bytes: list[tuple[npt.NDArray[np.intp], ByteRows]] = []
        for k in np.flatnonzero(np.bincount(feed_of)).tolist():
            feed = self._feeds[k]
            at = np.flatnonzero(feed_of == k)
            rows, messages = feed.take_rows_and_bytes_of_next_messages(len(at))
            header["channel_id"][at] = feed.channel_id
            header["sequence"][at] = feed.first_sequence + np.arange(rows.start, rows.stop)
            header["publish_time"][at] = feed.publish_time_ns[rows]
            header["length"][at] = messages.sizes + (MESSAGE_RECORD_DTYPE.itemsize - RECORD_PREFIX.size)
            rows_and_bytes.append((at, messages))
        offsets = offsets_from_sizes(header["length"].astype(np.int64) + RECORD_PREFIX.size)
        data = np.empty(int(offsets[-1]), np.uint8)
        sliding_byte_windows(data, MESSAGE_RECORD_DTYPE.itemsize)[offsets[:-1]] = header.view(
            np.dtype((np.void, MESSAGE_RECORD_DTYPE.itemsize))
        )
        for at, messages in rows_and_bytes:
            starts = offsets[at] + MESSAGE_RECORD_DTYPE.itemsize
            copy_rows(data, starts, messages.data, messages.offsets[:-1], messages.sizes)
        return ChunkPayload(data, start_ns, end_ns, _index_entries_by_channel(header, offsets))


def merges_of_large_and_small_feeds(feeds: Sequence[MessageFeed]) -> list[MessageMerge]:
    """Return a merge for each channel that alone is much of all messages, and one for the others together.

    Who reads the states then decompresses no predicted paths.
    """
    sizes = [len(feed) * feed.mean_message_bytes() for feed in feeds]
    limit = max(sum(sizes) * MIN_NEW_BYTES_SHARE_OF_CHANNEL_WITH_OWN_CHUNKS, BYTES_OF_FULL_NEW_CHUNK)
    small = [feed for feed, size in zip(feeds, sizes, strict=True) if size < limit]
    large = [feed for feed, size in zip(feeds, sizes, strict=True) if size >= limit]
    merges = [MessageMerge([feed], MIN_BYTES_OF_OWN_CHUNK) for feed in large]
    return [MessageMerge(small, MIN_BYTES_OF_SHARED_CHUNK), *merges]


def _index_entries_by_channel(header: npt.NDArray[np.void], offsets: Int64Array) -> dict[int, npt.NDArray[np.void]]:
    """Return channel id -> index entries, dtype `INDEX_ENTRY_DTYPE`."""
    entries = np.empty(len(header), INDEX_ENTRY_DTYPE)
    entries["log_time"] = header["log_time"]
    entries["offset"] = offsets[:-1]
    channel_ids = header["channel_id"]
    return {
        channel_id: entries[channel_ids == channel_id]
        for channel_id in np.flatnonzero(np.bincount(channel_ids)).tolist()
    }
