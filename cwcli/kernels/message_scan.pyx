# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Walks MCAP records and notes the messages; dictionary-codes strings."""

from libc.string cimport memcmp, memcpy

import numpy as np

cdef enum:
    OPCODE_MESSAGE = 5
    PREFIX_BYTES = 9
    HEADER_BYTES = 22

DONE = 0
DAMAGED = 1
FULL = 2


cdef inline unsigned long long u64(const unsigned char* at) noexcept nogil:
    cdef unsigned long long value
    memcpy(&value, at, 8)
    return value


cdef class Messages:
    """Room for messages, and those that were noted.

    Attributes:
        n: How many were noted.
        channel_id, sequence, log_time_ns, publish_time_ns, payload_start, payload_end: Shape (capacity,); the first n
            count.
    """

    cdef readonly Py_ssize_t n
    cdef readonly object channel_id, sequence, log_time_ns, publish_time_ns, payload_start, payload_end

    def __init__(self, Py_ssize_t capacity):
        self.n = 0
        self.channel_id, self.sequence = np.empty(capacity, np.uint16), np.empty(capacity, np.uint32)
        self.log_time_ns, self.publish_time_ns = np.empty(capacity, np.int64), np.empty(capacity, np.int64)
        self.payload_start, self.payload_end = np.empty(capacity, np.int64), np.empty(capacity, np.int64)


def scan_messages(
    const unsigned char[::1] data, Py_ssize_t start, Py_ssize_t end, const unsigned char[::1] is_wanted, Messages found
):
    """Note the messages of wanted channels among the records in data[start:end].

    Args:
        data: Records, one behind the other.
        start, end: Where to walk.
        is_wanted: Shape (65536,), by channel id.
        found: Written from its beginning.

    Returns:
        Where the walk stopped, and DONE, DAMAGED (a record does not fit) or FULL.
    """
    cdef unsigned short[::1] channel_id = found.channel_id
    cdef unsigned int[::1] sequence = found.sequence
    cdef long long[::1] log_time_ns = found.log_time_ns, publish_time_ns = found.publish_time_ns
    cdef long long[::1] payload_start = found.payload_start, payload_end = found.payload_end
    cdef Py_ssize_t at = start, content, n = 0, capacity = channel_id.shape[0]
    cdef unsigned long long length
    cdef const unsigned char* p = &data[0] if data.shape[0] else NULL
    cdef unsigned short channel
    cdef int status = 0
    with nogil:
        while at < end:
            if end - at < PREFIX_BYTES or p[at] == 0:
                status = 1
                break
            length = u64(p + at + 1)
            content = at + PREFIX_BYTES
            if length > <unsigned long long>(end - content):
                status = 1
                break
            if p[at] == OPCODE_MESSAGE:
                if length < HEADER_BYTES:
                    status = 1
                    break
                memcpy(&channel, p + content, 2)
                if is_wanted[channel]:
                    if n == capacity:
                        status = 2
                        break
                    channel_id[n] = channel
                    memcpy(&sequence[n], p + content + 2, 4)
                    memcpy(&log_time_ns[n], p + content + 6, 8)
                    memcpy(&publish_time_ns[n], p + content + 14, 8)
                    payload_start[n] = content + HEADER_BYTES
                    payload_end[n] = content + <Py_ssize_t>length
                    n += 1
            at = content + <Py_ssize_t>length
    found.n = n
    return at, status


def intern_spans(
    const unsigned char[::1] data,
    const long long[:, ::1] spans,
    int[::1] codes,
    dict known,
    list values,
):
    """Dictionary-code spans of bytes.

    Args:
        data: What the spans look into.
        spans: Shape (n, 2): start and length. A start of -1 means absent.
        codes: Written, shape (n,); -1 where absent.
        known: Bytes -> code; grows.
        values: Distinct bytes by code; grows.
    """
    cdef Py_ssize_t k, n = spans.shape[0]
    cdef long long start, length, last_start = -1, last_length = -1
    cdef const unsigned char* p = &data[0] if data.shape[0] else NULL
    cdef int code = -1
    for k in range(n):
        start = spans[k, 0]
        length = spans[k, 1]
        if start < 0:
            codes[k] = -1
            continue
        if length != last_length or memcmp(p + start, p + last_start, length) != 0:
            text = (<const char*>(p + start))[:length] if length else b""
            found = known.get(text)
            if found is None:
                found = len(values)
                known[text] = found
                values.append(text)
            code = found
            last_start = start
            last_length = length
        codes[k] = code
