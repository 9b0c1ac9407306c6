# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Bright stripes of a marking's width in image rows, and, for less, the dark joints that lie beside markings.

Arithmetic is +, -, *, / and comparisons in a fixed order (compiled with -ffp-contract=off): the same bits everywhere. The
loops over a row are plain single-precision ones, so that compilers turn them into vector code. The plain NumPy twin is in
tests/unit/vision/naive_ridge.py.
"""

from libc.stdlib cimport free, malloc

cdef enum:
    LANES = 8  # sums are taken in so many parts
    STEEP = 2  # pixels; in a narrower window the boundary of a lane moves too far from row to row

cdef struct Stripe:
    double inner      # width of the inner window, times h
    double gap        # where the side windows begin, likewise
    double side       # their width, likewise
    float floor_grey  # grey levels
    float relative
    float rough
    float lopsided    # share of the sides' difference
    float dead        # dead zone
    float crowded


def stripes(
    const unsigned char[:, ::1] grey, const int[::1] rows, double horizon_v, Stripe stripe, Stripe joint, *,
    float joint_weight, double joint_reach, int reach, int broad_reach, float[:, :, ::1] evidence
):
    cdef Py_ssize_t height = grey.shape[0], width = grey.shape[1], i, u, above, below
    cdef double h
    cdef float* made
    cdef int* sums = <int*>malloc((width + 1) * sizeof(int))
    cdef float* middle = <float*>malloc(5 * width * sizeof(float))
    cdef float* seam = <float*>malloc(2 * width * sizeof(float))  # a block of its own: else loops are no vector code
    cdef unsigned char* bright = <unsigned char*>malloc(width)
    if not (sums and middle and seam and bright):
        free(sums)
        free(middle)
        free(seam)
        free(bright)
        raise MemoryError
    cdef float* spare = middle + 4 * width
    cdef float* wider = seam + width
    with nogil:
        for i in range(rows.shape[0]):
            h = rows[i] - horizon_v
            if h < 1.0:
                h = 1.0
            made = &evidence[0, i, 0]
            above = below = rows[i]
            if stripe.inner * h >= STEEP:
                above -= above > 0
                below += below + 1 < height
            add_up(&grey[above, 0], &grey[rows[i], 0], &grey[below, 0], width, bright, sums)
            judge_row(sums, width, h, &stripe, False, middle, made)
            if joint_weight > 0.0:
                if above != below:
                    add_up(&grey[rows[i], 0], &grey[rows[i], 0], &grey[rows[i], 0], width, bright, sums)
                judge_row(sums, width, h, &joint, True, middle, seam)
                widen(seam, width, 0, <Py_ssize_t>(joint_reach * h + 0.5), spare, wider)
                for u in range(width):
                    wider[u] = wider[u] * joint_weight
                for u in range(width):
                    made[u] = made[u] if made[u] > wider[u] else wider[u]
            widen(&evidence[0, i, 0], width, 0, reach, spare, &evidence[1, i, 0])
            widen(&evidence[1, i, 0], width, reach, broad_reach, spare, &evidence[2, i, 0])
    free(sums)
    free(middle)
    free(seam)
    free(bright)


cdef void add_up(
    const unsigned char* above, const unsigned char* row, const unsigned char* below, Py_ssize_t width,
    unsigned char* bright, int* sums
) noexcept nogil:
    """Sums of the greatest of three rows: a raised dot is bright in one of them, and only every second row is judged."""
    cdef Py_ssize_t u
    cdef int total = 0
    cdef unsigned char greatest
    for u in range(width):
        greatest = above[u] if above[u] > row[u] else row[u]
        bright[u] = greatest if greatest > below[u] else below[u]
    sums[0] = 0
    for u in range(width):
        total += bright[u]
        sums[u + 1] = total


cdef void judge_row(
    const int* sums, Py_ssize_t width, double h, const Stripe* stripe, bint is_dark, float* middle, float* evidence
) noexcept nogil:
    """The evidence of one row, of bright stripes or of dark ones; `middle` has room for five rows."""
    cdef Py_ssize_t u
    cdef float* left = middle + width
    cdef float* right = middle + 2 * width
    cdef float* brighter = middle + 3 * width
    cdef float* spare = middle + 4 * width
    cdef float zero = 0.0, one = 1.0, darker, contrast, noise, base, share, lopsided = stripe.lopsided, dead = stripe.dead
    cdef float relative = -stripe.relative if is_dark else stripe.relative, rest = one / (one - stripe.dead)
    cdef double inner = stripe.inner * h, near = stripe.gap * h, far
    if inner < 1.0:
        inner = 1.0
    if near < 0.5 * inner + 0.5:
        near = 0.5 * inner + 0.5
    far = near + stripe.side * h
    if far < near + 1.5:
        far = near + 1.5
    box(sums, width, -0.5 * inner, 0.5 * inner, middle)
    box(sums, width, -far, -near, left)
    box(sums, width, near, far, right)
    if is_dark:  # as bright ones in the negative
        for u in range(3 * width):
            middle[u] = -middle[u]
    for u in range(width):
        brighter[u] = left[u] if left[u] > right[u] else right[u]
        darker = left[u] if left[u] < right[u] else right[u]
        contrast = darker - middle[u]
        spare[u] = contrast if contrast > zero else zero
        contrast = middle[u] - brighter[u] - lopsided * (brighter[u] - darker)
        evidence[u] = contrast if contrast > zero else zero
    base = stripe.floor_grey + stripe.rough * (total_of(spare, width) / <float>width)
    for u in range(width):
        noise = base + relative * brighter[u]
        contrast = evidence[u] * evidence[u]
        contrast = (contrast / (contrast + noise * noise) - dead) * rest
        evidence[u] = contrast if contrast > zero else zero
    share = total_of(evidence, width) / (<float>width * stripe.crowded)
    share = one / (one + share * share)
    for u in range(width):
        evidence[u] = evidence[u] * share


cdef float total_of(const float* values, Py_ssize_t n) noexcept nogil:
    """The sum, in `LANES` interleaved parts."""
    cdef float parts[LANES]
    cdef float total = 0.0
    cdef Py_ssize_t i, k, whole = n - n % LANES
    for k in range(LANES):
        parts[k] = 0.0
    i = 0
    while i < whole:
        for k in range(LANES):
            parts[k] += values[i + k]
        i += LANES
    for i in range(whole, n):
        parts[i - whole] += values[i]
    for k in range(LANES):
        total += parts[k]
    return total


cdef void widen(
    const float* values, Py_ssize_t width, Py_ssize_t done, Py_ssize_t reach, float* spare, float* made
) noexcept nogil:
    """The greatest value within `reach` columns, from the greatest within `done` ones."""
    cdef Py_ssize_t u, by
    cdef const float* source = values
    cdef float* target = made
    while done < reach:
        by = reach - done
        if by > 2 * done + 1:
            by = 2 * done + 1
        done += by
        greatest_of_three(source, width, by, target)
        source = target
        target = spare if target == made else made
    if source != made:
        for u in range(width):
            made[u] = source[u]


cdef void greatest_of_three(const float* values, Py_ssize_t width, Py_ssize_t by, float* made) noexcept nogil:
    """The greatest of each value and those `by` columns to both sides, or the outermost ones."""
    cdef Py_ssize_t u, first = by if by < width else width, last = width - by if width - by > first else first
    cdef float greatest
    for u in range(first, last):
        greatest = values[u - by] if values[u - by] > values[u] else values[u]
        made[u] = values[u + by] if values[u + by] > greatest else greatest
    for u in range(first):
        made[u] = greatest_at(values, width, u, by)
    for u in range(last, width):
        made[u] = greatest_at(values, width, u, by)


cdef float greatest_at(const float* values, Py_ssize_t width, Py_ssize_t u, Py_ssize_t by) noexcept nogil:
    cdef float greatest = values[u], left = values[u - by if u > by else 0]
    cdef float right = values[u + by if u + by < width else width - 1]
    if left > greatest:
        greatest = left
    return right if right > greatest else greatest


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
