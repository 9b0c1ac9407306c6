"""Fixes of two receivers or antennas in one topic: every second one lies beside the others.

A filter takes the mean of both, and what is wrong by half their distance never shows, as each pair is wrong alike. But
of one receiver every second fix lies where the others lie, and all together lie in one heap about the way.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cwcli.estimation.contradiction import CAR_MOTION_TEXT, Contradiction, SourceQuantity
from cwcli.estimation.measurements import Kind
from cwcli.estimation.passes import N_MOTION_STATES, SensorSeries
from cwcli.signals.columns import BoolArray, EastNorthRows, FloatArray, StateCovariance, StateRows, median_of_values
from cwcli.signals.vehicle_state import HEADING, X, Y

FixesOfTwoPlaces = tuple[str, float, str]
"""Source, how far some of its fixes lie beside the others (m, 0: none do), and words for those that do."""
MIN_FIXES_TO_SHOW_TWO_PLACES = 100
"""Least number of fixes that show it. Chosen by hand: ten blocks of five pairs."""
MIN_REPORTED_ANTENNA_DISTANCE_M = 1.0
"""Least distance that is told, m. Chosen: a car's width is 2 m, and two antennas on a roof are 1 m apart."""
N_BLOCKS_ALL_SHOWING_TWO_PLACES = 10
"""Number of parts of the log that must all show it. Chosen by hand: chance does so in one log of a thousand."""
MIN_DISTANCE_OF_TWO_PLACES_SIGMAS = 6.0
"""Least distance in its sigmas. Chosen: chance makes it once in 10^8 logs."""
MAX_SHARE_OF_VARIANCE_WITHIN_HEAPS = 0.2
"""Greatest share of the variance that is left within two heaps. Chosen by hand, not fitted: it is 0.36 of normal and
0.25 of uniform values, and 0.1 of two heaps six sigmas apart."""
MIN_SHARE_OF_SMALLER_HEAP = 0.1
"""Least share of the smaller heap; of fewer ones the gate rejects most. Chosen by hand; not fitted."""
MAX_DIFFERENCE_FROM_PATH_IN_MEDIANS = 6.0
"""Greatest difference from the way, in median ones, of a fix that is no outlier. Chosen by hand; not fitted."""
MIN_COSINE_OF_PLACES_LYING_ALONG_PATH = 0.9
"""Cosine of the angle between the two heaps and the way from which they lie along it. Chosen by hand."""


def distance_m_and_words_of_two_places(fixes: SensorSeries, time_s: FloatArray, state: StateRows) -> tuple[float, str]:
    """Return how far some fixes lie beside the others, m, and words for those that do; 0 where none do.

    Args:
        fixes: Positions.
        time_s, state: Times (m,) and states (m, 8) of the estimate from them.
    """
    if len(fixes) < MIN_FIXES_TO_SHOW_TWO_PLACES or len(time_s) < 2 or max(fixes.coarse_steps_m) > 0.0:
        return 0.0, ""
    at_s = fixes.time_s - fixes.latency_s
    beside_m = fixes.values - np.column_stack([np.interp(at_s, time_s, state[:, k]) for k in (X, Y)])
    heading = np.interp(at_s, time_s, state[:, HEADING])
    step_s = np.diff(fixes.time_s)
    n_steps = np.maximum(np.rint(step_s / max(median_of_values(step_s), 1e-9)), 1.0)
    is_odd = np.append(0.0, np.cumsum(n_steps)) % 2.0 == 1.0
    size_m = np.hypot(*beside_m.T)
    is_near = size_m <= MAX_DIFFERENCE_FROM_PATH_IN_MEDIANS * median_of_values(size_m)
    is_near &= (at_s >= time_s[0]) & (at_s <= time_s[-1])
    if is_near.sum() < MIN_FIXES_TO_SHOW_TWO_PLACES:
        return 0.0, ""
    beside_m, heading, is_odd = beside_m[is_near], heading[is_near], is_odd[is_near]
    if distance_m := distance_of_every_second_fix_m(beside_m, heading, is_odd):
        return distance_m, "every second fix lies"
    distance_m, share = distance_m_and_share_of_two_heaps(beside_m, heading)
    return distance_m, f"{100 * share:.0f} % of its fixes lie"


def distance_of_every_second_fix_m(beside_m: EastNorthRows, heading_rad: FloatArray, is_odd: BoolArray) -> float:
    """Return how far every second fix lies beside the others, m, on the map or as the car turns; 0 where it does not.

    Args:
        beside_m: Shape (n, 2): fixes less the places of the estimate.
        heading_rad: Shape (n,).
        is_odd: Shape (n,): the fix is one of the second ones.
    """
    sign = np.where(is_odd, 1.0, -1.0)[:, None]
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    in_car_m = np.column_stack(
        [cos * beside_m[:, 0] + sin * beside_m[:, 1], cos * beside_m[:, 1] - sin * beside_m[:, 0]]
    )
    most_m = 0.0
    for moved_m in (sign * beside_m, sign * in_car_m):
        mean_m = moved_m.mean(axis=0)
        half_m = float(np.hypot(*mean_m))
        along_m = moved_m @ (mean_m / max(half_m, 1e-9))
        blocks = np.array_split(along_m, N_BLOCKS_ALL_SHOWING_TWO_PLACES)
        sigma_m = float(along_m.std()) / len(along_m) ** 0.5
        is_clear = (
            2.0 * half_m > MIN_REPORTED_ANTENNA_DISTANCE_M and half_m > MIN_DISTANCE_OF_TWO_PLACES_SIGMAS * sigma_m
        )
        if is_clear and min(float(block.mean()) for block in blocks) > 0.0:
            most_m = max(most_m, 2.0 * half_m)
    return most_m


