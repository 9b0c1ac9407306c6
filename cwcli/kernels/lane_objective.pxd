# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Inline parts of the kernel `lane_ridge`: the objective of a lane of six numbers, and where its boundaries lie.

The formulas of arcs are derived in cwcli/signals/lane_geometry.py.
"""

from libc.math cimport NAN, fabs, sqrt, sqrtf

from cwcli.kernels.lane_ridge cimport BEND, HIGH, HORIZON, LOW, MEAN, MIDDLE, N, SIGMA, SPIRAL, VANISHING, WIDTH

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
    # the curve through the camera's foot: a boundary is parallel to it
    double origin, bend, spiral  # u0, k and q
    double centre, focal
    double start         # sine of its direction beside the camera
    double rate          # what the sine gains, times h
    double growth        # and beyond that, times h^2
    bint is_gentle       # no row that is judged shows the difference from a polynomial


cdef struct Curve:
    # one line: the sine of its direction, t = 1 / h away, is start + rate t + growth t^2
    double start, rate, growth
    double end           # the t where it turns back


cdef inline double gentle() noexcept nogil:
    """So much the sine may gain: a thousandth of the focal length in columns beside a polynomial."""
    return 0.2


cdef inline double turned() noexcept nogil:
    """Where the sine is so great, the line ends: it is about to turn back."""
    return 0.97


cdef inline double least_rest() noexcept nogil:
    """Of a circle's radius, inside a boundary: farther in there is no lane."""
    return 0.2


cdef inline Arc arc_of(
    double origin, double bend, double spiral, double least_h, double centre, double focal
) noexcept nogil:
    cdef Arc made
    cdef double slope = (origin - centre) / focal, cosine = 1.0 / sqrt(1.0 + slope * slope)
    made.origin = origin
    made.bend = bend
    made.spiral = spiral
    made.centre = centre
    made.focal = focal
    made.start = slope * cosine
    made.rate = 2.0 * bend * cosine * cosine * cosine / focal
    made.growth = 3.0 * spiral * cosine * cosine * cosine / focal
    made.is_gentle = fabs(made.rate) + fabs(made.growth) / least_h <= gentle() * least_h
    return made


cdef inline double first_root(double a, double b, double c, double before) noexcept nogil:
    """The smallest positive root of a t^2 + b t + c, or `before` if that is smaller, or there is none."""
    cdef double root = b * b - 4.0 * a * c, t
    if root < 0.0:
        return before
    root = sqrt(root)
    t = 2.0 * c / (root - b)
    if 0.0 < t < before:
        before = t
    t = 2.0 * c / (-root - b)
    return t if 0.0 < t < before else before


cdef inline Curve curve_of(const Arc* arc, double place) noexcept nogil:
    """A parallel line; no bend is tighter than `least_rest` allows."""
    cdef Curve made
    cdef double rest = 1.0 - arc.rate * place / arc.focal, own = 1.0 / (rest if rest > least_rest() else least_rest())
    made.start = arc.start * own
    made.rate = arc.rate * own
    made.growth = arc.growth * own * own * own
    made.end = 0.0
    if fabs(made.start) < turned():
        made.end = first_root(made.growth, made.rate, made.start - turned(), 1e30)
        made.end = first_root(made.growth, made.rate, made.start + turned(), made.end)
    return made


cdef inline double column_of(const Arc* arc, double place, double h) noexcept nogil:
    """Where a boundary lies, h rows below the horizon; NaN where it has turned back."""
    cdef Curve curve
    cdef double sine, more, middle
    if arc.is_gentle:
        return arc.origin + place * h + (arc.bend + arc.spiral / h) / h
    curve = curve_of(arc, place)
    if 1.0 / h >= curve.end:
        return NAN
    more = curve.growth / (h * h)
    sine = curve.start + curve.rate / h + more
    middle = 0.5 * (curve.start + sine)
    middle = 1.0 - middle * middle
    more = more / (6.0 * middle * sqrt(middle))
    sine = (curve.start + sine) / (sqrt(1.0 - curve.start * curve.start) + sqrt(1.0 - sine * sine))
    return arc.centre + place * h + arc.focal * (sine - more)


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
    """(left, right column at near_v, centre at far_v, bend in pixels at far_v, horizon, spiral in pixels at far_v) ->
    (u0, middle, width, k, v0, q)."""
    cdef double near_h = near_v - code[4], far_h = far_v - code[4]
    cdef double centre = 0.5 * (code[0] + code[1])
    if far_h < 1.0:
        far_h = 1.0
    if near_h < far_h + 1.0:
        near_h = far_h + 1.0
    cdef double k = code[3] * far_h, q = code[5] * far_h * far_h
    cdef double bent = (k + q / near_h) / near_h
    cdef double middle = (centre - code[2] - bent + (k + q / far_h) / far_h) / (near_h - far_h)
    values[VANISHING] = centre - middle * near_h - bent
    values[MIDDLE] = middle
    values[WIDTH] = (code[1] - code[0]) / near_h
    values[BEND] = k
    values[HORIZON] = code[4]
    values[SPIRAL] = q


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
    """As `place_line`, in a tight bend; vector code."""
    cdef Py_ssize_t r
    cdef Curve curve = curve_of(arc, place)
    cdef float first = <float>curve.start, gain = <float>curve.rate, growth = <float>curve.growth, end = <float>curve.end
    cdef float centre = <float>arc.centre, across = <float>place, focal = <float>arc.focal
    cdef float one = 1.0, half = 0.5, six = 6.0, most = <float>(turned() * turned()), nowhere = -1e6
    cdef float x, sine, square, more, middle, cosine = one - first * first
    cdef int column
    cosine = sqrtf(cosine if cosine > 0.0 else one)
    for r in range(start, n):
        more = growth * inverse[r] * inverse[r]
        sine = first + gain * inverse[r] + more
        middle = half * (first + sine)
        middle = middle * middle
        middle = one - (middle if middle < most else most)
        more = more / (six * middle * sqrtf(middle))
        square = sine * sine
        sine = (first + sine) / (cosine + sqrtf(one - (square if square < most else most)))
        x = centre + across * h[r] + focal * (sine - more)
        x = x if inverse[r] < end else nowhere
        column = <int>(x + one) - 1
        line.column[r] = column
        line.part[r] = x - <float>column


cdef inline void place_base(const Arc* arc, Scratch* scratch, Py_ssize_t n) noexcept nogil:
    """What all lines of a gentle bend have in common."""
    cdef Py_ssize_t r
    cdef float origin = <float>arc.origin, bend = <float>arc.bend, spiral = <float>arc.spiral
    if arc.is_gentle:
        for r in range(scratch.start, n):
            scratch.base[r] = origin + (bend + spiral * scratch.inverse[r]) * scratch.inverse[r]


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
    arc = arc_of(values[VANISHING], values[BEND], values[SPIRAL], scoring.min_h, scoring.centre, scoring.focal)
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
