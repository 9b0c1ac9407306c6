# Reads numbers of any width out of octets, the highest bit first.

cdef enum:
    READ_OK = 0
    READ_SHORT = 1
    READ_FRAGMENTED = 4


cdef struct Reader:
    const unsigned char* data
    long long at        # bits
    long long end       # bits
    int status


cdef inline long long take(Reader* r, long long width) noexcept nogil:
    """Up to 63 bits; 0 and a status behind the end."""
    cdef long long value = 0
    cdef long long at = r.at
    cdef long long left = width
    cdef int have, use
    if width > r.end - at:
        r.status = READ_SHORT
        return 0
    while left > 0:
        have = 8 - <int>(at & 7)
        use = have if left >= have else <int>left
        value = (value << use) | ((r.data[at >> 3] >> (have - use)) & ((1 << use) - 1))
        at += use
        left -= use
    r.at = at
    return value


cdef inline void skip(Reader* r, long long n_bits) noexcept nogil:
    if n_bits > r.end - r.at:
        r.status = READ_SHORT
    else:
        r.at += n_bits


cdef inline long long take_length(Reader* r) noexcept nogil:
    """A length determinant without bounds (X.691, 11.9)."""
    if not take(r, 1):
        return take(r, 7)
    if not take(r, 1):
        return take(r, 14)
    r.status = READ_FRAGMENTED
    return 0
