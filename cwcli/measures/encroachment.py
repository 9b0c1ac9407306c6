"""Post-encroachment time: between one vehicle leaving a spot and the other entering it; the time gap of a follower."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.kernels.encounters import rows_of_least_lag
from cwcli.measures.base import Measure
from cwcli.measures.crossing import MIN_CROSSING_SINE
from cwcli.measures.outlines import outline_separation_m
from cwcli.measures.pair import Pair, PairNumber, interpolate_x_y_speed_heading
from cwcli.signals.columns import FloatArray
from cwcli.signals.units import NS_PER_S

MAX_SEARCHED_LAG_S = 5.0
"""The longest lag that is looked for, s. Chosen by hand; not fitted."""
LAG_SEARCH_STEP_S = 0.1
"""Step of the grid on which the least lag is searched, s. Chosen by hand."""
LAG_REFINEMENT_STEP_S, HALF_WIDTH_OF_LAG_REFINEMENT_GRID_STEPS = 0.01, 2
"""The least lag is refined in steps of 0.01 s over 2 grid steps around it: a grid step may hide a contact."""


def post_encroachment_time_of_pair_s(pair: Pair) -> PairNumber:
    """The smallest lag (s) at which one's outline overlaps the other's that much later, (): 0 for a collision."""
    found = pair.compute_once(_grid_rows_of_least_lag)
    if not len(found):
        return np.array(np.nan)
    mine, other = found.astype(int)
    return np.array(_refine_least_lag_s(pair, mine, other) if mine != other else 0.0)


def encroachment_lag_and_states(pair: Pair) -> tuple[float, FloatArray, FloatArray]:
    """PET on the grid (s), and speed and heading (2,) of the host and of the other at that encroachment."""
    found = pair.compute_once(_grid_rows_of_least_lag)
    if not len(found):
        return np.nan, np.full(2, np.nan), np.full(2, np.nan)
    mine, other = found.astype(int)
    own, theirs = np.split(pair.compute_once(_states_of_both_on_time_grid), 2, axis=1)
    return abs(mine - other) * LAG_SEARCH_STEP_S, own[mine, 2:], theirs[other, 2:]


def host_encroachment_duration_s(pair: Pair) -> float:
    """How long the host is where the other is within `MAX_SEARCHED_LAG_S`, around the least lag, s; NaN for parallel
    headings."""
    found = pair.compute_once(_grid_rows_of_least_lag)
    if not len(found):
        return np.nan
    mine, other = found.astype(int)
    own, theirs = np.split(pair.compute_once(_states_of_both_on_time_grid), 2, axis=1)
    if np.abs(np.sin(own[mine, 3] - theirs[other, 3])) < MIN_CROSSING_SINE:
        return np.nan
    last, poses = round(MAX_SEARCHED_LAG_S / LAG_SEARCH_STEP_S), pair.compute_once(_poses_on_grid)
    inside = np.zeros(len(own), dtype=bool)
    for lag in range(-last, last + 1):
        rows, _ = _host_and_other_rows_overlapping_at_lag(poses, lag, pair)
        inside[rows] = True
    outside = np.flatnonzero(~inside)
    before, after = outside[outside < mine], outside[outside > mine]
    if not (len(before) and len(after)):
        return np.nan
    return float(after[0] - before[-1] - 1) * LAG_SEARCH_STEP_S


def _states_of_both_on_time_grid(pair: Pair) -> FloatArray:
    """Both states on the time grid while both are known, (g, 8): x, y, speed, heading of the host and of the other."""
    host, other = pair.host.stamp_ns, pair.other.stamp_ns
    if not (len(host) and len(other)):
        return np.zeros((0, 8))
    first, last = max(int(host[0]), int(other[0])), min(int(host[-1]), int(other[-1]))
    at_ns = np.arange(first, last + 1, round(LAG_SEARCH_STEP_S * NS_PER_S))
    return np.concatenate(
        [interpolate_x_y_speed_heading(track, at_ns, pair.max_gap_s) for track in (pair.host, pair.other)], axis=1
    )


def _poses_on_grid(pair: Pair) -> FloatArray:
    """x, y, cosine and sine of the heading of the host and of the other on the time grid, (8, g)."""
    x, y, _, heading, to_x, to_y, _, to_heading = pair.compute_once(_states_of_both_on_time_grid).T
    return np.stack([x, y, np.cos(heading), np.sin(heading), to_x, to_y, np.cos(to_heading), np.sin(to_heading)])


def _grid_rows_of_least_lag(pair: Pair) -> FloatArray:
    """Grid rows of the host and of the other whose outlines overlap at the least lag, (2,); (0,) if none do."""
    poses = pair.compute_once(_poses_on_grid)
    n = poses.shape[1]
    n_lags = min(round(MAX_SEARCHED_LAG_S / LAG_SEARCH_STEP_S), n - 1) + 1 if n > 1 else 0
    mine, them = rows_of_least_lag(poses, pair.host_size, pair.other_size, _max_overlap_distance_m(pair), n_lags)
    return np.array([mine, them], np.float64) if mine >= 0 else np.zeros(0)


def _max_overlap_distance_m(pair: Pair) -> float:
    """The distance of the centres, m, beyond which the outlines do not overlap."""
    return float(0.5 * (np.hypot(*pair.host_size) + np.hypot(*pair.other_size)))


def _refine_least_lag_s(pair: Pair, host_row: int, other_row: int) -> float:
    """Refine the least lag around two rows of the grid, s."""
    first_ns = max(int(pair.host.stamp_ns[0]), int(pair.other.stamp_ns[0]))
    n = round(HALF_WIDTH_OF_LAG_REFINEMENT_GRID_STEPS * LAG_SEARCH_STEP_S / LAG_REFINEMENT_STEP_S)
    fine_s = np.arange(-n, n + 1) * LAG_REFINEMENT_STEP_S
    tracks = []
    for track, row in ((pair.host, host_row), (pair.other, other_row)):
        at_ns = first_ns + np.rint((row * LAG_SEARCH_STEP_S + fine_s) * NS_PER_S).astype(np.int64)
        tracks.append(interpolate_x_y_speed_heading(track, at_ns, pair.max_gap_s))
    own, theirs = tracks
    i, j = (each.ravel() for each in np.meshgrid(np.arange(len(fine_s)), np.arange(len(fine_s)), indexing="ij"))
    lag_s = np.abs((host_row - other_row) * LAG_SEARCH_STEP_S + fine_s[i] - fine_s[j])
    i, j, lag_s = (each[lag_s <= abs(host_row - other_row) * LAG_SEARCH_STEP_S] for each in (i, j, lag_s))
    dx, dy = (theirs[j, k] - own[i, k] for k in (0, 1))
    known = np.isfinite(dx * dy)
    margin = outline_separation_m(
        dx[known], dy[known], own[i[known], 3], theirs[j[known], 3], pair.host_size, pair.other_size
    )
    return float(lag_s[known][margin <= 0.0].min(initial=abs(host_row - other_row) * LAG_SEARCH_STEP_S))


def _host_and_other_rows_overlapping_at_lag(
    poses: FloatArray, lag: int, pair: Pair
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Grid rows of the host, and of the other `lag` steps later, whose outlines overlap on all edge directions."""
    n = poses.shape[1] - abs(lag)
    mine, them = max(-lag, 0), max(lag, 0)
    own, theirs = poses[:4, mine : mine + n], poses[4:, them : them + n]
    dx, dy = theirs[0] - own[0], theirs[1] - own[1]
    rows = np.flatnonzero(dx * dx + dy * dy <= _max_overlap_distance_m(pair) ** 2)
    for (length, width), (to_length, to_width), side in (
        (pair.host_size, pair.other_size, own),
        (pair.other_size, pair.host_size, theirs),
    ):
        if not len(rows):
            break
        cosine, sine, x, y = side[2][rows], side[3][rows], dx[rows], dy[rows]
        cos_turn = np.abs(own[2][rows] * theirs[2][rows] + own[3][rows] * theirs[3][rows])
        sin_turn = np.abs(own[2][rows] * theirs[3][rows] - own[3][rows] * theirs[2][rows])
        across = np.abs(y * cosine - x * sine) <= 0.5 * (width + to_length * sin_turn + to_width * cos_turn)
        along = np.abs(x * cosine + y * sine) <= 0.5 * (length + to_length * cos_turn + to_width * sin_turn)
        rows = rows[across & along]
    return mine + rows, them + rows


