"""Turns of the onset hypothesis end after a right angle, with what was turned before; by hand."""

import numpy as np
import pytest

from cwcli.prediction.paths import Paths
from cwcli.prediction.rollout import RolloutSettings, roll_out_paths
from cwcli.prediction.turn_end import end_turns_of_paths_at_quarter_turn, left_turn_on_last_stretch_rad

RATE_HZ = 10
SETTINGS = RolloutSettings(horizon_s=4.0, step_s=0.01)


def circle(yaw_rate_radps: float, speed_mps: float = 10.0, heading_rad: float = 0.0) -> Paths:
    state = np.array([[0.0, 0.0, speed_mps, heading_rad, 0.0, yaw_rate_radps, 0.0, 0.0]])
    return roll_out_paths("ctrv", state, None, SETTINGS)


def drive(speed_mps: np.ndarray, yaw_rate_radps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stamps, and states with headings from the yaw rates."""
    stamp_ns = np.arange(len(speed_mps)) * (1_000_000_000 // RATE_HZ)
    state = np.zeros((len(speed_mps), 8))
    state[:, 2] = speed_mps
    state[1:, 3] = np.cumsum(yaw_rate_radps[1:] / RATE_HZ)
    return stamp_ns, state


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("heading_rad", [0.0, 2.0])
def test_a_circle_becomes_a_quarter_of_it_and_its_tangent(side: float, heading_rad: float) -> None:
    # 10 m/s and 0.5 rad/s: a radius of 20 m, a quarter after pi s; then straight for 4 - pi s
    ended = end_turns_of_paths_at_quarter_turn(circle(0.5 * side, heading_rad=heading_rad), np.zeros(1))
    x, y = 20.0, side * (20.0 + 10.0 * (4.0 - np.pi))
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    assert ended.x_m[0, -1] == pytest.approx(cos * x - sin * y, abs=0.005)
    assert ended.y_m[0, -1] == pytest.approx(sin * x + cos * y, abs=0.005)
    assert ended.heading_rad[0, -1] == pytest.approx(heading_rad + side * np.pi / 2)
    assert (ended.speed_mps == 10.0).all()


def test_a_path_within_the_right_angle_is_the_same_to_the_bit() -> None:
    path = circle(0.35)  # 1.4 rad
    ended = end_turns_of_paths_at_quarter_turn(path, np.zeros(1))
    assert (ended.x_m == path.x_m).all()
    assert (ended.heading_rad == path.heading_rad).all()


@pytest.mark.parametrize(
    ("turned_deg", "side", "left_deg"),
    [
        pytest.param(60.0, 1.0, 30.0, id="two thirds are done"),
        pytest.param(60.0, -1.0, 90.0, id="the other turn is new"),
        pytest.param(120.0, 1.0, 0.0, id="a roundabout"),
        pytest.param(-60.0, -1.0, 30.0, id="to the right"),
    ],
)
def test_what_was_turned_before_counts(turned_deg: float, side: float, left_deg: float) -> None:
    ended = end_turns_of_paths_at_quarter_turn(circle(0.5 * side), np.radians([turned_deg]))
    assert np.degrees(ended.heading_rad[0, -1]) == pytest.approx(side * left_deg)


def test_the_change_of_heading_counts_over_the_last_thirty_metres() -> None:
    # 10 m/s for 10 s, 0.2 rad/s to the left: 0.6 rad in 30 m; from a start on the way it counts from there
    stamp_ns, state = drive(np.full(101, 10.0), np.full(101, 0.2))
    turned = left_turn_on_last_stretch_rad(stamp_ns, stamp_ns, state)
    assert turned[0] == 0.0
    assert turned[20] == pytest.approx(0.4)
    assert turned[30:] == pytest.approx(np.full(71, 0.6))


def test_waiting_in_a_turn_does_not_make_it_a_new_one() -> None:
    speed = np.concatenate([np.full(21, 5.0), np.zeros(600), np.full(5, 5.0)])
    stamp_ns, state = drive(speed, np.where(speed > 0.0, 0.4, 0.0))
    turned = left_turn_on_last_stretch_rad(stamp_ns, stamp_ns, state)
    assert turned[20:621] == pytest.approx(np.full(601, 0.8))  # 2 s with 0.4 rad/s
    assert turned[-1] == pytest.approx(1.0)


def test_a_heading_that_passes_the_opposite_of_east_has_not_turned_back() -> None:
    stamp_ns, state = drive(np.full(31, 5.0), np.full(31, 0.2))
    wrapped = state.copy()
    wrapped[:, 3] = (state[:, 3] + 3.0 + np.pi) % (2.0 * np.pi) - np.pi
    np.testing.assert_allclose(
        left_turn_on_last_stretch_rad(stamp_ns, stamp_ns, wrapped),
        left_turn_on_last_stretch_rad(stamp_ns, stamp_ns, state),
        atol=1e-12,
    )


def test_states_that_come_later_than_newer_ones_change_nothing() -> None:
    stamp_ns, state = drive(np.full(31, 5.0), np.full(31, 0.2))
    log_time_ns = stamp_ns.copy()
    log_time_ns[10] = stamp_ns[15]  # overtaken by four others
    strange = state.copy()
    strange[10, 3] = 2.0
    one, other = (left_turn_on_last_stretch_rad(stamp_ns, log_time_ns, each) for each in (state, strange))
    np.testing.assert_array_equal(one, other)
    # the overtaken state has what was known before it
    assert one[10] == one[9]


def test_an_unknown_heading_leaves_the_known_turn() -> None:
    stamp_ns, state = drive(np.full(31, 5.0), np.full(31, 0.2))
    state[0, 3] = np.nan
    assert left_turn_on_last_stretch_rad(stamp_ns, stamp_ns, state)[-1] == pytest.approx(0.2 * 2.9)
    assert left_turn_on_last_stretch_rad(stamp_ns[:0], stamp_ns[:0], state[:0]).shape == (0,)
