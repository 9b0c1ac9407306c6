"""The records of a chunk through the kernel that finds the messages in them, and through its slow twin."""

from __future__ import annotations

import struct

import numpy as np

from cwcli.kernels.message_scan import DAMAGED, DONE, FULL, Messages, scan_messages
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
    return {"inputs": N_INPUTS, "accepted": accepted, "compared": N_INPUTS}


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
