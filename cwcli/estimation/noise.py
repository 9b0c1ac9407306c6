"""Estimate unstated noise: of measurements by innovation matching, of the motion by maximum likelihood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cwcli.estimation.measurements import Kind
from cwcli.estimation.model import MotionParameters
from cwcli.estimation.parameter import ParameterStatus
from cwcli.estimation.passes import PassResult, RowTimeOrder, SensorSeries, build_pass_input
from cwcli.estimation.prepare import average_rows_to_rate
from cwcli.estimation.stamp_noise import NoiseFit, fit_stamp_errors, may_have_stamp_errors
from cwcli.estimation.start import find_start_with_parameter_states
from cwcli.kernels import ekf
from cwcli.kernels.estimation import matching_factor
from cwcli.signals.columns import FloatArray

MIN_ROWS_FOR_NOISE = 50
"""Least number of rows from which noise is estimated. Chosen by hand; not fitted."""
MAX_NOISE_FACTOR_PER_CALL = 64.0
"""Greatest factor by which one call changes a noise variance. Chosen by hand; not fitted."""
N_BISECTIONS = 16
"""Number of bisections for the factor: it is exact to 64^(2 / 2^16)."""
MAX_COUNTED_NIS = 9.0
"""Greatest squared normalised innovation that is counted: an outlier counts as three sigma."""
AVERAGING_HZ = 10.0
"""Rate to which inertial series and speeds are averaged, Hz. Chosen: manoeuvres are slower."""
MAX_WINDOW_ROWS_WITH_IMU = 30_000
"""Greatest number of rows in the window with an IMU. Chosen: about ten minutes of a drive."""
MAX_WINDOW_ROWS_WITHOUT_IMU = 1_500
"""Greatest number of rows in the window without an IMU. Chosen for speed, as a log may hold many remote vehicles."""
ENOUGH_WINDOW_ROWS = 300
"""Number of rows in the window from which the whole log is not needed for the noise. Chosen by hand; not fitted."""
LOG_SIGMA_STEP = np.log(2.0)
"""Step of the parabola over a sigma of the motion, natural logarithm: half, once and twice the value are tried."""
MANOEUVRE_SIGMA_LIMITS: dict[str, tuple[float, float]] = {
    "jerk_sigma_mps3": (1.0 / 8.0, 2.0),
    "yaw_accel_sigma_radps2": (1.0 / 8.0, 2.0),
}
"""Fitted sigma of the motion -> least and greatest factor on its first value, chosen by what a driver can do."""
N_MATCHING_ROUNDS = 2
"""Number of rounds of innovation matching. Chosen by hand; not fitted."""
SETTLED_NOISE_FACTOR = 1.05
"""The noise has converged when its factor differs from 1 by less than this factor. Chosen by hand; not fitted."""
FIRST_POSITION_LEAD_IN_S = 2.5
"""Rows earlier than this before the first position are not used, s.

