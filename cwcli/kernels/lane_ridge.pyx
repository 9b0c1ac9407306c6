# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""The pair of parallel boundaries that the stripes of a frame (`lane_stripes`) support best.

A boundary lies in the column that cwcli/signals/lane_geometry.py derives from the six numbers of a lane (cwcli.vision.lane_model). The
evidence is a table over sampled rows and columns, 0 to 1.

Arithmetic is +, -, *, /, square roots and comparisons in a fixed order (compiled with -ffp-contract=off): the same bits everywhere. The plain
NumPy twin is in tests/unit/vision/naive_ridge.py.
"""

from libc.math cimport NAN, fabs, sqrt
from libc.stdlib cimport free, malloc

import numpy as np

from cwcli.kernels.lane_objective cimport (
    BEND_TAIL, SCRATCH, Arc, Scoring, Scratch, arc_of, at, column_of, judge, natural, place, place_base, scratch_of,
    set_horizon, turned
)

cdef enum:
    SAMPLES = 16  # of a parabola; cwcli.vision.ground.N_BOUNDARY_SAMPLES

cdef struct Pair:
    int left, right
    double penalty


cdef double SPARE = 1e-9  # more than rounding makes of an objective, which is about 1


cdef inline Py_ssize_t first_inside(
    const double[::1] places, double base, double wide, double from_x, double spacing
) noexcept nogil:
    """The first place whose column is at least from_x; places are evenly spaced up to rounding."""
    cdef Py_ssize_t n = places.shape[0], j
    cdef double guess = ((from_x - base) / wide - places[0]) / spacing
    if guess >= n:
        j = n
    elif guess <= 0.0:
        j = 0
    else:
        j = <Py_ssize_t>guess
    while j > 0 and base + places[j - 1] * wide >= from_x:
        j -= 1
    while j < n and base + places[j] * wide < from_x:
        j += 1
    return j


def scan(
    const float[:, ::1] evidence, const double[:, ::1] prior, Scoring scoring, *, const double[::1] depths, int step,
    const double[::1] vanishing, const double[::1] bends, const double[::1] places
):
    best_array = np.empty((vanishing.shape[0], bends.shape[0], 3))
    cdef double[:, :, ::1] best = best_array
    cdef double weight = scoring.prior_weight, beside = scoring.beside, half = scoring.half
    cdef int segment = scoring.segment
    cdef Py_ssize_t n_rows = evidence.shape[0], width = evidence.shape[1], n = places.shape[0]
    cdef Py_ssize_t i, p, q, r, j, left, right, n_pairs = 0
    cdef const float* row
    cdef double h, base, value, z, penalty, middle, wide, sine, cosine, least
    cdef double spacing = places[1] - places[0] if n > 1 else 1.0
    cdef Py_ssize_t start, stop, first, last
    cdef Arc arc
    cdef double* sums = <double*>malloc(n * sizeof(double))
    cdef double* stretch = <double*>malloc(n * sizeof(double))
    cdef double* broad = <double*>malloc(n * sizeof(double))
    cdef Pair* pairs = <Pair*>malloc(n * n * sizeof(Pair))
    cdef Pair* pair
    cdef Py_ssize_t used = (n_rows + step - 1) // step
    cdef double n_segments = <double>n_rows / segment
    if not (sums and pairs and broad and stretch):
        free(sums)
        free(broad)
        free(stretch)
        free(pairs)
        raise MemoryError
    with nogil:
        for left in range(n):
            if places[left] >= 0.0:
                break
            for right in range(left + 1, n):
                middle = 0.5 * (places[left] + places[right])
                wide = places[right] - places[left]
                if wide > prior[WIDTH, HIGH]:
                    break
                if places[right] > 0.0 and prior[WIDTH, LOW] <= wide and prior[MIDDLE, LOW] <= middle <= prior[MIDDLE, HIGH]:
                    pair = &pairs[n_pairs]
                    n_pairs += 1
                    pair.left = <int>left
                    pair.right = <int>right
                    z = (middle - prior[MIDDLE, MEAN]) / prior[MIDDLE, SIGMA]
                    penalty = z * z
                    z = (wide - prior[WIDTH, MEAN]) / prior[WIDTH, SIGMA]
                    pair.penalty = weight * (penalty + z * z)
        for p in range(vanishing.shape[0]):
            for q in range(bends.shape[0]):
                arc = arc_of(vanishing[p], bends[q], 0.0, scoring.min_h, scoring.centre, scoring.focal)
                for j in range(n):
                    sums[j] = stretch[j] = 0.0
                first = n
                last = 0
                for i in range(used):
                    r = i * step
                    h = depths[r]
                    base = vanishing[p] + bends[q] / h + 0.5
                    wide = h
                    if h > 0.0 and not arc.is_gentle:  # of concentric circles: the first two terms in the place
                        base = column_of(&arc, 0.0, h) + 0.5
                        sine = arc.start + arc.rate / h
                        cosine = sqrt(1.0 - sine * sine) if fabs(sine) < turned() else -1.0
                        wide = h / cosine
                    if wide > 0.0 and base == base:
                        row = &evidence[r, 0]
                        start = first_inside(places, base, wide, 0.0, spacing)
                        stop = first_inside(places, base, wide, width, spacing)
                        first = start if start < first else first
                        last = stop if stop > last else last
                        for j in range(start, stop):
                            stretch[j] += row[<int>(base + places[j] * wide)]
                    if (r + step) // segment != r // segment or i == used - 1:  # the next row is of another segment
                        for j in range(first, last):
                            sums[j] += stretch[j] / (stretch[j] + half / step)
                            stretch[j] = 0.0
                        first = n
                        last = 0
                z = (vanishing[p] - prior[VANISHING, MEAN]) / prior[VANISHING, SIGMA]
                penalty = z * z
                z = (bends[q] - prior[BEND, MEAN]) / prior[BEND, SIGMA]
                z *= z
                penalty = weight * (penalty + z / (1.0 + z / <double>BEND_TAIL))
                best[p, q, 0] = -1e30
                best[p, q, 1] = best[p, q, 2] = 0.0
                for j in range(n):
                    broad[j] = sums[j]
                    for i in range(j - 2 if j > 1 else 0, j + 3 if j + 3 < n else n):
                        if sums[i] > broad[j]:
                            broad[j] = sums[i]
                least = -1e30
                for i in range(n_pairs):
                    pair = &pairs[i]
                    left = pair.left
                    right = pair.right
                    value = sums[left] + sums[right]
                    if 2 * left - right >= 0:
                        value += beside * broad[2 * left - right]
                    if 2 * right - left < n:
                        value += beside * broad[2 * right - left]
                    if value < least + pair.penalty * n_segments:  # most are, and a division is slow
                        continue
                    value = value / n_segments - pair.penalty
                    if value - penalty > best[p, q, 0]:
                        least = (value - SPARE) * n_segments
                        best[p, q, 0] = value - penalty
                        best[p, q, 1] = places[left]
                        best[p, q, 2] = places[right]
    free(sums)
    free(broad)
    free(stretch)
    free(pairs)
    return best_array


def objective(
    const float[:, ::1] evidence, const float[:, ::1] broad, const int[::1] rows, const double[:, ::1] lanes,
    const double[:, ::1] prior, Scoring scoring
):
    value_array = np.empty(lanes.shape[0])
    cdef double[::1] value = value_array
    cdef Py_ssize_t i
    cdef double* room = <double*>malloc(SCRATCH * (rows.shape[0] + 1) * sizeof(double))
    if not room:
        raise MemoryError
    cdef Scratch scratch = scratch_of(room, rows.shape[0])
    with nogil:
        for i in range(lanes.shape[0]):
            value[i] = judge(evidence, broad, rows, &lanes[i, VANISHING], prior, &scoring, &scratch)
    free(room)
    return value_array


def refine(
    const float[:, ::1] evidence, const float[:, ::1] broad, const int[::1] rows, double[:, ::1] lanes,
    const double[:, ::1] prior, Scoring scoring, *, double near_v, double far_v, const double[::1] steps, int halvings
):
    value_array = np.empty(lanes.shape[0])
    cdef double[::1] value = value_array
    cdef Py_ssize_t i
    cdef int k, j, level, sign, rounds
    cdef double code[N], trial[N], base[N], values[N], step[N]
    cdef double best, found, before, near_h, far_h, far_at, bent
    cdef double* room = <double*>malloc(SCRATCH * (rows.shape[0] + 1) * sizeof(double))
    if not room:
        raise MemoryError
    cdef Scratch scratch = scratch_of(room, rows.shape[0])
    with nogil:
        for i in range(lanes.shape[0]):
            near_h = near_v - lanes[i, HORIZON]
            # not where an arc turns back
            far_at = max(far_v, lanes[i, HORIZON] + 2.5 * fabs(lanes[i, BEND]) / scoring.focal)
            far_h = far_at - lanes[i, HORIZON]
            if far_h < 1.0:
                far_h = 1.0
            if near_h < far_h + 1.0:
                near_h = far_h + 1.0
            bent = lanes[i, VANISHING] + (lanes[i, BEND] + lanes[i, SPIRAL] / near_h) / near_h
            code[0] = bent + (lanes[i, MIDDLE] - 0.5 * lanes[i, WIDTH]) * near_h
            code[1] = bent + (lanes[i, MIDDLE] + 0.5 * lanes[i, WIDTH]) * near_h
            bent = lanes[i, VANISHING] + (lanes[i, BEND] + lanes[i, SPIRAL] / far_h) / far_h
            code[2] = bent + lanes[i, MIDDLE] * far_h
            code[3] = lanes[i, BEND] / far_h
            code[4] = lanes[i, HORIZON]
            code[5] = lanes[i, SPIRAL] / (far_h * far_h)
            natural(code, near_v, far_at, values)
            best = judge(evidence, broad, rows, values, prior, &scoring, &scratch)
            for k in range(N):
                step[k] = steps[k]
            for level in range(halvings):
                rounds = 0
                while rounds < 8:
                    rounds += 1
                    before = best
                    for k in range(N):
                        base[k] = code[k]
                    for k in range(N):
                        if step[k] == 0.0:
                            continue
                        for sign in range(2):
                            for j in range(N):
                                trial[j] = code[j]
                            trial[k] += step[k] if sign == 0 else -step[k]
                            natural(trial, near_v, far_at, values)
                            found = judge(evidence, broad, rows, values, prior, &scoring, &scratch)
                            if found > best:
                                best = found
                                code[k] = trial[k]
                                break
                    if best <= before:
                        break
                    for k in range(N):
                        trial[k] = 2.0 * code[k] - base[k]
                    natural(trial, near_v, far_at, values)
                    found = judge(evidence, broad, rows, values, prior, &scoring, &scratch)
                    if found > best:
                        best = found
                        for k in range(N):
                            code[k] = trial[k]
                for k in range(N):
                    step[k] *= 0.5
            natural(code, near_v, far_at, values)
            for k in range(N):
                lanes[i, k] = values[k]
            value[i] = best
    free(room)
    return value_array


def along(
    const float[:, ::1] evidence, const int[::1] rows, const double[::1] lane, const double[::1] places, Scoring scoring
):
    values_array = np.empty((places.shape[0], rows.shape[0]))
    cdef double[:, ::1] values = values_array
    cdef Py_ssize_t r, p, width = evidence.shape[1]
    cdef double h, x
    cdef Arc arc = arc_of(lane[VANISHING], lane[BEND], lane[SPIRAL], scoring.min_h, scoring.centre, scoring.focal)
    with nogil:
        for r in range(evidence.shape[0]):
            h = rows[r] - lane[HORIZON]
            for p in range(places.shape[0]):
                values[p, r] = -1.0
                if h < scoring.min_h:
                    continue
                x = column_of(&arc, places[p], h)
                if 0.0 <= x <= width - 1.0:
                    values[p, r] = at(&evidence[r, 0], width, x)
    return values_array


def crowd(
    const float[:, ::1] evidence, const int[::1] rows, const double[::1] lane, const double[::1] places, Scoring scoring
):
    cdef Py_ssize_t n = evidence.shape[0], width = evidence.shape[1], r, p, n_seen = 0, n_striped = 0
    cdef const float* pixel
    cdef double* room = <double*>malloc(SCRATCH * (n + 1) * sizeof(double))
    if not room:
        raise MemoryError
    cdef Scratch scratch = scratch_of(room, n)
    cdef Arc arc = arc_of(lane[VANISHING], lane[BEND], lane[SPIRAL], scoring.min_h, scoring.centre, scoring.focal)
    with nogil:
        set_horizon(&scratch, rows, lane[HORIZON], scoring.min_h)
        place_base(&arc, &scratch, n)
        for p in range(places.shape[0]):
            place(&arc, &scratch, places[p], n)
            for r in range(scratch.start, n):
                if <unsigned int>scratch.line.column[r] < <unsigned int>(width - 1):
                    pixel = &evidence[r, 0] + scratch.line.column[r]
                    n_seen += 1
                    n_striped += pixel[0] > 0.0 or (pixel[1] > 0.0 and scratch.line.part[r] > 0.0)
    free(room)
    return <double>n_striped / n_seen if n_seen else 0.0


def supports(const float[:, ::1] evidence, const int[::1] rows, const double[::1] lane, Scoring scoring):
    value_array = np.empty(2)
    cdef double[::1] value = value_array
    cdef double min_h = scoring.min_h, half = scoring.half
    cdef int segment = scoring.segment
    cdef Py_ssize_t r, k, side, width = evidence.shape[1], n = rows.shape[0] // segment
    cdef double h, x, across, painted, part, total
    cdef int seen
    cdef Arc arc = arc_of(lane[VANISHING], lane[BEND], lane[SPIRAL], min_h, scoring.centre, scoring.focal)
    with nogil:
        for side in range(2):
            across = lane[MIDDLE] + (side - 0.5) * lane[WIDTH]
            total = part = 0.0
            for k in range(n):
                painted = 0.0
                seen = 0
                for r in range(k * segment, (k + 1) * segment):
                    h = rows[r] - lane[HORIZON]
                    if h < min_h:
                        continue
                    x = column_of(&arc, across, h)
                    if 0.0 <= x <= width - 1.0:
                        painted += at(&evidence[r, 0], width, x)
                        seen += 1
                total += painted / (painted + half) * (<double>seen / segment)
                part += <double>seen / segment
            value[side] = total / (part if part > 1.0 else 1.0)
    return value_array


def parabolas(
    const double[::1] lane, *, double top_y, double height, double width, double min_h, double centre, double focal
):
    made_array = np.empty((2, 3))
    cdef double[:, ::1] made = made_array
    cdef double normal[3][4]
    cdef double powers[3]
    cdef double x[SAMPLES]
    cdef double y, h
    cdef Py_ssize_t side, k, i, j
    cdef int n_in, n_below
    cdef bint inside
    cdef Arc arc = arc_of(lane[VANISHING], lane[BEND], lane[SPIRAL], min_h, centre, focal)
    with nogil:
        for side in range(2):
            n_in = n_below = 0
            for k in range(SAMPLES):
                h = height - (0.5 + (k + 0.5) / SAMPLES * top_y) - lane[HORIZON]
                x[k] = NAN
                if h > 0.0:
                    x[k] = column_of(&arc, lane[MIDDLE] + (side - 0.5) * lane[WIDTH], h) + 1.0
                    n_below += x[k] == x[k]
                    n_in += 1.0 <= x[k] <= width
            for j in range(3):
                made[side, j] = NAN
                for i in range(4):
                    normal[j][i] = 0.0
            inside = n_in >= 5
            if not inside and n_below < 3:
                continue
            for k in range(SAMPLES):
                if (1.0 <= x[k] <= width) if inside else x[k] == x[k]:
                    y = (0.5 + (k + 0.5) / SAMPLES * top_y) / height
                    powers[0] = y * y
                    powers[1] = y
                    powers[2] = 1.0
                    for j in range(3):
                        for i in range(3):
                            normal[j][i] += powers[j] * powers[i]
                        normal[j][3] += powers[j] * x[k]
            solve(normal)
            made[side, 0] = normal[0][3] / (height * height)
            made[side, 1] = normal[1][3] / height
            made[side, 2] = normal[2][3]
    return made_array


cdef void solve(double[4]* rows) noexcept nogil:
    """Three equations by Gauss with pivots; the last column becomes the solution."""
    cdef Py_ssize_t i, j, k, pivot
    cdef double factor
    for k in range(3):
        pivot = k
        for i in range(k + 1, 3):
            if fabs(rows[i][k]) > fabs(rows[pivot][k]):
                pivot = i
        for j in range(4):
            factor = rows[k][j]
            rows[k][j] = rows[pivot][j]
            rows[pivot][j] = factor
        for i in range(3):
            if i != k:
                factor = rows[i][k] / rows[k][k]
                for j in range(k, 4):
                    rows[i][j] -= factor * rows[k][j]
    for k in range(3):
        rows[k][3] = rows[k][3] / rows[k][k]
