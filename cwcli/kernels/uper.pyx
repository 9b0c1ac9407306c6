# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Decodes messages in ASN.1's unaligned packed encoding (ITU-T X.691) along a compiled type, many at once."""

from cwcli.kernels.bit_reader cimport Reader, skip, take, take_length

cdef enum:
    N_WORDS = 8
    MAX_FRAMES = 48

# Operations; each is a row (code, a, b, c, d, table, column, jump) of int64. `cwcli.signals.radio.program` makes them.
# A value goes to `column` of the row that `table` is at (0: the message's, k: that of the list's element); column -1:
# to nowhere.
cpdef enum:
    UPER_END = 0        # of the message
    UPER_INT = 1        # a bits; `b` more; at most `c` before `b` is added
    UPER_INT_EXT = 2    # as INT, behind the bit of an extensible range
    UPER_ENUM_EXT = 3   # as INT, behind the bit of an extensible enumeration: a later value counts from c + 1
    UPER_BIG = 4        # octets with a length before: a = 1 not negative, counted from `b`; a = 0 two's complement
    UPER_SIZED = 5      # `b` to `c` units of `a` bits, their number in `d` bits; jump = 1 extensible; c = -1 no bound
    UPER_SEQUENCE = 6   # a = 1 extensible; b optional components
    UPER_OPTION = 7     # to `jump` where the next optional component is absent
    UPER_SEQUENCE_END = 8
    UPER_CHOICE = 9     # index in `a` bits, of `b`; c = 1 extensible; rows ALTERNATIVE follow; a later one: to `jump`
    UPER_ALTERNATIVE = 10   # (at `jump`); by itself a jump
    UPER_LIST = 11      # `b` to `c` elements, their number in `a` bits; d = 1 extensible; `jump` behind its end
    UPER_LIST_END = 12
    UPER_OPEN = 13      # a length in octets, then by the last number one of `b` rows CASE (a); unknown: to `jump`
    UPER_CASE = 14
    UPER_OPEN_END = 15

# what `bit_reader` says of a message has the same numbers here
cpdef enum:
    UPER_OK
    UPER_SHORT          # the message ends before its last component
    UPER_RANGE          # a code that the type has no value for
    UPER_LENGTH         # an open type is longer than what is in it
    UPER_FRAGMENTED     # a length of 16,384 or more, which no radio message has
    UPER_FULL           # not the message's fault: a table has no room

cdef struct Frame:
    unsigned long long options  # of a sequence: presence, first component in the highest bit; of a list: elements left
    long long end       # of the open type around, or the list's first operation
    int table
    bint is_extended


cdef long long take_small(Reader* r) noexcept nogil:
    """A normally small number (X.691, 11.6)."""
    cdef long long size, value
    if not take(r, 1):
        return take(r, 6)
    size = take_length(r)
    if size > 7:
        r.status = UPER_RANGE
        return 0
    value = take(r, 8 * size)
    return value


cdef long long take_big(Reader* r, bint is_positive) noexcept nogil:
    """An integer in octets with their number before."""
    cdef long long size = take_length(r)
    cdef long long value
    if size < 1 or size > (7 if is_positive else 8):
        if r.status == UPER_OK:
            r.status = UPER_RANGE
        return 0
    if size == 8:
        value = take(r, 8)
        if value >= 128:
            value -= 256
        return value * (<long long>1 << 56) + take(r, 56)
    value = take(r, 8 * size)
    if not is_positive and value >> (8 * size - 1):
        value -= <long long>1 << (8 * size)
    return value


cdef void skip_extensions(Reader* r) noexcept nogil:
    """The additions of a sequence that are later than its type (X.691, 19.7 to 19.9)."""
    cdef long long n, k, bits_at, size
    if not take(r, 1):
        n = take(r, 6) + 1
    else:
        n = take_length(r)
    bits_at = r.at
    skip(r, n)
    for k in range(n):
        if r.status != UPER_OK:
            return
        if (r.data[(bits_at + k) >> 3] >> (7 - ((bits_at + k) & 7))) & 1:
            size = take_length(r)
            if r.status == UPER_OK:
                skip(r, 8 * size)


