"""The horizon that braking needs: at a great closing speed the default rule looks farther ahead.

A driver who is warned at time T before contact reacts, and then brakes the closing speed v away with b, so

    T = TIME_FROM_WARNING_TO_BRAKING_S + v / (2 b).

With 4 m/s^2 that is what UN Regulation 131 asks for (0.8 s before braking with 4 m/s^2 must begin), and it is more than
2.5 s above 12 m/s. The longer look counts for what drives ahead in the host's own direction, or stands there, and while
the host's path does not turn beyond its end. It never counts while the time to collision at the present speeds is more
than 4 s, where ISO 15623 calls a warning too early.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import replace
from cwcli.signals.columns import FloatArray, sort_distinct_values
from cwcli.warning.collision import PathPairs
from cwcli.warning.measures import MEASURE_ARRAY_NAMES, Measures, measure_paths
from cwcli.warning.remote_alignment import PathPoints, interpolate_paths
from cwcli.warning.types import WarningConfig

TIME_FROM_WARNING_TO_BRAKING_S = 1.1
"""Time from the warning to the braking, s: 0.8 s of the driver (UN R131, UN R152, ISO 15623), and 0.3 s that messages
and evaluations take. Chosen by hand."""
DECELERATION_AFTER_WARNING_MPS2 = 4.0
"""Deceleration after the reaction, m/s^2: that of UN R131."""
MAX_TTC_AT_WHICH_LOOK_BEYOND_HORIZON_COUNTS_S = 4.0
"""Time to collision at the present speeds, s, above which the longer look does not count: that of ISO 15623."""
MAX_TTC_OF_MEASURED_PAIRS_S = 5.0
"""Time to collision at the present speeds, s, up to which pairs are measured: a lead that brakes takes it from there to
`MAX_TTC_AT_WHICH_LOOK_BEYOND_HORIZON_COUNTS_S` in more than the persistence. Chosen by hand."""
MAX_HEADING_DIFFERENCE_IN_STREAM_RAD = np.radians(30.0)
"""Greatest angle between headings of vehicles in one stream, rad. Chosen by hand."""
MAX_STANDING_SPEED_MPS = 0.5
"""Speed below which a vehicle stands, m/s; its heading says nothing. Chosen by hand."""
MIN_CLOSING_SPEED_NOT_TO_WAIT_FOR_GENTLE_BRAKING_MPS = 2.5
"""Least closing speed at which gentle braking is not waited for, m/s: UN R152 begins at 10 km/h. Chosen by hand."""
MAX_DISTANCE_OF_ARC_FROM_LINE_M = 0.3
"""Greatest distance between the host's arc and the straight line that continues its path, m. Chosen by hand."""
CONTACT_PROBABILITY_STEP_S = 0.1
"""Step of the times by which the probability of contact is computed, s; between them it is interpolated."""


def measure_to_braking_horizon(
    measures: Measures,
    pairs: PathPairs,
    config: WarningConfig,
    persistence_s: float,
    *,
    is_wanted: npt.NDArray[np.bool_] | None = None,
) -> Measures:
    """Measure the pairs to the horizon that braking needs.

    Args:
        measures: Shape (m,) each: of the present moment.
        pairs: The m pairs of paths.
        persistence_s: How much farther the late probability looks.
        is_wanted: Shape (m,): rows that are measured; None: all.

    Returns:
        Measures with the probabilities by that horizon; they are 0 in rows where it does not apply.
    """
    m = len(measures.distance_m)
    whole = replace(measures, probability=np.zeros(m), late_probability=np.zeros(m))
    ttc_s = _outline_ttc_s(measures, pairs)
    rows = np.flatnonzero(
        ttc_s <= MAX_TTC_OF_MEASURED_PAIRS_S
        if is_wanted is None
        else is_wanted & (ttc_s <= MAX_TTC_OF_MEASURED_PAIRS_S)
    )
    if not len(rows):
        return whole
    time_s = _host_path_times_until_s(pairs, config.max_horizon_s + persistence_s)
    rows, own, theirs = _rows_and_paths_in_one_stream(pairs, rows, time_s)
    sizes = pairs.host_size, pairs.other_size
    far = measure_paths(
        own, theirs, time_s, horizon_s=float(time_s[-1]), radius_m=config.distance_m,
        host_size=sizes[0], other_size=sizes[1],
    )  # fmt: skip
    gap_m = far.distance_m - 0.5 * (sizes[0][0] + sizes[1][0])
    need_s = _braking_horizon_s(own, theirs, gap_m, far.overlap_s, time_s, config)
    is_straight = _bend_beyond_path_end_m(pairs, rows, need_s) <= MAX_DISTANCE_OF_ARC_FROM_LINE_M
    applies = is_straight & np.isfinite(need_s)
    chosen = np.flatnonzero(applies)
    if not len(chosen):
        return whole
    ends_s = sort_distinct_values(
        np.append(np.arange(0.0, time_s[-1], CONTACT_PROBABILITY_STEP_S).round(9), time_s[-1])
    )
    by_end = pairs.select_rows(rows[chosen]).contact_probability_by_times(
        far.min_distance_m[chosen], time_s, tuple(ends_s)
    )
    for name in MEASURE_ARRAY_NAMES:
        values = getattr(whole, name).copy()
        values[rows[chosen]] = getattr(far, name)[chosen]
        whole = replace(whole, **{name: values})
    within, late = (
        np.array([np.interp(end, ends_s, row) for end, row in zip(need_s[chosen] + more_s, by_end, strict=True)])
        for more_s in (0.0, persistence_s)
    )
    whole.probability[:], whole.late_probability[:] = 0.0, 0.0
    whole.probability[rows[chosen]] = np.where(
        ttc_s[rows[chosen]] <= MAX_TTC_AT_WHICH_LOOK_BEYOND_HORIZON_COUNTS_S, within, 0.0
    )
    whole.late_probability[rows[chosen]] = late
    return whole


