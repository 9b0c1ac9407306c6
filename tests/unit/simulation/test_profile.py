"""Profiles: ramps and changes of speed by hand, and what is refused."""

from __future__ import annotations

import math

import pytest

from cwcli.errors import UsageError
from cwcli.simulation.profile import MotionProfile, find_piece_at, read_motion_profile

ATOL = 1e-12


def profile(
    longitudinal: object = None, lateral: object = None, *, speed_mps: float, end_s: float = 20.0
) -> MotionProfile:
    return read_motion_profile(
        longitudinal, lateral, speed_mps=speed_mps, end_s=end_s, path="vehicles.host", source="drive.toml"
    )


def speed_and_accel(made: MotionProfile, time_s: float) -> tuple[float, float]:
    return find_piece_at(made.speed, time_s).speed_and_accel_at(time_s)


def test_accel_segment_ramps_at_its_jerk_then_holds() -> None:
    # Jerk 2 m/s^3 to 3 m/s^2: the ramp takes 1.5 s and gains 3 * 1.5 / 2 = 2.25 m/s.
    made = profile([{"from_s": 0, "accel_mps2": 3, "jerk_mps3": 2}], speed_mps=10)
    assert speed_and_accel(made, 1.0) == pytest.approx((11.0, 2.0), abs=ATOL)
    assert speed_and_accel(made, 1.5) == pytest.approx((12.25, 3.0), abs=ATOL)
    assert speed_and_accel(made, 3.5) == pytest.approx((18.25, 3.0), abs=ATOL)


def test_speed_segment_with_a_hold_takes_v_over_a_plus_a_over_j() -> None:
    # 0 to 8 m/s at 2 m/s^2 and 2 m/s^3: 8 / 2 + 2 / 2 = 5 s, half the speed at half the time.
    made = profile([{"from_s": 0, "speed_mps": 8, "limit_mps2": 2, "jerk_mps3": 2}], speed_mps=0)
    assert speed_and_accel(made, 1.0) == pytest.approx((1.0, 2.0), abs=ATOL)
    assert speed_and_accel(made, 2.5) == pytest.approx((4.0, 2.0), abs=ATOL)
    assert speed_and_accel(made, 4.5) == pytest.approx((8.0 - 2 * 0.5**2 / 2, 1.0), abs=ATOL)
    assert speed_and_accel(made, 5.0) == (8.0, 0.0)
    assert speed_and_accel(made, 19.0) == (8.0, 0.0)


def test_small_speed_change_never_reaches_the_limit() -> None:
    # 4 m/s less at 1 m/s^3: the peak is sqrt(1 * 4) = 2 m/s^2 after 2 s, done after 4 s.
    made = profile([{"from_s": 0, "speed_mps": 6, "limit_mps2": 5, "jerk_mps3": 1}], speed_mps=10)
    assert speed_and_accel(made, 2.0) == pytest.approx((8.0, -2.0), abs=ATOL)
    assert speed_and_accel(made, 4.0) == pytest.approx((6.0, 0.0), abs=ATOL)


def test_speed_segment_that_starts_while_accelerating_overshoots_and_returns() -> None:
    # At 2 m/s^2 when told to hold 12 m/s: releasing at 1 m/s^3 alone would end at 12 + 2^2 / 2 = 14 m/s.
    made = profile(
        [
            {"from_s": 0, "to_s": 2, "accel_mps2": 2, "jerk_mps3": 2},
            {"from_s": 2, "speed_mps": 13, "limit_mps2": 3, "jerk_mps3": 1},
        ],
        speed_mps=10,
    )
    assert speed_and_accel(made, 2.0) == pytest.approx((13.0, 2.0), abs=ATOL)
    assert speed_and_accel(made, 4.0) == pytest.approx((15.0, 0.0), abs=ATOL)  # the top of the overshoot
    # The way back: peak p with (p^2 - 0) / J = 2 m/s, so sqrt(2) m/s^2; two ramps of sqrt(2) s.
    end_s = 4.0 + 2 * math.sqrt(2)
    assert speed_and_accel(made, end_s + 1e-9) == pytest.approx((13.0, 0.0), abs=1e-8)


def test_smooth_ramp_peaks_at_its_jerk_and_takes_half_as_long_again() -> None:
    # To 2.5 m/s^2 at 1.25 m/s^3: 1.5 * 2 s. Half way half the acceleration; in all the speed gains 2.5 * 3 / 2.
    made = profile([{"from_s": 0, "accel_mps2": 2.5, "jerk_mps3": 1.25, "smooth": True}], speed_mps=10)
    assert speed_and_accel(made, 1.5)[1] == pytest.approx(1.25, abs=ATOL)
    slope = (speed_and_accel(made, 1.5 + 1e-5)[1] - speed_and_accel(made, 1.5 - 1e-5)[1]) / 2e-5
    assert slope == pytest.approx(1.25, abs=1e-6)
    assert speed_and_accel(made, 1e-3)[1] < 1e-5
    assert speed_and_accel(made, 3.0) == pytest.approx((13.75, 2.5), abs=ATOL)


