"""Fixes of two receivers or antennas in one topic: every second one lies beside the others.

A filter takes the mean of both, and what is wrong by half their distance never shows, as each pair is wrong alike. But
noise forgets itself from row to row: a fix that lies to the left of its neighbours now says nothing of one a second
later. Of fixes in turns it does.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.estimation.contradiction import CAR_MOTION_TEXT, Contradiction, SourceQuantity
from cwcli.estimation.measurements import Kind
from cwcli.estimation.passes import N_MOTION_STATES, SensorSeries
from cwcli.signals.columns import EastNorthRows, FloatArray, StateCovariance, median_of_values
from cwcli.signals.vehicle_state import X, Y

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


def find_contradictions_of_fixes_in_turns(distances_m: Sequence[tuple[str, float]]) -> list[Contradiction]:
    """Return contradictions of the sources of fixes in turns; for the argument see `distances_of_fixes_in_turns`."""
    return [
        Contradiction(
            SourceQuantity(source, Kind.POSITION),
            CAR_MOTION_TEXT,
            f"every second fix lies {distance_m:.1f} m beside the others, as of two receivers or antennas in one "
            "topic; sigma holds the half of it",
            explains_misfits=True,
        )
        for source, distance_m in distances_m
        if distance_m
    ]


def distances_of_fixes_in_turns(series: Sequence[SensorSeries]) -> list[tuple[str, float]]:
    """Return each source of used positions with the distance of its fixes in turns, m."""
    return [
        (s.source, 0.0 if s.is_exact else distance_of_fixes_in_turns_m(s.time_s, s.values))
        for s in series
        if s.kind is Kind.POSITION and len(s)
    ]


def covariance_from_fixes_in_turns(distances_m: Sequence[tuple[str, float]]) -> StateCovariance:
    """Return the covariance (8, 8) that fixes in turns add to all states: nobody knows which half of them is right.

    It is 0 where another position has none.
    """
    added = np.zeros((N_MOTION_STATES, N_MOTION_STATES))
    added[X, X] = added[Y, Y] = 0.5 * (0.5 * min((distance_m for _, distance_m in distances_m), default=0.0)) ** 2
    return added
