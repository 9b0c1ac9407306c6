"""Steering from vision: eq. 10 and 13 by hand, and what the robust derivative is for."""

import numpy as np
import pytest

from cwcli.dynamics.steering import (
    dynamic_to_kinematic_steering_ratio,
    rate_per_s_by_median_slope,
    rate_per_s_from_last_two_frames,
    steering_angle_from_vision_rad,
)
from cwcli.dynamics.vehicle import load_vehicle

CAR = load_vehicle()
STAMP_NS = np.arange(10, dtype=np.int64) * 100_000_000


def test_equation_10_by_hand() -> None:
    # Right bend 0.001 1/m, e_L grows by 0.002 rad in 0.1 s at 20 m/s:
    # delta_k = 1.96 * 0.001 - 0.002 * 1.96 / (20 * 0.1) = 0 to the right.
    heading = 0.002 * np.arange(10.0)
    steer = steering_angle_from_vision_rad(CAR, STAMP_NS, heading, np.full(10, 0.001), np.full(10, 20.0))
    assert np.isnan(steer[0])
    np.testing.assert_allclose(steer[1:], 0.0, atol=1e-15)


def test_following_a_right_bend_steers_to_the_right() -> None:
    steer = steering_angle_from_vision_rad(CAR, STAMP_NS, np.full(10, 0.01), np.full(10, 0.002), np.full(10, 20.0))
    np.testing.assert_allclose(steer[1:], -1.96 * 0.002)


def test_equation_13_at_half_load() -> None:
    assert float(dynamic_to_kinematic_steering_ratio(CAR, 20.0)) == pytest.approx(1.0 + 0.000843 * 400.0, abs=2e-4)
    assert float(dynamic_to_kinematic_steering_ratio(load_vehicle(load="full"), 20.0)) == float(
        dynamic_to_kinematic_steering_ratio(CAR, 20.0)
    )


@pytest.mark.parametrize("speed_mps", [0.0, 0.99, -5.0, np.nan])
def test_no_angle_without_speed(speed_mps: float) -> None:
    steer = steering_angle_from_vision_rad(CAR, STAMP_NS, np.zeros(10), np.zeros(10), np.full(10, speed_mps))
    assert np.isnan(steer).all()


def test_one_wrong_frame_does_not_reach_the_robust_rate() -> None:
    values = 0.3 * np.arange(10.0) * 0.1
    values[6] = 5.0
    np.testing.assert_allclose(rate_per_s_by_median_slope(STAMP_NS, values)[1:6], 0.3)
    np.testing.assert_allclose(rate_per_s_by_median_slope(STAMP_NS, values)[7:], 0.3)
    assert np.abs(rate_per_s_from_last_two_frames(STAMP_NS, values)[6:8]).min() > 40.0


def test_rates_use_real_times_and_make_nothing_up() -> None:
    stamp_ns = np.array([0, 50, 150, 150, 2150, 2250], dtype=np.int64) * 1_000_000
    values = np.array([0.0, 0.05, 0.15, 0.15, 9.0, np.nan])
    np.testing.assert_allclose(
        rate_per_s_from_last_two_frames(stamp_ns, values), [np.nan, 1.0, 1.0, np.nan, np.nan, np.nan]
    )
    rate = rate_per_s_by_median_slope(stamp_ns, values)
    np.testing.assert_allclose(rate[1:4], 1.0)
    assert np.isnan(rate[5])
    assert rate_per_s_by_median_slope(stamp_ns[:0], values[:0]).shape == (0,)


def test_the_robust_rate_is_quieter() -> None:
    random = np.random.default_rng(3)
    stamp_ns = np.arange(2000, dtype=np.int64) * 100_000_000
    values = 0.01 * random.standard_normal(2000)
    assert np.nanstd(rate_per_s_by_median_slope(stamp_ns, values)) < 0.35 * np.nanstd(
        rate_per_s_from_last_two_frames(stamp_ns, values)
    )
