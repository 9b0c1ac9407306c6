"""Warning moments of song2016 from the true states: equations 9, 2 and 10 written out, no filter, no noise.

An oracle of its own: it shares no code with the prediction and warning rooms. To see the moments of a scenario, or of a
variation of it:

    python -m tests.scenarios.song2016_moments rear-end lead.longitudinal.2.jerk_mps3=3
"""

from __future__ import annotations

import sys

import numpy as np
import numpy.typing as npt

from cwcli.simulation.scenario import EGO_VEHICLE_KEY, Scenario, load_scenario

FloatArray = npt.NDArray[np.float64]

STEP_S = 0.05
N_STEPS = 50
THRESHOLD_M = 2.5
GRID_S = 0.005


def predict(state: FloatArray, model: str) -> FloatArray:
    """Position 2.5 s ahead, shape (n, 2), of states (n, 8), by "speed" (eq. 9), "accel" (eq. 2) or "jerk" (eq. 10)."""
    x, y, v, heading, accel, yaw_rate, jerk, yaw_accel = (column.copy() for column in state.T)
    if model == "speed":
        accel[:] = yaw_rate[:] = 0.0
    if model in ("speed", "accel"):
        jerk[:] = yaw_accel[:] = 0.0
    for _ in range(N_STEPS):
        way = v * STEP_S + accel * STEP_S**2 / 2
        x += way * np.cos(heading)
        y += way * np.sin(heading)
        v += accel * STEP_S
        heading += yaw_rate * STEP_S
        accel += jerk * STEP_S
        yaw_rate += yaw_accel * STEP_S
    return np.column_stack([x, y])


def delayed(state: FloatArray, lag_s: FloatArray) -> FloatArray:
    """States (n, 8) on the grid with each column late by its own lag, as a filter would show them."""
    late = state.copy()
    for column, lag in enumerate(lag_s):
        k = round(float(lag) / GRID_S)
        if k:
            late[k:, column] = state[:-k, column]
            late[:k, column] = state[0, column]
    return late


def moments(scenario: Scenario, other: str, lag_s: FloatArray | None = None) -> dict[str, float]:
    """Ideal moment and warning moment of each model, seconds of the run; NaN where there is none."""
    time_s = np.arange(0.0, scenario.duration_s, GRID_S)
    host = scenario.vehicles["host"].motion.states_at(time_s)
    remote = scenario.vehicles[other].motion.states_at(time_s)
    found = {"ideal": _first_below(time_s, host[:, :2], remote[:, :2]) - STEP_S * N_STEPS}
    seen = remote if lag_s is None else delayed(remote, lag_s)
    for model in ("jerk", "accel", "speed"):
        found[model] = _first_below(time_s, predict(host, model), predict(seen, model))
    return found


def _first_below(time_s: FloatArray, a: FloatArray, b: FloatArray) -> float:
    is_below = np.hypot(*(a - b).T) < THRESHOLD_M
    return float(time_s[np.argmax(is_below)]) if is_below.any() else float("nan")


if __name__ == "__main__":
    varied = load_scenario(sys.argv[1], tuple(sys.argv[2:]))
    remote_name = next(name for name in varied.vehicles if name != EGO_VEHICLE_KEY)
    print("  ".join(f"{model} {moment:.3f} s" for model, moment in moments(varied, remote_name).items()))
