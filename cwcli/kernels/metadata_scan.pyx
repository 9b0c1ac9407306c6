# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Walks metadata records, and the records that index them, where many follow one another."""

from cpython.bytes cimport PyBytes_FromStringAndSize
from libc.string cimport memcpy

cdef enum:
    OPCODE_METADATA = 12
    OPCODE_METADATA_INDEX = 13
    PREFIX_BYTES = 9
    TEXT_PREFIX_BYTES = 4


def scan_metadata(
    const unsigned char[::1] data, unsigned long long offset, unsigned long long[::1] places, list names
):
    """Note metadata records that follow one another, up to one that is not whole, not in order, or of another kind.

    Args:
        data: Records, one behind the other.
        offset: Where `data` begins in the file.
        places: Written: where each begins in the file, and its length, prefix included, in turns.
        names: Their names are appended.

    Returns:
        Where the walk stopped in `data`, and how many were noted.
    """
    cdef Py_ssize_t at = 0, end = data.shape[0], stop, name, inner, n = 0
    cdef const unsigned char* p = &data[0] if data.shape[0] else NULL
    while 2 * n + 1 < places.shape[0]:
        stop = end_of_record(p, at, end, OPCODE_METADATA)
        if stop < 0:
            break
        name = end_of_text(p, at + PREFIX_BYTES, stop)
        inner = end_of_text(p, name, stop) if name >= 0 else -1
        if inner < 0:
            break
        try:
            if not are_texts(p, name + TEXT_PREFIX_BYTES, inner):
                break
            names.append(decoded(p, at + PREFIX_BYTES + TEXT_PREFIX_BYTES, name))
        except UnicodeDecodeError:
            break
        places[2 * n], places[2 * n + 1] = offset + at, stop - at
        n += 1
        at = stop
    return at, n


def scan_metadata_index(
    const unsigned char[::1] data, unsigned long long offset, unsigned long long[::1] places, list names
):
    """As `scan_metadata`, for records that index metadata; `places` is what they say."""
    cdef Py_ssize_t at = 0, end = data.shape[0], stop, name, n = 0
    cdef const unsigned char* p = &data[0] if data.shape[0] else NULL
    while 2 * n + 1 < places.shape[0]:
        stop = end_of_record(p, at, end, OPCODE_METADATA_INDEX)
        if stop < 0:
            break
        name = end_of_text(p, at + PREFIX_BYTES + 16, stop)
        if name < 0:
            break
        try:
            names.append(decoded(p, at + PREFIX_BYTES + 16 + TEXT_PREFIX_BYTES, name))
        except UnicodeDecodeError:
            break
        memcpy(&places[2 * n], p + at + PREFIX_BYTES, 16)
        n += 1
        at = stop
    return at, n


cdef Py_ssize_t end_of_record(const unsigned char* p, Py_ssize_t at, Py_ssize_t end, unsigned char opcode) noexcept:
    """Where a whole record of a kind ends; -1 if there is none."""
    cdef unsigned long long length
    if end - at < PREFIX_BYTES or p[at] != opcode:
        return -1
    memcpy(&length, p + at + 1, 8)
    at += PREFIX_BYTES
    return at + <Py_ssize_t>length if length <= <unsigned long long>(end - at) else -1


cdef Py_ssize_t end_of_text(const unsigned char* p, Py_ssize_t at, Py_ssize_t end) noexcept:
    """Where bytes end that stand behind their 32-bit length; -1 if they do not fit."""
    cdef unsigned int length
    if end - at < TEXT_PREFIX_BYTES:
        return -1
    memcpy(&length, p + at, TEXT_PREFIX_BYTES)
    at += TEXT_PREFIX_BYTES
    return at + <Py_ssize_t>length if length <= <unsigned long long>(end - at) else -1


cdef int are_texts(const unsigned char* p, Py_ssize_t at, Py_ssize_t end) except -1:
    """Whether pairs of texts fill a map.

    Raises:
        UnicodeDecodeError: One is no UTF-8.
    """
    cdef Py_ssize_t stop
    cdef int n = 0
    while at < end:
        stop = end_of_text(p, at, end)
        if stop < 0:
            return False
        decoded(p, at + TEXT_PREFIX_BYTES, stop)
        at = stop
        n ^= 1
    return n == 0


cdef object decoded(const unsigned char* p, Py_ssize_t start, Py_ssize_t end):
    return PyBytes_FromStringAndSize(<const char*>p + start, end - start).decode()
