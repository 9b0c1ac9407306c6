"""Fixes that are rounded or cut to a coarse step, such as longitudes with four decimals.

The error of a cut value is one-sided, and that of a car that stands does not change. No filter averages it out, so the
covariance of the states has to hold it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.estimation.measurements import Kind
from cwcli.estimation.passes import N_MOTION_STATES, SensorSeries
from cwcli.estimation.repeated_rows import quantisation_step_or_zero_or_infinity
from cwcli.signals.columns import EastNorthRows, StateCovariance
from cwcli.signals.normal_distribution import SIGMA_PER_MEDIAN_ABSOLUTE_DEVIATION
from cwcli.signals.vehicle_state import X, Y

MIN_COARSE_FIX_STEP_M = 0.3
"""Least step of fixes that counts as coarse, m: three times the 0.11 m of a millionth of a degree, in which many
receivers send. Chosen by hand."""
MIN_FIX_SCATTER_IN_STEPS = 0.15
"""Least scatter of rounded fixes about their neighbours, in steps: rounding alone makes 0.29 (the square root of 1/12).
Fixes of a car that drives on evenly are whole multiples of a step by chance, and do not scatter. Chosen as half."""
STEP_OF_UNCHANGING_AXIS_M = 7.4
"""Step of an axis on which all fixes are equal although those on the other axis scatter, m: a ten thousandth of a
degree of longitude at 48 degrees north, the coarsest in which receivers send."""
MIN_EQUAL_ROWS_OF_UNCHANGING_AXIS = 20
"""Least number of equal neighbours of such an axis. Chosen by hand; not fitted."""
MIN_NOISE_ON_CHANGING_AXIS_M = 0.05
"""Least noise on the other axis, m: the least of a position in `QUANTITY_BY_KIND`. Fixes of a simulator have less."""
ROUNDED_FIX_VARIANCE_IN_SQUARED_STEPS = 1.0 / 12.0 + 1.0 / 8.0
"""Variance of the error in squared steps: uniform in one step, and half a step to one side if the value is cut, which
has the prior probability 1/2."""


def find_coarse_east_north_steps_m(fixes_m: EastNorthRows) -> tuple[float, float]:
    """Return the step of fixes (n, 2) on each axis, m; 0 where they are not coarse."""
    steps = [0.0, 0.0]
    for k in (0, 1):
        change = np.diff(fixes_m[:, k])
        if len(change) >= MIN_EQUAL_ROWS_OF_UNCHANGING_AXIS and not change.any():
            noise_m = (
                SIGMA_PER_MEDIAN_ABSOLUTE_DEVIATION * float(np.median(np.abs(np.diff(fixes_m[:, 1 - k], 2)))) / 6.0**0.5
            )
            steps[k] = STEP_OF_UNCHANGING_AXIS_M if noise_m > MIN_NOISE_ON_CHANGING_AXIS_M else 0.0
            continue
        step_m = quantisation_step_or_zero_or_infinity(np.abs(change), MIN_COARSE_FIX_STEP_M)
        if np.isfinite(step_m) and step_m >= MIN_COARSE_FIX_STEP_M:
            bend = np.diff(change)[(change[1:] != 0.0) | (change[:-1] != 0.0)]
            scatter_m = float(np.sqrt(np.square(bend).mean() / 6.0))
            steps[k] = step_m if scatter_m > MIN_FIX_SCATTER_IN_STEPS * step_m else 0.0
    return steps[0], steps[1]


def covariance_from_coarse_fixes(series: Sequence[SensorSeries]) -> StateCovariance:
    """Return the covariance (8, 8) that the steps of the finest position source add to all states."""
    added = np.zeros((N_MOTION_STATES, N_MOTION_STATES))
    steps = [s.coarse_steps_m for s in series if s.kind is Kind.POSITION and len(s)]
    if steps:
        for axis, step_m in zip((X, Y), np.min(steps, axis=0).tolist(), strict=True):
            added[axis, axis] = ROUNDED_FIX_VARIANCE_IN_SQUARED_STEPS * step_m**2
    return added


def note_on_coarse_fixes(source: str, steps_m: tuple[float, float]) -> str:
    """Return what the user is told of coarse fixes."""
    axes = [f"{step_m:.2g} m {name}" for name, step_m in zip(("east", "north"), steps_m, strict=True) if step_m]
    return f"{source}: its positions are rounded or cut to steps of {' and '.join(axes)}: sigma holds that"