cdef int walk_one(
    Reader* r, const long long* program, long long row, const long long* tables, long long* counts,
    long long* current, long long missing
) noexcept nogil:
    """One message into its row and the rows of its lists; a status."""
    cdef Frame[MAX_FRAMES] frames
    cdef int depth = 0
    cdef long long pc = 0
    cdef long long last = 0
    cdef long long value, n, k, width
    cdef const long long* op
    cdef bint is_extended
    cdef Frame* frame
    while True:
        op = program + pc * N_WORDS
        pc += 1
        if op[0] == UPER_INT:
            value = take(r, op[1])
            if value > op[3] and r.status == UPER_OK:
                r.status = UPER_RANGE
            last = value + op[2]
        elif op[0] == UPER_INT_EXT or op[0] == UPER_ENUM_EXT:
            if not take(r, 1):
                value = take(r, op[1])
                if value > op[3] and r.status == UPER_OK:
                    r.status = UPER_RANGE
                last = value + op[2]
            elif op[0] == UPER_ENUM_EXT:
                last = op[3] + 1 + take_small(r) + op[2]
            else:
                last = take_big(r, False)
        elif op[0] == UPER_BIG:
            last = take_big(r, op[1] == 1) + op[2]
        elif op[0] == UPER_SIZED:
            is_extended = op[7] == 1 and take(r, 1) == 1
            if is_extended or op[3] < 0:
                n = take_length(r)
                if n < op[2] and r.status == UPER_OK:
                    r.status = UPER_RANGE
            else:
                n = take(r, op[4]) + op[2]
                if n > op[3] and r.status == UPER_OK:
                    r.status = UPER_RANGE
            width = op[1] * op[2] if op[1] * op[2] <= 63 else 63
            if r.status == UPER_OK:
                k = r.at
                last = take(r, width)
                r.at = k
                skip(r, n * op[1])
        elif op[0] == UPER_SEQUENCE:
            frame = &frames[depth]
            depth += 1
            frame.is_extended = op[1] == 1 and take(r, 1) == 1
            frame.options = (<unsigned long long>take(r, op[2])) << (64 - op[2]) if op[2] else 0
            if r.status != UPER_OK:
                return r.status
            continue
        elif op[0] == UPER_OPTION:
            frame = &frames[depth - 1]
            if not frame.options >> 63:
                pc = op[7]
            frame.options <<= 1
            continue
        elif op[0] == UPER_SEQUENCE_END:
            depth -= 1
            if frames[depth].is_extended:
                skip_extensions(r)
                if r.status != UPER_OK:
                    return r.status
            continue
        elif op[0] == UPER_CHOICE:
            is_extended = op[3] == 1 and take(r, 1) == 1
            if is_extended:
                last = op[2] + take_small(r)
                n = take_length(r)
                if r.status == UPER_OK:
                    skip(r, 8 * n)
                pc = op[7]
            else:
                last = take(r, op[1])
                if last >= op[2] and r.status == UPER_OK:
                    r.status = UPER_RANGE
                pc += last
        elif op[0] == UPER_ALTERNATIVE:
            pc = op[7]
            continue
        elif op[0] == UPER_LIST:
            is_extended = op[4] == 1 and take(r, 1) == 1
            if is_extended or op[3] < 0:
                n = take_length(r)
            else:
                n = take(r, op[1]) + op[2]
                if n > op[3] and r.status == UPER_OK:
                    r.status = UPER_RANGE
            if r.status != UPER_OK:
                return r.status
            if n == 0:
                pc = op[7]
                continue
            frame = &frames[depth]
            depth += 1
            frame.options = <unsigned long long>n
            frame.end = pc
            frame.table = <int>op[5]
            if not begin_element(frame.table, row, tables, counts, current, missing):
                return UPER_FULL
            continue
        elif op[0] == UPER_LIST_END:
            frame = &frames[depth - 1]
            frame.options -= 1
            if frame.options:
                pc = frame.end
                if not begin_element(frame.table, row, tables, counts, current, missing):
                    return UPER_FULL
            else:
                depth -= 1
            continue
        elif op[0] == UPER_OPEN:
            n = take_length(r)
            if r.status != UPER_OK:
                return r.status
            if 8 * n > r.end - r.at:
                return UPER_SHORT
            for k in range(op[2]):
                if (op + (k + 1) * N_WORDS)[1] == last:
                    pc = (op + (k + 1) * N_WORDS)[7]
                    frame = &frames[depth]
                    depth += 1
                    frame.end = r.end
                    r.end = r.at + 8 * n
                    break
            else:
                r.at += 8 * n
                pc = op[7]
            continue
        elif op[0] == UPER_OPEN_END:
            depth -= 1
            if r.end - r.at >= 8:
                return UPER_LENGTH
            r.at = r.end
            r.end = frames[depth].end
            continue
        else:
            return r.status
        if r.status != UPER_OK:
            return r.status
        if op[6] >= 0:
            (<long long*>tables[3 * op[5]])[current[op[5]] * tables[3 * op[5] + 1] + op[6]] = last


cdef inline bint begin_element(
    int table, long long row, const long long* tables, long long* counts, long long* current, long long missing
) noexcept nogil:
    """A fresh row of a list's table; whether there is room."""
    cdef long long k
    cdef long long* cells
    if table == 0:
        return True
    if counts[table] >= tables[3 * table + 2]:
        return False
    current[table] = counts[table]
    cells = (<long long*>tables[3 * table]) + counts[table] * tables[3 * table + 1]
    counts[table] += 1
    cells[0] = row
    for k in range(1, tables[3 * table + 1]):
        cells[k] = missing
    return True


def decode(
    const unsigned char[::1] data,
    const long long[::1] starts,
    const long long[::1] ends,
    *,
    const long long[:, ::1] program,
    const long long[:, ::1] tables,
    long long[::1] counts,
    long long[::1] current,
    Py_ssize_t first,
    long long missing,
    unsigned char[::1] status,
) -> int:
    """Decode messages from `first` on; how many of all are done, fewer where a table is full. See the `.pyi`."""
    cdef Py_ssize_t row, table, column
    cdef Py_ssize_t n_tables = len(counts)
    cdef Py_ssize_t n_rows = len(starts)
    cdef Py_ssize_t done = n_rows
    cdef Reader reader
    cdef long long[64] before
    cdef long long* cells
    cdef int found
    if n_tables > 64 or not n_rows or not len(data):
        return n_rows
    with nogil:
        for row in range(first, n_rows):
            if status[row] != UPER_OK:
                continue
            for table in range(n_tables):
                before[table] = counts[table]
            current[0] = row
            reader.data = &data[0]
            reader.at = 8 * starts[row]
            reader.end = 8 * ends[row]
            reader.status = UPER_OK
            found = walk_one(&reader, &program[0, 0], row, &tables[0, 0], &counts[0], &current[0], missing)
            if found != UPER_OK:
                for table in range(n_tables):
                    counts[table] = before[table]
                cells = (<long long*>tables[0, 0]) + row * tables[0, 1]
                for column in range(tables[0, 1]):
                    cells[column] = missing
                if found == UPER_FULL:
                    done = row
                    break
                status[row] = found
    return done
