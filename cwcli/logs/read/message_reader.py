"""Reads messages of some channels as arrays of their places and times, chunk by chunk."""

from __future__ import annotations

import struct
from collections import Counter, deque
from collections.abc import Collection, Iterator, Mapping, Sequence
from heapq import merge
from operator import itemgetter

import numpy as np
import numpy.typing as npt

from cwcli.errors import InputError
from cwcli.input import InputFile
from cwcli.kernels.message_scan import DAMAGED, FULL, Messages, scan_messages
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.codecs.column_buffers import ByteArray, Payloads
from cwcli.logs.format.chunks import (
    ChunkError,
    check_message_count_against_file_size,
    check_unchunked_message_count,
    decompress_chunk,
    decompress_cut_chunk_up_to_error,
)
from cwcli.logs.format.faults import RECOVER_HINT, Faults
from cwcli.logs.format.index import LogIndex, UnchunkedRange
from cwcli.logs.format.records import (
    MESSAGE_HEADER_BYTES,
    RECORD_PREFIX,
    ByteRange,
    ChunkIndex,
    Opcode,
    RecordError,
    channel_id_and_range_of_message_index_entries,
    crc32_of_range,
    read_opcode_and_content_range,
)
from cwcli.signals.columns import Int64Array
from cwcli.work_share import report_work

MIN_MESSAGE_BYTES = RECORD_PREFIX.size + MESSAGE_HEADER_BYTES
"""Size in bytes of a message record without payload (MCAP specification)."""
MAX_BATCH_MESSAGES = 1 << 16
"""The greatest number of messages in a batch. Chosen by hand."""
N_DECOMPRESSION_THREADS = 2
"""The number of threads that decompress chunks ahead. Chosen by hand."""
MAX_DECOMPRESSING_BYTES = 64 << 20
"""Total size in bytes of the chunks that are decompressed at the same time. Chosen by hand."""
UNCHUNKED_READ_BYTES = 1 << 20
"""Bytes outside chunks that are read at a time; a longer record is read alone. Chosen by hand."""
MAX_KEPT_CHUNK_BYTES = 256_000_000
"""Memory in bytes that chunks which stay unpacked may take, with the largest one that does not. Chosen by hand: as much
as one chunk may take."""
MIN_BYTES_FOR_THREADS = 4 << 20
"""Total size in bytes of chunks from which threads pay. Chosen by hand."""


@dataclass(frozen=True)
class MessageBatch:
    """Messages of the wanted channels in one chunk, in file order.

    Attributes:
        payloads: Places of the encoded messages.
        channel_id, sequence, log_time_ns, publish_time_ns: Shape (n,).
    """

    payloads: Payloads
    channel_id: npt.NDArray[np.uint16]
    sequence: npt.NDArray[np.uint32]
    log_time_ns: Int64Array
    publish_time_ns: Int64Array

    def __len__(self) -> int:
        return len(self.channel_id)

    def select_messages(self, rows: npt.NDArray[np.intp]) -> MessageBatch:
        payloads = self.payloads.select_messages(rows)
        return MessageBatch(
            payloads, self.channel_id[rows], self.sequence[rows], self.log_time_ns[rows], self.publish_time_ns[rows]
        )

    def iter_log_times_and_payloads(self) -> Iterator[tuple[int, memoryview]]:
        """Yield log time in ns and bytes of each message."""
        data = self.payloads.data.data
        places = zip(self.payloads.starts.tolist(), self.payloads.ends.tolist(), strict=True)
        for log_time_ns, (start, end) in zip(self.log_time_ns.tolist(), places, strict=True):
            yield log_time_ns, data[start:end]


