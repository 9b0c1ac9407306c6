"""One car's states on the map and the clock of another."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.channels.other_car import (
    estimate_recorder_clock_offset,
    merge_states_by_log_time,
    move_states_to_our_map_and_clock,
    recorder_clock_difference_text,
)
from cwcli.channels.vehicle_state import VehicleStates
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import HEADING, N_STATES

T0_NS = 1_700_000_000 * NS_PER_S
OURS = LocalMap(48.0, 11.0, 0.0)
ATOL_M = 1e-3


def states(n: int = 5) -> VehicleStates:
    rng = np.random.default_rng(7)
    factor = rng.normal(size=(n, N_STATES, N_STATES))
    state = rng.normal(scale=50.0, size=(n, N_STATES))
    state[:, HEADING] = rng.uniform(-np.pi, np.pi, n)
    stamp_ns = T0_NS + np.arange(n) * NS_PER_S // 10
    return VehicleStates.from_ego_states(stamp_ns, state, factor @ factor.transpose(0, 2, 1) + np.eye(N_STATES))


def test_on_the_same_map_nothing_moves_but_the_clock() -> None:
    before = states()
    after = move_states_to_our_map_and_clock(before, OURS, OURS, name="b", stamp_shift_ns=-7, log_shift_ns=9)
    np.testing.assert_allclose(after.state, before.state, atol=1e-6)
    np.testing.assert_allclose(after.covariance, before.covariance, atol=1e-6)
    assert after.ids.values == ("b",)
    np.testing.assert_array_equal(after.stamp_ns, before.stamp_ns - 7)
    np.testing.assert_array_equal(after.log_time_ns, before.log_time_ns + 9)


def test_another_map_is_turned_by_the_convergence_of_the_meridians() -> None:
    """Two planes 0.1 degrees of longitude apart at 48 degrees north are turned by 0.1 sin 48 = 0.0743 degrees."""
    theirs = LocalMap(48.0, 11.1, 0.0)
    before = states()
    after = move_states_to_our_map_and_clock(before, theirs, OURS, name="b", stamp_shift_ns=0, log_shift_ns=0)
    turned_deg = np.degrees(after.state[:, HEADING] - before.state[:, HEADING])
    np.testing.assert_allclose(turned_deg, 0.1 * np.sin(np.radians(48.0)), rtol=0.01)
    turn = np.radians(turned_deg[0])
    rotation = np.eye(N_STATES)
    rotation[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    np.testing.assert_allclose(after.covariance[0], rotation @ before.covariance[0] @ rotation.T, atol=1e-9)


def test_positions_are_the_same_places() -> None:
    theirs = LocalMap(48.01, 11.02, 0.0)
    before = states()
    after = move_states_to_our_map_and_clock(before, theirs, OURS, name="b", stamp_shift_ns=0, log_shift_ns=0)
    zeros = np.zeros(len(before))
    expected = theirs.wgs84_from_map(before.state[:, 0], before.state[:, 1], zeros)
    x_m, y_m, _ = OURS.map_from_wgs84(expected[0], expected[1], np.full(len(before), np.nan))
    np.testing.assert_allclose(after.state[:, 0], x_m, atol=ATOL_M)
    np.testing.assert_allclose(after.state[:, 1], y_m, atol=ATOL_M)


@pytest.mark.parametrize(
    ("period_ms", "phase_ms", "on_epochs"), [(100, 0, True), (50, 1, True), (100, 37, True), (100, 33.3, False)]
)
def test_whether_stamps_are_epochs(period_ms: int, phase_ms: float, on_epochs: bool) -> None:
    """37 ms lies 3 ms from a multiple of 10 ms."""
    stamp_ns = T0_NS + np.arange(50) * period_ms * 1_000_000 + round(phase_ms * 1e6)
    if phase_ms == 37:
        stamp_ns = stamp_ns + 3_000_000
    recorder = estimate_recorder_clock_offset(stamp_ns, stamp_ns + 120_000_000)
    assert recorder.is_on_epochs is on_epochs
    assert (recorder.ahead_ns, recorder.sigma_ns, recorder.n) == (120_000_000, 0, 50)


def test_the_clocks_are_told() -> None:
    ours = estimate_recorder_clock_offset(np.array([0, 10, 20]), np.array([100, 110, 120]))
    theirs = estimate_recorder_clock_offset(np.array([0, 10]), np.array([100, 110]))
    told = recorder_clock_difference_text(-1_500_000_000, ours, theirs)
    assert told.startswith("the other car's recorder is 1.500 s behind this one's")
    assert told.endswith("by the stamps of 3 and 2 positions")


def test_two_cars_stand_in_the_order_of_their_log_times() -> None:
    one = states(3)
    two = move_states_to_our_map_and_clock(states(3), OURS, OURS, name="b", stamp_shift_ns=1, log_shift_ns=1)
    both = merge_states_by_log_time(one, two)
    assert [both.ids.values[code] for code in both.ids.codes] == ["ego", "b"] * 3
    assert (np.diff(both.log_time_ns) >= 0).all()
    np.testing.assert_array_equal(both.state[::2], one.state)
