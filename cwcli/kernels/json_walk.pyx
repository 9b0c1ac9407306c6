# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Walks JSON messages along a tree of known keys and puts the wanted leaves into columns.

Whatever is unusual makes the message `STATUS_ODD`: Python's json module then decides. That is invalid text, keys with escapes,
keys that come twice, integers of more than 18 digits, and nesting beyond 200 levels.

Source: RFC 8259, and NaN, Infinity and -Infinity as Python's json module reads them.
"""

from libc.math cimport INFINITY, NAN
from libc.stdlib cimport calloc, free
from libc.string cimport memcmp

from cwcli.kernels.json_scan cimport (
    bits_of, E_CHILD, E_KEY, E_SIZE, E_SLOT, is_digit, MAX_DEPTH, N_COLUMNS, ODD, read_number, read_string,
    read_word, skip_space, State, store, UNKNOWN,
)


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
    *,
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
                    status[k] = STATUS_UNKNOWN_KEY
                    break
                status[k] = STATUS_ODD
            else:
                status[k] = STATUS_NOT_ASCII if state.has_high else STATUS_OK
            for s in range(n_slots):
                (<long long*><size_t>cursor_columns[s])[k] = cursors[s]
        else:
            k = n
    free(memory)
    return k