class MessageReader:
    """Reads a file's messages.

    Args:
        recover: Leave damaged parts out and count them.

    Attributes:
        trusts_indexes: Chunks whose index does not list a channel are not opened for it.
    """

    def __init__(self, file: InputFile, index: LogIndex, faults: Faults, *, recover: bool) -> None:
        self._file = file
        self._index = index
        self._chunks = index.items_of_type(ChunkIndex)
        self._spans = index.items_of_type(UnchunkedRange)
        self._faults = faults
        self._recover = recover
        self._counted: set[int] = set()
        self._lost: set[int] = set()
        self._unpacked: dict[int, memoryview] = {}
        self._n_bytes_to_keep_unpacked = 0
        self._verified: set[int] = set()
        self.trusts_indexes = index.has_message_counts
        self._checked: set[int] = set()
        self._listed_counts = index.statistics.channel_counts if index.statistics else {}
        self._n_found_in: Counter[int] = Counter()
        self._n_found = 0
        self._wanted_last: tuple[frozenset[int], ByteArray] = frozenset(), channel_mask(())

    def iter_batches(
        self, channel_ids: Collection[int], start_ns: int = 0, end_ns: int = 1 << 64
    ) -> Iterator[MessageBatch]:
        """Yield the messages of some channels in file order, without chunks that lie outside [start_ns, end_ns).

        Raises:
            InputError: A chunk that may hold them is damaged, and `recover` is off.
        """
        chunks = [
            each
            for each in self.chunks_with_channels(channel_ids)
            if each.end_ns >= start_ns and each.start_ns < end_ns
        ]
        loose = deque(self._spans)
        for n_read, (chunk, payload) in enumerate(self.iter_chunk_payloads(chunks)):
            report_work("chunks", n_read, len(chunks))
            while loose and loose[0][0] < chunk.chunk_start:
                yield from self.iter_unchunked_batches(channel_ids, [loose.popleft()])
            if payload is not None:
                yield from self.iter_chunk_batches(chunk, payload, channel_ids)
        yield from self.iter_unchunked_batches(channel_ids, loose)

    def keep_chunks_unpacked(self) -> None:
        """Keep the chunks that are read from now on unpacked, up to `MAX_KEPT_CHUNK_BYTES`."""
        sizes = [each.uncompressed_size for each in self._chunks]
        largest_not_kept = max(sizes) if sum(sizes) > MAX_KEPT_CHUNK_BYTES else 0
        self._n_bytes_to_keep_unpacked = MAX_KEPT_CHUNK_BYTES - largest_not_kept

    def drop_unpacked_chunks(self) -> None:
        """Free the chunks that were kept, and keep no more."""
        self._n_bytes_to_keep_unpacked = 0
        self._unpacked.clear()

    def distrust_indexes_if_not_yet(self) -> bool:
        """Open every chunk from now on, whatever its index lists; return whether that is new."""
        was_trusted, self.trusts_indexes = self.trusts_indexes, False
        return was_trusted

    def distrust_indexes_if_miscounted(self, channel_ids: Collection[int]) -> None:
        """Distrust the indexes if they list other numbers of messages than the summary counts.

        A caller that reads message by message must know this in advance; one that loads whole channels compares the
        counts afterwards and reads again.
        """
        if not self.trusts_indexes or self._checked >= set(channel_ids):
            return
        self._checked |= set(channel_ids)
        listed = dict.fromkeys(channel_ids, 0)
        for chunk in self.chunks_with_channels(channel_ids):
            for channel_id in listed.keys() & chunk.index_offsets.keys():
                entries = find_message_index_entries(self._file, self._index, chunk, channel_id)
                listed[channel_id] += 0 if entries is None else len(entries)
        if self._ids_of_miscounted_channels(listed):
            self.distrust_indexes_if_not_yet()

    def note_miscounted_channels(self, n_read_by_channel_id: Mapping[int, int]) -> None:
        """Add channels with another number of messages than the summary says to the faults.

        None is added where damaged parts of the file explain the difference.
        """
        faults = self._faults
        if not (faults.chunks_lost or faults.bytes_lost or faults.truncated):
            faults.miscounted_channel_ids |= self._ids_of_miscounted_channels(n_read_by_channel_id)

    def _ids_of_miscounted_channels(self, n_read_by_channel_id: Mapping[int, int]) -> set[int]:
        """Return the ids of channels with another number of messages than the summary says, if it says any."""
        listed = self._listed_counts
        return {each for each, n in n_read_by_channel_id.items() if n != listed.get(each, 0)} if listed else set()

    def read_log_times_ns(self, channel_ids: Collection[int]) -> npt.NDArray[np.uint64]:
        """Return the sorted log times in ns of the messages of some channels; chunks with indexes are not opened.

        Raises:
            InputError: A chunk without message index is damaged, and `recover` is off.
        """
        found = [np.zeros(0, np.uint64)]
        n_listed = dict.fromkeys(channel_ids, 0)
        n_unlisted = 0
        for chunk in self.chunks_with_channels(channel_ids):
            n_unlisted += not chunk.index_offsets
            for each in n_listed.keys() & chunk.index_offsets.keys():
                entries = find_message_index_entries(self._file, self._index, chunk, each)
                if entries is None:
                    n_unlisted += 1
                else:
                    found.append(entries[:, 0])
                    n_listed[each] += len(entries)
        if self._ids_of_miscounted_channels(n_listed):
            self.distrust_indexes_if_not_yet()
        if n_unlisted or not self.trusts_indexes:
            found[1:] = [batch.log_time_ns.view(np.uint64) for batch in self.iter_batches(channel_ids)]
        else:
            loose = self.iter_unchunked_batches(channel_ids, self._spans)
            found += [batch.log_time_ns.view(np.uint64) for batch in loose]
        return np.sort(np.concatenate(found))

    def chunks_with_channels(self, channel_ids: Collection[int]) -> list[ChunkIndex]:
        """Return the chunks that hold, or may hold, messages of these channels, in file order."""
        wanted_ids = frozenset(channel_ids)
        return [
            chunk
            for chunk in self._chunks
            if not self.trusts_indexes or not chunk.channel_ids or not wanted_ids.isdisjoint(chunk.channel_ids)
        ]

    def _cached_mask_of_channel_ids(self, channel_ids: Collection[int]) -> ByteArray:
        """Return `channel_mask`, cached for consecutive calls with the same channels."""
        wanted_ids = frozenset(channel_ids)
        if wanted_ids != self._wanted_last[0]:
            self._wanted_last = wanted_ids, channel_mask(wanted_ids)
        return self._wanted_last[1]

    def max_message_count_by_file_size(self) -> int:
        """Return the greatest number of messages that the file can hold by its size."""
        chunked = sum(min(chunk.uncompressed_size, self._file.max_chunk_bytes) for chunk in self._chunks)
        return (chunked + sum(end - start for start, end in self._spans)) // MIN_MESSAGE_BYTES

    def iter_log_times_offsets_and_batches_of_parts(
        self, channel_ids: Collection[int], spans_ns: Sequence[tuple[int, int]] | None = None
    ) -> Iterator[tuple[int, int, Iterator[MessageBatch]]]:
        """Yield parts of the file in order of their first log times.

        Args:
            spans_ns: Chunks that lie outside all of these times [start, end) are left out; None: none is.

        Yields:
            First log time in ns, byte offset in the file, batches of the part.
        """
        return merge(
            self._iter_chunks_in_time_order(channel_ids, spans_ns),
            self._iter_unchunked_in_time_order(channel_ids),
            key=itemgetter(0),
        )

    def _iter_chunks_in_time_order(
        self, channel_ids: Collection[int], spans_ns: Sequence[tuple[int, int]] | None
    ) -> Iterator[tuple[int, int, Iterator[MessageBatch]]]:
        chunks = sorted(self.chunks_with_channels(channel_ids), key=lambda chunk: (chunk.start_ns, chunk.chunk_start))
        if spans_ns is not None:
            chunks = [
                each for each in chunks if any(each.end_ns >= start and each.start_ns < end for start, end in spans_ns)
            ]
        for chunk, payload in self.iter_chunk_payloads(chunks):
            if payload is not None:
                yield chunk.start_ns, chunk.chunk_start, self.iter_chunk_batches(chunk, payload, channel_ids)

    def _iter_unchunked_in_time_order(
        self, channel_ids: Collection[int]
    ) -> Iterator[tuple[int, int, Iterator[MessageBatch]]]:
        parts = [
            (int(batch.log_time_ns.min()), *place)
            for span in self._spans
            for place, batch in self._iter_unchunked_parts(channel_ids, span)
        ]
        for first_ns, start, end in sorted(parts):
            yield first_ns, start, self.iter_unchunked_batches(channel_ids, [(start, end)])

    def iter_chunk_batches(
        self, chunk: ChunkIndex, payload: memoryview, channel_ids: Collection[int]
    ) -> Iterator[MessageBatch]:
        """Yield the messages of some channels in a decompressed chunk."""
        octets = np.frombuffer(payload, np.uint8)
        is_wanted = self._cached_mask_of_channel_ids(channel_ids)
        is_partial = chunk.chunk_start in self._index.cut_chunks
        at = 0
        noted: list[MessageBatch] = []
        while at < len(octets):
            batch, at, status = scan_messages_next_offset_and_status(octets, at, len(octets), is_wanted)
            noted.append(batch)
            n_new = max(sum(map(len, noted)) - self._n_found_in[chunk.chunk_start], 0)
            self._n_found_in[chunk.chunk_start] += n_new
            self._n_found += n_new
            try:
                check_message_count_against_file_size(self._file, self._n_found)
            except ChunkError as error:
                self._report_lost_chunk(chunk, error)
                return
            if status == DAMAGED:
                if not is_partial:
                    self._report_damaged_record(chunk.chunk_start, "a record in a chunk is damaged", 0)
                break
        if not is_partial and not self._are_message_indexes_correct(chunk, noted, channel_ids):
            self._count_fault_once(chunk.chunk_start, "broken_indexes")
        yield from noted

    def iter_unchunked_batches(
        self, channel_ids: Collection[int], spans: Collection[ByteRange]
    ) -> Iterator[MessageBatch]:
        """Yield the messages of some channels in byte ranges outside chunks."""
        for span in spans:
            for _, batch in self._iter_unchunked_parts(channel_ids, span):
                yield batch

    def _iter_unchunked_parts(
        self, channel_ids: Collection[int], span: ByteRange
    ) -> Iterator[tuple[ByteRange, MessageBatch]]:
        """Yield each part of a byte range that holds messages: its start and end, and the messages."""
        at, end = span
        is_wanted = self._cached_mask_of_channel_ids(channel_ids)
        size = UNCHUNKED_READ_BYTES
        while at < end:
            records = self._index.records_with_log_ids(at, self._file[at : min(at + size, end)])
            octets = np.frombuffer(records, np.uint8)
            batch, n_bytes, status = scan_messages_next_offset_and_status(octets, 0, len(octets), is_wanted)
            size = UNCHUNKED_READ_BYTES
            if len(batch):
                self._check_data_section_crc(at)
                n_new = max(len(batch) - self._n_found_in[at], 0)
                self._n_found_in[at] += n_new
                self._n_found += n_new
                check_unchunked_message_count(self._file, self._n_found)
                yield (at, at + n_bytes), batch
            at += n_bytes
            if status == DAMAGED and not n_bytes:  # at the first record, which may be longer than what was read
                try:
                    opcode, _, record_end = read_opcode_and_content_range(self._file, at, end)
                except RecordError:
                    record_end = at
                if record_end - at <= len(octets):
                    self._report_damaged_record(at, "a record is damaged", end - at)
                    return
                if opcode == Opcode.MESSAGE:
                    size = record_end - at
                else:
                    at = record_end

    def _check_data_section_crc(self, at: int) -> None:
        """Check the CRC over the data section around an offset, once per section.

        Nothing else protects messages outside chunks.

        Raises:
            InputError: It is wrong, and `recover` is off.
        """
        start, end = self._index.start_and_data_end_of_section_at(at)
        if end is None or end in self._counted:
            return
        self._counted.add(end)
        (crc,) = struct.unpack("<I", self._file[end + RECORD_PREFIX.size : end + RECORD_PREFIX.size + 4])
        if not crc or crc == crc32_of_range(self._file, start, end):
            return
        if not self._recover:
            raise self._error_about_damage("the CRC of its messages is wrong", end)
        self._faults.data_crc_mismatch = True

    def iter_chunk_payloads(self, chunks: Sequence[ChunkIndex]) -> Iterator[tuple[ChunkIndex, memoryview | None]]:
        """Yield each chunk with its records (None if it is lost), decompressed ahead by threads if that pays."""
        if (
            sum(chunk.uncompressed_size for chunk in chunks) < MIN_BYTES_FOR_THREADS
            or len(chunks) < N_DECOMPRESSION_THREADS
        ):
            for chunk in chunks:
                try:
                    yield chunk, self._decompress_chunk(chunk)
                except ChunkError as error:
                    self._report_lost_chunk(chunk, error)
                    yield chunk, None
            return
        from concurrent.futures import Future, ThreadPoolExecutor

        waiting = deque(chunks)
        running: deque[tuple[ChunkIndex, Future[memoryview]]] = deque()
        pool = ThreadPoolExecutor(N_DECOMPRESSION_THREADS)
        try:
            while waiting or running:
                while waiting and len(running) <= N_DECOMPRESSION_THREADS:
                    n_bytes = sum(each.uncompressed_size for each, _ in running)
                    if running and n_bytes + waiting[0].uncompressed_size > MAX_DECOMPRESSING_BYTES:
                        break
                    chunk = waiting.popleft()
                    running.append((chunk, pool.submit(self._decompress_chunk, chunk)))
                chunk, future = running.popleft()
                payload: memoryview | None = None
                try:
                    payload = future.result()
                except ChunkError as error:
                    self._report_lost_chunk(chunk, error)
                del future
                yield chunk, payload
        finally:
            pool.shutdown(wait=True, cancel_futures=True)

    def _decompress_chunk(self, chunk: ChunkIndex) -> memoryview:
        """Return the records of a chunk, with the log's channel ids; one that was found lost is not read again."""
        if chunk.chunk_start in self._lost:
            raise ChunkError("it was found damaged before")
        if chunk.chunk_start in self._unpacked:
            return self._unpacked[chunk.chunk_start]
        if chunk.chunk_start in self._index.cut_chunks:
            self._count_fault_once(chunk.chunk_start, "chunks_partial")
            return self._index.records_with_log_ids(
                chunk.chunk_start, decompress_cut_chunk_up_to_error(self._file, chunk)
            )
        verify = chunk.chunk_start not in self._verified  # the stages of a run read it several times
        payload = decompress_chunk(self._file, chunk, verify=verify)
        self._verified.add(chunk.chunk_start)
        records = self._index.records_with_log_ids(chunk.chunk_start, payload)
        if len(records) <= self._n_bytes_to_keep_unpacked:
            self._n_bytes_to_keep_unpacked -= len(records)
            self._unpacked[chunk.chunk_start] = records
        return records

    def _report_lost_chunk(self, chunk: ChunkIndex, error: ChunkError) -> None:
        """Count a lost chunk once.

        Raises:
            InputError: `recover` is off.
        """
        at = chunk.chunk_start
        if not self._recover:
            raise self._error_about_damage(str(error), at, error.hint) from error
        self._lost.add(at)
        if at not in self._counted:
            self._counted.add(at)
            self._faults.chunks_lost += 1
            self._faults.crc_mismatches += error.is_crc_mismatch
            self._faults.bytes_lost += chunk.chunk_length
            self._faults.messages_lost += self._count_indexed_messages(chunk)

    def _report_damaged_record(self, at: int, what: str, n_bytes: int) -> None:
        """Count the lost bytes of a damaged record once.

        Raises:
            InputError: `recover` is off.
        """
        if not self._recover:
            raise self._error_about_damage(what, at)
        if at not in self._counted:
            self._counted.add(at)
            self._faults.bytes_lost += n_bytes

    def _error_about_damage(self, what: str, at: int, hint: str = RECOVER_HINT) -> InputError:
        file, at = self._file.part_and_offset(at)
        return InputError(f"{what} (at byte {at})", where=file.name, hint=hint)

    def _count_fault_once(self, at: int, fault: str) -> None:
        """Add one to a field of `Faults`, once per offset."""
        if at not in self._counted:
            self._counted.add(at)
            setattr(self._faults, fault, getattr(self._faults, fault) + 1)

    def _count_indexed_messages(self, chunk: ChunkIndex) -> int:
        """Return the number of messages in a chunk's message indexes."""
        return sum(
            len(entries)
            for each in chunk.index_offsets
            if (entries := find_message_index_entries(self._file, self._index, chunk, each)) is not None
        )

    def _are_message_indexes_correct(
        self, chunk: ChunkIndex, batches: Sequence[MessageBatch], channel_ids: Collection[int]
    ) -> bool:
        """Tell whether a chunk's message indexes list exactly its messages."""
        if not chunk.index_offsets:
            return True
        ids = np.concatenate([batch.channel_id for batch in batches] or [np.zeros(0, np.uint16)])
        times = np.concatenate([batch.log_time_ns for batch in batches] or [np.zeros(0, np.int64)])
        places = np.concatenate([batch.payloads.starts for batch in batches] or [np.zeros(0, np.int64)])
        for channel_id in channel_ids:
            is_own = ids == channel_id
            if channel_id not in chunk.index_offsets:
                if is_own.any():
                    return False
                continue
            listed = find_message_index_entries(self._file, self._index, chunk, channel_id)
            if listed is None or len(listed) != int(is_own.sum()):
                return False
            order = np.argsort(listed[:, 1], kind="stable")
            if not np.array_equal(listed[order, 1], (places[is_own] - MIN_MESSAGE_BYTES).astype(np.uint64)):
                return False
            if not np.array_equal(listed[order, 0], times[is_own].view(np.uint64)):
                return False
        return True


