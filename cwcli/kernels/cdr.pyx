# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Walks CDR messages along a compiled layout and puts the wanted leaves into columns."""

from libc.stdlib cimport free, malloc
from libc.string cimport memcpy

cdef enum:
    MAX_DEPTH = 16

# Operations; each is a row (code, align, size, count, slot, jump) of int32. `cwcli.logs.codecs.cdr_program` makes them.
cpdef enum:
    OP_SKIP = 0         # align, skip `size * count` bytes
    OP_FIXED = 1        # align, copy `count` elements of `size` bytes into the slot's row
    OP_STRING = 2       # a string; its span goes into the slot if there is one
    OP_SEQUENCE = 3     # count, then that many elements of `size` bytes; appended to the ragged slot if there is one
    OP_LOOP = 4         # count, then the body that many times; `jump` is the operation behind its end
    OP_REPEAT = 5       # the body `count` times
    OP_END = 6          # end of a body
    OP_APPEND = 7       # as FIXED, appended to the ragged slot
    OP_BLOB = 8         # a byte sequence; its span goes into the slot

cpdef enum:
    STATUS_OK
    STATUS_SHORT
    STATUS_FOREIGN


cdef struct Layout:
    const int* program
    Py_ssize_t n_ops
    const int* program_v2
    Py_ssize_t n_ops_v2
    const long long* slots
    const long long* ragged
    long long* cursors


cdef inline void copy_elements(
    unsigned char* target, const unsigned char* source, Py_ssize_t size, Py_ssize_t count, bint is_swapped
) noexcept nogil:
    cdef Py_ssize_t k, b
    if not is_swapped or size == 1:
        if size == 8 and count == 1:
            memcpy(target, source, 8)
        elif size == 4 and count == 1:
            memcpy(target, source, 4)
        else:
            memcpy(target, source, size * count)
        return
    for k in range(count):
        for b in range(size):
            target[k * size + b] = source[k * size + size - 1 - b]


def walk(
    const unsigned char[::1] data,
    const long long[::1] starts,
    const long long[::1] ends,
    *,
    const int[:, ::1] program,
    const int[:, ::1] program_v2,
    const long long[::1] slots,
    const long long[::1] ragged,
    long long[::1] cursors,
    const long long[::1] cursor_columns,
    Py_ssize_t first_row,
    unsigned char[::1] status,
):
    """Decode messages into rows `first_row` and following.

    Args:
        data: What starts and ends look into.
        starts, ends: Shape (n,), each message with its encapsulation header.
        program: Shape (m, 6), for plain CDR (XCDR1).
        program_v2: The same for plain CDR of XCDR2 (no alignment above 4); no rows where there is none.
        slots: Addresses of the fixed slots' row 0. Rows of strings and blobs are two int64: start and length in `data`.
        ragged: Addresses of the ragged slots' buffers, each large enough for all bytes of all messages.
        cursors: Bytes written in each ragged buffer; grows.
        cursor_columns: Addresses of int64 arrays of shape (n,): the cursor of each slot after each message.
        first_row: Row of message 0 in the fixed slots.
        status: Written, shape (n,). Rows that are not STATUS_OK hold nothing of use, and nothing in the ragged buffers.
    """
    cdef Py_ssize_t k, n = starts.shape[0], n_ragged = ragged.shape[0], s
    cdef const unsigned char* p = &data[0] if data.shape[0] else NULL
    cdef int result
    cdef long long* before = <long long*>malloc(8 * (n_ragged + 1))
    cdef Layout layout
    layout.program = &program[0, 0] if program.shape[0] else NULL
    layout.n_ops = program.shape[0]
    layout.program_v2 = &program_v2[0, 0] if program_v2.shape[0] else NULL
    layout.n_ops_v2 = program_v2.shape[0]
    layout.slots = &slots[0] if slots.shape[0] else NULL
    layout.ragged = &ragged[0] if n_ragged else NULL
    layout.cursors = &cursors[0] if n_ragged else NULL
    if before == NULL:
        raise MemoryError
    with nogil:
        for k in range(n):
            for s in range(n_ragged):
                before[s] = cursors[s]
            result = walk_one(p, starts[k], ends[k], &layout, first_row + k)
            status[k] = result
            for s in range(n_ragged):
                if result:
                    cursors[s] = before[s]
                (<long long*><size_t>cursor_columns[s])[k] = cursors[s]
    free(before)