PET = Measure(
    summary="post-encroachment time",
    symbol="PET",
    column="pet_s",
    critical="low",
    formula="least |t_1 - t_2| with overlapping outlines, of one at t_1 and of the other at t_2",
    source="Allen, Shin and Cooper 1978",
    compute=post_encroachment_time_of_pair_s,
    note="post-encroachment time to 0.01 s",
    undefined="neither vehicle entered a spot within 5 s after the other had left it",
    misleads="when following a vehicle: there it is the time gap, which is small for hours in dense traffic",
    is_series=False,
    with_warnings=True,
)


def encroachment_time_of_pair_s(pair: Pair) -> PairNumber:
    """Encroachment time (s) of the pair, (), at its narrowest encroachment."""
    return np.array(host_encroachment_duration_s(pair))


ET = Measure(
    summary="time that the host is in the area where both drive",
    symbol="ET",
    column="et_s",
    critical="high",
    formula=(
        "from the first to the last moment around that of PET at which the host's outline overlaps the other's of some"
        " other moment within 5 s, in steps of 0.1 s"
    ),
    source="Allen, Shin and Cooper 1978",
    compute=encroachment_time_of_pair_s,
    is_series=False,
    is_symmetric=False,
    undefined="as for PET, or the two drive within 30 degrees of parallel",
    misleads="in a queue: it lasts as long as the host stands",
)
