"""Speeds that are rounded to coarse steps, such as 5 km/h.

At an even speed such a speed errs by the same amount for minutes, which no filter averages out. Only where it changes
by one step is the true speed known, halfway, and where it is zero. Of one that is rounded down or up it is the upper or
the lower of both; beside fixes such a speed is half a step too low or too high.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.estimation.measurements import Kind
from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.prepare import PreparedSeries
from cwcli.estimation.repeated_rows import quantisation_step_or_zero_or_infinity
from cwcli.estimation.source_checks import MedianInterval
from cwcli.estimation.step_motion import compute_step_motion_by_source, step_edges_s
from cwcli.lazy_dataclass import replace

MIN_COARSE_SPEED_STEP_MPS = 0.6
"""Least step of a speed that counts as coarse, m/s: above 2 km/h and 1 mile/h. Chosen by hand: beside fixes a finer one
errs by less than its wheels do."""
MAX_DIFFERENCE_OF_SAME_SPEED_MPS = 1e-3
"""Greatest difference of two speeds that are the same, m/s: rounding of numbers."""
MAX_SPEED_CHANGE_DURATION_S = 1.0
"""Longest time between the two rows of a change, s. Chosen as for headings."""

CREEP_TIME_BESIDE_STANDSTILL_S = 2.0
"""Time before and after a standstill in which the rounded speed is zero and the car may move, s. Chosen by hand: it
passes half a step in it."""
MEAN_SPEED_COMPARISON_STEP_S = 4.0
"""Length of the steps, s, in which the mean speed is compared with that by fixes. Chosen by hand: noise of 1 m is
0.35 m/s in it."""
MIN_SPEED_CHANGE_NOISE_IN_STEPS = 0.1
"""Least noise of a change, in steps: the speed's own noise moves the change. Chosen by hand; not fitted."""


def keep_changes_and_standstills_of_coarse_speeds_and_note(
    prepared: Sequence[PreparedSeries],
) -> tuple[list[PreparedSeries], list[str]]:
    """Return the series, of coarse speeds those rows alone that tell the speed, and what the user is told."""
    fixes = next((p.series for p in prepared if p.series.kind is Kind.POSITION and len(p.series)), None)
    found: list[PreparedSeries] = []
    notes: list[str] = []
    for p in prepared:
        s = p.series
        change = np.diff(s.values[:, 0]) if s.kind is Kind.SPEED and not s.is_exact else np.zeros(0)
        step_mps = (
            quantisation_step_or_zero_or_infinity(np.abs(change), MAX_DIFFERENCE_OF_SAME_SPEED_MPS)
            if len(change)
            else 0.0
        )
        if not MIN_COARSE_SPEED_STEP_MPS <= step_mps < np.inf:
            found.append(p)
            continue
        is_one_step = (np.abs(change) > MAX_DIFFERENCE_OF_SAME_SPEED_MPS) & (np.abs(change) < 1.5 * step_mps)
        is_one_step &= np.diff(s.time_s) <= MAX_SPEED_CHANGE_DURATION_S
        values, time_s = s.values.copy(), s.time_s.copy()
        rows = np.flatnonzero(is_one_step) + 1
        half_steps = 0 if fixes is None else _half_steps_below_fixes(s, fixes, step_mps)
        values[rows, 0] += 0.5 * (half_steps * step_mps - change[rows - 1])
        time_s[rows] = 0.5 * (s.time_s[rows] + s.time_s[rows - 1])
        moving_s = s.time_s[np.abs(s.values[:, 0]) > MAX_DIFFERENCE_OF_SAME_SPEED_MPS]
        near = np.searchsorted(moving_s, s.time_s - CREEP_TIME_BESIDE_STANDSTILL_S) < np.searchsorted(
            moving_s, s.time_s + CREEP_TIME_BESIDE_STANDSTILL_S
        )
        is_used = ~near
        is_used[rows] = True
        floor = max(s.floor, MIN_SPEED_CHANGE_NOISE_IN_STEPS * step_mps)
        noise = np.maximum(s.noise, [floor**2, 0.0, 0.0])
        series = replace(s, time_s=time_s, values=values, noise=noise, floor=floor)
        found.append(replace(p, series=series.select_rows(is_used)))
        way = ("", "down ", "up ")[half_steps]
        notes.append(
            f"{s.source}: its speeds are rounded {way}to steps of {step_mps:.2g} m/s: only the {len(rows)} changes "
            "from one step to the next and the rows at standstill are used"
        )
    return found, notes


def _half_steps_below_fixes(speed: SensorSeries, fixes: SensorSeries, step_mps: float) -> int:
    """Return by how many half steps a speed lies below that of fixes: 1 if it is rounded down, -1 if up, else 0."""
    edges_s = step_edges_s([fixes], MEAN_SPEED_COMPARISON_STEP_S)
    if len(edges_s) < 2:
        return 0
    by_fixes, own = (compute_step_motion_by_source(s, edges_s).speed_mps for s in (fixes, speed))
    is_known = np.isfinite(by_fixes) & (own > 0.0)
    middle = MedianInterval.from_values((by_fixes - own)[is_known])
    return int(middle.low > 0.25 * step_mps) - int(middle.high < -0.25 * step_mps)
