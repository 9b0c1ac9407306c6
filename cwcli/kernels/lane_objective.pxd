# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Inline parts of the kernel `lane_ridge`: the objective of a lane of five numbers, and where its boundaries lie.

The formulas of arcs are derived in cwcli/vision/arcs.py.
"""

from libc.math cimport NAN, fabs, sqrt, sqrtf

from cwcli.kernels.lane_ridge cimport BEND, HIGH, HORIZON, LOW, MEAN, MIDDLE, N, SIGMA, VANISHING, WIDTH

cdef enum:
    SCRATCH = 3  # numbers of eight bytes a row
    BEND_TAIL = 9  # squared sigmas: most roads are straight, and some bend, so the prior of the bend has heavy tails


cdef struct Scoring:
    double prior_weight  # of a squared sigma
    double min_h         # rows less than this below the horizon are not judged
    double beside        # weight of the neighbouring lanes' outer boundaries
    double half          # evidence of a segment that counts one half
    int segment          # rows in a segment
    double centre        # column of the principal point
    double focal         # fx


cdef struct Arc:
    # the circle through the camera's foot: a boundary's is concentric with it
    double origin, bend  # u0 and k
    double centre, focal
    double start         # sine of its direction beside the camera
    double rate          # what the sine gains, times h
    bint is_gentle       # no row that is judged shows the difference from a parabola


cdef inline double gentle() noexcept nogil:
    """So much the sine may gain: in columns, a thousandth / 8 of the focal length beside a parabola."""
    return 0.1


cdef inline double turned() noexcept nogil:
    """Where the sine is so great, the line ends: it is about to turn back."""
    return 0.97


cdef inline double least_rest() noexcept nogil:
    """Of a circle's radius, inside a boundary: farther in there is no lane."""
    return 0.2


cdef inline Arc arc_of(double origin, double bend, double least_h, double centre, double focal) noexcept nogil:
    cdef Arc made
    cdef double slope = (origin - centre) / focal, cosine = 1.0 / sqrt(1.0 + slope * slope)
    made.origin = origin
    made.bend = bend
    made.centre = centre
    made.focal = focal
    made.start = slope * cosine
    made.rate = 2.0 * bend * cosine * cosine * cosine / focal
    made.is_gentle = fabs(made.rate) <= gentle() * least_h
    return made


cdef inline double tighter(const Arc* arc, double place) noexcept nogil:
    """By so much a concentric circle is tighter."""
    cdef double rest = 1.0 - arc.rate * place / arc.focal
    return 1.0 / (rest if rest > least_rest() else least_rest())


cdef inline double column_of(const Arc* arc, double place, double h) noexcept nogil:
    """Where a boundary lies, h rows below the horizon; NaN where it has turned back."""
    cdef double own, start, sine
    if arc.is_gentle:
        return arc.origin + place * h + arc.bend / h
    own = tighter(arc, place)
    start = arc.start * own
    sine = (arc.start + arc.rate / h) * own
    if fabs(start) >= turned() or fabs(sine) >= turned():
        return NAN
    return arc.centre + place * h + arc.focal * (start + sine) / (sqrt(1.0 - start * start) + sqrt(1.0 - sine * sine))


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
    values[VANISHING] = centre - middle * near_h - k / near_h
    values[MIDDLE] = middle
    values[WIDTH] = (code[1] - code[0]) / near_h
    values[BEND] = k
    values[HORIZON] = code[4]


cdef struct Line:
    int* column
    float* part


cdef struct Scratch:
    # room for some numbers a row; h and inverse depend on the horizon alone
    double horizon
    Py_ssize_t start  # first row that is judged
    float* h
    float* inverse
    float* base
    Line line


cdef inline Scratch scratch_of(double* room, Py_ssize_t n) noexcept nogil:
    """`room` holds `SCRATCH` numbers a row."""
    cdef Scratch made
    made.horizon = NAN
    made.start = 0
    made.h = <float*>room
    made.inverse = made.h + n
    made.base = made.inverse + n
    made.line.part = made.base + n
    made.line.column = <int*>(made.line.part + n)
    return made


cdef inline void set_horizon(Scratch* scratch, const int[::1] rows, double horizon, double min_h) noexcept nogil:
    cdef Py_ssize_t n = rows.shape[0], r = 0
    scratch.horizon = horizon
    while r < n and not rows[r] - horizon >= min_h:
        r += 1
    scratch.start = r
    for r in range(scratch.start, n):
        scratch.h[r] = <float>(rows[r] - horizon)
    for r in range(scratch.start, n):
        scratch.inverse[r] = <float>1.0 / scratch.h[r]


