# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Inline parts of the JSON kernel: the cursor, and what a value is: strings, words, numbers."""

from libc.math cimport INFINITY, NAN
from libc.stdlib cimport strtod
from libc.string cimport memcmp, memcpy

from cwcli.kernels.json_walk cimport T_ABSENT, T_ARRAY, T_FLOAT, T_INT

cdef enum:
    MAX_DEPTH = 200
    MAX_NUMBER_BYTES = 60
    MAX_EXACT_POWER = 22
    MAX_INTEGER_DIGITS = 18
    MAX_MANTISSA_DIGITS = 19

cdef enum:
    E_KEY = 0           # where the key begins in `keys`
    E_SIZE = 1          # or -1 for a key that JSON writes with escapes
    E_SLOT = 2          # or -1
    E_CHILD = 3         # node of the object below, or -1
    N_COLUMNS = 4

cdef enum:
    ODD = -1
    UNKNOWN = -2

cdef extern from "<float.h>":
    const int LDBL_MANT_DIG

cdef enum:
    MAX_EXTENDED_POWER = 27     # 5^27 < 2^64

cdef extern from *:
    """
    /* Each is exact: 5^22 fits the 53 bits of a double, 5^27 the 64 bits of an x86 long double. */
    static const double POWERS[] = {
        1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19,
        1e20, 1e21, 1e22};
    static const long double EXTENDED_POWERS[] = {
        1e0L, 1e1L, 1e2L, 1e3L, 1e4L, 1e5L, 1e6L, 1e7L, 1e8L, 1e9L, 1e10L, 1e11L, 1e12L, 1e13L, 1e14L, 1e15L, 1e16L,
        1e17L, 1e18L, 1e19L, 1e20L, 1e21L, 1e22L, 1e23L, 1e24L, 1e25L, 1e26L, 1e27L};
    """
    const double POWERS[23]
    const long double EXTENDED_POWERS[28]


cdef inline bint extended_quotient(unsigned long long mantissa, int scale, double* value) noexcept nogil:
    """mantissa * 10^scale, correctly rounded; False where that is not sure.

    In the 64-bit significands of x86 both numbers are exact, so the result is off by half a unit of the 64th bit at most.
    Rounding it to 53 bits is right unless the eleven bits that go lie next to the middle.
    """
    cdef long double result
    cdef unsigned long long bits
    if LDBL_MANT_DIG != 64 or scale < -MAX_EXTENDED_POWER or scale > MAX_EXTENDED_POWER:
        return False
    result = <long double>mantissa
    result = result / EXTENDED_POWERS[-scale] if scale < 0 else result * EXTENDED_POWERS[scale]
    memcpy(&bits, &result, 8)
    if 0x3FF <= (bits & 0x7FF) <= 0x401:
        return False
    value[0] = <double>result
    return True


cdef struct State:
    const unsigned char* p
    Py_ssize_t start
    Py_ssize_t end
    Py_ssize_t row
    const unsigned char* keys
    const int* entries
    const int* nodes
    const long long* tags
    const long long* values
    const long long* element_tags
    const long long* element_values
    long long* cursors
    long long* stamps
    long long serial
    bint learns
    bint has_high


cdef inline bint is_space(unsigned char c) noexcept nogil:
    return c == 32 or c == 10 or c == 13 or c == 9


cdef inline bint is_digit(unsigned char c) noexcept nogil:
    return 48 <= c <= 57


cdef inline Py_ssize_t skip_space(const State* s, Py_ssize_t at) noexcept nogil:
    while at < s.end and is_space(s.p[at]):
        at += 1
    return at


cdef inline void store(State* s, int entry, bint in_array, unsigned char tag, long long value) noexcept nogil:
    cdef int slot
    cdef long long cursor
    if entry < 0:
        return
    slot = (s.entries + N_COLUMNS * entry)[E_SLOT]
    if slot < 0:
        return
    if in_array:
        cursor = s.cursors[slot]
        (<unsigned char*><size_t>s.element_tags[slot])[cursor] = tag
        (<long long*><size_t>s.element_values[slot])[cursor] = value
        s.cursors[slot] = cursor + 1
    else:
        (<unsigned char*><size_t>s.tags[slot])[s.row] = tag
        (<long long*><size_t>s.values[slot])[s.row] = value


