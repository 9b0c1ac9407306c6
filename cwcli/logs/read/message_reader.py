"""Messages of some channels, as arrays of where they are: chunk by chunk, without one Python object per message."""

from __future__ import annotations

import struct
from collections import Counter, deque
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from heapq import merge
from operator import itemgetter

import numpy as np
import numpy.typing as npt

from cwcli.errors import InputError
from cwcli.input import InputFile
from cwcli.kernels.message_scan import DAMAGED, FULL, Messages, scan_messages
from cwcli.logs.codecs.slots import ByteArray, Payloads
from cwcli.logs.format.chunks import ChunkError, check_messages, chunk_payload, partial_payload
from cwcli.logs.format.faults import RECOVER_HINT, Faults
from cwcli.logs.format.index import Index, Span
from cwcli.logs.format.records import (
    MESSAGE,
    MESSAGE_HEADER_BYTES,
    MESSAGE_INDEX,
    PREFIX,
    ChunkIndex,
    RecordError,
    crc32,
    read_message_index,
    read_prefix,
)
from cwcli.logs.read.message_counts import MessageCounts
from cwcli.signals.columns import Int64Array

MIN_MESSAGE_BYTES = PREFIX.size + MESSAGE_HEADER_BYTES
MAX_BATCH_MESSAGES = 1 << 16
N_AHEAD = 2
MAX_AHEAD_BYTES = 64 << 20
"""Of several chunks that are unpacked at once."""
LOOSE_BYTES = 1 << 20
"""Read at once, of what lies outside chunks; a longer record is read alone."""
MIN_BYTES_FOR_THREADS = 4 << 20


@dataclass(frozen=True)
class Batch:
    """Messages of the wanted channels in one chunk, in file order.

    Attributes:
        payloads: The messages.
        channel_id, sequence, log_time_ns, publish_time_ns: Shape (n,).
    """

    payloads: Payloads
    channel_id: npt.NDArray[np.uint16]
    sequence: npt.NDArray[np.uint32]
    log_time_ns: Int64Array
    publish_time_ns: Int64Array

    def __len__(self) -> int:
        return len(self.channel_id)

    def take(self, rows: npt.NDArray[np.intp]) -> Batch:
        """Some of the messages."""
        payloads = self.payloads.take(rows)
        return Batch(
            payloads, self.channel_id[rows], self.sequence[rows], self.log_time_ns[rows], self.publish_time_ns[rows]
        )

    def messages(self) -> Iterator[tuple[int, memoryview]]:
        """Log time and bytes of each."""
        data = self.payloads.data.data
        places = zip(self.payloads.starts.tolist(), self.payloads.ends.tolist(), strict=True)
        for log_time_ns, (start, end) in zip(self.log_time_ns.tolist(), places, strict=True):
            yield log_time_ns, data[start:end]


