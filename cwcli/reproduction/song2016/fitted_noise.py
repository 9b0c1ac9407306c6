"""What the printed estimates of table 1 say of Q and of the drives, and what the slope's window does to figure 7.

Five numbers are printed and a diagonal Q has five unknowns, so one Q gives all five as the covariance of the filter at
rest. That Q is fitted to the paper; run on the drives, it shows whether the printed numbers are also the errors.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cwcli.dynamics.riccati import steady_predicted_covariance
from cwcli.estimation.song2016 import (
    SAMPLING_TIME_S,
    filtered_states_and_covariances_of_matrix,
    least_squares_slope_of_last_samples,
)
from cwcli.metrics.intervals import normal_interval
from cwcli.reproduction.classes import MeasuredNumber
from cwcli.reproduction.findings import StudyPart, median_and_interval_bounds
from cwcli.reproduction.song2016.estimation import (
    PERCENT_OF_G_PER_MPS2,
    QUANTITY_LABELS,
    table1_error_rows,
)
from cwcli.reproduction.song2016.methods import (
    PREDICTION_HORIZON_S,
    measure_vehicle,
    paper_filter_states_with_derivatives,
    paper_predicted_points_m,
)
from cwcli.reproduction.song2016.prediction import starts_and_error_function
from cwcli.signals.columns import FloatArray
from cwcli.simulation.scenario import EGO_VEHICLE_KEY, load_scenario

FITTED_NOISE_FIGURE = "q"
"""Name of this part among the figures."""
PRINTED_ESTIMATE_ERROR_SIGMAS = np.array([0.15, 0.1, np.radians(0.21), 0.27 / PERCENT_OF_G_PER_MPS2, np.radians(0.043)])
"""Printed errors of the estimates (song2016, table 1): position, speed, heading, acceleration, yaw rate; SI units."""
PRINTED_MEASUREMENT_NOISE_SIGMAS = np.array(
    [0.6, 0.6, 0.5, np.radians(1.0), 0.5 / PERCENT_OF_G_PER_MPS2, np.radians(0.1)]
)
"""Printed noise of the measurement vector (song2016, table 1), in SI units; 0.5 % read as of g."""
COVARIANCE_SPEED_OF_FIT_MPS = 15.0
"""Speed at which the covariance is computed, m/s: that of figure 3's drive at its end. The speed only couples heading
and position; from 10 to 20 m/s the fitted Q changes by 3 %."""
FIRST_GUESS_OF_PROCESS_NOISE_DIAGONAL_ROOTS = np.array([0.03, 0.02, 0.001, 0.02, 0.0004])
"""The search for Q begins with these roots of its diagonal, in SI units. Chosen by hand; not fitted."""
MAX_FIT_STEPS = 30
"""Largest number of Newton steps of the search. Chosen by hand; not fitted: five are enough."""
SLOPE_WINDOWS_IN_SAMPLES = (2, 3)
"""Windows, in samples, whose largest errors enclose figure 7's printed one."""
PREDICTION_HORIZON_OF_PRINTED_ERROR_S = 2.9
"""Horizon of figure 7's printed error, in s."""


def stationary_filter_sigmas(step_sigmas: FloatArray) -> FloatArray:
    """Return the sigmas (5,) of the paper's filter at rest on a straight, for a diagonal Q.

    Args:
        step_sigmas: Shape (5,): roots of Q's diagonal: position (each axis), speed, heading, acceleration, yaw rate.
    """
    dt = SAMPLING_TIME_S
    f = np.eye(6)  # eq. 6 at heading 0, acceleration 0
    f[0, 2], f[0, 4], f[1, 3], f[2, 4], f[3, 5] = dt, dt**2 / 2, COVARIANCE_SPEED_OF_FIT_MPS * dt, dt, dt
    q, r = np.diag(np.square(step_sigmas[[0, 0, 1, 2, 3, 4]])), np.diag(np.square(PRINTED_MEASUREMENT_NOISE_SIGMAS))
    predicted = steady_predicted_covariance(f, np.eye(6), q, r)
    variance = np.diag(predicted - predicted @ np.linalg.solve(predicted + r, predicted))
    return np.asarray(np.sqrt([(variance[0] + variance[1]) / 2, *variance[2:]]))


