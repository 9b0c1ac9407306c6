# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Walks JSON messages along a tree of known keys and puts the wanted leaves into columns.

Whatever is unusual makes the message `STATUS_ODD`: Python's json module then decides. That is invalid text, keys with escapes,
keys that come twice, integers of more than 18 digits, and nesting beyond 200 levels.

Source: RFC 8259, and NaN, Infinity and -Infinity as Python's json module reads them.
"""

from libc.math cimport INFINITY, NAN
from libc.stdlib cimport calloc, free, strtod
from libc.string cimport memcmp, memcpy

cdef enum:
    MAX_DEPTH = 200
    MAX_NUMBER_BYTES = 60
    MAX_EXACT_POWER = 22
    MAX_INTEGER_DIGITS = 18
    MAX_MANTISSA_DIGITS = 19

# Kinds of values; `cwcli.logs.codecs.json_columns` uses the same numbers.
cdef enum:
    T_ABSENT = 0
    T_NULL = 1
    T_BOOL = 2
    T_INT = 3
    T_FLOAT = 4
    T_STRING = 5        # value: offset in the message << 32 | size
    T_ARRAY = 6         # with at least one value in it that is neither an object nor an array
    T_ESCAPED = 7       # as T_STRING, with escapes in it

cdef enum:
    E_KEY = 0           # where the key begins in `keys`
    E_SIZE = 1          # or -1 for a key that JSON writes with escapes
    E_SLOT = 2          # or -1
    E_CHILD = 3         # node of the object below, or -1
    N_COLUMNS = 4

cdef enum:
    S_OK = 0
    S_ODD = 1
    S_UNKNOWN_KEY = 2
    S_NOT_ASCII = 3

STATUS_OK = S_OK
STATUS_ODD = S_ODD
STATUS_UNKNOWN_KEY = S_UNKNOWN_KEY
STATUS_NOT_ASCII = S_NOT_ASCII

cdef enum:
    ODD = -1
    UNKNOWN = -2

cdef double[23] POWERS
for _k in range(23):
    POWERS[_k] = float("1e%d" % _k)

cdef extern from "<float.h>":
    const int LDBL_MANT_DIG

cdef enum:
    MAX_EXTENDED_POWER = 27     # 5^27 < 2^64

cdef long double[28] EXTENDED_POWERS
EXTENDED_POWERS[0] = 1
for _k in range(1, 28):
    EXTENDED_POWERS[_k] = EXTENDED_POWERS[_k - 1] * 10


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


cdef Py_ssize_t read_string(State* s, Py_ssize_t at, bint* has_escape) noexcept nogil:
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


cdef Py_ssize_t read_word(
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


cdef Py_ssize_t read_number(State* s, Py_ssize_t at, int entry, bint in_array) noexcept nogil:
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


cdef Py_ssize_t read_value(State* s, Py_ssize_t at, int entry, bint in_array, int depth) noexcept nogil:
    """One value, from its first character; returns where it ends, ODD or UNKNOWN."""
    cdef unsigned char c
    cdef Py_ssize_t begin
    cdef bint has_escape
    if at >= s.end:
        return ODD
    c = s.p[at]
    if c == 34:
        begin = at + 1
        at = read_string(s, begin, &has_escape)
        if at < 0:
            return at
        store(
            s, entry, in_array, T_ESCAPED if has_escape else T_STRING,
            (<long long>(begin - s.start) << 32) | <long long>(at - begin),
        )
        return at + 1
    if c == 123:
        return read_object(s, at + 1, entry, in_array, depth + 1)
    if c == 91:
        return read_array(s, at + 1, entry, in_array, depth + 1)
    if c == 45 or is_digit(c):
        return read_number(s, at, entry, in_array)
    if c == 116:
        return read_word(s, at, entry, in_array, "true", 4, T_BOOL, 1)
    if c == 102:
        return read_word(s, at, entry, in_array, "false", 5, T_BOOL, 0)
    if c == 110:
        return read_word(s, at, entry, in_array, "null", 4, T_NULL, 0)
    if c == 78:
        return read_word(s, at, entry, in_array, "NaN", 3, T_FLOAT, bits_of(NAN))
    if c == 73:
        return read_word(s, at, entry, in_array, "Infinity", 8, T_FLOAT, bits_of(INFINITY))
    return ODD


cdef Py_ssize_t read_array(State* s, Py_ssize_t at, int entry, bint in_array, int depth) noexcept nogil:
    cdef int slot = -1
    cdef long long before = 0
    if depth > MAX_DEPTH:
        return ODD
    if entry >= 0 and not in_array:
        slot = (s.entries + N_COLUMNS * entry)[E_SLOT]
    if slot >= 0:
        before = s.cursors[slot]
    at = skip_space(s, at)
    if at < s.end and s.p[at] == 93:
        return at + 1
    while True:
        at = read_value(s, at, entry, True, depth)
        if at < 0:
            return at
        at = skip_space(s, at)
        if at >= s.end:
            return ODD
        if s.p[at] == 93:
            if slot >= 0 and s.cursors[slot] > before:
                store(s, entry, False, T_ARRAY, 0)
            return at + 1
        if s.p[at] != 44:
            return ODD
        at = skip_space(s, at + 1)


cdef Py_ssize_t read_object(State* s, Py_ssize_t at, int entry, bint in_array, int depth) noexcept nogil:
    """From behind the opening brace. The root is entry -2."""
    cdef int node = -1, first = 0, n_entries = 0, guess = 0, k, found
    cdef Py_ssize_t begin, size
    cdef bint has_escape
    cdef long long serial
    cdef const int* row
    if depth > MAX_DEPTH:
        return ODD
    if entry == -2:
        node = 0
    elif entry >= 0:
        node = (s.entries + N_COLUMNS * entry)[E_CHILD]
        if node < 0 and s.learns:
            return UNKNOWN
    if node >= 0:
        first = s.nodes[2 * node]
        n_entries = s.nodes[2 * node + 1]
    s.serial += 1
    serial = s.serial
    at = skip_space(s, at)
    if at < s.end and s.p[at] == 125:
        return at + 1
    while True:
        if at >= s.end or s.p[at] != 34:
            return ODD
        begin = at + 1
        found = -1
        if guess < n_entries:
            # Most often it is the key that followed this one in the message before.
            row = s.entries + N_COLUMNS * (first + guess)
            size = row[E_SIZE]
            if size >= 0 and size < s.end - begin and s.p[begin + size] == 34:
                if memcmp(s.keys + row[E_KEY], s.p + begin, size) == 0:
                    found = first + guess
                    guess += 1
        if found >= 0:
            at = begin + size
            if s.stamps[found] == serial:
                return ODD
            s.stamps[found] = serial
        else:
            at = read_string(s, begin, &has_escape)
            if at < 0:
                return at
        if found < 0 and node >= 0:
            if has_escape:
                return ODD
            size = at - begin
            for k in range(n_entries):
                if guess >= n_entries:
                    guess = 0
                row = s.entries + N_COLUMNS * (first + guess)
                if row[E_SIZE] == size and memcmp(s.keys + row[E_KEY], s.p + begin, size) == 0:
                    found = first + guess
                    guess += 1
                    break
                guess += 1
            if found >= 0:
                if s.stamps[found] == serial:
                    return ODD
                s.stamps[found] = serial
            elif s.learns:
                return UNKNOWN
        at = skip_space(s, at + 1)
        if at >= s.end or s.p[at] != 58:
            return ODD
        at = read_value(s, skip_space(s, at + 1), found, in_array, depth)
        if at < 0:
            return at
        at = skip_space(s, at)
        if at >= s.end:
            return ODD
        if s.p[at] == 125:
            return at + 1
        if s.p[at] != 44:
            return ODD
        at = skip_space(s, at + 1)


def walk(
    const unsigned char[::1] data,
    const long long[::1] starts,
    const long long[::1] ends,
    const unsigned char[::1] keys,
    const int[:, ::1] entries,
    const int[:, ::1] nodes,
    const long long[::1] tags,
    const long long[::1] values,
    const long long[::1] element_tags,
    const long long[::1] element_values,
    long long[::1] cursors,
    const long long[::1] cursor_columns,
    bint learns,
    Py_ssize_t begin,
    Py_ssize_t first_row,
    unsigned char[::1] status,
):
    """Decode messages into rows `first_row` and following, whose tags must be zero.

    Args:
        data: What starts and ends look into.
        starts, ends: Shape (n,).
        keys: All keys, one behind the other.
        entries: Shape (m, 4): key's start and size, slot, node of the object below. At least one row.
        nodes: Shape (k, 2): first entry and number of entries of each object; node 0 is the message.
        tags, values: Addresses of row 0 of each slot's uint8 and int64 columns.
        element_tags, element_values: Addresses of each slot's buffers for elements of arrays.
        cursors: Elements written in each slot; grows.
        cursor_columns: Addresses of int64 arrays of shape (n,): the cursor of each slot after each message.
        learns: Stop at a message with an unknown key.
        begin: First message to decode.
        first_row: Row of message 0.
        status: Written, shape (n,).

    Returns:
        n, or the message that holds an unknown key.
    """
    cdef Py_ssize_t k, s, at, n = starts.shape[0], n_slots = cursors.shape[0]
    cdef State state
    cdef long long* before
    cdef long long* memory = <long long*>calloc(n_slots + entries.shape[0] + 1, 8)
    if memory == NULL:
        raise MemoryError
    before = memory
    state.p = &data[0] if data.shape[0] else NULL
    state.keys = &keys[0] if keys.shape[0] else NULL
    state.entries = &entries[0, 0]
    state.nodes = &nodes[0, 0]
    state.tags = &tags[0] if n_slots else NULL
    state.values = &values[0] if n_slots else NULL
    state.element_tags = &element_tags[0] if n_slots else NULL
    state.element_values = &element_values[0] if n_slots else NULL
    state.cursors = &cursors[0] if n_slots else NULL
    state.stamps = memory + n_slots
    state.serial = 0
    state.learns = learns
    with nogil:
        for k in range(begin, n):
            for s in range(n_slots):
                before[s] = cursors[s]
            state.start = starts[k]
            state.end = ends[k]
            state.row = first_row + k
            state.has_high = False
            at = skip_space(&state, starts[k])
            if at < state.end and state.p[at] == 123:
                at = read_object(&state, at + 1, -2, False, 1)
                if at >= 0 and skip_space(&state, at) != state.end:
                    at = ODD
            else:
                at = ODD
            if at < 0:
                for s in range(n_slots):
                    cursors[s] = before[s]
                    (<unsigned char*><size_t>tags[s])[first_row + k] = 0
                if at == UNKNOWN:
                    status[k] = S_UNKNOWN_KEY
                    break
                status[k] = S_ODD
            else:
                status[k] = S_NOT_ASCII if state.has_high else S_OK
            for s in range(n_slots):
                (<long long*><size_t>cursor_columns[s])[k] = cursors[s]
        else:
            k = n
    free(memory)
    return k