cdef inline void place_line(
    const float* h, const float* base, float place, Py_ssize_t start, Py_ssize_t n, Line line
) noexcept nogil:
    """Where a line lies in each row: a pixel, and the part of the way to the next one; vector code."""
    cdef Py_ssize_t r
    cdef float x, one = 1.0
    cdef int column
    for r in range(start, n):
        x = base[r] + place * h[r]
        column = <int>(x + one) - 1  # below zero for all x below zero
        line.column[r] = column
        line.part[r] = x - <float>column


cdef inline void place_arc(
    const Arc* arc, const float* h, const float* inverse, double place, Py_ssize_t start, Py_ssize_t n, Line line
) noexcept nogil:
    """As `place_line`, on a concentric circle; vector code."""
    cdef Py_ssize_t r
    cdef double own = tighter(arc, place), begin = arc.start * own
    cdef float first = <float>begin, gain = <float>(arc.rate * own), centre = <float>arc.centre, across = <float>place
    cdef float focal = <float>arc.focal, one = 1.0, most = <float>(turned() * turned()), nowhere = -1e6
    cdef float cosine, x, sine, square
    cdef int column
    begin *= begin
    cosine = sqrtf(<float>(1.0 - begin)) if begin < most else 0.0
    for r in range(start, n):
        sine = first + gain * inverse[r]
        square = sine * sine
        x = centre + across * h[r] + focal * (first + sine) / (cosine + sqrtf(one - (square if square < most else most)))
        x = x if square < most and cosine > 0.0 else nowhere
        column = <int>(x + one) - 1
        line.column[r] = column
        line.part[r] = x - <float>column


cdef inline void place_base(const Arc* arc, Scratch* scratch, Py_ssize_t n) noexcept nogil:
    """What all lines of a gentle bend have in common."""
    cdef Py_ssize_t r
    cdef float origin = <float>arc.origin, bend = <float>arc.bend
    if arc.is_gentle:
        for r in range(scratch.start, n):
            scratch.base[r] = origin + bend * scratch.inverse[r]


cdef inline void place(const Arc* arc, Scratch* scratch, double at, Py_ssize_t n) noexcept nogil:
    """Fill `scratch.line` with the line at a place; `place_base` came before."""
    if arc.is_gentle:
        place_line(scratch.h, scratch.base, <float>at, scratch.start, n, scratch.line)
    else:
        place_arc(arc, scratch.h, scratch.inverse, at, scratch.start, n, scratch.line)


cdef inline double along_line(
    const float* evidence, Py_ssize_t width, Line line, Py_ssize_t start, Py_ssize_t stop
) noexcept nogil:
    """The evidence in some rows, linear between pixels."""
    cdef Py_ssize_t r
    cdef float total = 0.0
    cdef const float* pixel
    for r in range(start, stop):
        if <unsigned int>line.column[r] < <unsigned int>(width - 1):
            pixel = evidence + r * width + line.column[r]
            total += pixel[0] + line.part[r] * (pixel[1] - pixel[0])
    return total


cdef inline double judge(
    const float[:, ::1] evidence, const float[:, ::1] broad, const int[::1] rows, const double* values,
    const double[:, ::1] prior, const Scoring* scoring, Scratch* scratch
) noexcept nogil:
    """The objective of a lane."""
    cdef Py_ssize_t n = evidence.shape[0], width = evidence.shape[1], start, stop
    cdef double total = 0.0, z, penalty = 0.0, painted
    cdef const float* table
    cdef Arc arc
    cdef int k, segment = scoring.segment
    for k in range(N):
        if not (prior[k, LOW] <= values[k] <= prior[k, HIGH]):
            return -1e30
        z = (values[k] - prior[k, MEAN]) / prior[k, SIGMA]
        z *= z
        penalty += z / (1.0 + z / <double>BEND_TAIL) if k == BEND else z
    if scratch.horizon != values[HORIZON]:
        set_horizon(scratch, rows, values[HORIZON], scoring.min_h)
    arc = arc_of(values[VANISHING], values[BEND], scoring.min_h, scoring.centre, scoring.focal)
    place_base(&arc, scratch, n)
    for k in range(4 if scoring.beside > 0.0 else 2):
        z = (0.5 if k < 2 else 1.5) * values[WIDTH]
        z = values[MIDDLE] + z if k % 2 else values[MIDDLE] - z
        place(&arc, scratch, z, n)
        table = &evidence[0, 0] if k < 2 else &broad[0, 0]
        z = 1.0 if k < 2 else scoring.beside
        start = scratch.start
        stop = (start // segment) * segment
        while stop < n:
            stop += segment
            if stop > n:
                stop = n
            painted = along_line(table, width, scratch.line, start, stop)
            total += z * painted / (painted + scoring.half)
            start = stop
    return total * segment / n - scoring.prior_weight * penalty