Chosen as the longest latency of the search and a little more."""


def noise_variance_factor(s: SensorSeries, nis: FloatArray, so_far: float | None = None) -> float:
    """Return the factor on the noise variance that brings the innovations into agreement (innovation matching).

    The equation is mean(min(nu^2 / (h P h' + factor r), 9)) = 1 over all rows, gated ones too: an outlier counts, but
    no more than three sigma. One call moves the variance by at most a factor of 64, because the predicted
    covariance answers to it. A message's own covariance is only ever raised: errors that are slow look small
    from one innovation to the next, and are there all the same. Where they have a state of their own (`slow_state`)
    the noise is what is left of the message's, the white part, and free.

    White noise that was fitted together with an error of the stamps stays as it is: there the log is predicted best,
    and the innovations along the path, which depend little on it, would outweigh those across.

    Args:
        s: The series with its present noise.
        nis: Shape (n, 5): see `PassResult.nis`.
        so_far: Factor on the noise of the message until now; None: not known, then one call at most halves it.
    """
    if len(nis) < MIN_ROWS_FOR_NOISE or s.is_exact or s.stamp_error.status is ParameterStatus.USED:
        return 1.0
    nu2, prior = nis[:, 1], nis[:, 2]
    r = s.noise[:, 0] if s.n_values_per_row == 1 else 0.5 * (s.noise[:, 0] + s.noise[:, 2])
    factor = matching_factor(
        nu2, prior, np.ascontiguousarray(r), most=MAX_NOISE_FACTOR_PER_CALL, n_steps=N_BISECTIONS, limit=MAX_COUNTED_NIS
    )
    if s.slow_state < 0:
        if s.noise_origin == "message":
            return factor if factor > 1.1 else 1.0
        if s.noise_origin == "message, scaled":
            return max(factor, 0.5 if so_far is None else 1.0 / so_far)
    return max(factor, s.floor**2 / float(r.mean()))


def estimate_noise_and_manoeuvres(
    series: Sequence[SensorSeries],
    parameters: MotionParameters,
    walk: FloatArray,
    prior: FloatArray,
    *,
    every_row: bool = True,
) -> tuple[list[SensorSeries], MotionParameters]:
    """Find the noise of the series that do not state it, and how strongly the car manoeuvres.

    Works on a window of the log. Each round matches the innovations and moves the jerk's and the yaw acceleration's
    sigma towards the largest likelihood, by a parabola over half, once and twice the present value.

    Args:
        series: All series, latencies corrected.
        parameters: Motion model to begin with.
        walk, prior: Shape (n,): see `run_filter_pass`, `find_start_with_parameter_states`.
        every_row: Look for errors of the stamps, and end with passes over all rows; else the noise is that of the
            averaged window.

    Returns:
        The series with settled noise; the motion model.
    """
    window = [replace(s, gate_nis=0.0) for s in _cut_to_busiest_window(_drop_rows_before_first_position(series))]
    if sum(len(s) for s in window) < 2 * MIN_ROWS_FOR_NOISE or not any(
        len(s) and s.kind is Kind.POSITION for s in window
    ):
        return list(series), parameters
    begin, orders = parameters, dict[float, RowTimeOrder]()

    def scale_manoeuvres(parameters: MotionParameters, factors: Sequence[float]) -> MotionParameters:
        for (name, limits), factor in zip(MANOEUVRE_SIGMA_LIMITS.items(), factors, strict=True):
            parameters = _set_sigma_within_limits(
                parameters, name, float(getattr(parameters, name)) * factor, limits, begin
            )
        return parameters

    may: list[bool] = []

    def refit_noise_and_motion(fit: NoiseFit) -> NoiseFit:
        result = _MotionModelTrials(fit.series, walk, prior, orders).pass_result_of(fit.parameters)
        may[:] = [may_have_stamp_errors(s, nis) for s, nis in zip(fit.series, result.nis, strict=True)]
        fit = _match_noise_to_innovations(fit, result)
        trials, parameters = _MotionModelTrials(fit.series, walk, prior, orders), fit.parameters
        base = trials.log_likelihood_of(parameters)
        for name, limits in MANOEUVRE_SIGMA_LIMITS.items():
            parameters, base = _refit_manoeuvre_sigma(trials, parameters, name, limits, base, begin)
        return replace(fit, parameters=parameters)

    fit = NoiseFit(tuple(window), (1.0,) * len(window), parameters)
    for _ in range(N_MATCHING_ROUNDS):
        fit = refit_noise_and_motion(fit)
    if every_row and any(may):
        start = find_start_with_parameter_states(fit.series, prior, causal=False)

        def run_filter(series: Sequence[SensorSeries], parameters: MotionParameters) -> PassResult:
            motion = parameters.to_process_model(walk)
            prepared = build_pass_input(series, start.time_s, np.zeros(0), reset_after=50, orders=orders)
            return prepared.split_result_by_series(prepared.run_filter(start, motion, smooth=False))

        found = fit_stamp_errors(fit, may, run_filter, scale_manoeuvres)
        fit = fit if found is fit else refit_noise_and_motion(found)
    parameters, factors = fit.parameters, np.array(fit.factors)
    series = [replace(s, stamp_error=w.stamp_error) for s, w in zip(series, fit.series, strict=True)]
    settled = [replace(s.scale_noise_variance(float(f)), gate_nis=0.0) for s, f in zip(series, factors, strict=True)]
    # The window shows the motion; the noise of single rows and of the slow sources needs the whole log.
    whole = every_row and any(
        len(w) < (len(s) if s.bias_state >= 0 else min(len(s), ENOUGH_WINDOW_ROWS))
        for s, w in zip(series, window, strict=True)
    )
    late = _drop_rows_before_first_position(settled)
    for _ in range(N_MATCHING_ROUNDS if whole else 0):
        result = _MotionModelTrials(late, walk, prior, {}).pass_result_of(parameters)
        change = [noise_variance_factor(s, nis) for s, nis in zip(late, result.nis, strict=True)]
        late = [s.scale_noise_variance(f) for s, f in zip(late, change, strict=True)]
        settled = [s.scale_noise_variance(f) for s, f in zip(settled, change, strict=True)]
        factors *= change
        if max(np.abs(np.log(change))) < np.log(SETTLED_NOISE_FACTOR):
            break
    for i, (s, factor) in enumerate(zip(settled, factors.tolist(), strict=True)):
        if factor != 1.0:
            settled[i] = replace(s, noise_origin="message, scaled" if s.noise_origin == "message" else "log")
    return settled, parameters


def _match_noise_to_innovations(fit: NoiseFit, result: PassResult) -> NoiseFit:
    """Return the fit with each noise scaled until it agrees with the innovations of a pass."""
    change = [noise_variance_factor(*each) for each in zip(fit.series, result.nis, fit.factors, strict=True)]
    series = []
    for s, factor in zip(fit.series, change, strict=True):
        origin = s.noise_origin
        if factor != 1.0:
            origin = "message, scaled" if origin.startswith("message") else "log"
        series.append(replace(s.scale_noise_variance(factor), noise_origin=origin))
    factors = tuple(old * new for old, new in zip(fit.factors, change, strict=True))
    return replace(fit, series=tuple(series), factors=factors)


class _MotionModelTrials:
    """Passes over the same series with different motion models; start and time order stay."""

    def __init__(
        self, series: Sequence[SensorSeries], walk: FloatArray, prior: FloatArray, orders: dict[float, RowTimeOrder]
    ) -> None:
        self._start = find_start_with_parameter_states(series, prior, causal=False)
        self._walk = walk
        self._input = build_pass_input(series, self._start.time_s, np.zeros(0), reset_after=50, orders=orders)

    def _run_filter(self, parameters: MotionParameters) -> ekf.Pass:
        return self._input.run_filter(self._start, parameters.to_process_model(self._walk), smooth=False)

    def log_likelihood_of(self, parameters: MotionParameters) -> float:
        """Run the filter and return only the log-likelihood."""
        return self._run_filter(parameters).log_likelihood

    def pass_result_of(self, parameters: MotionParameters) -> PassResult:
        """Run the filter and return the result, split by series."""
        return self._input.split_result_by_series(self._run_filter(parameters))


def _refit_manoeuvre_sigma(
    trials: _MotionModelTrials,
    parameters: MotionParameters,
    name: str,
    limits: tuple[float, float],
    base: float,
    begin: MotionParameters,
) -> tuple[MotionParameters, float]:
    """Move one sigma of the motion towards the largest likelihood; returns the model and its likelihood."""
    now, first = float(getattr(parameters, name)), float(getattr(begin, name))
    likelihood = [trials.log_likelihood_of(_replace_parameter(parameters, name, now * f)) for f in (0.5, 2.0)]
    left, right = likelihood
    bend = left - 2.0 * base + right
    if bend < 0.0:
        move = 0.5 * (left - right) / bend * LOG_SIGMA_STEP
        move = float(np.clip(move, -2.0 * LOG_SIGMA_STEP, 2.0 * LOG_SIGMA_STEP))
    else:
        move = LOG_SIGMA_STEP * (1.0 if right > left else -1.0)
    scale = float(np.clip(np.log(now / first) + move, *np.log(limits)))
    better = _replace_parameter(parameters, name, first * float(np.exp(scale)))
    reached = trials.log_likelihood_of(better)
    options = [(base, parameters), (reached, better)]
    options += [(v, _replace_parameter(parameters, name, now * f)) for v, f in zip(likelihood, (0.5, 2.0), strict=True)]
    best = max(options, key=lambda option: option[0])
    return _set_sigma_within_limits(best[1], name, float(getattr(best[1], name)), limits, begin), best[0]


def _set_sigma_within_limits(
    parameters: MotionParameters, name: str, value: float, limits: tuple[float, float], begin: MotionParameters
) -> MotionParameters:
    """Return the motion parameters with a new value of one sigma, kept within limits relative to its first value."""
    first = float(getattr(begin, name))
    limited = float(np.clip(np.log(value / first), *np.log(limits)))
    return _replace_parameter(parameters, name, first * float(np.exp(limited)))


def _replace_parameter(parameters: MotionParameters, name: str, value: float) -> MotionParameters:
    change: dict[str, Any] = {name: value}
    return replace(parameters, **change)


def _drop_rows_before_first_position(series: Sequence[SensorSeries]) -> list[SensorSeries]:
    """Leave out what lies long before the first position: a start that is badly known looks like noise."""
    firsts = [float(s.time_s[0] - s.latency_s) for s in series if s.kind is Kind.POSITION and len(s)]
    first = min(firsts, default=-np.inf)
    return [s.select_rows(s.time_s - s.latency_s >= first - FIRST_POSITION_LEAD_IN_S) for s in series]


def _cut_to_busiest_window(series: Sequence[SensorSeries]) -> list[SensorSeries]:
    """Thin the series of a log with an IMU, and cut all to a window where the vehicle goes farthest.

    Without an IMU the window is short, and averages of a short one hide how fast the vehicle changes its speed.
    """
    has_imu = any(s.bias_state >= 0 for s in series)
    series = [average_rows_to_rate(s, AVERAGING_HZ) if has_imu else s for s in series]
    total = sum(len(s) for s in series)
    most = MAX_WINDOW_ROWS_WITH_IMU if has_imu else MAX_WINDOW_ROWS_WITHOUT_IMU
    if total <= most:
        return list(series)
    begin = min(float(s.time_s[0]) for s in series if len(s))
    end = max(float(s.time_s[-1]) for s in series if len(s))
    span = (end - begin) * most / total
    # A slow source needs enough rows in it to show its noise.
    slowest = max((float(np.median(np.diff(s.time_s))) for s in series if len(s) > MIN_ROWS_FOR_NOISE), default=0.0)
    span = min(max(span, 2.0 * MIN_ROWS_FOR_NOISE * slowest), end - begin)
    left = busiest_window_start_s(series, begin, end, span)
    cut = []
    for s in series:
        time = s.time_s - s.latency_s
        cut.append(s.select_rows((time >= left) & (time <= left + span)))
    return cut


def busiest_window_start_s(series: Sequence[SensorSeries], begin: float, end: float, span: float) -> float:
    """Return where a window of `span` seconds covers the longest way, by the positions."""
    position = next((s for s in series if s.kind is Kind.POSITION and len(s) > 2), None)
    if position is None:
        return begin
    time = position.time_s - position.latency_s
    choices = np.arange(begin, max(end - span, begin) + 1e-9, max(span / 4, 1e-3))
    first = np.clip(np.searchsorted(time, choices), 0, len(time) - 1)
    middle = np.clip(np.searchsorted(time, choices + span / 2), 0, len(time) - 1)
    last = np.clip(np.searchsorted(time, choices + span), 0, len(time) - 1)
    xy = position.values
    way = np.hypot(*(xy[middle] - xy[first]).T) + np.hypot(*(xy[last] - xy[middle]).T)
    return float(choices[int(way.argmax())])
