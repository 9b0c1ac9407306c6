"""Mutators of whole logs: their bytes, their records, what is in their chunks, and their summaries.

Lengths, CRCs and the summary are mended most of the time, so that what is changed is reached behind what checks it.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from typing import NamedTuple

import lz4.frame
import zstandard

from cwcli.logs.format import record_bytes
from cwcli.logs.format.records import (
    MCAP_MAGIC,
    RECORD_PREFIX,
    ChunkIndex,
    Opcode,
    Statistics,
)
from tests.fuzz.messages import JSON_TOKENS, ROS_TOKENS
from tests.fuzz.mutate import NUMBERS, Rng, mutate

CHUNK_HEAD = struct.Struct("<QQQI")
MESSAGE_HEAD = struct.Struct("<HIQQ")
OPCODES = (*range(16), 0x80)
TIMES = (0, 1, 1 << 63, (1 << 64) - 1, 1_700_000_000_000_000_000)
COMPRESS: dict[str, Callable[[bytes], bytes]] = {
    "": bytes,
    "zstd": lambda data: zstandard.ZstdCompressor(level=1).compress(data),
    "lz4": lz4.frame.compress,
}
UNPACK: dict[str, Callable[[bytes], bytes]] = {
    "": bytes,
    "zstd": lambda data: zstandard.ZstdDecompressor().decompress(data),
    "lz4": lz4.frame.decompress,
}


class Record(NamedTuple):
    """A record: its kind and what is in it."""

    opcode: int
    content: bytes

    @property
    def bytes(self) -> bytes:
        """As it stands in a file."""
        return RECORD_PREFIX.pack(self.opcode, len(self.content)) + self.content


def split(data: bytes) -> list[Record]:
    """Whole records, one behind the other."""
    records, at = [], 0
    while at < len(data):
        opcode, length = RECORD_PREFIX.unpack_from(data, at)
        at += RECORD_PREFIX.size + length
        records.append(Record(opcode, data[at - length : at]))
    return records


def mutated_log(rng: Rng, data: bytes) -> bytes:
    """A log that is whole, with a few changes."""
    choice = rng.random()
    if choice < 0.15:
        return mutate(rng, data)
    records = split(data[len(MCAP_MAGIC) : -len(MCAP_MAGIC)])
    n_data = next(k for k, each in enumerate(records) if each.opcode == Opcode.DATA_END)
    inside, summary = records[:n_data], records[n_data + 1 : -1]
    if choice < 0.35:  # the summary's records, with a CRC that fits
        return _file(inside, mutated_records(rng, summary))
    if choice < 0.5:
        inside = mutated_records(rng, inside)
    else:
        inside = [
            _mutated_chunk(rng, each) if each.opcode == Opcode.CHUNK and rng.random() < 0.5 else each for each in inside
        ]
        if not any(each.opcode == Opcode.CHUNK for each in inside):
            inside = mutated_records(rng, inside)
    choice = rng.random()
    if choice < 0.6:
        return _file(inside, _summary(inside) if choice < 0.3 else [])
    return _file(inside, summary)


def mutated_records(rng: Rng, records: list[Record]) -> list[Record]:
    """Records that go, come twice, change their places, their kinds or what is in them."""
    made = list(records)
    for _ in range(int(rng.integers(1, 4))):
        if not made:
            break
        k, change = int(rng.integers(len(made))), int(rng.integers(8))
        if change == 0:
            del made[k]
        elif change == 1:
            made.insert(int(rng.integers(len(made) + 1)), made[k])
        elif change == 2:
            made.insert(int(rng.integers(len(made))), made.pop(k))
        elif change == 3:
            made[k] = made[k]._replace(opcode=int(rng.choice(OPCODES)))
        else:
            made[k] = _mutated_record(rng, made[k])
    return made


def _mutated_record(rng: Rng, record: Record) -> Record:
    opcode, content = record
    if opcode == Opcode.MESSAGE and len(content) >= MESSAGE_HEAD.size:
        channel, sequence, log_ns, publish_ns = MESSAGE_HEAD.unpack_from(content)
        payload = content[MESSAGE_HEAD.size :]
        if rng.random() < 0.2:
            log_ns = (log_ns, *TIMES)[int(rng.integers(len(TIMES) + 1))]
        elif rng.random() < 0.1:
            channel = int(rng.integers(4))
        else:
            payload = mutate(rng, payload, JSON_TOKENS if payload[:1] == b"{" else NUMBERS)
        return Record(opcode, MESSAGE_HEAD.pack(channel, sequence, log_ns, publish_ns) + payload)
    if opcode == Opcode.SCHEMA and rng.random() < 0.8:
        return Record(opcode, mutate(rng, content, ROS_TOKENS if b"float64" in content else NUMBERS))
    return Record(opcode, mutate(rng, content))


def _mutated_chunk(rng: Rng, chunk: Record) -> Record:
    """Other records in it, and now and then a size or a CRC that does not fit them."""
    start_ns, end_ns, compression, unpacked = opened(chunk)
    changed = mutate(rng, unpacked) if rng.random() < 0.2 else joined(mutated_records(rng, split(unpacked)))
    compression = compression if rng.random() < 0.9 else str(rng.choice(["", "zstd", "lz4", "xz"]))
    stored = COMPRESS.get(compression, bytes)(changed)
    size, crc = len(changed), zlib.crc32(changed)
    if rng.random() < 0.05:
        size = int(rng.choice([0, 1, size - 1 if size else 9, 1 << 31, 1 << 62]))
    if rng.random() < 0.05:
        crc = int(rng.choice([0, crc ^ 1]))
    if rng.random() < 0.05:
        stored = mutate(rng, stored)
    head = CHUNK_HEAD.pack(start_ns, end_ns, size, crc)
    named = struct.pack("<I", len(compression)) + compression.encode()
    return Record(Opcode.CHUNK, head + named + struct.pack("<Q", len(stored)) + stored)


def opened(chunk: Record) -> tuple[int, int, str, bytes]:
    """First and last time, compression and records of a chunk."""
    start_ns, end_ns, _, _ = CHUNK_HEAD.unpack_from(chunk.content)
    (n,) = struct.unpack_from("<I", chunk.content, CHUNK_HEAD.size)
    at = CHUNK_HEAD.size + 4
    compression = chunk.content[at : at + n].decode()
    return start_ns, end_ns, compression, UNPACK[compression](chunk.content[at + n + 8 :])


def joined(records: list[Record]) -> bytes:
    """Records as they stand in a file."""
    return b"".join(each.bytes for each in records)


def _file(inside: list[Record], summary: list[Record]) -> bytes:
    """A file with these records, and a footer that fits the summary."""
    head = MCAP_MAGIC + joined(inside) + record_bytes.encode_data_end()
    end = joined(summary)
    return head + end + record_bytes.encode_footer(len(head) if end else 0, 0, end) + MCAP_MAGIC


def _summary(inside: list[Record]) -> list[Record]:
    """Definitions, chunk indexes and statistics of what is in a file; none where its records do not allow it."""
    try:
        return _told(inside)
    except (struct.error, UnicodeDecodeError):
        return []


def _told(inside: list[Record]) -> list[Record]:
    defined: dict[bytes, Record] = {}
    indexes: list[ChunkIndex] = []
    counts: dict[int, int] = {}
    at = len(MCAP_MAGIC)
    for record in inside:
        within = [record]
        if record.opcode == Opcode.CHUNK:
            start_ns, end_ns, size, _ = CHUNK_HEAD.unpack_from(record.content)
            (n,) = struct.unpack_from("<I", record.content, CHUNK_HEAD.size)
            name_at = CHUNK_HEAD.size + 4
            compression = record.content[name_at : name_at + n].decode(errors="replace")
            stored = len(record.content) - name_at - n - 8
            indexes.append(ChunkIndex(start_ns, end_ns, at, len(record.bytes), {}, 0, compression, stored, size))
            try:
                within = split(opened(record)[3])
            except Exception:  # what is in it can't be told
                within = []
        elif record.opcode == Opcode.MESSAGE_INDEX and indexes and len(record.content) >= 2:
            index = indexes[-1]
            offsets = {**index.index_offsets, int.from_bytes(record.content[:2], "little"): at}
            length = at + len(record.bytes) - index.chunk_start - index.chunk_length
            indexes[-1] = index._replace(index_offsets=offsets, index_length=length)
        for each in within:
            if each.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                defined.setdefault(bytes([each.opcode]) + each.content[:2], each)
            elif each.opcode == Opcode.MESSAGE and len(each.content) >= 2:
                channel = int.from_bytes(each.content[:2], "little")
                counts[channel] = counts.get(channel, 0) + 1
        at += len(record.bytes)
    n_schemas = sum(each.opcode == Opcode.SCHEMA for each in defined.values())
    counted = Statistics(sum(counts.values()), n_schemas, len(defined) - n_schemas, 0, 0, len(indexes), 0, 0, counts)
    written = [record_bytes.encode_record(counted), *map(record_bytes.encode_record, indexes)]
    return [*defined.values(), *split(b"".join(written))]
