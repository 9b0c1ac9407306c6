# Where lines through the errors of two paths meet the steps of these paths: a part of contact.pyx.

cdef enum:
    N_AXES = 5  # the edges' directions of both outlines, and across the mean way of a step

cdef double STANDING_M = 1e-9
cdef double PARALLEL = 1e-12
cdef double ACROSS = 0.02  # rad: an axis so nearly across the way says as much as the one that is
cdef double OUTSIDE = 4.5  # sigmas: what a line meets out there does not matter
cdef double EVERYWHERE = 1e300  # sigmas: the end of an interval without one


cdef struct Slab:  # the places along a direction at which the outlines reach each other
    double x, y  # the direction
    double reach
    # of a line, as functions of its direction and of the two errors off the lines' plane
    double place, place_one, place_two, slope_ahead, slope_left, moved, moved_one, moved_two, turned_ahead, turned_left


cdef struct Step:  # from one point to the next; changes are from begin to end
    Py_ssize_t begin
    double x, y, way_x, way_y  # middle of the centres' way, and the way
    double cos_host, sin_host, cos_other, sin_other
    Slab slabs[5]
    double gap  # along the direction in which the outlines are farthest apart, in sigmas; negative where they overlap
    int order[5]  # of the slabs: those first that show soonest that a line adds nothing
    double weight  # what the step can count for: the density there
    Root host, other, host_change, other_change
    double along[4]  # a line's direction to the place, row by row, and the two errors off the lines' plane
    double aside[4]
    double along_change[4]
    double aside_change[4]


cdef struct Errors:  # of a line: its direction, and the two errors off the lines' plane
    double cosine, sine, one, two


cdef struct Line:  # in one step: place in the middle, its slope along the line, and half of the change of both
    double x, y, slope_x, slope_y, moved_x, moved_y, turned_x, turned_y


cdef inline void product(Root a, Root b, double* out) noexcept nogil:
    """The product of two symmetric matrices, row by row."""
    out[0], out[1] = a.xx * b.xx + a.xy * b.xy, a.xx * b.xy + a.xy * b.yy
    out[2], out[3] = a.xy * b.xx + a.yy * b.xy, a.xy * b.xy + a.yy * b.yy


cdef inline double half_extent(double nx, double ny, double cosine, double sine, double length, double width) noexcept nogil:
    """Half of what an outline measures along a direction."""
    return 0.5 * (length * fabs(nx * cosine + ny * sine) + width * fabs(ny * cosine - nx * sine))


cdef inline double reach_along(double nx, double ny, const Step* step, const Outlines* outlines) noexcept nogil:
    """How near the centres are along a direction when the outlines touch there."""
    return (half_extent(nx, ny, step.cos_host, step.sin_host, outlines.host_length, outlines.host_width)
            + half_extent(nx, ny, step.cos_other, step.sin_other, outlines.other_length, outlines.other_width))


cdef inline void maps_of(Root host, Root other, const double* to_host, const double* to_other, const double* left_host,
                         const double* left_other, double* along, double* aside) noexcept nogil:
    """Lines' directions, and the errors off their plane, to places."""
    along[0] = host.xx * to_host[0] + host.xy * to_host[2] + other.xx * to_other[0] + other.xy * to_other[2]
    along[1] = host.xx * to_host[1] + host.xy * to_host[3] + other.xx * to_other[1] + other.xy * to_other[3]
    along[2] = host.xy * to_host[0] + host.yy * to_host[2] + other.xy * to_other[0] + other.yy * to_other[2]
    along[3] = host.xy * to_host[1] + host.yy * to_host[3] + other.xy * to_other[1] + other.yy * to_other[3]
    aside[0] = other.xx * left_other[0] + other.xy * left_other[2] - host.xx * left_host[0] - host.xy * left_host[2]
    aside[1] = other.xx * left_other[1] + other.xy * left_other[3] - host.xx * left_host[1] - host.xy * left_host[3]
    aside[2] = other.xy * left_other[0] + other.yy * left_other[2] - host.xy * left_host[0] - host.yy * left_host[2]
    aside[3] = other.xy * left_other[1] + other.yy * left_other[3] - host.xy * left_host[1] - host.yy * left_host[3]