cdef inline Py_ssize_t read_string(State* s, Py_ssize_t at, bint* has_escape) noexcept nogil:
    """From behind the opening quote; returns where the closing one is, or ODD."""
    cdef unsigned char c
    cdef int k
    has_escape[0] = False
    while at < s.end:
        c = s.p[at]
        if c == 34:
            return at
        if c < 32:
            return ODD
        if c >= 128:
            s.has_high = True
        elif c == 92:
            has_escape[0] = True
            at += 1
            if at >= s.end:
                return ODD
            c = s.p[at]
            if c == 117:
                if s.end - at < 5:
                    return ODD
                for k in range(1, 5):
                    c = s.p[at + k]
                    if not (is_digit(c) or 65 <= c <= 70 or 97 <= c <= 102):
                        return ODD
                at += 4
            elif not (c == 34 or c == 92 or c == 47 or c == 98 or c == 102 or c == 110 or c == 114 or c == 116):
                return ODD
        at += 1
    return ODD


cdef inline Py_ssize_t read_word(
    State* s, Py_ssize_t at, int entry, bint in_array, const char* word, int size, unsigned char tag, long long value
) noexcept nogil:
    if s.end - at < size or memcmp(s.p + at, word, size) != 0:
        return ODD
    store(s, entry, in_array, tag, value)
    return at + size


cdef inline long long bits_of(double value) noexcept nogil:
    cdef long long bits
    memcpy(&bits, &value, 8)
    return bits


cdef inline Py_ssize_t read_number(State* s, Py_ssize_t at, int entry, bint in_array) noexcept nogil:
    cdef Py_ssize_t begin = at
    cdef bint is_negative = False, is_float = False, exponent_negative = False
    cdef unsigned long long mantissa = 0
    cdef int n_digits = 0, scale = 0, exponent = 0
    cdef double value
    cdef char[64] text
    if s.p[at] == 45:
        is_negative = True
        at += 1
        if at < s.end and s.p[at] == 73:
            return read_word(s, at, entry, in_array, "Infinity", 8, T_FLOAT, bits_of(-INFINITY))
    if at >= s.end or not is_digit(s.p[at]):
        return ODD
    if s.p[at] == 48:
        at += 1
        if at < s.end and is_digit(s.p[at]):
            return ODD
    else:
        while at < s.end and is_digit(s.p[at]):
            if n_digits < MAX_MANTISSA_DIGITS:
                mantissa = 10 * mantissa + (s.p[at] - 48)
            n_digits += 1
            at += 1
    if at < s.end and s.p[at] == 46:
        is_float = True
        at += 1
        if at >= s.end or not is_digit(s.p[at]):
            return ODD
        while at < s.end and is_digit(s.p[at]):
            if n_digits < MAX_MANTISSA_DIGITS:
                mantissa = 10 * mantissa + (s.p[at] - 48)
            if n_digits or s.p[at] != 48:
                n_digits += 1
            scale -= 1
            at += 1
    if at < s.end and (s.p[at] == 101 or s.p[at] == 69):
        is_float = True
        at += 1
        if at < s.end and (s.p[at] == 43 or s.p[at] == 45):
            exponent_negative = s.p[at] == 45
            at += 1
        if at >= s.end or not is_digit(s.p[at]):
            return ODD
        while at < s.end and is_digit(s.p[at]):
            if exponent < 100000:
                exponent = 10 * exponent + (s.p[at] - 48)
            at += 1
        scale += -exponent if exponent_negative else exponent
    if entry < 0 or (s.entries + N_COLUMNS * entry)[E_SLOT] < 0:
        return at
    if not is_float:
        if n_digits > MAX_INTEGER_DIGITS:
            return ODD
        store(s, entry, in_array, T_INT, -<long long>mantissa if is_negative else <long long>mantissa)
        return at
    # Exact where both numbers are exact doubles (Clinger 1990): one correctly rounded operation.
    if n_digits <= MAX_MANTISSA_DIGITS and mantissa <= (<unsigned long long>1 << 53) and -MAX_EXACT_POWER <= scale <= MAX_EXACT_POWER:
        value = <double>mantissa
        value = value / POWERS[-scale] if scale < 0 else value * POWERS[scale]
        if is_negative:
            value = -value
    elif n_digits <= MAX_MANTISSA_DIGITS and extended_quotient(mantissa, scale, &value):
        if is_negative:
            value = -value
    else:
        if at - begin > MAX_NUMBER_BYTES:
            return ODD
        memcpy(text, s.p + begin, at - begin)
        text[at - begin] = 0
        value = strtod(text, NULL)
    store(s, entry, in_array, T_FLOAT, bits_of(value))
    return at
