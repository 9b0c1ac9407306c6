"""The scenarios of song2016: what the paper prints of them holds, and its warning times are within reach.

The times are taken from the true states (`song2016_moments`): without a filter, and with the lags that a filter adds.
The warning stage's own times, with noise, are tested elsewhere.
"""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.simulation.scenario import Scenario, load_scenario
from tests.approach import closest_approach_time_and_distance
from tests.scenarios.song2016_moments import moments, predict

TOLERANCE_S = 0.1
PUBLISHED_S = {
    "rear-end": {"ideal": 3.5, "jerk": 3.6, "accel": 4.0, "speed": 4.5},
    "intersection": {"ideal": 4.62, "jerk": 4.72, "accel": 4.80, "speed": 4.88},
}
OTHER = {"rear-end": "lead", "intersection": "other"}
FILTER_LAG_S = np.array([0, 0, 0.03, 0.02, 0.05, 0.03, 0.12, 0.12])
"""Delay of each state behind the truth in a filter at 20 Hz: a fraction of a sample to two and a half samples."""


def host_states(scenario: Scenario, step_s: float = 0.01) -> tuple[np.ndarray, np.ndarray]:
    time_s = np.arange(0.0, scenario.duration_s, step_s)
    return time_s, scenario.vehicles["host"].motion.states_at(time_s)


@pytest.mark.parametrize("name", PUBLISHED_S)
def test_lagged_states_warn_at_the_published_moments(name: str) -> None:
    found = moments(load_scenario(name), OTHER[name], FILTER_LAG_S)
    for model, published in PUBLISHED_S[name].items():
        assert found[model] == pytest.approx(published, abs=TOLERANCE_S), model
    assert found["jerk"] < found["accel"] < found["speed"]


@pytest.mark.parametrize("name", PUBLISHED_S)
def test_exact_states_leave_room_for_the_lag_of_a_filter(name: str) -> None:
    exact = moments(load_scenario(name), OTHER[name])
    published = PUBLISHED_S[name]
    assert exact["ideal"] == pytest.approx(published["ideal"], abs=TOLERANCE_S)
    assert exact["ideal"] <= exact["jerk"] + 0.005 < exact["accel"] < exact["speed"]
    for model in ("jerk", "accel"):
        assert published[model] - 0.16 < exact[model] < published[model]
    assert exact["speed"] == pytest.approx(published["speed"], abs=0.05)


@pytest.mark.parametrize("name", PUBLISHED_S)
def test_collision_is_a_hit_and_not_a_graze(name: str) -> None:
    scenario = load_scenario(name)
    _, distance_m = closest_approach_time_and_distance(
        scenario.vehicles["host"].motion, scenario.vehicles[OTHER[name]].motion, scenario.duration_s
    )
    assert distance_m < 1.5  # of the 2.5 m that count as a collision


def test_rear_end_starts_at_20_m_and_20_mps() -> None:
    vehicles = load_scenario("rear-end").vehicles
    host, lead = (vehicles[name].motion.states_at(np.array([0.0]))[0] for name in ("host", "lead"))
    assert (lead[0] - host[0], host[2], lead[2]) == (20.0, 20.0, 20.0)


def test_intersection_speeds_sides_and_lanes() -> None:
    scenario = load_scenario("intersection")
    time_s = np.arange(0.0, scenario.duration_s, 0.01)
    host = scenario.vehicles["host"].motion.states_at(time_s)
    other = scenario.vehicles["other"].motion.states_at(time_s)
    np.testing.assert_allclose(host[:, 2], 9.0)
    np.testing.assert_allclose(other[:, 2], 10.0)
    assert np.ptp(host[:, 3]) == 0  # straight on
    assert other[0, 0] > host[0, 0]  # northbound host: the right is east
    assert np.all(np.diff(other[:, 3]) >= 0)  # turns left only
    at_collision = np.argmax(np.hypot(*(host - other)[:, :2].T) < 2.5)
    # 2.62 s after the turn began: yaw rate up to 0.25 rad/s in 2 s, then 0.62 s of it: 0.25 + 0.155 rad.
    assert other[at_collision, 3] - other[0, 3] == pytest.approx(0.405, abs=0.005)


def test_straight_is_from_rest_by_two_accelerations_to_15_mps() -> None:
    _, state = host_states(load_scenario("straight"))
    assert state[0, 2] == 0
    assert state[-1, 2] == 15
    is_accelerating = state[:, 4] > 1e-6
    assert np.count_nonzero(np.diff(is_accelerating.astype(int)) == 1) == 2
    assert np.all(state[:, 1] == 0)


def test_curve_radius_entry_and_exit() -> None:
    time_s, state = host_states(load_scenario("curve"))
    np.testing.assert_allclose(state[:, 2], 10.0)
    in_bend = state[:, 5] > 0.125  # half of v / R
    assert time_s[in_bend][[0, -1]] == pytest.approx([15.0, 30.0], abs=0.05)
    assert state[:, 5].max() == pytest.approx(10 / 40)


@pytest.mark.parametrize("name", ["straight", "curve"])
def test_order_of_the_three_families_on_exact_states(name: str) -> None:
    # Figures 3 and 5: speed worst, acceleration between, jerk best, in the mean and in the maximum.
    scenario = load_scenario(name)
    time_s = np.arange(0.0, scenario.duration_s - 2.5, 0.01)
    motion = scenario.vehicles["host"].motion
    later = motion.states_at(time_s + 2.5)[:, :2]
    errors = {m: np.hypot(*(predict(motion.states_at(time_s), m) - later).T) for m in ("jerk", "accel", "speed")}
    for statistic in (np.mean, np.max):
        assert statistic(errors["jerk"]) < 0.75 * statistic(errors["accel"])
        assert statistic(errors["accel"]) < 0.75 * statistic(errors["speed"])
