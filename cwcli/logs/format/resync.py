"""Finding the next record behind damage.

MCAP has no markers between records. A record is believed where its length leads to a further record, and so on for a
few steps or to the file's end; a chunk is believed by its own three lengths, which must agree.
"""

from __future__ import annotations

from collections.abc import Container

import numpy as np

from cwcli.logs.format.records import (
    CHUNK,
    DATA_END,
    FOOTER,
    MAGIC,
    MESSAGE,
    MESSAGE_HEADER_BYTES,
    PREFIX,
    Data,
    RecordError,
    read_chunk,
    read_prefix,
)

N_STEPS = 4
BLOCK_BYTES = 4 << 20
LENGTH_HIGH_BYTES = 3  # of a length below 2^40


def next_record(data: Data, at: int, channels: Container[int]) -> int:
    """Offset of the next believable record at or behind `at`; the length of the file when there is none.

    Args:
        data: The file.
        at: Where to begin.
        channels: Known channel ids; messages of others are not believed.
    """
    last = len(data) - PREFIX.size
    while at < last:
        stop = min(at + BLOCK_BYTES, last)
        octets = np.frombuffer(data[at : stop + PREFIX.size], np.uint8)
        opcodes = octets[: stop - at]
        believable = (opcodes >= 1) & (opcodes <= DATA_END)
        for k in range(PREFIX.size - LENGTH_HIGH_BYTES, PREFIX.size):
            believable &= octets[k : k + stop - at] == 0
        for candidate in (np.flatnonzero(believable) + at).tolist():
            if is_record(data, candidate, channels):
                return int(candidate)
        at = stop
    return len(data)


def is_record(data: Data, at: int, channels: Container[int]) -> bool:
    """Whether a believable record begins at an offset; arguments as for `next_record`."""
    for _ in range(N_STEPS):
        try:
            opcode, start, end = read_prefix(data, at, len(data))
            if opcode == CHUNK:
                chunk = read_chunk(data, start, end)
                return chunk.data_start + chunk.data_length == end
        except RecordError:
            return False
        if opcode == FOOTER:
            return data[end : end + len(MAGIC)] == MAGIC
        is_known = opcode <= DATA_END
        if opcode == MESSAGE:
            is_long_enough = end - start >= MESSAGE_HEADER_BYTES
            is_known = is_long_enough and int.from_bytes(data[start : start + 2], "little") in channels
        if not is_known or end == len(data):
            return is_known
        at = end
    return True
