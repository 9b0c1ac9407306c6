"""How near two simulated vehicles come to each other."""

from __future__ import annotations

import numpy as np

from cwcli.simulation.truth import Motion
from tests.drive_truth import TRUTH_GRID_STEP_S


def closest_approach_time_and_distance(a: Motion, b: Motion, end_s: float) -> tuple[float, float]:
    """Time (s of the run) and size (m) of the smallest distance between two vehicles' centres, on a grid of 1 ms."""
    time_s = np.arange(0.0, end_s + TRUTH_GRID_STEP_S / 2, TRUTH_GRID_STEP_S)
    distance = np.hypot(*(a.states_at(time_s)[:, :2] - b.states_at(time_s)[:, :2]).T)
    i = int(np.argmin(distance))
    return float(time_s[i]), float(distance[i])


def first_time_nearer_than_s(a: Motion, b: Motion, end_s: float, distance_m: float) -> float:
    """First time (s of the run) at which two vehicles' centres are nearer than a distance; NaN if never."""
    time_s = np.arange(0.0, end_s + TRUTH_GRID_STEP_S / 2, TRUTH_GRID_STEP_S)
    is_below = np.hypot(*(a.states_at(time_s)[:, :2] - b.states_at(time_s)[:, :2]).T) < distance_m
    return float(time_s[int(np.argmax(is_below))]) if is_below.any() else float("nan")
