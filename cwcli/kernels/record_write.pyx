# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Writes the records of a chunk one behind the other, and the entries of its message indexes."""

from cpython.bytearray cimport PyByteArray_AsString
from cpython.bytes cimport PyBytes_AsString, PyBytes_FromStringAndSize
from libc.stdint cimport uint8_t, uint16_t, uint32_t, uint64_t
from libc.string cimport memcpy

cdef enum:
    OPCODE_MESSAGE = 5
    PREFIX_BYTES = 9
    HEADER_BYTES = 22
    INDEX_ENTRY_BYTES = 16


def write_records(list pieces, dict counts, dict entries, bytearray out):
    cdef uint8_t* start = <uint8_t*> PyByteArray_AsString(out)
    cdef uint8_t* at
    cdef Py_ssize_t offset = 0, end = len(out), n
    cdef uint64_t length, log_time_ns, first_ns = <uint64_t> -1, last_ns = 0
    cdef uint16_t channel_id
    cdef uint32_t sequence
    cdef uint64_t[2] entry
    cdef object piece, key, time, payload, count, index_bytes
    for piece in pieces:
        if isinstance(piece, bytes):
            n = len(<bytes> piece)
            if n > end - offset:
                raise ValueError("the records need more room")
            memcpy(start + offset, PyBytes_AsString(piece), n)
            offset += n
            continue
        key, time, payload = <tuple?> piece
        n = len(<bytes?> payload)
        if PREFIX_BYTES + HEADER_BYTES + n > end - offset:
            raise ValueError("the records need more room")
        channel_id, log_time_ns = key, time
        count = counts.get(key, 0)
        sequence = <uint32_t> (<uint64_t> count)
        counts[key] = count + 1
        length = HEADER_BYTES + n
        at = start + offset
        at[0] = OPCODE_MESSAGE
        memcpy(at + 1, &length, 8)
        memcpy(at + 9, &channel_id, 2)
        memcpy(at + 11, &sequence, 4)
        memcpy(at + 15, &log_time_ns, 8)
        memcpy(at + 23, &log_time_ns, 8)
        memcpy(at + PREFIX_BYTES + HEADER_BYTES, PyBytes_AsString(payload), n)
        index_bytes = entries.get(key)
        if index_bytes is None:
            index_bytes = entries[key] = bytearray()
        entry[0], entry[1] = log_time_ns, <uint64_t> offset
        index_bytes += PyBytes_FromStringAndSize(<char*> entry, INDEX_ENTRY_BYTES)
        first_ns, last_ns = min(first_ns, log_time_ns), max(last_ns, log_time_ns)
        offset += PREFIX_BYTES + HEADER_BYTES + n
    if offset != end:
        raise ValueError("the records need less room")
    return first_ns, last_ns
