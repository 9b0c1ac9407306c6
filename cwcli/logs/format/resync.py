"""Finds the next record after damage.

MCAP has no markers between records. A record counts as plausible if its length leads to a further record, and so on for
a few records or to the file's end; a chunk counts as plausible if its own three lengths agree.
"""

from __future__ import annotations

from collections.abc import Container

import numpy as np

from cwcli.logs.format.records import (
    MCAP_MAGIC,
    MESSAGE_HEADER_BYTES,
    RECORD_PREFIX,
    ByteSource,
    Opcode,
    RecordError,
    read_chunk,
    read_opcode_and_content_range,
)

N_CONSECUTIVE_RECORDS_TO_VERIFY = 4
"""The number of consecutive records that must be plausible. Chosen by hand."""
SEARCH_BLOCK_BYTES = 4 << 20
"""Bytes that are searched at a time. Chosen by hand."""
N_ZERO_HIGH_BYTES_OF_RECORD_LENGTH = 3
"""Number of high bytes of a record length that must be zero: records are shorter than 2^40 bytes. Chosen by hand."""


def find_next_record_offset_or_end(data: ByteSource, at: int, known_channel_ids: Container[int]) -> int:
    """Return the offset of the next plausible record at or after `at`; the length of the file if there is none.

    Args:
        known_channel_ids: As the file defines them; messages of other channels are not plausible.
    """
    last = len(data) - RECORD_PREFIX.size
    while at < last:
        stop = min(at + SEARCH_BLOCK_BYTES, last)
        octets = np.frombuffer(data[at : stop + RECORD_PREFIX.size], np.uint8)
        opcodes = octets[: stop - at]
        believable = (opcodes >= 1) & (opcodes <= Opcode.DATA_END)
        for k in range(RECORD_PREFIX.size - N_ZERO_HIGH_BYTES_OF_RECORD_LENGTH, RECORD_PREFIX.size):
            believable &= octets[k : k + stop - at] == 0
        for candidate in (np.flatnonzero(believable) + at).tolist():
            if is_plausible_record(data, candidate, known_channel_ids):
                return int(candidate)
        at = stop
    return len(data)


def is_plausible_record(data: ByteSource, at: int, known_channel_ids: Container[int]) -> bool:
    """Tell whether a plausible record begins at an offset; arguments as for `find_next_record_offset_or_end`."""
    for _ in range(N_CONSECUTIVE_RECORDS_TO_VERIFY):
        try:
            opcode, start, end = read_opcode_and_content_range(data, at, len(data))
            if opcode == Opcode.CHUNK:
                chunk = read_chunk(data, start, end)
                return chunk.data_start + chunk.data_length == end
        except RecordError:
            return False
        if opcode == Opcode.FOOTER:
            return data[end : end + len(MCAP_MAGIC)] == MCAP_MAGIC
        is_known = opcode <= Opcode.DATA_END
        if opcode == Opcode.MESSAGE:
            is_long_enough = end - start >= MESSAGE_HEADER_BYTES
            is_known = is_long_enough and int.from_bytes(data[start : start + 2], "little") in known_channel_ids
        if not is_known or end == len(data):
            return is_known
        at = end
    return True