cdef inline double share_aside(const Slab* slab) noexcept nogil:
    """Share of the variance along a direction that is off the lines' plane."""
    cdef double aside = slab.place_one * slab.place_one + slab.place_two * slab.place_two
    return aside / (aside + (slab.slope_ahead * slab.slope_ahead + slab.slope_left * slab.slope_left))


cdef inline void narrow(double c, double slope, double moved, double turned, double reach, double* low,
                        double* high) noexcept nogil:
    """Cut an interval of a line to where its place along a direction is within reach, at some time in the step.

    The place at r in the middle of the step is c + slope r; half of its change in the step is moved + turned r.
    """
    cdef double one, two
    if slope < 0.0:  # the slab is the same from its other side
        c, slope, moved, turned = -c, -slope, -moved, -turned
    if slope < PARALLEL:
        slope, turned = PARALLEL, 0.0
    if fabs(turned) >= slope:
        turned = 0.0
    one, two = -reach - c, reach - c
    # each bound goes one way during the step: it is farthest out at the begin or at the end
    if moved * slope > -one * turned:
        one = (one - moved) / (slope + turned)
    else:
        one = (one + moved) / (slope - turned)
    if moved * slope < -two * turned:
        two = (two - moved) / (slope + turned)
    else:
        two = (two + moved) / (slope - turned)
    low[0], high[0] = max(low[0], one), min(high[0], two)


cdef inline void narrow_across(double bound, const Step* step, const Line* line, const Outlines* outlines,
                               double* low, double* high) noexcept nogil:
    """Cut it by the direction across the way that the place has at one of its bounds: the mean way has another."""
    cdef double wx, wy, length
    if low[0] > high[0] or fabs(bound) > OUTSIDE:
        return
    wx, wy = line.moved_x + bound * line.turned_x, line.moved_y + bound * line.turned_y
    length = sqrt(wx * wx + wy * wy)
    if length < STANDING_M or fabs(step.slabs[0].x * wx + step.slabs[0].y * wy) <= ACROSS * length:
        return
    wx, wy = wx / length, wy / length
    narrow(wx * line.y - wy * line.x, wx * line.slope_y - wy * line.slope_x, wx * line.moved_y - wy * line.moved_x,
           wx * line.turned_y - wy * line.turned_x, reach_along(-wy, wx, step, outlines), low, high)


cdef inline Line place_line(const Step* step, const Errors* errors) noexcept nogil:
    """Where a line is in a step."""
    cdef Line line
    line.x = step.x + step.aside[0] * errors.one + step.aside[1] * errors.two
    line.y = step.y + step.aside[2] * errors.one + step.aside[3] * errors.two
    line.slope_x = step.along[0] * errors.cosine + step.along[1] * errors.sine
    line.slope_y = step.along[2] * errors.cosine + step.along[3] * errors.sine
    line.moved_x = 0.5 * (step.way_x + step.aside_change[0] * errors.one + step.aside_change[1] * errors.two)
    line.moved_y = 0.5 * (step.way_y + step.aside_change[2] * errors.one + step.aside_change[3] * errors.two)
    line.turned_x = 0.5 * (step.along_change[0] * errors.cosine + step.along_change[1] * errors.sine)
    line.turned_y = 0.5 * (step.along_change[2] * errors.cosine + step.along_change[3] * errors.sine)
    return line


cdef inline void project_lines(const Step* step, Slab* slab) noexcept nogil:
    """The same along the direction of a slab, as functions of a line's errors."""
    cdef double nx = slab.x, ny = slab.y
    slab.place = nx * step.x + ny * step.y
    slab.place_one = nx * step.aside[0] + ny * step.aside[2]
    slab.place_two = nx * step.aside[1] + ny * step.aside[3]
    slab.slope_ahead = nx * step.along[0] + ny * step.along[2]
    slab.slope_left = nx * step.along[1] + ny * step.along[3]
    slab.moved = 0.5 * (nx * step.way_x + ny * step.way_y)
    slab.moved_one = 0.5 * (nx * step.aside_change[0] + ny * step.aside_change[2])
    slab.moved_two = 0.5 * (nx * step.aside_change[1] + ny * step.aside_change[3])
    slab.turned_ahead = 0.5 * (nx * step.along_change[0] + ny * step.along_change[2])
    slab.turned_left = 0.5 * (nx * step.along_change[1] + ny * step.along_change[3])