class MessageReader:
    """Reads a file's messages.

    Args:
        file: The log.
        index: What it holds.
        faults: Counts what is lost.
        recover: Leave damaged parts out and count them.
        verify: Check CRCs and message indexes.

    Attributes:
        counts: What the summary counts, to compare with what is read.
        trusts_indexes: Chunks whose index does not list a channel are not opened for it.
    """

    def __init__(self, file: InputFile, index: Index, faults: Faults, *, recover: bool, verify: bool) -> None:
        self._file = file
        self._index = index
        self._chunks = index.items_of(ChunkIndex)
        self._spans = index.items_of(Span)
        self._faults = faults
        self._recover = recover
        self._verify = verify
        self._counted: set[int] = set()
        self._verified: set[int] = set()
        self.trusts_indexes = index.is_counted
        self._checked: set[int] = set()
        self.counts = MessageCounts(index.statistics, faults)
        self._n_found_in: Counter[int] = Counter()
        self._n_found = 0
        self._wanted_last: tuple[frozenset[int], ByteArray] = frozenset(), wanted_ids(())

    def batches(self, channel_ids: Collection[int], start_ns: int = 0, end_ns: int = 1 << 64) -> Iterator[Batch]:
        """The messages of some channels, in file order; chunks that end before `start_ns` or begin at `end_ns` or later
        are left out.

        Raises:
            InputError: A chunk that may hold them is damaged, and `recover` is off.
        """
        chunks = [each for each in self.chunks(channel_ids) if each.end_ns >= start_ns and each.start_ns < end_ns]
        loose = deque(self._spans)
        for chunk, payload in self._payloads(chunks):
            while loose and loose[0][0] < chunk.chunk_start:
                yield from self.loose_batches(channel_ids, [loose.popleft()])
            if payload is not None:
                yield from self.chunk_batches(chunk, payload, channel_ids)
        yield from self.loose_batches(channel_ids, loose)

    def distrust_indexes(self) -> bool:
        """Open every chunk from now on, whatever its index says is in it; returns whether that is new."""
        was_trusted, self.trusts_indexes = self.trusts_indexes, False
        return was_trusted

    def check_indexes(self, channel_ids: Collection[int]) -> None:
        """Distrust the indexes if they list other numbers of messages than the summary counts.

        Who reads whole channels at once finds that when they have been read, and reads them again; who
        takes one message after the other, or some of them, has to know before.
        """
        if not self.trusts_indexes or self._checked >= set(channel_ids):
            return
        self._checked |= set(channel_ids)
        listed = dict.fromkeys(channel_ids, 0)
        for chunk in self.chunks(channel_ids):
            for channel_id in listed.keys() & chunk.index_offsets.keys():
                entries = message_index(self._file, self._index, chunk, channel_id)
                listed[channel_id] += 0 if entries is None else len(entries)
        if self.counts.differing(listed):
            self.distrust_indexes()

    def chunks(self, channel_ids: Collection[int]) -> list[ChunkIndex]:
        """The chunks that hold, or may hold, messages of these channels, in file order."""
        wanted = frozenset(channel_ids)
        return [
            chunk
            for chunk in self._chunks
            if not self.trusts_indexes or not chunk.channel_ids or not wanted.isdisjoint(chunk.channel_ids)
        ]

    def _wanted(self, channel_ids: Collection[int]) -> ByteArray:
        """`wanted_ids`, made once for one chunk after the other."""
        wanted = frozenset(channel_ids)
        if wanted != self._wanted_last[0]:
            self._wanted_last = wanted, wanted_ids(wanted)
        return self._wanted_last[1]

    def max_messages(self) -> int:
        """More messages than this can't be in the file."""
        chunked = sum(min(chunk.uncompressed_size, self._file.max_chunk_bytes) for chunk in self._chunks)
        return (chunked + sum(end - start for start, end in self._spans)) // MIN_MESSAGE_BYTES

    def in_time_order(self, channel_ids: Collection[int]) -> Iterator[tuple[int, int, Iterator[Batch]]]:
        """The batches of one part of the file after the other: no later one holds an earlier message.

        Yields:
            First log time, place in the file, batches.
        """
        return merge(self._chunks_in_time_order(channel_ids), self._loose_in_time_order(channel_ids), key=itemgetter(0))

    def _chunks_in_time_order(self, channel_ids: Collection[int]) -> Iterator[tuple[int, int, Iterator[Batch]]]:
        chunks = sorted(self.chunks(channel_ids), key=lambda chunk: (chunk.start_ns, chunk.chunk_start))
        for chunk, payload in self._payloads(chunks):
            if payload is not None:
                yield chunk.start_ns, chunk.chunk_start, self.chunk_batches(chunk, payload, channel_ids)

    def _loose_in_time_order(self, channel_ids: Collection[int]) -> Iterator[tuple[int, int, Iterator[Batch]]]:
        parts = [
            (int(batch.log_time_ns.min()), *place)
            for span in self._spans
            for place, batch in self._loose_parts(channel_ids, span)
        ]
        for first_ns, start, end in sorted(parts):
            yield first_ns, start, self.loose_batches(channel_ids, [(start, end)])

    def chunk_batches(self, chunk: ChunkIndex, payload: memoryview, channel_ids: Collection[int]) -> Iterator[Batch]:
        """The messages in an opened chunk."""
        octets = np.frombuffer(payload, np.uint8)
        is_wanted = self._wanted(channel_ids)
        is_partial = chunk.chunk_start in self._index.cut_chunks
        at = 0
        noted: list[Batch] = []
        while at < len(octets):
            batch, at, status = scan_records(octets, at, len(octets), is_wanted)
            noted.append(batch)
            n_new = max(sum(map(len, noted)) - self._n_found_in[chunk.chunk_start], 0)
            self._n_found_in[chunk.chunk_start] += n_new
            self._n_found += n_new
            try:
                check_messages(self._file, self._n_found)
            except ChunkError as error:
                self._lose_chunk(chunk, error)
                return
            if status == DAMAGED:
                if not is_partial:
                    self._lose(chunk.chunk_start, "a record in a chunk is damaged", 0)
                break
        if self._verify and not is_partial and not self._index_fits(chunk, noted, channel_ids):
            self._count(chunk.chunk_start, "broken_indexes")
        yield from noted

    def loose_batches(self, channel_ids: Collection[int], spans: Collection[tuple[int, int]]) -> Iterator[Batch]:
        """The messages outside chunks, in some parts of the data section."""
        for span in spans:
            for _, batch in self._loose_parts(channel_ids, span):
                yield batch

    def _loose_parts(
        self, channel_ids: Collection[int], span: tuple[int, int]
    ) -> Iterator[tuple[tuple[int, int], Batch]]:
        """Start and end of one part after the other that holds messages, and these."""
        at, end = span
        is_wanted = self._wanted(channel_ids)
        size = LOOSE_BYTES
        while at < end:
            records = self._index.with_own_ids(at, self._file[at : min(at + size, end)])
            octets = np.frombuffer(records, np.uint8)
            batch, n_bytes, status = scan_records(octets, 0, len(octets), is_wanted)
            size = LOOSE_BYTES
            if len(batch):
                self._check_data_crc(at)
                yield (at, at + n_bytes), batch
            at += n_bytes
            if status == DAMAGED and not n_bytes:  # at the first record, which may be longer than what was read
                try:
                    opcode, _, record_end = read_prefix(self._file, at, end)
                except RecordError:
                    record_end = at
                if record_end - at <= len(octets):
                    self._lose(at, "a record is damaged", end - at)
                    return
                if opcode == MESSAGE:
                    size = record_end - at
                else:
                    at = record_end

    def _check_data_crc(self, at: int) -> None:
        """Check the CRC over the data section around an offset, once: nothing else protects messages outside chunks."""
        start, end = self._index.section_at(at)
        if not self._verify or end is None or end in self._counted:
            return
        self._counted.add(end)
        (crc,) = struct.unpack("<I", self._file[end + PREFIX.size : end + PREFIX.size + 4])
        if not crc or crc == crc32(self._file, start, end):
            return
        if not self._recover:
            raise self._error("the CRC of its messages does not fit", end)
        self._faults.data_crc_mismatch = True

    def _payloads(self, chunks: Sequence[ChunkIndex]) -> Iterator[tuple[ChunkIndex, memoryview | None]]:
        """Each chunk with what is in it (None if it is lost), decompressed ahead by threads where that pays."""
        if sum(chunk.uncompressed_size for chunk in chunks) < MIN_BYTES_FOR_THREADS or len(chunks) < N_AHEAD:
            for chunk in chunks:
                try:
                    yield chunk, self._payload(chunk)
                except ChunkError as error:
                    self._lose_chunk(chunk, error)
                    yield chunk, None
            return
        from concurrent.futures import Future, ThreadPoolExecutor

        waiting = deque(chunks)
        running: deque[tuple[ChunkIndex, Future[memoryview]]] = deque()
        pool = ThreadPoolExecutor(N_AHEAD)
        try:
            while waiting or running:
                while waiting and len(running) <= N_AHEAD:
                    n_bytes = sum(each.uncompressed_size for each, _ in running)
                    if running and n_bytes + waiting[0].uncompressed_size > MAX_AHEAD_BYTES:
                        break
                    chunk = waiting.popleft()
                    running.append((chunk, pool.submit(self._payload, chunk)))
                chunk, future = running.popleft()
                payload: memoryview | None = None
                try:
                    payload = future.result()
                except ChunkError as error:
                    self._lose_chunk(chunk, error)
                del future
                yield chunk, payload
        finally:
            pool.shutdown(wait=True, cancel_futures=True)

    def _payload(self, chunk: ChunkIndex) -> memoryview:
        if chunk.chunk_start in self._index.cut_chunks:
            self._count(chunk.chunk_start, "chunks_partial")
            return self._index.with_own_ids(chunk.chunk_start, partial_payload(self._file, chunk))
        verify = self._verify and chunk.chunk_start not in self._verified  # the stages of a run read it several times
        payload = chunk_payload(self._file, chunk, verify=verify)
        self._verified.add(chunk.chunk_start)
        return self._index.with_own_ids(chunk.chunk_start, payload)

    def _lose_chunk(self, chunk: ChunkIndex, error: ChunkError) -> None:
        at = chunk.chunk_start
        if not self._recover:
            raise self._error(str(error), at, error.hint) from error
        if at not in self._counted:
            self._counted.add(at)
            self._faults.chunks_lost += 1
            self._faults.crc_mismatches += error.is_crc
            self._faults.bytes_lost += chunk.chunk_length
            self._faults.messages_lost += self._indexed_messages(chunk)

    def _lose(self, at: int, what: str, n_bytes: int) -> None:
        if not self._recover:
            raise self._error(what, at)
        if at not in self._counted:
            self._counted.add(at)
            self._faults.bytes_lost += n_bytes

    def _error(self, what: str, at: int, hint: str = RECOVER_HINT) -> InputError:
        file, at = self._file.place(at)
        return InputError(f"{what} (at byte {at})", where=file.name, hint=hint)

    def _count(self, at: int, fault: str) -> None:
        if at not in self._counted:
            self._counted.add(at)
            setattr(self._faults, fault, getattr(self._faults, fault) + 1)

    def _indexed_messages(self, chunk: ChunkIndex) -> int:
        """How many messages a chunk's indexes list."""
        return sum(
            len(entries)
            for each in chunk.index_offsets
            if (entries := message_index(self._file, self._index, chunk, each)) is not None
        )

    def _index_fits(self, chunk: ChunkIndex, batches: Sequence[Batch], channel_ids: Collection[int]) -> bool:
        """Whether a chunk's message indexes list what is in it."""
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
            listed = message_index(self._file, self._index, chunk, channel_id)
            if listed is None or len(listed) != int(is_own.sum()):
                return False
            order = np.argsort(listed[:, 1], kind="stable")
            if not np.array_equal(listed[order, 1], (places[is_own] - MIN_MESSAGE_BYTES).astype(np.uint64)):
                return False
            if not np.array_equal(listed[order, 0], times[is_own].view(np.uint64)):
                return False
        return True