def fit_diagonal_noise_sigmas() -> FloatArray:
    """Return the roots of Q's diagonal, (5,), for which `stationary_filter_sigmas` are the printed ones (Newton)."""
    logs = np.log(FIRST_GUESS_OF_PROCESS_NOISE_DIAGONAL_ROOTS)
    for _ in range(MAX_FIT_STEPS):
        error = np.log(stationary_filter_sigmas(np.exp(logs)) / PRINTED_ESTIMATE_ERROR_SIGMAS)
        if np.abs(error).max() < 1e-10:
            break
        scaled_sigmas = [
            np.log(stationary_filter_sigmas(np.exp(logs + step)) / PRINTED_ESTIMATE_ERROR_SIGMAS) - error
            for step in 1e-5 * np.eye(5)
        ]
        logs = logs - np.linalg.solve(np.array(scaled_sigmas).T / 1e-5, error)
    return np.asarray(np.exp(logs))


def fitted_noise_part(n_seeds: int, tick: Callable[[], None]) -> StudyPart:
    """Compute the fitted Q, its covariance at rest, and the errors of the paper's filter with it on both drives."""
    fitted = fit_diagonal_noise_sigmas()
    scales = (1.0, 1.0, np.degrees(1.0), PERCENT_OF_G_PER_MPS2, np.degrees(1.0))
    measured = [
        MeasuredNumber(FITTED_NOISE_FIGURE, f"fitted Q: {label} a step", float(value))
        for label, value in zip(QUANTITY_LABELS.values(), fitted, strict=True)
    ]
    measured += [
        MeasuredNumber(FITTED_NOISE_FIGURE, f"fitted Q: sigma of the {label} at rest", float(scale * value))
        for label, scale, value in zip(QUANTITY_LABELS.values(), scales, stationary_filter_sigmas(fitted), strict=True)
    ]
    for name in ("straight", "curve"):
        scenario = load_scenario(name)
        changes: dict[str, list[float]] = {quantity: [] for quantity in QUANTITY_LABELS}
        for seed in range(n_seeds):
            run = measure_vehicle(scenario, EGO_VEHICLE_KEY, seed)
            q = np.diag(np.square(fitted[[0, 0, 1, 2, 3, 4]]))
            states, _ = filtered_states_and_covariances_of_matrix(run.vectors, tuple(run.sigma), process_noise=q)
            for row in table1_error_rows(run, states):
                changes[row.name].append(row.change_percent)
            tick()
        for quantity, values in changes.items():
            low, high = normal_interval(np.array(values))
            what = f"{name}: change of the {QUANTITY_LABELS[quantity]} error with the fitted Q"
            measured.append(MeasuredNumber(FITTED_NOISE_FIGURE, what, float(np.mean(values)), low, high))
    return StudyPart(tuple(measured))


def slope_window_part(n_seeds: int, tick: Callable[[], None]) -> StudyPart:
    """Compute figure 7's largest error with short windows of the slope, and what they cost at the paper's horizon."""
    scenario = load_scenario("straight")
    motion = scenario.vehicles[EGO_VEHICLE_KEY].motion
    largest: dict[int, list[float]] = {window: [] for window in SLOPE_WINDOWS_IN_SAMPLES}
    means: dict[int, list[float]] = {window: [] for window in SLOPE_WINDOWS_IN_SAMPLES}
    for seed in range(n_seeds):
        run = measure_vehicle(scenario, EGO_VEHICLE_KEY, seed)
        filtered = paper_filter_states_with_derivatives(run)[:, :6]
        for window in SLOPE_WINDOWS_IN_SAMPLES:
            slopes = (least_squares_slope_of_last_samples(filtered[:, k], window) for k in (4, 5))
            states = np.column_stack([filtered, *slopes])
            for horizon, found in ((PREDICTION_HORIZON_OF_PRINTED_ERROR_S, largest), (PREDICTION_HORIZON_S, means)):
                _, errors = starts_and_error_function(run.time_s, scenario.duration_s, horizon, motion.states_at)
                error_m = errors(paper_predicted_points_m(states, "jerk", horizon))
                found[window].append(float(error_m.max() if found is largest else error_m.mean()))
        tick()
    measured = []
    for window in SLOPE_WINDOWS_IN_SAMPLES:
        error = f"largest error of constant jerk, {PREDICTION_HORIZON_OF_PRINTED_ERROR_S:g} s ahead"
        what = f"straight: {error}, slope over {window} samples"
        measured.append(MeasuredNumber("fig 7", what, *median_and_interval_bounds(np.array(largest[window]))))
        what = f"straight: mean error of constant jerk, {PREDICTION_HORIZON_S:g} s ahead, slope over {window} samples"
        measured.append(MeasuredNumber("fig 7", what, *median_and_interval_bounds(np.array(means[window]))))
    return StudyPart(tuple(measured))
