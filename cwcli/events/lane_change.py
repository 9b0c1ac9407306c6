"""Lane changes of the ego, from its motion: the heading leaves the road's direction and comes back, a lane aside."""

from __future__ import annotations

import itertools
from bisect import bisect_left, insort
from collections.abc import Iterator

import numpy as np

from cwcli.events.base import EventKind, Moment
from cwcli.events.evidence import EventEvidence
from cwcli.events.own_path import PROJECTION_TIME_STEP_S, rows_one_grid_step_apart
from cwcli.signals.columns import FloatArray

MIN_LATERAL_SHIFT_OF_LANE_CHANGE_M, MAX_LATERAL_SHIFT_OF_LANE_CHANGE_M = 2.4, 4.6
"""Least and greatest distance between the old and the new lane, m: lanes are 2.75 m to 3.75 m wide."""
MIN_LANE_CHANGE_DURATION_S, MAX_LANE_CHANGE_DURATION_S = 1.5, 10.0
"""Least and greatest duration of a lane change, s (Toledo and Zohar 2007: 1 s to 13 s, mean 4.6 s)."""
MIN_LANE_CHANGE_SPEED_MPS = 4.0
"""Slower than this a car parks or evades, m/s. Chosen by hand."""
ROAD_YAW_RATE_WINDOW_S = 24.0
"""The road's own yaw rate is the median over this time, s. Chosen by hand: more than twice the longest lane change."""
MIN_HEADING_CHANGE_ABOVE_NOISE_RAD = 0.006
"""Smaller changes of heading are noise, rad. Chosen by hand: a tenth of a usual lane change."""
MAX_REMAINING_HEADING_SHARE = 0.35
"""Largest share of the change of heading that may be left over afterwards. Chosen by hand."""
N_ROWS_AROUND_HEADING_CHANGE = 10
"""Rows before and after the change of heading that belong to the lane change: 1 s, in which the heading hardly turns.
Chosen by hand."""
LANE_CHANGE_EDGE_DISTANCE_SHARE = 0.05
"""A lane change lasts from this share of its distance to the rest of it. Chosen by hand."""
MAX_LANE_CHANGE_HEADING_RAD = 0.35
"""The heading changes by less than this within a lane change, rad. Chosen by hand: more is a turn."""


def find_lane_changes(evidence: EventEvidence) -> Iterator[Moment]:
    """Yield the ego's lane changes, which are looked for once."""
    if evidence.lane_changes is None:
        evidence.lane_changes = tuple(_iter_lane_changes(evidence))
    yield from evidence.lane_changes


def _iter_lane_changes(evidence: EventEvidence) -> Iterator[Moment]:
    rows = rows_one_grid_step_apart(evidence)
    stamp_ns, state = evidence.stamp_ns[rows], evidence.ego_state[rows]
    if len(rows) < MIN_LANE_CHANGE_DURATION_S / PROJECTION_TIME_STEP_S:
        return
    speed_mps = state[:, 2]
    turned_rad = np.diff(np.unwrap(state[:, 3]))
    turned_rad = np.concatenate([turned_rad[:1], turned_rad])
    turned_rad -= _running_median(turned_rad, round(ROAD_YAW_RATE_WINDOW_S / PROJECTION_TIME_STEP_S))
    lobes = _split_into_lobes(turned_rad)
    last_end = -1
    for one, other in itertools.pairwise(lobes):
        (first, _, left_rad), (_, last, right_rad) = one, other
        if first < last_end or left_rad * right_rad > 0.0:
            continue
        steepest_rad = max(abs(left_rad), abs(right_rad))
        if (
            abs(left_rad + right_rad) > MAX_REMAINING_HEADING_SHARE * steepest_rad
            or steepest_rad > MAX_LANE_CHANGE_HEADING_RAD
        ):
            continue
        first, last = (
            max(first - N_ROWS_AROUND_HEADING_CHANGE, 0),
            min(last + N_ROWS_AROUND_HEADING_CHANGE, len(rows) - 1),
        )
        aside_m = _lateral_displacement_m(turned_rad[first : last + 1], speed_mps[first : last + 1])
        shift_m = float(aside_m[-1])
        if (
            not MIN_LATERAL_SHIFT_OF_LANE_CHANGE_M <= abs(shift_m) <= MAX_LATERAL_SHIFT_OF_LANE_CHANGE_M
            or speed_mps[first : last + 1].min() < MIN_LANE_CHANGE_SPEED_MPS
        ):
            continue
        share = aside_m / shift_m
        begin = first + int(np.argmax(share >= LANE_CHANGE_EDGE_DISTANCE_SHARE))
        end = last - int(np.argmax(share[::-1] <= 1.0 - LANE_CHANGE_EDGE_DISTANCE_SHARE))
        duration_s = (end - begin) * PROJECTION_TIME_STEP_S
        if MIN_LANE_CHANGE_DURATION_S <= duration_s <= MAX_LANE_CHANGE_DURATION_S:
            last_end = last
            side = "to the left" if shift_m > 0.0 else "to the right"
            span = int(stamp_ns[begin]), int(stamp_ns[end])
            yield Moment(*span, (evidence.ego_id,), abs(shift_m), 1.0, side, f"{abs(shift_m):.1f} m {side}")


