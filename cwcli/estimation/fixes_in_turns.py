"""Fixes of two receivers or antennas in one topic: every second one lies beside the others.

A filter takes the mean of both, and what is wrong by half their distance never shows, as each pair is wrong alike. But
noise forgets itself from row to row: a fix that lies to the left of its neighbours now says nothing of one a second
later. Of fixes in turns it does. Of receivers that come in any order it does not, but the fixes then lie in two heaps.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.estimation.contradiction import CAR_MOTION_TEXT, Contradiction, SourceQuantity
from cwcli.estimation.measurements import Kind
from cwcli.estimation.passes import N_MOTION_STATES, SensorSeries
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import EastNorthRows, FloatArray, StateCovariance, StateRows, median_of_values
from cwcli.signals.vehicle_state import HEADING, X, Y

MIN_FIXES_IN_TURNS = 100
"""Least number of fixes that show it. Chosen by hand: ten blocks of five pairs."""
MIN_DISTANCE_OF_TWO_ANTENNAS_M = 1.0
"""Least distance that is told, m. Chosen: a car's width is 2 m, and two antennas on a roof are 1 m apart."""
COMPARED_ROWS_APART = 6
"""Rows between two compared deviations, an even number: those of noise share no fix. Chosen as small, as
cars turn."""
N_BLOCKS_THAT_ALL_SHOW_FIXES_IN_TURNS = 10
"""Number of parts of the log that must all show it. Chosen by hand: chance does so in one log of a thousand."""
MIN_SIGMAS_OF_DISTANCE = 6.0
"""Least squared distance in its sigmas, of rows of which one in `COMPARED_ROWS_APART` is independent. Chosen: chance
makes it once in 10^9 logs."""
MAX_STEP_TO_USUAL = 1.5
"""Longest step between two compared fixes, in usual steps. Chosen by hand: then none is missing."""


MAX_SHARE_OF_VARIANCE_WITHIN_HEAPS = 0.2
"""Greatest share of the variance that is left within two heaps. Chosen by hand, not fitted: it is 0.36 of normal and
0.25 of uniform values, and 0.1 of two heaps six sigmas apart."""
MIN_SHARE_OF_FIXES_ELSEWHERE = 0.1
"""Least share of the smaller heap; of fewer ones the gate rejects most. Chosen by hand; not fitted."""
MAX_USUAL_DIFFERENCES = 6.0
"""Greatest difference from the way, in median ones, of a fix that is no outlier. Chosen by hand; not fitted."""
MIN_COSINE_ALONG_WAY = 0.9
"""Cosine of the angle between the two heaps and the way from which they lie along it. Chosen by hand."""


def distance_of_fixes_in_turns_m(time_s: FloatArray, fixes_m: EastNorthRows) -> float:
    """Return how far every second fix lies beside the others, m; 0 where it does not.

    Args:
        time_s: Shape (n,), increasing.
        fixes_m: Shape (n, 2).
    """
    if len(time_s) < MIN_FIXES_IN_TURNS:
        return 0.0
    step_s = np.diff(time_s)
    is_whole = (step_s > 0.0) & (step_s < MAX_STEP_TO_USUAL * median_of_values(step_s))
    is_whole &= (np.diff(fixes_m, axis=0) != 0.0).any(axis=1)  # a repeated fix comes late, from no other place
    share = (step_s[:-1] / np.maximum(step_s[:-1] + step_s[1:], 1e-9))[:, None]
    deviation = fixes_m[1:-1] - ((1.0 - share) * fixes_m[:-2] + share * fixes_m[2:])
    deviation[1::2] *= -1.0
    product = np.einsum("ni,ni->n", deviation[:-COMPARED_ROWS_APART], deviation[COMPARED_ROWS_APART:])
    # One missing fix exchanges the two receivers
    n_broken = np.append(0, np.cumsum(~is_whole))
    product = product[n_broken[COMPARED_ROWS_APART + 2 :] == n_broken[: -COMPARED_ROWS_APART - 2]]
    if len(product) < MIN_FIXES_IN_TURNS // 2:
        return 0.0
    blocks = np.array([block.mean() for block in np.array_split(product, N_BLOCKS_THAT_ALL_SHOW_FIXES_IN_TURNS)])
    squared_m2 = float(product.mean())
    sigma_m2 = float(product.std()) / (len(product) / COMPARED_ROWS_APART) ** 0.5
    is_clear = squared_m2 > max(MIN_DISTANCE_OF_TWO_ANTENNAS_M**2, MIN_SIGMAS_OF_DISTANCE * sigma_m2) and bool(
        (blocks > 0.0).all()
    )
    return squared_m2**0.5 if is_clear else 0.0


