"""The car's response and the replay against kinematics by hand."""

import numpy as np
import pytest

from cwcli.control.car import CarResponse, CarState, advance_car
from cwcli.control.closed_loop import (
    PedalSituation,
    RecordedMotion,
    fuzzy_controller_throttle_and_pressure,
    replay_with_policy,
    throttle_and_pressure_of_driver_braking_after_warning,
    time_to_close_gap_s,
)

INSTANT = CarResponse(brake_lag_s=1e-9, throttle_lag_s=1e-9, max_jerk_mps3=1e9)


def straight(speed_mps: float, start_m: float, end_s: float = 10.0) -> RecordedMotion:
    time_s = np.linspace(0.0, end_s, 201)
    zeros = np.zeros_like(time_s)
    return RecordedMotion(time_s, start_m + speed_mps * time_s, zeros, zeros, np.full_like(time_s, speed_mps))


def brake_5_mpa(situation: PedalSituation) -> tuple[np.ndarray, np.ndarray]:
    n = len(situation.ttc_s)
    return np.zeros(n), np.full(n, 5.0)


def test_stopping_distance_of_an_ideal_brake() -> None:
    # 5 MPa * 0.9 = 4.5 m/s^2; from 18 m/s that takes 4 s and 36 m, after 36 m until the warning.
    outcome = replay_with_policy(straight(18.0, 0.0), straight(0.0, 500.0), np.array([2.0]), brake_5_mpa, car=INSTANT)
    assert outcome.x_m[0, -1] == pytest.approx(72.0, abs=0.02)
    assert outcome.speed_mps[0, -1] == 0.0
    assert outcome.peak_deceleration_mps2[0] == pytest.approx(4.5, abs=1e-6)
    assert not outcome.collided[0]


def test_friction_limits_the_deceleration() -> None:
    slippery = CarResponse(brake_lag_s=1e-9, max_jerk_mps3=1e9, friction=0.2)
    outcome = replay_with_policy(straight(18.0, 0.0), straight(0.0, 500.0), np.array([2.0]), brake_5_mpa, car=slippery)
    assert outcome.peak_deceleration_mps2[0] == pytest.approx(0.2 * 9.80665, rel=1e-9)


def test_jerk_is_limited() -> None:
    outcome = replay_with_policy(straight(18.0, 0.0), straight(0.0, 500.0), np.array([2.0]), brake_5_mpa)
    assert outcome.peak_jerk_mps3[0] <= CarResponse().max_jerk_mps3 * (1 + 1e-9)


def test_brake_lag_is_first_order() -> None:
    # After one time constant the pressure has reached 1 - 1/e of the command, whatever the step.
    zeros = np.zeros(1)
    state = CarState(zeros, zeros, zeros, np.array([30.0]), zeros)
    for _ in range(15):
        state = advance_car(CarResponse(brake_lag_s=0.15), state, zeros, np.array([8.0]), 0.01)
    assert state.pressure_mpa[0] == pytest.approx(8.0 * (1.0 - np.exp(-1.0)), rel=1e-12)


def test_never_warned_replays_the_recording() -> None:
    outcome = replay_with_policy(
        straight(10.0, 0.0), straight(0.0, 60.0), np.array([np.inf]), fuzzy_controller_throttle_and_pressure
    )
    np.testing.assert_allclose(outcome.x_m[0], 10.0 * outcome.time_s, atol=1e-9)
    # The host drives through the standing car's position at 6 s.
    assert outcome.collided[0]
    assert outcome.min_distance_time_s[0] == pytest.approx(6.0, abs=0.01)


def test_runs_of_one_batch_do_not_influence_each_other() -> None:
    host, other = straight(15.0, 0.0), straight(0.0, 80.0)
    both = replay_with_policy(host, other, np.array([2.0, 3.0]), fuzzy_controller_throttle_and_pressure)
    alone = replay_with_policy(host, other, np.array([3.0]), fuzzy_controller_throttle_and_pressure)
    np.testing.assert_allclose(both.x_m[1], alone.x_m[0], rtol=0.0, atol=1e-9)


def test_fuzzy_controller_stops_before_a_standing_car_when_warned_in_time() -> None:
    outcome = replay_with_policy(
        straight(15.0, 0.0), straight(0.0, 80.0), np.array([1.0]), fuzzy_controller_throttle_and_pressure
    )
    assert not outcome.collided[0]
    assert outcome.speed_mps[0, -1] == 0.0


def test_driver_brakes_after_the_reaction_time() -> None:
    outcome = replay_with_policy(
        straight(15.0, 0.0),
        straight(0.0, 500.0),
        np.array([2.0]),
        throttle_and_pressure_of_driver_braking_after_warning,
    )
    before = outcome.time_s < 3.5 - 1e-9
    assert np.all(outcome.speed_mps[0, before] == 15.0)
    assert outcome.speed_mps[0, np.searchsorted(outcome.time_s, 3.8)] < 15.0


def test_host_keeps_to_its_recorded_curve() -> None:
    angle = np.linspace(0.0, np.pi, 400)
    time_s = angle * 40.0 / 10.0
    host = RecordedMotion(time_s, 40.0 * np.sin(angle), 40.0 - 40.0 * np.cos(angle), angle, np.full(400, 10.0))
    outcome = replay_with_policy(host, straight(0.0, 500.0, end_s=12.0), np.array([3.0]), brake_5_mpa)
    radius = np.hypot(outcome.x_m[0], outcome.y_m[0] - 40.0)
    np.testing.assert_allclose(radius, 40.0, atol=2e-3)


def test_motions_that_do_not_overlap_are_refused() -> None:
    late = straight(1.0, 0.0)
    late = RecordedMotion(late.time_s + 100.0, late.x_m, late.y_m, late.heading_rad, late.speed_mps)
    with pytest.raises(ValueError, match="overlap"):
        replay_with_policy(straight(1.0, 0.0), late, np.array([1.0]), fuzzy_controller_throttle_and_pressure)


@pytest.mark.parametrize(
    ("gap_m", "rate_mps", "change_mps2", "expected_s"),
    [
        pytest.param(10.0, -5.0, 0.0, 2.0, id="constant closing speed"),
        pytest.param(8.0, 0.0, -4.0, 2.0, id="from rest: sqrt(2 g / a)"),
        pytest.param(6.0, -1.0, -2.0, 2.0, id="both: 6 = 2 + 4"),
        pytest.param(10.0, -2.0, 1.0, np.inf, id="slows down in time: 2^2 < 2 * 1 * 10"),
        pytest.param(10.0, 3.0, 0.0, np.inf, id="opens"),
        pytest.param(4.0, 1.0, -6.0, 4.0 / 3.0, id="opens, then closes: 4 + 4/3 = 3 * 16/9"),
    ],
)
def test_time_to_close_by_hand(gap_m: float, rate_mps: float, change_mps2: float, expected_s: float) -> None:
    time_s = time_to_close_gap_s(np.array([gap_m]), np.array([rate_mps]), np.array([change_mps2]))
    assert time_s[0] == pytest.approx(expected_s)
