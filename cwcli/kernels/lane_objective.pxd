# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Inline parts of the kernel `lane_ridge`: the objective of a lane of five numbers."""

cdef enum:
    N = 5
    BEND_TAIL = 9  # squared sigmas: most roads are straight, and some bend, so the prior of the bend has heavy tails


cdef inline float at(const float* row, Py_ssize_t width, double x) noexcept nogil:
    cdef Py_ssize_t i
    cdef float part
    if not (0.0 <= x <= width - 1.0):
        return 0.0
    i = <Py_ssize_t>x
    if i >= width - 1:
        return row[width - 1]
    part = <float>(x - i)
    return row[i] + part * (row[i + 1] - row[i])


cdef inline void natural(const double* code, double near_v, double far_v, double* values) noexcept nogil:
    """(left, right column at near_v, centre at far_v, bend in pixels at far_v, horizon) -> (u0, middle, width, k, v0)."""
    cdef double near_h = near_v - code[4], far_h = far_v - code[4]
    cdef double centre = 0.5 * (code[0] + code[1])
    if far_h < 1.0:
        far_h = 1.0
    if near_h < far_h + 1.0:
        near_h = far_h + 1.0
    cdef double k = code[3] * far_h
    cdef double middle = (centre - code[2] - k * (1.0 / near_h - 1.0 / far_h)) / (near_h - far_h)
    values[0] = centre - middle * near_h - k / near_h
    values[1] = middle
    values[2] = (code[1] - code[0]) / near_h
    values[3] = k
    values[4] = code[4]


cdef struct Line:
    int* column
    float* part


cdef inline void place_line(
    const double* h, const double* base, double place, Py_ssize_t start, Py_ssize_t n, Line line
) noexcept nogil:
    """Where a line lies in each row: a pixel, and the part of the way to the next one; vector code."""
    cdef Py_ssize_t r
    cdef double x
    cdef int column
    for r in range(start, n):
        x = base[r] + place * h[r]
        column = <int>(x + 1.0) - 1  # below zero for all x below zero
        line.column[r] = column
        line.part[r] = <float>(x - column)


cdef inline double along_line(
    const float* evidence, Py_ssize_t width, Line line, Py_ssize_t start, Py_ssize_t stop
) noexcept nogil:
    """The evidence in some rows, linear between pixels."""
    cdef Py_ssize_t r
    cdef double total = 0.0
    cdef const float* pixel
    for r in range(start, stop):
        if <unsigned int>line.column[r] < <unsigned int>(width - 1):
            pixel = evidence + r * width + line.column[r]
            total += pixel[0] + line.part[r] * (pixel[1] - pixel[0])
    return total


cdef inline double judge(
    const float[:, ::1] evidence, const float[:, ::1] broad, const int[::1] rows, const double* values,
    const double[:, ::1] prior, double weight, double min_h, double beside, double half,
    int segment, double* scratch
) noexcept nogil:
    """The objective of a lane; `scratch` has room for six numbers a row."""
    cdef Py_ssize_t n = evidence.shape[0], width = evidence.shape[1], r = 0, start, stop
    cdef double total = 0.0, z, penalty = 0.0, left, right
    cdef double* h = scratch
    cdef double* base = scratch + n
    cdef Line lines[4]
    cdef int k
    for k in range(N):
        if not (prior[k, 2] <= values[k] <= prior[k, 3]):
            return -1e30
        z = (values[k] - prior[k, 0]) / prior[k, 1]
        z *= z
        penalty += z / (1.0 + z / <double>BEND_TAIL) if k == 3 else z
    while r < n and not rows[r] - values[4] >= min_h:
        r += 1
    start = r
    for r in range(start, n):
        h[r] = rows[r] - values[4]
        base[r] = values[0] + values[3] / h[r]
    for k in range(4 if beside > 0.0 else 2):
        lines[k].column = <int*>(scratch + (2 + k) * n)
        lines[k].part = <float*>(lines[k].column + n)
        z = (0.5 if k < 2 else 1.5) * values[2]
        place_line(h, base, values[1] + z if k % 2 else values[1] - z, start, n, lines[k])
    stop = (start // segment) * segment
    while stop < n:
        stop += segment
        if stop > n:
            stop = n
        left = along_line(&evidence[0, 0], width, lines[0], start, stop)
        right = along_line(&evidence[0, 0], width, lines[1], start, stop)
        total += left / (left + half) + right / (right + half)
        if beside > 0.0:
            left = along_line(&broad[0, 0], width, lines[2], start, stop)
            right = along_line(&broad[0, 0], width, lines[3], start, stop)
            total += beside * (left / (left + half) + right / (right + half))
        start = stop
    return total * segment / n - weight * penalty
