# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Bright stripes in image rows, and the pair of parallel boundaries that they support best.

A boundary of a flat road of constant curvature is, h rows below the horizon, u = u0 + m h + k / h: u0 is the vanishing
point, m the lateral place over the camera's height (right positive), k the curvature; u0, k and the horizon are common
to both boundaries. The evidence is a table over sampled rows and columns, 0 to 1.

Arithmetic is +, -, *, / and comparisons in a fixed order (compiled with -ffp-contract=off): the same bits everywhere. The plain
NumPy twin is in tests/unit/vision/naive_ridge.py.
"""

from libc.stdlib cimport free, malloc

cdef enum:
    N = 5

cdef double BEND_TAIL = 9.0  # squared sigmas: most roads are straight, and some bend, so the prior of the bend has heavy tails


def ridges(
    const unsigned char[:, ::1] grey, const int[::1] rows, double horizon_v, const double[::1] shape,
    float[:, ::1] evidence
):
    """Evidence of a stripe centred at each pixel of the given rows (see the stub)."""
    cdef Py_ssize_t width = grey.shape[1]
    cdef Py_ssize_t i, u, v
    cdef double h, inner, near, far, floor_grey = shape[3], relative = shape[4], rough = shape[5], lopsided = shape[6], dead = shape[7]
    cdef double crowd, crowded = shape[8]
    cdef int* sums = <int*>malloc((width + 1) * sizeof(int))
    cdef float* middle = <float*>malloc(width * sizeof(float))
    cdef float* left = <float*>malloc(width * sizeof(float))
    cdef float* right = <float*>malloc(width * sizeof(float))
    cdef int total
    cdef double texture, side, other, contrast, noise
    if not (sums and middle and left and right):
        free(sums)
        free(middle)
        free(left)
        free(right)
        raise MemoryError
    with nogil:
        for i in range(rows.shape[0]):
            v = rows[i]
            h = v - horizon_v
            if h < 1.0:
                h = 1.0
            total = 0
            sums[0] = 0
            for u in range(width):
                total += grey[v, u]
                sums[u + 1] = total
            inner = shape[0] * h
            if inner < 1.0:
                inner = 1.0
            near = shape[1] * h
            if near < 0.5 * inner + 0.5:
                near = 0.5 * inner + 0.5
            far = near + shape[2] * h
            if far < near + 1.5:
                far = near + 1.5
            box(sums, width, -0.5 * inner, 0.5 * inner, middle)
            box(sums, width, -far, -near, left)
            box(sums, width, near, far, right)
            texture = 0.0
            for u in range(width):
                side = left[u] if left[u] < right[u] else right[u]
                if side > middle[u]:
                    texture += side - middle[u]
            texture = texture / width
            for u in range(width):
                side = left[u]
                other = right[u]
                if other > side:
                    side, other = other, side
                contrast = middle[u] - side - lopsided * (side - other)
                if contrast <= 0.0:
                    evidence[i, u] = 0.0
                    continue
                noise = floor_grey + relative * side + rough * texture
                contrast = contrast * contrast
                contrast = contrast / (contrast + noise * noise) - dead
                evidence[i, u] = <float>(contrast / (1.0 - dead)) if contrast > 0.0 else <float>0.0
            crowd = 0.0
            for u in range(width):
                crowd += evidence[i, u]
            crowd = crowd / (width * crowded)
            crowd = 1.0 / (1.0 + crowd * crowd)
            for u in range(width):
                evidence[i, u] = <float>(evidence[i, u] * crowd)
    free(sums)
    free(middle)
    free(left)
    free(right)


cdef void box(const int* sums, Py_ssize_t width, double start, double end, float* mean) noexcept nogil:
    """Mean of the row between start and end from each pixel's centre; clipped at the image's sides."""
    cdef double lower = start + 0.5, upper = end + 0.5
    cdef Py_ssize_t i = <Py_ssize_t>lower, j = <Py_ssize_t>upper
    if i > lower:
        i -= 1
    if j > upper:
        j -= 1
    cdef float a = <float>(lower - i), b = <float>(upper - j)
    cdef float factor = <float>(1.0 / (end - start))
    cdef Py_ssize_t u, first = -i if i < 0 else 0, last = width - j - 1
    cdef double x0, x1
    if last > width:
        last = width
    if first > width:
        first = width
    if last < first:
        last = first
    for u in range(first, last):
        mean[u] = factor * (
            <float>(sums[u + j] - sums[u + i])
            + b * <float>(sums[u + j + 1] - sums[u + j])
            - a * <float>(sums[u + i + 1] - sums[u + i])
        )
    for u in range(0, first):
        mean[u] = clipped(sums, width, u + lower, u + upper)
    for u in range(last, width):
        mean[u] = clipped(sums, width, u + lower, u + upper)


cdef float clipped(const int* sums, Py_ssize_t width, double lower, double upper) noexcept nogil:
    """Mean from lower to upper, as far as they lie in the row; less than half a pixel: the outermost pixel."""
    cdef Py_ssize_t i, j
    if lower < 0.0:
        lower = 0.0
    if upper > width:
        upper = width
    if upper - lower < 0.5:
        if lower < 0.5 * width:
            lower = 0.0
            upper = 1.0
        else:
            lower = width - 1.0
            upper = width
    i = <Py_ssize_t>lower
    j = <Py_ssize_t>upper
    cdef double total = sums[j] - sums[i]
    if j < width:
        total += (upper - j) * (sums[j + 1] - sums[j])
    if i < width:
        total -= (lower - i) * (sums[i + 1] - sums[i])
    return <float>(total / (upper - lower))


def scan(
    const float[:, ::1] evidence, const double[::1] depths, int step, const double[::1] vanishing,
    const double[::1] bends, const double[::1] places, const double[:, ::1] prior, double weight,
    double beside, double half, int segment, double[:, :, ::1] best
):
    """The best pair of boundaries for each vanishing point and bend (see the stub)."""
    cdef Py_ssize_t n_rows = evidence.shape[0], width = evidence.shape[1], n = places.shape[0]
    cdef Py_ssize_t i, p, q, r, j, left, right
    cdef double h, base, x, value, z, penalty, middle, wide
    cdef double* sums = <double*>malloc(n * sizeof(double))
    cdef double* stretch = <double*>malloc(n * sizeof(double))
    cdef double* broad = <double*>malloc(n * sizeof(double))
    cdef double* pair = <double*>malloc(n * n * sizeof(double))
    cdef Py_ssize_t used = (n_rows + step - 1) // step
    cdef double n_segments = <double>n_rows / segment
    if not (sums and pair and broad and stretch):
        free(sums)
        free(broad)
        free(stretch)
        free(pair)
        raise MemoryError
    with nogil:
        for left in range(n):
            for right in range(n):
                middle = 0.5 * (places[left] + places[right])
                wide = places[right] - places[left]
                pair[left * n + right] = 1e30
                if places[left] < 0.0 < places[right] and prior[2, 2] <= wide <= prior[2, 3]:
                    if prior[1, 2] <= middle <= prior[1, 3]:
                        z = (middle - prior[1, 0]) / prior[1, 1]
                        penalty = z * z
                        z = (wide - prior[2, 0]) / prior[2, 1]
                        pair[left * n + right] = weight * (penalty + z * z)
        for p in range(vanishing.shape[0]):
            for q in range(bends.shape[0]):
                for j in range(n):
                    sums[j] = 0.0
                    stretch[j] = 0.0
                for i in range(used):
                    r = i * step
                    h = depths[r]
                    if h > 0.0:
                        base = vanishing[p] + bends[q] / h + 0.5
                        for j in range(n):
                            x = base + places[j] * h
                            if 0.0 <= x < width:
                                stretch[j] += evidence[r, <Py_ssize_t>x]
                    if (r + step) // segment != r // segment or i == used - 1:  # the next row is of another segment
                        for j in range(n):
                            sums[j] += stretch[j] / (stretch[j] + half / step)
                            stretch[j] = 0.0
                z = (vanishing[p] - prior[0, 0]) / prior[0, 1]
                penalty = z * z
                z = (bends[q] - prior[3, 0]) / prior[3, 1]
                z *= z
                penalty = weight * (penalty + z / (1.0 + z / BEND_TAIL))
                best[p, q, 0] = -1e30
                best[p, q, 1] = 0.0
                best[p, q, 2] = 0.0
                for j in range(n):
                    broad[j] = sums[j]
                    for i in range(j - 2 if j > 1 else 0, j + 3 if j + 3 < n else n):
                        if sums[i] > broad[j]:
                            broad[j] = sums[i]
                for left in range(n):
                    if places[left] >= 0.0:
                        break
                    for right in range(left + 1, n):
                        if pair[left * n + right] > 1e29:
                            continue
                        value = sums[left] + sums[right]
                        if 2 * left - right >= 0:
                            value += beside * broad[2 * left - right]
                        if 2 * right - left < n:
                            value += beside * broad[2 * right - left]
                        value = value / n_segments - pair[left * n + right]
                        if value - penalty > best[p, q, 0]:
                            best[p, q, 0] = value - penalty
                            best[p, q, 1] = places[left]
                            best[p, q, 2] = places[right]
    free(sums)
    free(broad)
    free(stretch)
    free(pair)


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


cdef void natural(const double* code, double near_v, double far_v, double* values) noexcept nogil:
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


cdef double judge(
    const float[:, ::1] evidence, const float[:, ::1] broad, const int[::1] rows, const double* values,
    const double[:, ::1] prior, double weight, double min_h, double beside, double half,
    int segment
) noexcept nogil:
    cdef Py_ssize_t n = evidence.shape[0], width = evidence.shape[1], r
    cdef double total = 0.0, h, base, z, penalty = 0.0, left = 0.0, right = 0.0, outer_left = 0.0, outer_right = 0.0
    cdef int k
    for k in range(N):
        if not (prior[k, 2] <= values[k] <= prior[k, 3]):
            return -1e30
        z = (values[k] - prior[k, 0]) / prior[k, 1]
        z *= z
        penalty += z / (1.0 + z / BEND_TAIL) if k == 3 else z
    for r in range(n):
        h = rows[r] - values[4]
        if h >= min_h:
            base = values[0] + values[3] / h
            left += at(&evidence[r, 0], width, base + (values[1] - 0.5 * values[2]) * h)
            right += at(&evidence[r, 0], width, base + (values[1] + 0.5 * values[2]) * h)
            if beside > 0.0:
                outer_left += at(&broad[r, 0], width, base + (values[1] - 1.5 * values[2]) * h)
                outer_right += at(&broad[r, 0], width, base + (values[1] + 1.5 * values[2]) * h)
        if (r + 1) % segment == 0 or r == n - 1:
            total += left / (left + half) + right / (right + half)
            if beside > 0.0:
                total += beside * (outer_left / (outer_left + half) + outer_right / (outer_right + half))
            left = right = outer_left = outer_right = 0.0
    return total * segment / n - weight * penalty


def objective(
    const float[:, ::1] evidence, const float[:, ::1] broad, const int[::1] rows, const double[:, ::1] lanes,
    const double[:, ::1] prior, double weight, double min_h, double beside, double half, int segment,
    double[::1] value
):
    """The objective of given lanes (u0, middle, width, k, v0)."""
    cdef Py_ssize_t i
    with nogil:
        for i in range(lanes.shape[0]):
            value[i] = judge(evidence, broad, rows, &lanes[i, 0], prior, weight, min_h, beside, half, segment)


def refine(
    const float[:, ::1] evidence, const float[:, ::1] broad, const int[::1] rows, double near_v, double far_v,
    const double[::1] steps, int halvings, const double[:, ::1] prior, double weight, double min_h, double beside,
    double half, int segment, double[:, ::1] lanes, double[::1] value
):
    """Improve each lane by a pattern search (Hooke and Jeeves 1961) with steps that are halved."""
    cdef Py_ssize_t i
    cdef int k, j, level, sign, rounds
    cdef double code[N]
    cdef double trial[N]
    cdef double base[N]
    cdef double values[N]
    cdef double step[N]
    cdef double best, found, before, near_h, far_h
    cdef bint moved
    with nogil:
        for i in range(lanes.shape[0]):
            near_h = near_v - lanes[i, 4]
            far_h = far_v - lanes[i, 4]
            if far_h < 1.0:
                far_h = 1.0
            if near_h < far_h + 1.0:
                near_h = far_h + 1.0
            code[0] = lanes[i, 0] + (lanes[i, 1] - 0.5 * lanes[i, 2]) * near_h + lanes[i, 3] / near_h
            code[1] = lanes[i, 0] + (lanes[i, 1] + 0.5 * lanes[i, 2]) * near_h + lanes[i, 3] / near_h
            code[2] = lanes[i, 0] + lanes[i, 1] * far_h + lanes[i, 3] / far_h
            code[3] = lanes[i, 3] / far_h
            code[4] = lanes[i, 4]
            natural(code, near_v, far_v, values)
            best = judge(evidence, broad, rows, values, prior, weight, min_h, beside, half, segment)
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
                        for sign in range(2):
                            for j in range(N):
                                trial[j] = code[j]
                            trial[k] += step[k] if sign == 0 else -step[k]
                            natural(trial, near_v, far_v, values)
                            found = judge(evidence, broad, rows, values, prior, weight, min_h, beside, half, segment)
                            if found > best:
                                best = found
                                code[k] = trial[k]
                                break
                    if best <= before:
                        break
                    for k in range(N):
                        trial[k] = 2.0 * code[k] - base[k]
                    natural(trial, near_v, far_v, values)
                    found = judge(evidence, broad, rows, values, prior, weight, min_h, beside, half, segment)
                    if found > best:
                        best = found
                        for k in range(N):
                            code[k] = trial[k]
                for k in range(N):
                    step[k] *= 0.5
            natural(code, near_v, far_v, values)
            for k in range(N):
                lanes[i, k] = values[k]
            value[i] = best


def along(
    const float[:, ::1] evidence, const int[::1] rows, const double[::1] lane, const double[::1] places, double min_h,
    double[:, ::1] values
):
    """Evidence in each row along lines at the given places; -1 where one is outside the image or above min_h."""
    cdef Py_ssize_t r, p, width = evidence.shape[1]
    cdef double h, x, base
    with nogil:
        for r in range(evidence.shape[0]):
            h = rows[r] - lane[4]
            base = lane[0] + lane[3] / h
            for p in range(places.shape[0]):
                values[p, r] = -1.0
                if h < min_h:
                    continue
                x = base + places[p] * h
                if 0.0 <= x <= width - 1.0:
                    values[p, r] = at(&evidence[r, 0], width, x)
