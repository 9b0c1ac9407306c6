"""song2016's headline numbers against a computation of their own: `own_song2016` is written from the paper alone.

Both sides get the same noisy measurement vectors; everything after them is computed twice.
"""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest

from cwcli.control.closed_loop import fuzzy_controller_throttle_and_pressure, replay_with_policy
from cwcli.reproduction.song2016.control import true_recorded_motion
from cwcli.reproduction.song2016.estimation import reproduce_table_1_of_scenario
from cwcli.reproduction.song2016.methods import measure_vehicle
from cwcli.reproduction.song2016.prediction import MIN_PREDICTION_START_S, compute_prediction_errors
from cwcli.reproduction.song2016.sensitivity import paper_warning_times_s
from cwcli.reproduction.song2016.warning import collision_time_s
from cwcli.simulation.scenario import EGO_VEHICLE_KEY, load_scenario
from tests.papers import own_song2016 as own

OTHERS = {"rear-end": "lead", "intersection": "other"}


@pytest.mark.parametrize("name", ["own_song2016", "own_xiang2019", "own_zhang2011"])
def test_the_own_computations_share_no_code(name: str) -> None:
    tree = ast.parse((Path(__file__).parent / f"{name}.py").read_text(encoding="utf-8"))
    imported = {
        alias.name if isinstance(node, ast.Import) else node.module
        for node in ast.walk(tree)
        if isinstance(node, ast.Import | ast.ImportFrom)
        for alias in node.names
    }
    assert imported
    assert {str(each).split(".")[0] for each in imported} <= {"__future__", "numpy", "scipy"}


@pytest.mark.parametrize("drive", ["straight", "curve"])
def test_table_1_of_the_papers_filter(drive: str) -> None:
    """Number 1 and 2: every row of table 1 by a filter with full matrices."""
    found = {each.what: each.ours for each in reproduce_table_1_of_scenario(drive, 2, lambda: None).numbers}
    changes: dict[str, list[float]] = {}
    for seed in range(2):
        run = measure_vehicle(load_scenario(drive), EGO_VEHICLE_KEY, seed)
        error, noise = (values - run.truth[:, :6] for values in (own.filtered(run.vectors, run.sigma), run.vectors))
        for each in (error, noise):
            each[:, 3] = own.wrapped(each[:, 3])
        columns = {"position": [0, 1], "speed": [2], "heading": [3], "acceleration": [4], "yaw rate": [5]}
        for quantity, own_columns in columns.items():
            rms = [np.sqrt(np.mean(each[:, own_columns] ** 2)) for each in (error, noise)]
            changes.setdefault(quantity, []).append(100.0 * (rms[0] / rms[1] - 1.0))
    for quantity, values in changes.items():
        label = f"{drive}: change of the {quantity} error, the paper's filter"
        assert found[label] == pytest.approx(np.mean(values), abs=1e-4), quantity


@pytest.mark.parametrize("name", OTHERS)
def test_warning_moments_of_figures_9_and_11(name: str) -> None:
    """Number 3 and 4: sensors to warning, the three families, three seeds each."""
    scenario = load_scenario(name)
    for seed in range(3):
        states = [
            own.filtered(run.vectors, run.sigma)
            for run in (measure_vehicle(scenario, car, seed) for car in (EGO_VEHICLE_KEY, OTHERS[name]))
        ]
        for family, moment in paper_warning_times_s(scenario, OTHERS[name], seed).items():
            np.testing.assert_allclose(
                own.first_warning(states[0], states[1], family), moment, atol=1e-9, err_msg=f"{family} {seed}"
            )


def test_ideal_moments_of_figures_9_and_11() -> None:
    """Number 5 and 6: the scenarios' motions integrated by hand."""
    time_s = np.arange(0.0, 10.0, 1e-3)
    rear_end = time_s[np.argmax(own.lead(time_s)[0] - 20.0 * time_s < 2.5)]
    host = np.stack([np.full(len(time_s), 5.25), -67.0 + 9.0 * time_s], axis=1)
    crossing = time_s[np.argmax(np.linalg.norm(own.turning(time_s) - host, axis=1) < 2.5)]
    assert collision_time_s(load_scenario("rear-end"), "lead") == pytest.approx(rear_end, abs=2e-3)
    assert collision_time_s(load_scenario("intersection"), "other") == pytest.approx(crossing, abs=2e-3)


def test_prediction_errors_of_figures_3_and_7() -> None:
    """Number 7 and 8: the error of each family 2.5 s ahead, of the jerk family 2.9 s ahead, at every start of a run.

    Starts at which the filter says less than 1 m/s are left out: a car that comes to rest has a rule of its own.
    """
    errors = compute_prediction_errors("straight", 2, lambda: None)
    run = measure_vehicle(load_scenario("straight"), EGO_VEHICLE_KEY, 0)
    motion = load_scenario("straight").vehicles[EGO_VEHICLE_KEY].motion
    states = own.filtered(run.vectors, run.sigma)
    cases = [(family, 2.5, errors.example_m[family]) for family in ("speed", "acceleration", "jerk")]
    for family, horizon_s, theirs in [*cases, ("jerk", 2.9, errors.horizon_example_m[2.9][1])]:
        rows = (run.time_s >= MIN_PREDICTION_START_S) & (run.time_s + horizon_s <= 22.0 + 1e-9)
        later = motion.states_at(run.time_s[rows] + horizon_s)[:, :2]
        ours = np.linalg.norm(own.predicted(states, family, round(horizon_s / own.DT))[rows] - later, axis=1)
        moves = states[rows, 2] > 1.0
        assert moves.mean() > 0.8
        np.testing.assert_allclose(theirs[moves], ours[moves], atol=1e-6, err_msg=f"{family}, {horizon_s} s")
    assert errors.horizon_max_m[2.9][0] == pytest.approx(errors.horizon_example_m[2.9][1].max())


@pytest.mark.parametrize("warned_s", [3.7, 3.95, 4.55])  # jerk, acceleration, speed
def test_least_distances_of_figure_12(warned_s: float) -> None:
    """Number 9: fuzzy inference, brake, and motion of both cars on our own."""
    scenario = load_scenario("rear-end")
    host, other = true_recorded_motion(scenario, EGO_VEHICLE_KEY), true_recorded_motion(scenario, "lead")
    theirs = float(
        replay_with_policy(host, other, np.array([warned_s]), fuzzy_controller_throttle_and_pressure).min_distance_m[0]
    )
    assert theirs == pytest.approx(own.least_distance(warned_s), abs=0.03)