def message_index(file: InputFile, index: Index, chunk: ChunkIndex, channel_id: int) -> npt.NDArray[np.uint64] | None:
    """Shape (n, 2): a channel's message index, (log time, offset); None if it is not what and where it should be."""
    try:
        opcode, start, stop = read_prefix(file, chunk.index_offsets[channel_id], chunk.end)
        found, first, last = read_message_index(file, start, stop)
    except RecordError:
        return None
    renumbering = index.renumbering(chunk.chunk_start)
    own_id = found if renumbering is None else renumbering.id(found)
    if opcode != MESSAGE_INDEX or own_id != channel_id:
        return None
    return np.frombuffer(file[first:last], "<u8").reshape(-1, 2)


def scan_records(octets: ByteArray, at: int, end: int, is_wanted: ByteArray) -> tuple[Batch, int, int]:
    """Up to a batch's worth of messages of wanted channels (`wanted_ids`), where the walk stopped, and why."""
    found = Messages(min((end - at) // MIN_MESSAGE_BYTES + 1, MAX_BATCH_MESSAGES))
    stop, status = scan_messages(octets, at, end, is_wanted, found)
    n = found.n
    if status == FULL and not n:
        raise AssertionError("a batch has room for a message")
    payloads = Payloads(octets, found.payload_start[:n], found.payload_end[:n])
    batch = Batch(payloads, found.channel_id[:n], found.sequence[:n], found.log_time_ns[:n], found.publish_time_ns[:n])
    return batch, stop, status


def wanted_ids(channel_ids: Collection[int]) -> ByteArray:
    """Shape (65536,): 1 for these channels."""
    is_wanted = np.zeros(1 << 16, np.uint8)
    is_wanted[list(channel_ids)] = 1
    return is_wanted
