"""The further scenarios: conflicts collide, traps don't, and by how much."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.simulation.catalogue import scenario_names
from cwcli.simulation.scenario import EGO_VEHICLE_KEY, load_scenario
from cwcli.simulation.truth import Motion
from tests.approach import closest_approach_time_and_distance, first_time_nearer_than_s

CONFLICT_M = 2.5
CONFLICTS = ("rear-end", "intersection", "cut-in", "oncoming-left-turn", "stopped-behind-curve")
TRAPS = {"brake-and-release": 20.0, "following": 20.0, "near-miss-crossing": 4.0, "parallel-lanes": 3.5}


def pair(name: str) -> tuple[Motion, Motion, float]:
    scenario = load_scenario(name)
    (other,) = [key for key in scenario.vehicles if key != EGO_VEHICLE_KEY]
    return scenario.vehicles[EGO_VEHICLE_KEY].motion, scenario.vehicles[other].motion, scenario.duration_s


def test_every_scenario_with_two_cars_is_a_conflict_or_a_trap() -> None:
    scenarios = {name: load_scenario(name) for name in scenario_names()}
    with_two = {name for name, each in scenarios.items() if len(each.vehicles) > 1 and each.v2x is not None}
    assert with_two == {*CONFLICTS, *TRAPS}


@pytest.mark.parametrize("name", CONFLICTS)
def test_conflicts_collide_after_there_was_time_to_warn(name: str) -> None:
    host, other, end_s = pair(name)
    assert first_time_nearer_than_s(host, other, end_s, CONFLICT_M) > 5.0
    assert closest_approach_time_and_distance(host, other, end_s)[1] < 1.5


@pytest.mark.parametrize("name", TRAPS)
def test_traps_keep_their_distance(name: str) -> None:
    host, other, end_s = pair(name)
    assert closest_approach_time_and_distance(host, other, end_s)[1] == pytest.approx(TRAPS[name], abs=0.01)


def test_following_keeps_20_m_throughout() -> None:
    host, other, end_s = pair("following")
    time_s = np.linspace(0, end_s, 500)
    np.testing.assert_allclose(other.states_at(time_s)[:, 0] - host.states_at(time_s)[:, 0], 20.0, atol=1e-9)


def test_near_miss_leaves_room_between_the_outlines() -> None:
    # One car points north, the other west, so the outlines are boxes along the axes.
    scenario = load_scenario("near-miss-crossing")
    host, crosser = scenario.vehicles["host"], scenario.vehicles["crosser"]
    time_s = np.arange(0, scenario.duration_s, 0.001)
    apart = np.abs(host.motion.states_at(time_s)[:, :2] - crosser.motion.states_at(time_s)[:, :2])
    half = np.array([host.width_m + crosser.length_m, host.length_m + crosser.width_m]) / 2
    clearance_m = np.hypot(*np.maximum(apart - half, 0.0).T)
    assert clearance_m.min() == pytest.approx(0.71, abs=0.02)


def test_cutter_ends_in_the_hosts_lane_and_turner_faces_east() -> None:
    cutter = load_scenario("cut-in").vehicles["cutter"].motion.states_at(np.array([9.0]))[0]
    assert cutter[[1, 3]] == pytest.approx([0.0, 0.0], abs=0.01)
    turner = load_scenario("oncoming-left-turn").vehicles["turner"].motion.states_at(np.array([9.0]))[0]
    assert np.degrees(turner[3]) == pytest.approx(360.0, abs=0.1)


def test_city_stops_starts_and_turns() -> None:
    scenario = load_scenario("city")
    time_s = np.arange(0, scenario.duration_s, 0.1)
    state = scenario.vehicles["host"].motion.states_at(time_s)
    stops = np.diff((state[:, 2] < 1e-6).astype(int))
    assert np.count_nonzero(stops == 1) == 3  # besides the start
    assert np.count_nonzero(np.diff((np.abs(state[:, 5]) > 0.3).astype(int)) == 1) == 3  # right-angled turns
    assert 10 < state[:, 2].max() < 16