def distance_m_and_share_of_fixes_elsewhere(
    fixes: SensorSeries, time_s: FloatArray, state: StateRows
) -> tuple[float, float]:
    """Return how far a part of the fixes lies beside the others, m, and its share; zeros where none does.

    Two receivers that come in any order leave two heaps of differences from the way; those of one receiver leave one.
    Late stamps leave two along the way alone.

    Args:
        fixes: Positions.
        time_s, state: Times (m,) and states (m, 8) of the estimate from them.
    """
    none = 0.0, 0.0
    if len(fixes) < MIN_FIXES_IN_TURNS or len(time_s) < 2 or max(fixes.coarse_steps_m) > 0.0:
        return none
    at_s = fixes.time_s - fixes.latency_s
    beside_m = fixes.values - np.column_stack([np.interp(at_s, time_s, state[:, k]) for k in (X, Y)])
    size_m = np.hypot(*beside_m.T)
    is_near = size_m < MAX_USUAL_DIFFERENCES * median_of_values(size_m)
    is_near &= (at_s >= time_s[0]) & (at_s <= time_s[-1])
    if is_near.sum() < MIN_FIXES_IN_TURNS:
        return none
    beside_m, at_s = beside_m[is_near], at_s[is_near]
    _, axes = np.linalg.eigh(np.cov(beside_m.T))
    along = axes[:, 1]
    heading = np.interp(at_s, time_s, state[:, HEADING])
    if np.mean(np.abs(np.column_stack([np.cos(heading), np.sin(heading)]) @ along) > MIN_COSINE_ALONG_WAY) > 0.9:
        return none
    values = beside_m @ along
    limit, share_within = _limit_and_share_of_variance_within_two_heaps(values)
    is_other = values > limit
    share = float(min(is_other.mean(), 1.0 - is_other.mean()))
    n_changes = np.count_nonzero(is_other[1:] != is_other[:-1])
    if (
        share_within > MAX_SHARE_OF_VARIANCE_WITHIN_HEAPS
        or share < MIN_SHARE_OF_FIXES_ELSEWHERE
        or n_changes < share * (1.0 - share) * len(values)  # half of what chance makes: places that last are no noise
    ):
        return none
    distances_m = [
        float(block[other].mean() - block[~other].mean()) if other.any() and not other.all() else 0.0
        for block, other in zip(
            np.array_split(values, N_BLOCKS_THAT_ALL_SHOW_FIXES_IN_TURNS),
            np.array_split(is_other, N_BLOCKS_THAT_ALL_SHOW_FIXES_IN_TURNS),
            strict=True,
        )
    ]
    distance_m = float(values[is_other].mean() - values[~is_other].mean())
    is_clear = distance_m > MIN_DISTANCE_OF_TWO_ANTENNAS_M and min(distances_m) > 0.5 * distance_m
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


@dataclass(frozen=True)
class FixesOfTwoPlaces:
    """Fixes of which some lie beside the others.

    Attributes:
        source: Topic.
        distance_m: How far; 0 where none do.
        which: Words for those that do.
    """

    source: str
    distance_m: float = 0.0
    which: str = ""


def find_contradictions_of_fixes_in_turns(found: Sequence[FixesOfTwoPlaces]) -> list[Contradiction]:
    """Return contradictions of the sources of fixes of two places."""
    return [
        Contradiction(
            SourceQuantity(each.source, Kind.POSITION),
            CAR_MOTION_TEXT,
            f"{each.which} {each.distance_m:.1f} m beside the others, as of two receivers or antennas in one "
            "topic; sigma holds the half of it",
            explains_misfits=True,
        )
        for each in found
        if each.distance_m
    ]


def find_fixes_of_two_places(
    series: Sequence[SensorSeries], time_s: FloatArray, state: StateRows
) -> list[FixesOfTwoPlaces]:
    """Return what was found of each source of used positions; for the times and states of the estimate see above."""
    found = []
    for s in series:
        if s.kind is not Kind.POSITION or not len(s):
            continue
        each = FixesOfTwoPlaces(s.source)
        if not s.is_exact:
            if distance_m := distance_of_fixes_in_turns_m(s.time_s, s.values):
                each = FixesOfTwoPlaces(s.source, distance_m, "every second fix lies")
            else:
                distance_m, share = distance_m_and_share_of_fixes_elsewhere(s, time_s, state)
                each = FixesOfTwoPlaces(s.source, distance_m, f"{100 * share:.0f} % of its fixes lie")
        found.append(each)
    return found


def covariance_from_fixes_in_turns(found: Sequence[FixesOfTwoPlaces]) -> StateCovariance:
    """Return the covariance (8, 8) that fixes in turns add to all states: nobody knows which half of them is right.

    It is 0 where another position has none.
    """
    added = np.zeros((N_MOTION_STATES, N_MOTION_STATES))
    added[X, X] = added[Y, Y] = 0.5 * (0.5 * min((each.distance_m for each in found), default=0.0)) ** 2
    return added