def distance_m_and_share_of_two_heaps(beside_m: EastNorthRows, heading_rad: FloatArray) -> tuple[float, float]:
    """Return how far a part of the fixes lies beside the others, m, and its share; zeros where none does.

    Two receivers that come in any order leave two heaps of differences from the way; those of one receiver leave one.
    Late stamps leave two along the way alone. For the arguments see above.
    """
    none = 0.0, 0.0
    east_m, north_m = (beside_m - beside_m.mean(axis=0)).T
    angle = 0.5 * math.atan2(2.0 * float(east_m @ north_m), float(east_m @ east_m - north_m @ north_m))
    along = np.array([math.cos(angle), math.sin(angle)])  # of the greatest scatter
    if (
        np.mean(
            np.abs(np.column_stack([np.cos(heading_rad), np.sin(heading_rad)]) @ along)
            > MIN_COSINE_OF_PLACES_LYING_ALONG_PATH
        )
        > 0.9
    ):
        return none
    values = beside_m @ along
    limit, share_within = _limit_and_share_of_variance_within_two_heaps(values)
    is_other = values > limit
    share = float(min(is_other.mean(), 1.0 - is_other.mean()))
    n_changes = np.count_nonzero(is_other[1:] != is_other[:-1])
    if (
        share_within > MAX_SHARE_OF_VARIANCE_WITHIN_HEAPS
        or share < MIN_SHARE_OF_SMALLER_HEAP
        or n_changes < share * (1.0 - share) * len(values)  # half of what chance makes: places that last are no noise
    ):
        return none
    distances_m = [
        float(block[other].mean() - block[~other].mean()) if other.any() and not other.all() else 0.0
        for block, other in zip(
            np.array_split(values, N_BLOCKS_ALL_SHOWING_TWO_PLACES),
            np.array_split(is_other, N_BLOCKS_ALL_SHOWING_TWO_PLACES),
            strict=True,
        )
    ]
    distance_m = float(values[is_other].mean() - values[~is_other].mean())
    is_clear = distance_m > MIN_REPORTED_ANTENNA_DISTANCE_M and min(distances_m) > 0.5 * distance_m
    return (distance_m, share) if is_clear else none


def _limit_and_share_of_variance_within_two_heaps(values: FloatArray) -> tuple[float, float]:
    """Return the limit that parts values (n,) into two heaps best, and the share of their variance that is within."""
    ordered = np.sort(values)
    n = np.arange(1, len(ordered))
    low = np.cumsum(ordered)[:-1] / n
    high = (ordered.sum() - n * low) / (len(ordered) - n)
    between = n * (len(ordered) - n) / len(ordered) ** 2 * (high - low) ** 2
    k = int(np.argmax(between))
    return float(0.5 * (ordered[k] + ordered[k + 1])), 1.0 - float(between[k] / max(ordered.var(), 1e-12))


def find_contradictions_of_fixes_of_two_places(found: Sequence[FixesOfTwoPlaces]) -> list[Contradiction]:
    """Return contradictions of the sources of fixes of two places."""
    return [
        Contradiction(
            SourceQuantity(source, Kind.POSITION),
            CAR_MOTION_TEXT,
            f"{which} {distance_m:.1f} m beside the others, as of two receivers or antennas in one "
            "topic; sigma holds the half of it",
            explains_misfits=True,
        )
        for source, distance_m, which in found
        if distance_m
    ]


def find_fixes_of_two_places(
    series: Sequence[SensorSeries], time_s: FloatArray, state: StateRows
) -> list[FixesOfTwoPlaces]:
    """Return what was found of each source of used positions; for the times and states of the estimate see above."""
    return [
        (s.source, *((0.0, "") if s.is_exact else distance_m_and_words_of_two_places(s, time_s, state)))
        for s in series
        if s.kind is Kind.POSITION and len(s)
    ]


def covariance_from_fixes_of_two_places(found: Sequence[FixesOfTwoPlaces]) -> StateCovariance:
    """Return the covariance (8, 8) that fixes in turns add to all states: nobody knows which half of them is right.

    It is 0 where another position has none.
    """
    added = np.zeros((N_MOTION_STATES, N_MOTION_STATES))
    added[X, X] = added[Y, Y] = 0.5 * (0.5 * min((distance_m for _, distance_m, _ in found), default=0.0)) ** 2
    return added