cdef int walk_one(
    const unsigned char* p, Py_ssize_t start, Py_ssize_t end, const Layout* layout, Py_ssize_t row
) noexcept nogil:
    cdef const int* program = layout.program
    cdef const long long* slots = layout.slots
    cdef const long long* ragged = layout.ragged
    cdef long long* cursors = layout.cursors
    cdef Py_ssize_t base = start + 4, at = base, pc = 0, n_ops = layout.n_ops, total
    cdef unsigned int length
    cdef bint is_swapped
    cdef int depth = 0, slot
    cdef unsigned char kind
    cdef const int* op
    cdef long long[16] left
    cdef Py_ssize_t[16] body
    cdef long long* span
    if end - start < 4:
        return STATUS_SHORT
    if p[start] != 0:
        return STATUS_FOREIGN
    kind = p[start + 1]
    if kind == 6 or kind == 7:
        program = layout.program_v2
        n_ops = layout.n_ops_v2
        if program == NULL:
            return STATUS_FOREIGN
    elif kind > 1:
        return STATUS_FOREIGN
    is_swapped = kind & 1 == 0
    while pc < n_ops:
        op = program + 6 * pc
        pc += 1
        slot = op[4]
        if op[0] == OP_SKIP or op[0] == OP_FIXED or op[0] == OP_APPEND:
            at = base + ((at - base + op[1] - 1) & ~<Py_ssize_t>(op[1] - 1))
            total = <Py_ssize_t>op[2] * op[3]
            if total > end - at:
                return STATUS_SHORT
            if op[0] == OP_FIXED:
                copy_elements(<unsigned char*><size_t>slots[slot] + row * total, p + at, op[2], op[3], is_swapped)
            elif op[0] == OP_APPEND:
                copy_elements(<unsigned char*><size_t>ragged[slot] + cursors[slot], p + at, op[2], op[3], is_swapped)
                cursors[slot] += total
            at += total
            continue
        if op[0] == OP_END:
            left[depth - 1] -= 1
            if left[depth - 1] > 0:
                pc = body[depth - 1]
            else:
                depth -= 1
            continue
        if op[0] == OP_REPEAT:
            left[depth] = op[3]
            body[depth] = pc
            depth += 1
            continue
        # The rest begins with a 32-bit count.
        at = base + ((at - base + 3) & ~<Py_ssize_t>3)
        if end - at < 4:
            return STATUS_SHORT
        if is_swapped:
            length = (<unsigned int>p[at] << 24) | (<unsigned int>p[at + 1] << 16) | (p[at + 2] << 8) | p[at + 3]
        else:
            memcpy(&length, p + at, 4)
        at += 4
        if op[0] == OP_STRING or op[0] == OP_BLOB:
            if length > <size_t>(end - at):
                return STATUS_SHORT
            if slot >= 0:
                span = <long long*><size_t>slots[slot] + 2 * row
                span[0] = at
                # A string's length counts its final NUL; some writers give an empty one the length 0.
                span[1] = length - 1 if op[0] == OP_STRING and length else length
            at += length
        elif op[0] == OP_SEQUENCE:
            if not length:
                continue
            at = base + ((at - base + op[1] - 1) & ~<Py_ssize_t>(op[1] - 1))
            if end < at or length > <size_t>(end - at) / <size_t>op[2]:
                return STATUS_SHORT
            total = <Py_ssize_t>length * op[2]
            if slot >= 0:
                copy_elements(<unsigned char*><size_t>ragged[slot] + cursors[slot], p + at, op[2], length, is_swapped)
                cursors[slot] += total
            at += total
        else:  # OP_LOOP
            if length == 0:
                pc = op[5]
            elif length > <size_t>(end - at):
                return STATUS_SHORT
            else:
                left[depth] = length
                body[depth] = pc
                depth += 1
    return STATUS_OK
