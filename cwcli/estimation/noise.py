"""Estimate unstated noise: of measurements by innovation matching, of the motion by maximum likelihood."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np

from cwcli.estimation.measurements import Kind
from cwcli.estimation.model import MANOEUVRE_SIGMA_FACTOR_LIMITS, MotionParameters
from cwcli.estimation.noise_matching import MIN_ROWS_FOR_NOISE, noise_variance_factor
from cwcli.estimation.passes import PassResult, SensorSeries
from cwcli.estimation.prepare import average_rows_to_rate
from cwcli.estimation.sensor_model import StateLayout
from cwcli.estimation.stamp_noise import NoiseFit, fit_stamp_errors, may_have_stamp_errors
from cwcli.estimation.trial import FilterTrials, cut_to_window, trial_key
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.columns import median_of_values, sort_distinct_values

NOISE_AVERAGING_HZ = 10.0
"""Rate to which inertial series and speeds are averaged, Hz. Chosen: manoeuvres are slower."""
MAX_WINDOW_ROWS_WITH_IMU = 30_000
"""Greatest number of rows in the window with an IMU. Chosen: about ten minutes of a drive."""
MAX_WINDOW_ROWS_WITHOUT_IMU = 1_500
"""Greatest number of rows in the window without an IMU. Chosen for speed, as a log may hold many remote vehicles."""
N_WINDOW_ROWS_ENOUGH_FOR_NOISE = 300
"""Number of rows in the window from which the whole log is not needed for the noise. Chosen by hand; not fitted."""
MOTION_SIGMA_LOG_STEP = np.log(2.0)
"""Step of the parabola over a sigma of the motion, natural logarithm: half, once and twice the value are tried."""
N_INNOVATION_MATCHING_ROUNDS = 2
"""Number of rounds of innovation matching. Chosen by hand; not fitted."""
MAX_NOISE_FACTOR_AT_CONVERGENCE = 1.05
"""The noise has converged when its factor differs from 1 by less than this factor. Chosen by hand; not fitted."""
LEAD_IN_BEFORE_FIRST_POSITION_S = 2.5
"""Time in s before the first position from which rows are used. Chosen as the longest latency of the search and a
little more."""


@dataclass(frozen=True)
class WindowFit:
    """Noise and manoeuvre intensity that a window of a log shows.

    Attributes:
        begin: The layout at which the fit began.
        window: Series of the window, with their first noise.
        fit: Their fitted noise, and the motion model.
        has_hint: Per series: whether the innovations hint at stamp errors, see `may_have_stamp_errors`.
    """

    begin: StateLayout
    window: tuple[SensorSeries, ...]
    fit: NoiseFit
    has_hint: tuple[bool, ...]


WindowFits = dict[Hashable, tuple[StateLayout, WindowFit | None]]
"""`trial_key` of a layout -> the layout, so that the key stays true, and its fit; None: too short a log for one."""


def estimate_noise_and_manoeuvres(
    layout: StateLayout, *, every_row: bool = True, known_fits: WindowFits | None = None
) -> StateLayout:
    """Find the noise of the series that do not state it, and how strongly the car manoeuvres.

    Works on a window of the log. Each round matches the innovations and moves the jerk's and the yaw acceleration's
    sigma towards the largest likelihood, by a parabola over half, once and twice the present value.

    Args:
        layout: All series, latencies corrected, with the motion model to begin with.
        every_row: Look for errors of the stamps, and end with passes over all rows; else the noise is that of the
            averaged window.
        known_fits: Fits of the windows of this log so far; that of this layout is taken from them, or put in.

    Returns:
        The layout with settled noise and motion model.
    """
    known_fits = {} if known_fits is None else known_fits
    key = trial_key(layout)
    if key not in known_fits:
        known_fits[key] = layout, _fit_window(layout)
    found = known_fits[key][1]
    if found is None:
        return layout
    fit = _fit_with_stamp_errors(found) if every_row and any(found.has_hint) else found.fit
    series, parameters, factors = layout.series, fit.parameters, np.array(fit.factors)
    series = [replace(s, stamp_error=w.stamp_error) for s, w in zip(series, fit.series, strict=True)]
    settled = [replace(s.scale_noise_variance(float(f)), gate_nis=0.0) for s, f in zip(series, factors, strict=True)]
    # The window shows the motion; the noise of single rows and of the slow sources needs the whole log.
    whole = every_row and any(
        len(w) < (len(s) if s.bias_state >= 0 else min(len(s), N_WINDOW_ROWS_ENOUGH_FOR_NOISE))
        for s, w in zip(series, found.window, strict=True)
    )
    late = _drop_rows_long_before_first_position(settled)
    for _ in range(N_INNOVATION_MATCHING_ROUNDS if whole else 0):
        result = FilterTrials().run_filter(replace(layout, series=late, parameters=parameters))
        change = [noise_variance_factor(s, nis) for s, nis in zip(late, result.nis, strict=True)]
        late = [s.scale_noise_variance(f) for s, f in zip(late, change, strict=True)]
        settled = [s.scale_noise_variance(f) for s, f in zip(settled, change, strict=True)]
        factors *= change
        if max(np.abs(np.log(change))) < np.log(MAX_NOISE_FACTOR_AT_CONVERGENCE):
            break
    for i, (s, factor) in enumerate(zip(settled, factors.tolist(), strict=True)):
        if factor != 1.0:
            settled[i] = replace(s, noise_origin="message, scaled" if s.noise_origin == "message" else "log")
    return replace(layout, series=settled, parameters=parameters)


def _fit_window(layout: StateLayout) -> WindowFit | None:
    """Return the fit of the busiest window; None where it has too few rows or no position."""
    cut = _cut_to_busiest_window(_drop_rows_long_before_first_position(layout.series))
    window = tuple(replace(s, gate_nis=0.0) for s in cut)
    if sum(len(s) for s in window) < 2 * MIN_ROWS_FOR_NOISE or not any(
        len(s) and s.kind is Kind.POSITION for s in window
    ):
        return None
    trials, has_hint = FilterTrials(), (False,) * len(window)
    fit = NoiseFit(window, (1.0,) * len(window), layout.parameters)
    for _ in range(N_INNOVATION_MATCHING_ROUNDS):
        result = trials.run_filter(fit.apply_to_layout(layout))
        has_hint = tuple(may_have_stamp_errors(s, nis) for s, nis in zip(fit.series, result.nis, strict=True))
        fit = _refit_noise_and_motion(trials, layout, fit, result)
    return WindowFit(layout, window, fit, has_hint)


def _refit_noise_and_motion(trials: FilterTrials, layout: StateLayout, fit: NoiseFit, result: PassResult) -> NoiseFit:
    """Return the fit after a round: noise by the innovations of its pass, then the sigmas of the motion."""
    fit = _match_noise_to_innovations(fit, result)
    base = trials.log_likelihood(fit.apply_to_layout(layout))
    for name in MANOEUVRE_SIGMA_FACTOR_LIMITS:
        fit, base = _refit_manoeuvre_sigma_and_get_likelihood(trials, layout, fit, name, base)
    return fit


def _fit_with_stamp_errors(window_fit: WindowFit) -> NoiseFit:
    """Return the fit of a window with the stamp errors that it shows; the given fit where it shows none."""
    layout, fit = window_fit.begin, window_fit.fit
    with_errors = fit_stamp_errors(fit, window_fit.has_hint, layout)
    if with_errors is fit:
        return fit
    trials = FilterTrials()
    result = trials.run_filter(with_errors.apply_to_layout(layout))
    return _refit_noise_and_motion(trials, layout, with_errors, result)


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


def _refit_manoeuvre_sigma_and_get_likelihood(
    trials: FilterTrials, layout: StateLayout, fit: NoiseFit, sigma_name: str, likelihood_of_fit: float
) -> tuple[NoiseFit, float]:
    """Move one sigma of the motion towards the largest likelihood; returns the fit and its likelihood."""

    def log_likelihood(parameters: MotionParameters) -> float:
        return trials.log_likelihood(replace(fit, parameters=parameters).apply_to_layout(layout))

    parameters, limits = fit.parameters, MANOEUVRE_SIGMA_FACTOR_LIMITS[sigma_name]
    current_sigma, first = float(getattr(parameters, sigma_name)), float(getattr(layout.parameters, sigma_name))
    sides = [parameters.with_manoeuvre_sigma(sigma_name, current_sigma * f) for f in (0.5, 2.0)]
    left, right = (log_likelihood(side) for side in sides)
    bend = left - 2.0 * likelihood_of_fit + right
    if bend < 0.0:
        move = 0.5 * (left - right) / bend * MOTION_SIGMA_LOG_STEP
        move = float(np.clip(move, -2.0 * MOTION_SIGMA_LOG_STEP, 2.0 * MOTION_SIGMA_LOG_STEP))
    else:
        move = MOTION_SIGMA_LOG_STEP * (1.0 if right > left else -1.0)
    scale = float(np.clip(np.log(current_sigma / first) + move, *np.log(limits)))
    better = parameters.with_manoeuvre_sigma(sigma_name, first * float(np.exp(scale)))
    options = [(likelihood_of_fit, parameters), (log_likelihood(better), better), (left, sides[0]), (right, sides[1])]
    reached, best = max(options, key=lambda option: option[0])
    sigma = float(getattr(best, sigma_name))
    return replace(
        fit, parameters=best.with_manoeuvre_sigma_within_limits(sigma_name, sigma, layout.parameters)
    ), reached


def _drop_rows_long_before_first_position(series: Sequence[SensorSeries]) -> list[SensorSeries]:
    """Leave out what lies long before the first position: a start that is badly known looks like noise."""
    firsts = [float(s.time_s[0] - s.latency_s) for s in series if s.kind is Kind.POSITION and len(s)]
    first = min(firsts, default=-np.inf)
    return [s.select_rows(s.time_s - s.latency_s >= first - LEAD_IN_BEFORE_FIRST_POSITION_S) for s in series]


def _cut_to_busiest_window(series: Sequence[SensorSeries]) -> list[SensorSeries]:
    """Thin the series of a log with an IMU, and cut all to a window where the vehicle goes farthest.

    Without an IMU the window is short, and averages of a short one hide how fast the vehicle changes its speed.
    """
    has_imu = any(s.bias_state >= 0 for s in series)
    series = [average_rows_to_rate(s, NOISE_AVERAGING_HZ) if has_imu else s for s in series]
    total = sum(len(s) for s in series)
    most = MAX_WINDOW_ROWS_WITH_IMU if has_imu else MAX_WINDOW_ROWS_WITHOUT_IMU
    if total <= most:
        return list(series)
    begin = min(float(s.time_s[0]) for s in series if len(s))
    end = max(float(s.time_s[-1]) for s in series if len(s))
    span = (end - begin) * most / total
    # A slow source needs enough rows in it to show its noise.
    slowest = max((median_of_values(np.diff(s.time_s)) for s in series if len(s) > MIN_ROWS_FOR_NOISE), default=0.0)
    span = min(max(span, 2.0 * MIN_ROWS_FOR_NOISE * slowest), end - begin)
    left = longest_driven_window_start_s(series, begin, end, span)
    return [cut_to_window(s, left, left + span) for s in series]


def longest_driven_window_start_s(
    series: Sequence[SensorSeries], begin_s: float, end_s: float, window_s: float
) -> float:
    """Return where a window of `window_s` seconds covers the longest way, by the positions."""
    position = next((s for s in series if s.kind is Kind.POSITION and len(s) > 2), None)
    if position is None:
        return begin_s
    time = position.time_s - position.latency_s
    step = max(window_s / 4, 1e-3)
    last_start = max(end_s - window_s, begin_s)
    if last_start - begin_s <= 4 * len(time) * step:
        choices = np.arange(begin_s, last_start + 1e-9, step)
    else:  # a pause of years: only windows with fixes in them
        cell = sort_distinct_values(((time - begin_s) / step).astype(np.int64))
        index = sort_distinct_values(np.clip(cell[:, None] - np.arange(5), 0, int((last_start - begin_s) / step)))
        choices = begin_s + step * index
    first = np.clip(np.searchsorted(time, choices), 0, len(time) - 1)
    middle = np.clip(np.searchsorted(time, choices + window_s / 2), 0, len(time) - 1)
    last = np.clip(np.searchsorted(time, choices + window_s), 0, len(time) - 1)
    xy = position.values
    way = np.hypot(*(xy[middle] - xy[first]).T) + np.hypot(*(xy[last] - xy[middle]).T)
    return float(choices[int(way.argmax())])
