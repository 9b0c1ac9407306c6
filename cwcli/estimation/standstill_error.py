"""Errors that a standing vehicle shows: what moves then is the error of its sensors.

Fixes of a standing vehicle wander for seconds, and a speed that is read as a magnitude is positive on average. The
filter takes both for noise of single rows and averages them out. So its sigma is far too small, of the position at any
time and of the speed of a standing vehicle.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from cwcli.estimation.measurements import Kind
from cwcli.estimation.median import median_of_finite_values
from cwcli.estimation.passes import N_MOTION_STATES, SensorSeries
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import EastNorthRows, FloatArray, StateCovariances, StateRows
from cwcli.signals.vehicle_state import SPEED, X, Y

MAX_STANDING_SPEED_MPS = 0.1
"""Greatest speed at which a vehicle counts as standing, m/s. Chosen by hand: half of what wheel speeds resolve."""
STANDSTILL_WINDOW_S = 5.0
"""Time over which fixes are averaged before and after a moment to tell whether a vehicle stands, and least length of a
standstill that is used, s. Chosen by hand: an error of half a metre that lasts for 20 s moves by 0.05 m/s in it."""
MAX_FIX_INTERVAL_IN_STANDSTILL_S = 1.0
"""Greatest interval between two fixes of one standstill, s. Chosen by hand; not fitted."""
FIX_ERROR_COVARIANCE_LAG_S = 0.5
"""Interval of two fixes whose errors are compared, s: white noise has no covariance over it, lasting errors have."""
MIN_FIX_INTERVAL_S = 1e-3
"""Least interval of two fixes, s: of stamps that are cut, most differ by 0. Chosen by hand."""
MIN_FIX_ERROR_COVARIANCE_IN_SIGMAS = 3.0
"""Least covariance of the errors of such fixes, in sigmas of that of white noise. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class StandstillErrors:
    """One sigma of the errors that a standing vehicle shows; 0 where none shows.

    Attributes:
        position_m: Lasting error of the position on each axis, m.
        speed_mps: Speed of the states of a standing vehicle, m/s.
    """

    position_m: float = 0.0
    speed_mps: float = 0.0


def standstill_errors_of_best_position_source(
    series: Sequence[SensorSeries], output_s: FloatArray, state: StateRows, covariance: StateCovariances
) -> StandstillErrors:
    """Return the errors in all standstills of a track, by the source of positions that errs least.

    Args:
        series: Sources of the track; those whose slow error the filter models have to be left out.
        output_s: Shape (m,): times of the states.
        state: Shape (m, 8).
        covariance: Shape (m, 8, 8).
    """
    found = [
        _standstill_errors_of_source(s, output_s, state, covariance)
        for s in series
        if s.kind is Kind.POSITION and len(s) > 1 and not s.is_exact
    ]
    return min(found, key=lambda each: each.position_m, default=StandstillErrors())


def covariance_from_standstill_errors(state: StateRows, errors: StandstillErrors) -> StateCovariances:
    """Return the covariance (m, 8, 8) that the errors add to states (m, 8)."""
    added = np.zeros((len(state), N_MOTION_STATES, N_MOTION_STATES))
    added[:, X, X] = added[:, Y, Y] = errors.position_m**2
    with np.errstate(invalid="ignore"):
        added[np.abs(state[:, SPEED]) < MAX_STANDING_SPEED_MPS, SPEED, SPEED] = errors.speed_mps**2
    return added


def _standstill_errors_of_source(
    fixes: SensorSeries, output_s: FloatArray, state: StateRows, covariance: StateCovariances
) -> StandstillErrors:
    time_s = fixes.time_s - fixes.latency_s
    covariance_sum, variance_sum, n, n_states = 0.0, 0.0, 0, 0
    position_sum_m2 = speed_sum_m2ps2 = 0.0
    for rows in _iter_standstill_row_slices(time_s, fixes.values[:, :2]):
        mean = fixes.values[rows, :2].mean(axis=0)
        error = fixes.values[rows, :2] - mean
        step_s = max(median_of_finite_values(np.diff(time_s[rows])), MIN_FIX_INTERVAL_S)  # stamps may be equal
        lag = max(1, round(FIX_ERROR_COVARIANCE_LAG_S / step_s))
        covariance_sum += float((error[lag:] * error[:-lag]).sum())
        variance_sum += float((error[lag:] ** 2).sum())
        n += 2 * max(len(error) - lag, 0)
        inside = (output_s >= time_s[rows.start]) & (output_s <= time_s[rows.stop - 1]) & np.isfinite(state[:, SPEED])
        n_states += int(inside.sum())
        expected_m2 = covariance[inside, X, X] + covariance[inside, Y, Y]
        position_sum_m2 += float(((state[inside, :2] - mean) ** 2).sum() - expected_m2.sum())
        speed_sum_m2ps2 += float((state[inside, SPEED] ** 2 - covariance[inside, SPEED, SPEED]).sum())
    if not n or not n_states:
        return StandstillErrors()
    wander_m2 = (
        covariance_sum / n if covariance_sum > MIN_FIX_ERROR_COVARIANCE_IN_SIGMAS * variance_sum / n**0.5 else 0.0
    )
    return StandstillErrors(
        max(wander_m2, position_sum_m2 / (2 * n_states), 0.0) ** 0.5, max(speed_sum_m2ps2 / n_states, 0.0) ** 0.5
    )


def _iter_standstill_row_slices(time_s: FloatArray, fixes_m: EastNorthRows) -> Iterator[slice]:
    """Yield the rows of each standstill that is long enough: the mean of the fixes before and after hardly differ."""
    n = len(time_s)
    total = np.concatenate((np.zeros((1, 2)), np.cumsum(fixes_m, axis=0)))
    first = np.searchsorted(time_s, time_s - STANDSTILL_WINDOW_S)
    last = np.searchsorted(time_s, time_s + STANDSTILL_WINDOW_S, side="right")
    row_numbers = np.arange(n)
    before_m = (total[row_numbers + 1] - total[first]) / (row_numbers + 1 - first)[:, None]
    after_m = (total[last] - total[row_numbers]) / (last - row_numbers)[:, None]
    between_s = 0.5 * (time_s[last - 1] - time_s[first])
    moved_m = np.hypot(*(after_m - before_m).T)
    standing: npt.NDArray[np.bool_] = moved_m < MAX_STANDING_SPEED_MPS * between_s
    breaks = np.flatnonzero((standing[1:] != standing[:-1]) | (np.diff(time_s) > MAX_FIX_INTERVAL_IN_STANDSTILL_S)) + 1
    for begin, end in zip([0, *breaks], [*breaks, n], strict=True):
        if standing[begin] and time_s[end - 1] - time_s[begin] >= STANDSTILL_WINDOW_S:
            yield slice(int(begin), int(end))
