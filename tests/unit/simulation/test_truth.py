"""The true motion: circles, clothoids and stopping distances by hand, a whole drive by an independent integrator."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import fresnel

from cwcli.errors import UsageError
from cwcli.simulation.profile import read_motion_profile
from cwcli.simulation.scenario import load_scenario
from cwcli.simulation.truth import (
    Motion,
    TrueMotion,
    check_motion_is_drivable,
)
from tests.approach import closest_approach_time_and_distance, first_time_nearer_than_s

ATOL_M = 1e-6
ATOL_RAD = 1e-9
X, Y, SPEED, HEADING, ACCEL, YAW_RATE, JERK, YAW_ACCEL = range(8)


def motion(
    longitudinal: object = None,
    lateral: object = None,
    *,
    speed_mps: float = 10,
    end_s: float = 60,
    heading_rad: float = 0,
) -> TrueMotion:
    profile = read_motion_profile(
        longitudinal, lateral, speed_mps=speed_mps, end_s=end_s, path="host", source="drive.toml"
    )
    return TrueMotion(profile, x_m=0.0, y_m=0.0, heading_rad=heading_rad)


def at(made: Motion, *time_s: float) -> np.ndarray:
    return made.states_at(np.array(time_s))


def test_constant_speed_north() -> None:
    state = at(motion(speed_mps=7, heading_rad=np.pi / 2), 0.0, 12.3456)
    np.testing.assert_allclose(state[:, [X, Y]], [[0.0, 0.0], [0.0, 7 * 12.3456]], atol=ATOL_M)


def test_circle_of_40_m_comes_round_after_two_pi_r_over_v() -> None:
    # 10 m/s, R = 40 m: once the curvature is reached, 8 pi s make one turn. The opposite point is 80 m away.
    made = motion(lateral=[{"from_s": 0, "curvature_1pm": 0.025, "curvature_rate_1pmps": 0.0125}])
    turn_s = 2 * np.pi * 40 / 10
    start, half, full = at(made, 5.0, 5.0 + turn_s / 2, 5.0 + turn_s)
    np.testing.assert_allclose(full[[X, Y]], start[[X, Y]], atol=ATOL_M)
    assert np.hypot(*(half[[X, Y]] - start[[X, Y]])) == pytest.approx(80.0, abs=ATOL_M)
    assert full[HEADING] - start[HEADING] == pytest.approx(2 * np.pi, abs=ATOL_RAD)
    assert start[YAW_RATE] == pytest.approx(0.25, abs=ATOL_RAD)
    # The centre lies 40 m to the left of the car.
    centre = start[[X, Y]] + 40 * np.array([-np.sin(start[HEADING]), np.cos(start[HEADING])])
    np.testing.assert_allclose(half[[X, Y]], 2 * centre - start[[X, Y]], atol=ATOL_M)


def test_clothoid_against_the_fresnel_integrals() -> None:
    # Heading 0.5 * w' t^2 with w' = rate * speed = 0.02 rad/s^2; x = v sqrt(pi / w') C(t sqrt(w' / pi)), y likewise S.
    made = motion(lateral=[{"from_s": 0, "curvature_1pm": 0.1, "curvature_rate_1pmps": 0.002}], speed_mps=10, end_s=60)
    time_s = np.array([3.0, 17.77, 49.0])
    scale = np.sqrt(np.pi / 0.02)
    sine, cosine = fresnel(time_s / scale)
    np.testing.assert_allclose(at(made, *time_s)[:, [X, Y]], 10 * scale * np.column_stack([cosine, sine]), atol=ATOL_M)


def test_stopping_distance_by_hand() -> None:
    # 20 m/s to rest at 8 m/s^2 and 10 m/s^3: 20 / 8 + 8 / 10 = 3.3 s, mean speed 10 m/s by symmetry: 33 m.
    made = motion([{"from_s": 0, "speed_mps": 0, "limit_mps2": 8, "jerk_mps3": 10}], speed_mps=20)
    stopped, later = at(made, 3.3, 60.0)
    assert stopped[X] == pytest.approx(33.0, abs=ATOL_M)
    np.testing.assert_allclose(later[[X, Y, SPEED, ACCEL]], [33.0, 0.0, 0.0, 0.0], atol=ATOL_M)


def test_before_the_run_the_car_came_straight_at_its_first_speed() -> None:
    state = at(motion([{"from_s": 0, "accel_mps2": 3, "jerk_mps3": 100}], speed_mps=10), -2.0)[0]
    np.testing.assert_allclose(state, [-20, 0, 10, 0, 0, 0, 0, 0], atol=ATOL_M)


def test_times_outside_the_truth_are_refused() -> None:
    with pytest.raises(ValueError, match="truth is known from"):
        at(motion(end_s=10), 20.1)


def test_rates_are_the_derivatives_of_the_states() -> None:
    made = load_scenario("city").vehicles["host"].motion
    rng = np.random.default_rng(5)
    time_s, step_s = rng.uniform(1, 239, 400), 1e-4
    early, late = made.states_at(time_s - step_s), made.states_at(time_s + step_s)
    slope = (late - early) / (2 * step_s)
    state = made.states_at(time_s)
    np.testing.assert_allclose(slope[:, X], state[:, SPEED] * np.cos(state[:, HEADING]), atol=1e-5)
    np.testing.assert_allclose(slope[:, Y], state[:, SPEED] * np.sin(state[:, HEADING]), atol=1e-5)
    np.testing.assert_allclose(slope[:, HEADING], state[:, YAW_RATE], atol=1e-5)
    np.testing.assert_allclose(slope[:, SPEED], state[:, ACCEL], atol=1e-4)
    for rate, derivative in ((ACCEL, JERK), (YAW_RATE, YAW_ACCEL)):  # they jump at the edges of segments
        difference = np.abs(slope[:, rate] - state[:, derivative])
        assert np.quantile(difference, 0.98) < 1e-6


def test_city_track_against_an_independent_integrator() -> None:
    made = load_scenario("city").vehicles["host"].motion

    def rate(time_s: float, _state: np.ndarray) -> list[float]:
        s = made.states_at(np.array([time_s]))[0]
        return [s[SPEED] * np.cos(s[HEADING]), s[SPEED] * np.sin(s[HEADING])]

    end_s = 45.0
    solved = solve_ivp(rate, (0.0, end_s), [0.0, 0.0], rtol=1e-10, atol=1e-8, max_step=0.5)
    np.testing.assert_allclose(at(made, end_s)[0, [X, Y]], solved.y[:, -1], atol=1e-5)


def test_friction_limit_counts_both_directions_together() -> None:
    # 20 m/s on R = 100 m needs 4 m/s^2, with braking at 4 m/s^2 sqrt(32) = 5.66: inside 0.6 g = 5.88, not 0.55 g.
    made = motion(
        [
            {"from_s": 0, "to_s": 3, "accel_mps2": 0},
            {"from_s": 3, "to_s": 3.4, "accel_mps2": -4, "jerk_mps3": 100},
            {"from_s": 3.4, "accel_mps2": 0, "jerk_mps3": 100},
        ],
        [{"from_s": 0, "curvature_1pm": 0.01, "curvature_rate_1pmps": 0.01}],
        speed_mps=20,
        end_s=5,
    )
    check_motion_is_drivable(made, end_s=5, friction=0.6, turning_radius_m=5, path="vehicles.host", source="drive.toml")
    with pytest.raises(UsageError) as error:
        check_motion_is_drivable(
            made, end_s=5, friction=0.55, turning_radius_m=5, path="vehicles.host", source="drive.toml"
        )
    assert str(error.value).startswith("drive.toml: vehicles.host needs 5.6")
    assert "permitted: 0 to 5.39 m/s^2 (friction 0.55 * g" in str(error.value)


def test_turning_on_the_spot_is_refused() -> None:
    made = motion(lateral=[{"from_s": 0, "yaw_rate_dps": 10}], speed_mps=0, end_s=5)
    with pytest.raises(UsageError, match=r"host turns at .* permitted: a radius of 5 m or more"):
        check_motion_is_drivable(made, end_s=5, friction=0.9, turning_radius_m=5, path="host", source="drive.toml")


def test_closest_approach_of_two_crossing_cars_by_hand() -> None:
    # East at 10 m/s from the origin, north at 10 m/s from (30, -38): relative way along (-1, 1) / sqrt(2).
    east = motion(speed_mps=10, end_s=8)
    profile = read_motion_profile(None, None, speed_mps=10, end_s=8, path="b", source="drive.toml")
    north = TrueMotion(profile, x_m=30.0, y_m=-38.0, heading_rad=np.pi / 2)
    time_s, distance_m = closest_approach_time_and_distance(east, north, 8)
    assert time_s == pytest.approx(3.4, abs=1e-3)
    assert distance_m == pytest.approx(8 / np.sqrt(2), abs=1e-5)
    assert np.isnan(first_time_nearer_than_s(east, north, 8, 5.0))