def _outline_ttc_s(measures: Measures, pairs: PathPairs) -> FloatArray:
    """Time to collision of vehicles in one line at the present speeds, (m,): gap over closing speed."""
    gap_m = measures.distance_m - 0.5 * (pairs.host_size[0] + pairs.other_size[0])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(measures.closing_mps > 0.0, np.maximum(gap_m, 0.0) / measures.closing_mps, np.inf)


def _host_path_times_until_s(pairs: PathPairs, end_s: float) -> FloatArray:
    """The times of the host's path points, (q,), as far as the end, and the end."""
    step_s = float(pairs.host.time_s[1])
    times = np.arange(int(end_s / step_s + 1e-6) + 1) * step_s
    return sort_distinct_values(np.append(times, end_s).round(9))


def _rows_and_paths_in_one_stream(
    pairs: PathPairs, rows: np.ndarray, time_s: FloatArray
) -> tuple[np.ndarray, PathPoints, PathPoints]:
    """Those of the rows whose other drives the host's way or stands, and the points of both paths."""
    zero_age_s = np.zeros(1)
    own = interpolate_paths(pairs.host, pairs.host_row[rows], np.zeros(len(rows)), zero_age_s)
    theirs = interpolate_paths(pairs.other, pairs.other_row[rows], pairs.age_s[rows], zero_age_s)
    turn = np.cos(theirs.heading_rad[:, 0] - own.heading_rad[:, 0])
    is_standing = np.abs(theirs.speed_mps[:, 0]) < MAX_STANDING_SPEED_MPS
    rows_in_stream = rows[is_standing | (turn > np.cos(MAX_HEADING_DIFFERENCE_IN_STREAM_RAD))]
    host = interpolate_paths(pairs.host, pairs.host_row[rows_in_stream], np.zeros(len(rows_in_stream)), time_s)
    other = interpolate_paths(pairs.other, pairs.other_row[rows_in_stream], pairs.age_s[rows_in_stream], time_s)
    return rows_in_stream, host, other


def _braking_horizon_s(
    host: PathPoints,
    other: PathPoints,
    gap_m: FloatArray,
    overlap_s: FloatArray,
    time_s: FloatArray,
    config: WarningConfig,
) -> FloatArray:
    """The horizon that braking needs, (k,), at most the longest; NaN where the rule's own horizon is enough.

    The closing speed is that at contact, v_c^2 = v^2 + 2 a d, with the present closing speed v, gap d and relative
    acceleration a: the paths let an acceleration fade, and a lead that brakes may well go on.
    Below the rule's own horizon the need counts for a vehicle that stands, of which gentle braking warns too late.
    """
    closing_mps = _contact_speed_at_present_accel_mps(host, other, gap_m, float(time_s[1]))
    need_s = np.minimum(
        TIME_FROM_WARNING_TO_BRAKING_S + closing_mps / (2.0 * DECELERATION_AFTER_WARNING_MPS2), config.max_horizon_s
    )
    is_standing = np.abs(other.speed_mps[:, 0]) < MAX_STANDING_SPEED_MPS
    counts = (
        np.isfinite(overlap_s)
        & (closing_mps >= MIN_CLOSING_SPEED_NOT_TO_WAIT_FOR_GENTLE_BRAKING_MPS)
        & (is_standing | (need_s > config.horizon_s))
    )
    return np.where(counts, need_s, np.nan)


def _contact_speed_at_present_accel_mps(
    host: PathPoints, other: PathPoints, present_gap_m: FloatArray, step_s: float
) -> FloatArray:
    """Closing speed along the host's heading when the gap is used up at the present accelerations, (k,)."""
    closing = host.speed_mps[:, :2] - other.speed_mps[:, :2] * np.cos(other.heading_rad - host.heading_rad)[:, :2]
    accel_mps2 = (closing[:, 1] - closing[:, 0]) / step_s
    return np.sqrt(
        np.maximum(closing[:, 0] * np.abs(closing[:, 0]) + 2.0 * accel_mps2 * np.maximum(present_gap_m, 0.0), 0.0)
    )


def _bend_beyond_path_end_m(pairs: PathPairs, rows: np.ndarray, until_s: FloatArray) -> FloatArray:
    """How far the host's arc leaves the straight line that continues its path after the end, m, (k,)."""
    host, own = pairs.host, pairs.host_row[rows]
    beyond_s = np.maximum(until_s - float(host.time_s[-1]), 0.0)
    step_s = float(host.time_s[1])
    yaw_rate = (host.heading_rad[own, -1] - host.heading_rad[own, -2]) / step_s
    return np.asarray(0.5 * np.abs(host.speed_mps[own, -1] * yaw_rate) * beyond_s**2)