def find_message_index_entries(
    file: InputFile, index: LogIndex, chunk: ChunkIndex, channel_id: int
) -> npt.NDArray[np.uint64] | None:
    """Return a channel's message index in a chunk: (log time, offset), shape (n, 2); None if missing or damaged."""
    try:
        opcode, start, stop = read_opcode_and_content_range(file, chunk.index_offsets[channel_id], chunk.end_offset)
        found, first, last = channel_id_and_range_of_message_index_entries(file, start, stop)
    except RecordError:
        return None
    renumbering = index.channel_renumbering_at_offset(chunk.chunk_start)
    own_id = found if renumbering is None else renumbering.log_channel_id(found)
    if opcode != Opcode.MESSAGE_INDEX or own_id != channel_id:
        return None
    return np.frombuffer(file[first:last], "<u8").reshape(-1, 2)


def scan_messages_next_offset_and_status(
    octets: ByteArray, at: int, end: int, is_wanted: ByteArray
) -> tuple[MessageBatch, int, int]:
    """Scan records for messages of wanted channels (`channel_mask`), up to one batch.

    Returns:
        The messages, the offset at which the scan stopped, and the status of the kernel.
    """
    found = Messages(min((end - at) // MIN_MESSAGE_BYTES + 1, MAX_BATCH_MESSAGES))
    stop, status = scan_messages(octets, at, end, is_wanted, found)
    n = found.n
    if status == FULL and not n:
        raise AssertionError("a batch has room for a message")
    payloads = Payloads(octets, found.payload_start[:n], found.payload_end[:n])
    batch = MessageBatch(
        payloads, found.channel_id[:n], found.sequence[:n], found.log_time_ns[:n], found.publish_time_ns[:n]
    )
    return batch, stop, status


def channel_mask(channel_ids: Collection[int]) -> ByteArray:
    """Return a mask over all channel ids: 1 for these channels, shape (65536,)."""
    is_wanted = np.zeros(1 << 16, np.uint8)
    is_wanted[list(channel_ids)] = 1
    return is_wanted
