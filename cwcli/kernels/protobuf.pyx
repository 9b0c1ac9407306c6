# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Walks protobuf messages along compiled tables and puts the wanted leaves into columns.

Whatever is unusual (a wire type that is not the declared one, a group, text beyond ASCII, two members of one oneof, damage)
makes the message `STATUS_ODD`: the official parser then decides.

Source: https://protobuf.dev/programming-guides/encoding/
"""

from libc.stdlib cimport free, malloc
from libc.string cimport memcpy, memset

cdef enum:
    MAX_DEPTH = 48

# Kinds of fields, for `cwcli.logs.codecs.protobuf_tables` too.
cpdef enum:
    VARINT64 = 1
    VARINT32 = 2
    ZIGZAG32 = 3
    ZIGZAG64 = 4
    BOOLEAN = 5
    FIXED32 = 6
    FIXED64 = 7
    TEXT = 8
    OCTETS = 9
    MESSAGE = 10
    GROUP = 11

# How a value is stored.
cpdef enum:
    STORE_NOT = 0       # walked over
    STORE_ROW = 1       # the slot's row; the last one wins
    STORE_APPEND = 2    # appended to the ragged slot: a repeated scalar
    STORE_ELEMENT = 3   # the last element of the ragged slot: a scalar in a repeated message

# Columns of the field table.
cpdef enum:
    F_NUMBER = 0
    F_KIND = 1
    F_REPEATED = 2
    F_STORE = 3
    F_SLOT = 4
    F_PRESENCE = 5      # slot of the presence flags, or -1
    F_ONEOF = 6         # slot of the oneof's last member, or -1
    F_CHILD = 7         # node of a message
    F_ELEMENTS = 8      # first of the ragged slots that a repeated message's element fills
    F_N_ELEMENTS = 9
    N_COLUMNS = 10

cpdef enum:
    STATUS_OK
    STATUS_ODD

cdef struct Tables:
    const int* fields
    const int* nodes        # node -> first field, number of fields
    const int* elements     # ragged slots, for F_ELEMENTS
    const long long* slots
    const long long* ragged
    long long* cursors
    const long long* presence
    const long long* oneofs


cdef inline int size_of(int kind) noexcept nogil:
    if kind == BOOLEAN:
        return 1
    if kind == VARINT32 or kind == ZIGZAG32 or kind == FIXED32:
        return 4
    return 8


cdef inline int wire_of(int kind) noexcept nogil:
    if kind <= BOOLEAN:
        return 0
    if kind == FIXED32:
        return 5
    if kind == FIXED64:
        return 1
    return 2


cdef inline Py_ssize_t read_varint(
    const unsigned char* p, Py_ssize_t at, Py_ssize_t end, unsigned long long* value
) noexcept nogil:
    """Returns where it ends, or -1."""
    cdef unsigned long long result = 0
    cdef int shift = 0
    cdef unsigned char octet
    while at < end:
        octet = p[at]
        at += 1
        if shift == 63 and octet > 1:
            return -1
        result |= (<unsigned long long>(octet & 0x7F)) << shift
        if octet < 0x80:
            value[0] = result
            return at
        shift += 7
        if shift > 63:
            return -1
    return -1


cdef inline Py_ssize_t read_scalar(
    const unsigned char* p, Py_ssize_t at, Py_ssize_t end, int kind, unsigned char* target
) noexcept nogil:
    """Decode one scalar into `target`; returns where it ends, or -1."""
    cdef unsigned long long value
    cdef unsigned int narrow
    if kind == FIXED64:
        if end - at < 8:
            return -1
        memcpy(target, p + at, 8)
        return at + 8
    if kind == FIXED32:
        if end - at < 4:
            return -1
        memcpy(target, p + at, 4)
        return at + 4
    at = read_varint(p, at, end, &value)
    if at < 0:
        return -1
    if kind == VARINT64:
        memcpy(target, &value, 8)
    elif kind == ZIGZAG64:
        value = (value >> 1) ^ (0 - (value & 1))
        memcpy(target, &value, 8)
    elif kind == BOOLEAN:
        target[0] = value != 0
    else:
        narrow = <unsigned int>value
        if kind == ZIGZAG32:
            narrow = (narrow >> 1) ^ (0 - (narrow & 1))
        memcpy(target, &narrow, 4)
    return at


cdef inline Py_ssize_t skip_unknown(const unsigned char* p, Py_ssize_t at, Py_ssize_t end, int wire) noexcept nogil:
    cdef unsigned long long value
    if wire == 0:
        return read_varint(p, at, end, &value)
    if wire == 1:
        return at + 8 if end - at >= 8 else -1
    if wire == 5:
        return at + 4 if end - at >= 4 else -1
    if wire == 2:
        at = read_varint(p, at, end, &value)
        if at < 0 or value > <unsigned long long>(end - at):
            return -1
        return at + <Py_ssize_t>value
    return -1


def walk(
    const unsigned char[::1] data,
    const long long[::1] starts,
    const long long[::1] ends,
    *,
    const int[:, ::1] fields,
    const int[:, ::1] nodes,
    const int[::1] elements,
    const long long[::1] slots,
    const long long[::1] presence,
    const long long[::1] oneofs,
    const long long[::1] ragged,
    long long[::1] cursors,
    const long long[::1] cursor_columns,
    Py_ssize_t first_row,
    unsigned char[::1] status,
):
    """Decode messages into rows `first_row` and following, which must be zero.

    Args:
        data: What starts and ends look into.
        starts, ends: Shape (n,).
        fields: Shape (m, 10), the fields of all nodes; a node's fields lie together. Row 0 is the field of no node.
        nodes: Shape (k, 2): first field and number of fields of each message type; node 0 is the root.
        elements: Ragged slots of repeated messages' elements; at least one entry.
        slots: Addresses of the fixed slots' row 0; strings and blobs are two int64, start and length in `data`.
        presence: Addresses of uint8 columns: 1 where a field was there.
        oneofs: Addresses of int32 columns for the kernel's own use.
        ragged: Addresses of the ragged slots' buffers, each with room for 8 bytes per byte of all messages.
        cursors, cursor_columns, first_row, status: As in `cwcli.kernels.cdr.walk`.
    """
    cdef Py_ssize_t k, s, n = starts.shape[0], n_ragged = cursors.shape[0]
    cdef const unsigned char* p = &data[0] if data.shape[0] else NULL
    cdef long long* before = <long long*>malloc(8 * (n_ragged + 1))
    cdef Tables tables
    cdef int result
    tables.fields = &fields[0, 0]
    tables.nodes = &nodes[0, 0]
    tables.elements = &elements[0]
    tables.slots = &slots[0] if slots.shape[0] else NULL
    tables.presence = &presence[0] if presence.shape[0] else NULL
    tables.oneofs = &oneofs[0] if oneofs.shape[0] else NULL
    tables.ragged = &ragged[0] if ragged.shape[0] else NULL
    tables.cursors = &cursors[0] if n_ragged else NULL
    if before == NULL:
        raise MemoryError
    with nogil:
        for k in range(n):
            for s in range(n_ragged):
                before[s] = cursors[s]
            result = walk_one(p, starts[k], ends[k], 0, &tables, first_row + k, 0)
            status[k] = result
            for s in range(n_ragged):
                if result:
                    cursors[s] = before[s]
                (<long long*><size_t>cursor_columns[s])[k] = cursors[s]
    free(before)


cdef int walk_one(
    const unsigned char* p, Py_ssize_t at, Py_ssize_t end, int node, const Tables* tables, Py_ssize_t row, int depth
) noexcept nogil:
    cdef const int* first = tables.fields + N_COLUMNS * tables.nodes[2 * node]
    cdef int n_fields = tables.nodes[2 * node + 1]
    cdef int guess = 0, k, kind, wire, slot, size
    cdef unsigned long long tag, length
    cdef Py_ssize_t stop, octet
    cdef const int* field
    cdef unsigned char[8] scratch
    cdef unsigned char* target
    cdef long long* span
    cdef int* member
    if depth > MAX_DEPTH:
        return STATUS_ODD
    while at < end:
        at = read_varint(p, at, end, &tag)
        if at < 0 or tag < 8 or (tag >> 32) != 0:
            return STATUS_ODD
        wire = <int>(tag & 7)
        field = NULL
        for k in range(n_fields):
            if guess >= n_fields:
                guess = 0
            if <unsigned long long>(first + N_COLUMNS * guess)[F_NUMBER] == tag >> 3:
                field = first + N_COLUMNS * guess
                break
            guess += 1
        if field == NULL:
            at = skip_unknown(p, at, end, wire)
            if at < 0:
                return STATUS_ODD
            continue
        kind = field[F_KIND]
        slot = field[F_SLOT]
        if not field[F_REPEATED]:
            guess += 1
        if field[F_PRESENCE] >= 0:
            (<unsigned char*><size_t>tables.presence[field[F_PRESENCE]])[row] = 1
        if field[F_ONEOF] >= 0:
            member = <int*><size_t>tables.oneofs[field[F_ONEOF]] + row
            if member[0] and member[0] != field[F_NUMBER]:
                return STATUS_ODD
            member[0] = field[F_NUMBER]
        if kind < TEXT:
            size = size_of(kind)
            if wire == wire_of(kind):
                if field[F_STORE] == STORE_ROW:
                    target = <unsigned char*><size_t>tables.slots[slot] + row * size
                elif field[F_STORE] == STORE_ELEMENT:
                    target = <unsigned char*><size_t>tables.ragged[slot] + tables.cursors[slot] - size
                elif field[F_STORE] == STORE_APPEND:
                    target = <unsigned char*><size_t>tables.ragged[slot] + tables.cursors[slot]
                    tables.cursors[slot] += size
                else:
                    target = scratch
                at = read_scalar(p, at, end, kind, target)
                if at < 0:
                    return STATUS_ODD
                continue
            if wire != 2 or not field[F_REPEATED]:
                return STATUS_ODD
            at = read_varint(p, at, end, &length)
            if at < 0 or length > <unsigned long long>(end - at):
                return STATUS_ODD
            stop = at + <Py_ssize_t>length
            if field[F_STORE] == STORE_APPEND and (kind == FIXED64 or kind == FIXED32):
                if length % size:
                    return STATUS_ODD
                memcpy(<unsigned char*><size_t>tables.ragged[slot] + tables.cursors[slot], p + at, length)
                tables.cursors[slot] += length
                at = stop
                continue
            while at < stop:
                target = scratch
                if field[F_STORE] == STORE_APPEND:
                    target = <unsigned char*><size_t>tables.ragged[slot] + tables.cursors[slot]
                    tables.cursors[slot] += size
                at = read_scalar(p, at, stop, kind, target)
                if at < 0:
                    return STATUS_ODD
            continue
        if kind == GROUP or wire != 2:
            return STATUS_ODD
        at = read_varint(p, at, end, &length)
        if at < 0 or length > <unsigned long long>(end - at):
            return STATUS_ODD
        stop = at + <Py_ssize_t>length
        if kind == MESSAGE:
            for k in range(field[F_N_ELEMENTS]):
                slot = tables.elements[field[F_ELEMENTS] + 2 * k]
                size = tables.elements[field[F_ELEMENTS] + 2 * k + 1]
                memset(<unsigned char*><size_t>tables.ragged[slot] + tables.cursors[slot], 0, size)
                tables.cursors[slot] += size
            if walk_one(p, at, stop, field[F_CHILD], tables, row, depth + 1):
                return STATUS_ODD
        else:
            if kind == TEXT:
                for octet in range(at, stop):
                    if p[octet] >= 0x80:
                        return STATUS_ODD
            if field[F_STORE] == STORE_ROW:
                span = <long long*><size_t>tables.slots[slot] + 2 * row
                span[0] = at
                span[1] = <long long>length
        at = stop
    return STATUS_OK