def test_smooth_speed_change_meets_its_target() -> None:
    # 7.5 m/s with a peak of 2.5 m/s^2: two ramps of 3 s, and nothing to hold between them.
    segment = {"from_s": 0, "speed_mps": 7.5, "limit_mps2": 2.5, "jerk_mps3": 1.25, "smooth": True}
    made = profile([segment], speed_mps=0)
    assert speed_and_accel(made, 3.0) == pytest.approx((3.75, 2.5), abs=1e-9)
    assert speed_and_accel(made, 6.0 - 1e-9) == pytest.approx((7.5, 0.0), abs=1e-9)


def test_curvature_ramp_by_hand() -> None:
    made = profile(None, [{"from_s": 0, "curvature_1pm": 0.025, "curvature_rate_1pmps": 0.0125}], speed_mps=10)
    assert find_piece_at(made.turn, 1.0).curvature_or_yaw_rate_at(1.0) == pytest.approx(0.0125, abs=ATOL)
    assert find_piece_at(made.turn, 5.0).curvature_or_yaw_rate_at(5.0) == 0.025


def test_change_from_curvature_to_yaw_rate_keeps_the_yaw_rate() -> None:
    made = profile(
        None,
        [
            {"from_s": 0, "to_s": 5, "curvature_1pm": 0.02},
            {"from_s": 5, "yaw_rate_dps": 0, "yaw_accel_dps2": 10},
        ],
        speed_mps=10,
    )
    assert find_piece_at(made.turn, 5.0).curvature_or_yaw_rate_at(5.0) == pytest.approx(
        0.2, abs=ATOL
    )  # 0.02 1/m * 10 m/s


@pytest.mark.parametrize(
    ("longitudinal", "message"),
    [
        pytest.param(
            [{"from_s": 1, "accel_mps2": 1}],
            "vehicles.host.longitudinal.0.from_s is 1: the profile has a gap; permitted: 0 s",
            id="late-start",
        ),
        pytest.param(
            [{"from_s": 0, "to_s": 3, "accel_mps2": 0}, {"from_s": 4, "accel_mps2": 1}],
            "vehicles.host.longitudinal.0.to_s is 3: the profile has a gap; permitted: 4 s, where the next one starts",
            id="gap",
        ),
        pytest.param(
            [{"from_s": 0, "to_s": 5, "accel_mps2": 0}, {"from_s": 4, "accel_mps2": 1}],
            "vehicles.host.longitudinal.0.to_s is 5: the profile has an overlap; "
            "permitted: 4 s, where the next one starts",
            id="overlap",
        ),
        pytest.param(
            [{"from_s": 0, "to_s": 19, "accel_mps2": 0}],
            "vehicles.host.longitudinal.0.to_s is 19: the profile has a gap; permitted: at least 20 s",
            id="ends-before-the-run",
        ),
        pytest.param(
            [{"from_s": 0, "accel_mps2": 1, "speed_mps": 3}],
            "vehicles.host.longitudinal.0 has both of accel_mps2 and speed_mps; permitted: exactly one of them",
            id="two-targets",
        ),
        pytest.param(
            [{"from_s": 0}],
            "vehicles.host.longitudinal.0 has neither of accel_mps2 and speed_mps; permitted: exactly one of them",
            id="no-target",
        ),
        pytest.param(
            [
                {"from_s": 0, "to_s": 1, "speed_mps": 20, "limit_mps2": 2, "jerk_mps3": 2},
                {"from_s": 1, "accel_mps2": 0},
            ],
            "vehicles.host.longitudinal.0 lasts 1 s: too short to reach its target; permitted: at least 6.000 s",
            id="too-short",
        ),
        pytest.param(
            [{"from_s": 0, "accel_mps2": -2, "jerk_mps3": 100}],
            "vehicles.host.longitudinal reaches -29.98 m/s at 20.00 s; permitted: a speed of 0 m/s or more",
            id="reverse",
        ),
        pytest.param(
            [{"from_s": 0, "accel_mps2": 1, "jerk_mps3": -1}],
            "vehicles.host.longitudinal.0.jerk_mps3 is -1; permitted: 0.01 to 100 m/s^3",
            id="negative-jerk",
        ),
        pytest.param(
            [{"from_s": 0, "accel": 1}],
            "vehicles.host.longitudinal.0.accel is unknown; "
            "permitted: from_s, to_s, accel_mps2, speed_mps, limit_mps2, jerk_mps3, smooth",
            id="unknown-key",
        ),
        pytest.param([], "vehicles.host.longitudinal is []; permitted: a list of segments", id="empty"),
    ],
)
def test_bad_profile_is_refused_with_place_and_range(longitudinal: object, message: str) -> None:
    with pytest.raises(UsageError) as error:
        profile(longitudinal, speed_mps=10)
    assert str(error.value) == f"drive.toml: {message}"
