"""Records through the kernels that find the messages, or the metadata, in them; and through their slow twins."""

from __future__ import annotations

import struct
from array import array

import numpy as np

from cwcli.kernels.message_scan import DAMAGED, DONE, FULL, Messages, scan_messages
from cwcli.kernels.metadata_scan import scan_metadata, scan_metadata_index
from cwcli.logs.format import record_bytes
from cwcli.logs.format.records import MetadataIndex, Opcode
from tests.fuzz.mutate import Rng, mutate

N_INPUTS = 16
MESSAGE = 5
WANTED = (1, 7, 0xFFFF)
PREFIX, HEADER = struct.Struct("<BQ"), struct.Struct("<HIQQ")
Row = tuple[int, int, int, int, int, int]


def check_scan(rng: Rng) -> dict[str, int]:
    """Records of several chunks; counts of inputs."""
    accepted = 0
    for _ in range(N_INPUTS):
        data = mutate(rng, b"".join(_record(rng) for _ in range(int(rng.integers(12)))))
        capacity = int(rng.integers(1, 8))
        wanted = np.zeros(1 << 16, np.uint8)
        wanted[list(WANTED)] = 1
        room = Messages(capacity)
        at, status = scan_messages(np.array(bytearray(data), np.uint8), 0, len(data), wanted, room)
        columns = (room.channel_id, room.sequence, room.log_time_ns, room.publish_time_ns)
        places = (room.payload_start, room.payload_end)
        found = list(zip(*(each[: room.n].tolist() for each in (*columns, *places)), strict=True))
        assert (found, at, status) == scanned(data, capacity)
        accepted += status != DAMAGED
    for _ in range(N_INPUTS):
        accepted += _check_metadata(rng)
    return {"inputs": 2 * N_INPUTS, "accepted": accepted, "compared": 2 * N_INPUTS}


def _check_metadata(rng: Rng) -> bool:
    """Whether all records were noted."""
    opcode = int(rng.choice([Opcode.METADATA, Opcode.METADATA_INDEX]))
    texts = [str(rng.choice(["", "run", "ä", "name of a record"])) for _ in range(30)]
    names = iter(texts)
    records = [
        record_bytes.encode_metadata(next(names), {next(names): next(names)} if rng.random() < 0.5 else {})
        if opcode == Opcode.METADATA
        else record_bytes.encode_record(MetadataIndex(int(rng.integers(1 << 63)), 7, next(names)))
        for _ in range(int(rng.integers(10)))
    ]
    data = mutate(rng, b"".join(records))
    capacity = int(rng.integers(1, 12))
    room, found = array("Q", bytes(16 * capacity)), list[str]()
    scan = scan_metadata if opcode == Opcode.METADATA else scan_metadata_index
    at, n = scan(np.array(bytearray(data), np.uint8).data, 1000, room, found)
    assert n == len(found)
    rows = [(*room[2 * k : 2 * k + 2], name) for k, name in enumerate(found)]
    assert (rows, at) == _metadata(data, opcode, capacity)
    return at == len(data)


def _metadata(data: bytes, opcode: int, capacity: int) -> tuple[list[tuple[int, int, str]], int]:
    """What the kernels must find: offset, length and name of each record, and where they stop."""
    rows: list[tuple[int, int, str]] = []
    at = 0
    while len(rows) < capacity and at + PREFIX.size <= len(data) and data[at] == opcode:
        end = at + PREFIX.size + PREFIX.unpack_from(data, at)[1]
        content = data[at + PREFIX.size : end]
        try:
            if end > len(data):
                break
            if opcode == Opcode.METADATA_INDEX:
                rows.append((*struct.unpack_from("<QQ", content), _text(content, 16)[0]))
            else:
                name, name_end = _text(content, 0)
                (length,) = struct.unpack_from("<I", content, name_end)
                entries, k = content[name_end + 4 : name_end + 4 + length], 0
                if len(entries) < length:
                    break
                while k < len(entries):
                    for _ in range(2):
                        _, k = _text(entries, k)
                rows.append((1000 + at, end - at, name))
        except (struct.error, ValueError):
            break
        at = end
    return rows, at


def _text(data: bytes, at: int) -> tuple[str, int]:
    """A text, and where it ends.

    Raises:
        struct.error, ValueError: There is none.
    """
    (length,) = struct.unpack_from("<I", data, at)
    if len(data) < at + 4 + length:
        raise ValueError("it is cut")
    return data[at + 4 : at + 4 + length].decode(), at + 4 + length


def scanned(data: bytes, capacity: int) -> tuple[list[Row], int, int]:
    """What `scan_messages` must find: the rows, where it stops, and why."""
    rows: list[Row] = []
    at = 0
    while at < len(data):
        if len(data) - at < PREFIX.size or data[at] == 0:
            return rows, at, DAMAGED
        opcode, length = PREFIX.unpack_from(data, at)
        start = at + PREFIX.size
        if length > len(data) - start or (opcode == MESSAGE and length < HEADER.size):
            return rows, at, DAMAGED
        if opcode == MESSAGE:
            channel, sequence, log_ns, publish_ns = HEADER.unpack_from(data, start)
            if channel in WANTED:
                if len(rows) == capacity:
                    return rows, at, FULL
                log_ns, publish_ns = (each - (1 << 64) if each >> 63 else each for each in (log_ns, publish_ns))
                rows.append((channel, sequence, log_ns, publish_ns, start + HEADER.size, start + length))
        at = start + length
    return rows, at, DONE


def _record(rng: Rng) -> bytes:
    opcode = int(rng.choice([MESSAGE, MESSAGE, MESSAGE, 3, 4, 0x80]))
    channel = int(rng.choice([*WANTED, 2]))
    content = HEADER.pack(channel, 5, int(rng.integers(1 << 63)), 1 << 63) + rng.bytes(int(rng.integers(30)))
    return PREFIX.pack(opcode, len(content)) + content