cdef inline bint adds_nothing(double low, double high, const double* lows, const double* highs, int n) noexcept nogil:
    """Whether an interval is empty, out of reach, or inside one of n others."""
    cdef int k
    if low > high or low > OUTSIDE or high < -OUTSIDE:
        return True
    for k in range(n):
        if low >= lows[k] and high <= highs[k]:
            return True
    return False


cdef int add_interval(const Step* step, const Errors* errors, const Outlines* outlines, double* lows, double* highs,
                      int n) noexcept nogil:
    """Add to n intervals of a line the one in which it touches in a step; returns how many they are then.

    The direction along which the outlines are farthest apart comes first: in most steps it shows that they add nothing
    to a nearer one. An interval that reaches outside goes on without an end, so that it holds more of the others.
    """
    cdef double low = -EVERYWHERE, high = EVERYWHERE, one, two
    cdef const Slab* slab
    cdef Line line
    cdef int k
    for k in range(N_AXES):
        slab = &step.slabs[step.order[k]]
        narrow(slab.place + slab.place_one * errors.one + slab.place_two * errors.two,
               slab.slope_ahead * errors.cosine + slab.slope_left * errors.sine,
               slab.moved + slab.moved_one * errors.one + slab.moved_two * errors.two,
               slab.turned_ahead * errors.cosine + slab.turned_left * errors.sine, slab.reach, &low, &high)
        if adds_nothing(low, high, lows, highs, n):
            return n
    line = place_line(step, errors)
    one, two = low, high
    narrow_across(one, step, &line, outlines, &low, &high)
    narrow_across(two, step, &line, outlines, &low, &high)
    if adds_nothing(low, high, lows, highs, n):
        return n
    low = -EVERYWHERE if low < -OUTSIDE else low
    high = EVERYWHERE if high > OUTSIDE else high
    for k in range(n):
        if low <= highs[k] and high >= lows[k]:
            lows[k], highs[k] = min(lows[k], low), max(highs[k], high)
            return n
    lows[n], highs[n] = low, high
    return n + 1


cdef inline void order_slabs(int tight, int* order) noexcept nogil:
    """The tightest slab, the one across it, and the others."""
    cdef int across = 4 if tight == 0 else 5 - tight  # of the host 1 and 4, of the other 2 and 3; 4 may be across 0
    cdef int axis, n = 2
    order[0], order[1] = tight, across
    for axis in range(N_AXES):
        if axis != tight and axis != across:
            order[n] = axis
            n += 1


cdef void sort_by_gap(Py_ssize_t* order, Py_ssize_t begin, Py_ssize_t end, const Step* steps) noexcept nogil:
    """Sort the steps from begin to end, from the nearest in sigmas to the farthest."""
    cdef Py_ssize_t i, k, step
    for i in range(begin + 1, end):
        step, k = order[i], i
        while k > begin and steps[order[k - 1]].gap > steps[step].gap:
            order[k] = order[k - 1]
            k -= 1
        order[k] = step


cdef inline double share_below(double r) noexcept nogil:
    """Share of a line's errors below r: their distance from the middle is Rayleigh's, to either side alike."""
    cdef double half = 0.5 * exp(-0.5 * r * r)
    return half if r < 0.0 else 1.0 - half


cdef double share_of(double* low, double* high, int n) noexcept nogil:
    """Share of a line that is in any of n intervals, which are sorted in place."""
    cdef int i, k
    cdef double a, b, end, total = 0.0
    for i in range(1, n):
        a, b = low[i], high[i]
        k = i - 1
        while k >= 0 and low[k] > a:
            low[k + 1], high[k + 1] = low[k], high[k]
            k -= 1
        low[k + 1], high[k + 1] = a, b
    i = 0
    while i < n:
        a, end = low[i], high[i]
        i += 1
        while i < n and low[i] <= end:
            end = max(end, high[i])
            i += 1
        total += share_below(end) - share_below(a)
    return total
