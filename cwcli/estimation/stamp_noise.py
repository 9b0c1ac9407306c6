"""Random error of stamps: fixes that are stamped at reception after a transmission of varying duration.

A fix at p(t) that is stamped t + e lies v e behind, so that errors e with sigma_t add sigma_t^2 v v' to its noise: only
along the path, growing with speed, nothing at standstill. White noise acts in all directions at all speeds, and
manoeuvres show in the fixes that follow, so that a moving car separates the three. As every other error it is used only
where the log is predicted better.

Most logs have none, so the search runs only where the innovations along the path are larger, relative to those across
it, than expected (a score test).
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence

import numpy as np

from cwcli.estimation.measurements import Kind
from cwcli.estimation.model import MANOEUVRE_SIGMA_FACTOR_LIMITS, MotionParameters
from cwcli.estimation.parameter import NO_STAMP_ERROR, Parameter, ParameterStatus
from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.score import (
    INNOVATION_CAP_PROBABILITY,
    MIN_LIKELIHOOD_GAIN_PER_PARAMETER,
    MIN_LIKELIHOOD_GAIN_SIGMAS,
    bounded_log_likelihood_without_inertial_sensors,
    is_prediction_clearly_better,
    row_log_likelihoods,
)
from cwcli.estimation.sensor_limits import STAMP_SIGMA_RANGE
from cwcli.estimation.sensor_model import StateLayout
from cwcli.estimation.start import find_full_filter_start
from cwcli.estimation.trial import FilterTrials, with_outlier_gate
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.metrics.chi_square import nis_gate_limit
from cwcli.signals.columns import FloatArray, median_of_values

STAMP_SIGMA_AT_STEP_ZERO_S = 0.005
"""Sigma of the stamp error at step 0 of the grid, s. Chosen by hand; not fitted."""
GRID_STEPS_PER_OCTAVE = 4
"""Number of grid steps in a factor of two, for all sigmas of the grid. Chosen by hand."""
MIN_STAMP_SIGMA_STEP, MAX_STAMP_SIGMA_STEP = -2 * GRID_STEPS_PER_OCTAVE, 7 * GRID_STEPS_PER_OCTAVE
"""Least and greatest grid step of the stamp error: 1.3 ms and 0.64 s."""
SEARCH_STRIDES_IN_GRID_STEPS = (GRID_STEPS_PER_OCTAVE, GRID_STEPS_PER_OCTAVE // 2)
"""Strides of the climb in grid steps: octaves, then half octaves."""
MAX_FILTER_PASSES_PER_SEARCH = 150
"""Greatest number of filter passes of one search. Chosen to bound the time; not fitted."""
FIRST_TRIED_GRID_STEPS = (0, 2 * GRID_STEPS_PER_OCTAVE)
"""Grid steps that are tried first, 5 and 20 ms: if neither helps, the search ends."""
WHITE_VARIANCE_STEP_FACTOR = 2.0
"""Step factor of the white noise variance in the final refinement. Chosen by hand; not fitted."""
MAX_WHITE_VARIANCE_STEPS = 16
"""Greatest number of such steps in one direction. Chosen by hand; not fitted."""
MIN_POSITION_ROWS = 50
"""Least number of rows of a position that is examined. Chosen by hand; not fitted."""
FIX_INTERVAL_FOR_SPEED_S = 2.0
"""Time between two fixes from which a speed is taken, s. Chosen so that their distance exceeds the noise."""

TrialGridSteps = tuple[int | None, int, int, int]
"""Grid steps of a trial: stamp error (None: none), total noise, jerk and yaw acceleration."""


@dataclass(frozen=True)
class NoiseFit:
    """Series with their noise, and the motion model.

    Attributes:
        series: Series with their noise.
        factors: Factor on the noise of each series so far.
        parameters: The motion model.
    """

    series: tuple[SensorSeries, ...]
    factors: tuple[float, ...]
    parameters: MotionParameters

    def apply_to_layout(self, layout: StateLayout) -> StateLayout:
        """Return the layout with the series and the motion model of the fit."""
        return replace(layout, series=list(self.series), parameters=self.parameters)


def may_have_stamp_errors(s: SensorSeries, nis: FloatArray) -> bool:
    """Whether the innovations of a position hint at stamp errors, by the score in `ekf.Pass`; outliers are bounded."""
    if (
        s.kind is not Kind.POSITION
        or s.is_exact
        or len(s) < MIN_POSITION_ROWS
        or np.ptp(s.time_s) < 2.0 * FIX_INTERVAL_FOR_SPEED_S
    ):
        return False
    limit = nis_gate_limit(INNOVATION_CAP_PROBABILITY, s.n_values_per_row)
    slope = nis[:, 4] * limit / np.maximum(nis[:, 0], limit)
    return bool(np.nansum(slope) > MIN_LIKELIHOOD_GAIN_SIGMAS * np.sqrt(np.nansum(slope**2)))


def fit_stamp_errors(fit: NoiseFit, has_hint: Sequence[bool], layout: StateLayout) -> NoiseFit:
    """Return the fit with stamp errors for those positions whose log is predicted better with them.

    White noise and motion are optimised with and without the error, so that they favour neither.

    Args:
        fit: Fit without stamp errors.
        has_hint: For each series, see `may_have_stamp_errors`.
        layout: The layout at which the fit began.
    """
    trials = FilterTrials(find_full_filter_start(fit.series, layout.prior, causal=False))
    for i in np.flatnonzero(has_hint).tolist():
        fit = _StampErrorSearch(fit, i, layout, trials).search_best_fit()
    return fit


class _StampErrorSearch:
    """Trials of one position's noise on a grid of logarithms."""

    def __init__(self, fit: NoiseFit, i: int, layout: StateLayout, trials: FilterTrials) -> None:
        self._fit, self._i, self._layout, self._trials = fit, i, layout, trials
        s = fit.series[i]
        self._variance = 0.5 * float((s.noise[:, 0] + s.noise[:, 2]).mean())
        few = s.select_rows(
            np.arange(len(s))
            % max(1, int(FIX_INTERVAL_FOR_SPEED_S * len(s) / max(float(np.ptp(s.time_s)), FIX_INTERVAL_FOR_SPEED_S)))
            == 0
        )
        speed_mps = np.hypot(*np.diff(few.values, axis=0).T) / np.maximum(np.diff(few.time_s), 1e-3)
        self._speed2 = median_of_values(speed_mps) ** 2
        stated = s.noise_origin.startswith("message") and s.slow_state < 0
        # What a message states is raised only, however little it states.
        self._least = 1.0 / fit.factors[i] if stated else s.floor**2 / self._variance
        self._scores: dict[TrialGridSteps, float] = {}
        self._passes: dict[Hashable, tuple[float, FloatArray]] = {}

    def search_best_fit(self) -> NoiseFit:
        """Return the fit with the stamp error and its noise and motion; the given fit if the log shows none."""
        plain = self._climb_to_best_point((None, 0, 0, 0), (1, 2, 3), SEARCH_STRIDES_IN_GRID_STEPS[:1])
        if not any(
            self._log_likelihood_at((step, *plain[1:])) > self._log_likelihood_at(plain)
            for step in FIRST_TRIED_GRID_STEPS
        ):
            return self._fit
        plain = self._climb_to_best_point(plain, (1, 2, 3))
        best = self._climb_to_best_point((0, *plain[1:]), (0, 1, 2, 3))
        plain = max(plain, self._climb_to_best_point((None, *best[1:]), (1, 2, 3)), key=self._log_likelihood_at)
        gains = self._log_likelihood_at(best) > self._log_likelihood_at(plain) + MIN_LIKELIHOOD_GAIN_PER_PARAMETER
        if not gains or not is_prediction_clearly_better(
            self._total_and_row_log_likelihoods_at(best)[1] - self._total_and_row_log_likelihoods_at(plain)[1],
            MIN_LIKELIHOOD_GAIN_PER_PARAMETER,
        ):
            return self._fit
        return self._fit_at_parabola_vertex(best)

    def _fit_at_parabola_vertex(self, best: TrialGridSteps) -> NoiseFit:
        """Return the fit at the vertex of the parabola through the best point and its neighbours in log(sigma_t).

        The curvature gives the sigma of the stamp error; white noise and motion are optimised at each of the three.
        """
        stride = SEARCH_STRIDES_IN_GRID_STEPS[-1]
        while True:
            assert best[0] is not None
            at: list[TrialGridSteps] = [(best[0] - stride, *best[1:]), (best[0] + stride, *best[1:])]
            if (
                len(self._scores) >= MAX_FILTER_PASSES_PER_SEARCH
                or not MIN_STAMP_SIGMA_STEP <= best[0] - stride < best[0] + stride <= MAX_STAMP_SIGMA_STEP
            ):
                return self._fit  # the top has not been reached: nothing is known
            sides = [self._climb_to_best_point(side, (1, 2, 3)) for side in at]
            better = max(sides, key=self._log_likelihood_at)
            if not self._log_likelihood_at(better) > self._log_likelihood_at(best):
                break
            best = better
        before, top, after = (self._log_likelihood_at(point) for point in (sides[0], best, sides[1]))
        bend = 2.0 * top - before - after
        unit = math.log(2.0) * stride / GRID_STEPS_PER_OCTAVE
        move = 0.5 * (after - before) / bend if bend > 0.0 else 0.0
        value = STAMP_SIGMA_AT_STEP_ZERO_S * 2.0 ** (best[0] / GRID_STEPS_PER_OCTAVE) * math.exp(unit * move)
        sigma = value * unit / math.sqrt(bend) if bend > 0.0 else math.nan
        if not STAMP_SIGMA_RANGE.contains_or_is_nan(value):  # no link has one as large as that
            series = list(self._fit.series)
            series[self._i] = replace(series[self._i], stamp_error=Parameter(0.0, status=ParameterStatus.CONTRADICTS))
            return replace(self._fit, series=tuple(series))
        return self._refine_white_noise(best, Parameter(value, sigma, ParameterStatus.USED))

    def _refine_white_noise(self, best: TrialGridSteps, error: Parameter) -> NoiseFit:
        """Return the fit with the likeliest white noise for a given stamp error.

        On the grid white noise is total noise minus the stamps' share, which is coarse where that share is large.
        """
        white = self._white_noise_variance_factor(best, error)
        score = self._total_and_row_log_likelihoods_with_white(best, error, white)[0]
        for factor in (1.0 / WHITE_VARIANCE_STEP_FACTOR, WHITE_VARIANCE_STEP_FACTOR):
            for _ in range(MAX_WHITE_VARIANCE_STEPS):
                other = max(white * factor, self._least)
                if other == white:
                    break
                better = self._total_and_row_log_likelihoods_with_white(best, error, other)[0]
                if not better > score:
                    break
                white, score = other, better
        return self._noise_fit_at(best, error, white)

    def _climb_to_best_point(
        self, point: TrialGridSteps, axes: Sequence[int], strides: Sequence[int] = SEARCH_STRIDES_IN_GRID_STEPS
    ) -> TrialGridSteps:
        """Climb along the axes, one after the other, to the likeliest point."""
        for stride in strides:
            has_moved = True
            while has_moved and len(self._scores) < MAX_FILTER_PASSES_PER_SEARCH:
                has_moved = False
                for axis in axes:
                    for step in (stride, -stride):
                        while (other := _neighbouring_point(point, axis, step)) and self._log_likelihood_at(
                            other
                        ) > self._log_likelihood_at(point):
                            point, has_moved = other, True
        return point

    def _log_likelihood_at(self, point: TrialGridSteps) -> float:
        if point not in self._scores:
            self._scores[point] = self._total_and_row_log_likelihoods_at(point)[0]
        return self._scores[point]

    def _total_and_row_log_likelihoods_at(self, point: TrialGridSteps) -> tuple[float, FloatArray]:
        error = (
            NO_STAMP_ERROR
            if point[0] is None
            else Parameter(STAMP_SIGMA_AT_STEP_ZERO_S * 2.0 ** (point[0] / GRID_STEPS_PER_OCTAVE))
        )
        return self._total_and_row_log_likelihoods_with_white(
            point, error, self._white_noise_variance_factor(point, error)
        )

    def _total_and_row_log_likelihoods_with_white(
        self, point: TrialGridSteps, error: Parameter, white: float
    ) -> tuple[float, FloatArray]:
        """Return the log-likelihood of all rows, and that of each row of the position.

        Points whose numbers are the same, because a limit holds them, share a pass.
        """
        fit = self._noise_fit_at(point, error, white)
        key = error.value, white, fit.parameters.hashable_key_of_equal_parameters
        if key not in self._passes:
            gated = [with_outlier_gate(s) for s in fit.series]
            result = self._trials.run_filter(replace(self._layout, series=gated, parameters=fit.parameters))
            rows = row_log_likelihoods(gated[self._i], result.nis[self._i])
            self._passes[key] = bounded_log_likelihood_without_inertial_sensors(gated, result), rows
        return self._passes[key]

    def _white_noise_variance_factor(self, point: TrialGridSteps, error: Parameter) -> float:
        # What the stamps add is taken off, in the mean over the axes: a step of theirs keeps the whole.
        white = 4.0 ** (point[1] / GRID_STEPS_PER_OCTAVE) - 0.5 * error.value**2 * self._speed2 / self._variance
        return max(float(white), self._least)

    def _noise_fit_at(self, point: TrialGridSteps, error: Parameter, white: float) -> NoiseFit:
        series, factors = list(self._fit.series), list(self._fit.factors)
        series[self._i] = replace(series[self._i].scale_noise_variance(white), stamp_error=error)
        factors[self._i] *= white
        parameters = self._fit.parameters
        for name, step in zip(MANOEUVRE_SIGMA_FACTOR_LIMITS, point[2:], strict=True):
            sigma = float(getattr(parameters, name)) * 2.0 ** (step / GRID_STEPS_PER_OCTAVE)
            parameters = parameters.with_manoeuvre_sigma_within_limits(name, sigma, self._layout.parameters)
        return NoiseFit(tuple(series), tuple(factors), parameters)


def _neighbouring_point(point: TrialGridSteps, axis: int, step: int) -> TrialGridSteps | None:
    """Return the point a step away along an axis; None where the stamp error leaves its bounds."""
    neighbour = list(point)
    at = neighbour[axis]
    assert at is not None
    neighbour[axis] = at + step
    if axis == 0 and not MIN_STAMP_SIGMA_STEP <= at + step <= MAX_STAMP_SIGMA_STEP:
        return None
    return neighbour[0], *neighbour[1:]  # type: ignore[return-value]