def _lateral_displacement_m(turned_rad: FloatArray, speed_mps: FloatArray) -> FloatArray:
    """Return the distance to the left since the first row, from the changes of heading relative to the road, (m,).

    The direction before and after is that of the road: what differs there is taken away linearly.
    """
    heading_rad = np.cumsum(turned_rad)
    n = N_ROWS_AROUND_HEADING_CHANGE // 2
    before_rad, after_rad = heading_rad[:n].mean(), heading_rad[-n:].mean()
    heading_rad = heading_rad - np.linspace(before_rad, after_rad, len(heading_rad))
    return np.asarray(np.cumsum(np.sin(heading_rad) * speed_mps * PROJECTION_TIME_STEP_S))


def _running_median(values: FloatArray, n: int) -> FloatArray:
    """Return the median of about `n` values around each one, (m,)."""
    half = n // 2
    padded = np.pad(values, half, mode="symmetric")  # at the edges, too, the road goes on as it is there
    if np.isnan(padded).any():
        return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1))
    rows: list[float] = padded.tolist()
    in_window = sorted(rows[: 2 * half + 1])
    medians = [in_window[half]]
    for old, new in zip(
        rows, rows[2 * half + 1 :], strict=False
    ):  # a quarter of the time of the medians of all windows
        del in_window[bisect_left(in_window, old)]
        insort(in_window, new)
        medians.append(in_window[half])
    return np.array(medians)


def _split_into_lobes(turned_rad: FloatArray) -> list[tuple[int, int, float]]:
    """Return first row, last row and change of heading [rad] of each stretch with one sign; small ones are left out.

    Neighbours with the same sign, between which only a small one was left out, are one.
    """
    sign = np.sign(turned_rad)
    edges = np.concatenate([[0], np.flatnonzero(np.diff(sign)) + 1, [len(sign)]])
    lobes: list[tuple[int, int, float]] = []
    changes_rad = np.add.reduceat(turned_rad, edges[:-1])
    large = ~(np.abs(changes_rad) < MIN_HEADING_CHANGE_ABOVE_NOISE_RAD)
    spans = zip(edges[:-1][large].tolist(), edges[1:][large].tolist(), changes_rad[large].tolist(), strict=True)
    for first, stop, change_rad in spans:
        if lobes and lobes[-1][2] * change_rad > 0.0 and first - lobes[-1][1] < 1.0 / PROJECTION_TIME_STEP_S:
            lobes[-1] = lobes[-1][0], stop - 1, lobes[-1][2] + change_rad
        else:
            lobes.append((first, stop - 1, change_rad))
    return lobes


EVENT = EventKind(
    summary="the ego changes the lane",
    value_name="shift_m",
    threshold=f"{MIN_LATERAL_SHIFT_OF_LANE_CHANGE_M:g} m to {MAX_LATERAL_SHIFT_OF_LANE_CHANGE_M:g} m aside in "
    f"{MIN_LANE_CHANGE_DURATION_S:g} s to {MAX_LANE_CHANGE_DURATION_S:g} s",
    source="widths of lanes; Toledo and Zohar 2007",
    needs="states",
    find=find_lane_changes,
)
