"""Levelling and invented samples."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.estimation.imu import interpolated_sample_mask, level_imu_by_gravity
from cwcli.estimation.odd_sensors import find_tilt_and_evidence
from cwcli.estimation.prepare import burst_row_mask

TIME = 0.01 * np.arange(2000.0)


def noisy(seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    values = 0.05 * rng.standard_normal((2000, 6))
    values[:, 2] += 9.81
    return values


def test_level_imu_takes_the_yaw_rate_about_the_vertical_of_a_pitched_mount() -> None:
    """10 degrees nose down: a turn of 0.3 rad/s about the vertical shows as 0.3 cos 10 on the z axis."""
    pitch = np.radians(10.0)
    values = noisy()
    values[:, 0] -= 9.81 * np.sin(pitch)
    values[:, 2] += 9.81 * (np.cos(pitch) - 1.0)
    values[:, 3] -= 0.3 * np.sin(pitch)
    values[:, 5] += 0.3 * np.cos(pitch)
    levelled = level_imu_by_gravity(TIME, values, None)
    assert levelled.yaw_rate_radps.mean() == pytest.approx(0.3, abs=0.005)
    assert levelled.accel_mps2.mean() == pytest.approx(-9.81 * np.sin(pitch), abs=0.01)


def test_level_imu_trusts_the_mount_where_gravity_was_taken_out() -> None:
    values = noisy()
    values[:, 2] -= 9.81
    values[:, 5] += 0.2
    np.testing.assert_array_equal(level_imu_by_gravity(TIME, values, None).yaw_rate_radps, values[:, 5])


def test_interpolated_run_is_found_and_nothing_else() -> None:
    values = noisy()
    ends = values[[700, 850]]
    values[700:851] = ends[0] + np.linspace(0, 1, 151)[:, None] * (ends[1] - ends[0])
    found = interpolated_sample_mask(TIME, values)
    assert found[710:840].all()
    assert not found[:690].any()
    assert not found[860:].any()


def test_interpolated_samples_leaves_smooth_signals_alone() -> None:
    assert not interpolated_sample_mask(TIME, noisy()).any()
    clean = np.stack([np.sin(TIME)] * 6, axis=1)
    assert not interpolated_sample_mask(TIME, clean).any()
    assert not interpolated_sample_mask(TIME, np.zeros((2000, 6))).any()


def test_held_back_finds_the_burst_but_not_jitter() -> None:
    rng = np.random.default_rng(1)
    time = np.arange(0.0, 30.0, 0.1)
    jitter = np.sort(time + rng.uniform(-0.04, 0.04, len(time)))
    assert burst_row_mask(jitter).sum() == 0
    burst = time.copy()
    burst[100:120] = 11.99 + 0.0005 * np.arange(20)
    late = burst_row_mask(np.sort(burst))
    assert late[101:118].all()
    assert late.sum() <= 21


def test_a_bend_to_one_side_does_not_look_like_a_rolled_mount() -> None:
    """15 s of a bend in 36 s at 10 m/s, 0.25 rad/s: the mean force leans by atan(1.04 / 9.81), 6 degrees."""
    time_s = np.arange(0.0, 36.0, 0.05)
    values = np.zeros((len(time_s), 6))
    values[:, 5] = np.where((time_s > 13.0) & (time_s < 28.0), 0.25, 0.0)
    values[:, 1], values[:, 2] = 10.0 * values[:, 5], 9.80665
    levelled = level_imu_by_gravity(time_s, values, None)
    assert levelled.mounting is not None
    assert levelled.mounting.left_up_rad == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(levelled.yaw_rate_radps, values[:, 5], atol=1e-9)


@pytest.mark.parametrize("yaw_rate_radps", [0.3, -0.5])
def test_a_circle_without_end_does_not_look_like_a_rolled_mount(yaw_rate_radps: float) -> None:
    """A skid pad at 10 m/s and 0.3 rad/s: the mean force leans by atan(3 / 9.81), 17 degrees, but the turn does not."""
    rng = np.random.default_rng(4)
    time_s = np.arange(0.0, 60.0, 0.05)
    values = rng.normal(0.0, [0.1] * 3 + [0.005] * 3, (len(time_s), 6))
    values += [0.0, 10.0 * yaw_rate_radps, 9.80665, 0.0, 0.0, yaw_rate_radps]
    levelled = level_imu_by_gravity(time_s, values, None)
    assert levelled.mounting is not None
    assert levelled.mounting.left_up_rad == pytest.approx(0.0, abs=np.radians(0.1))
    assert levelled.yaw_rate_radps.mean() == pytest.approx(yaw_rate_radps, rel=1e-3)
    assert find_tilt_and_evidence(values) is None


def test_an_imu_that_is_rolled_is_found_to_be_tilted_on_a_circle_too() -> None:
    """Rolled by 30 degrees at 10 m/s and 0.3 rad/s: the turn is about its axis (0, sin 30, cos 30)."""
    time_s = np.arange(0.0, 60.0, 0.05)
    s, c = np.sin(np.radians(30.0)), np.cos(np.radians(30.0))
    turn = np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
    force, gyro = turn @ [0.0, 3.0, 9.80665], turn @ [0.0, 0.0, 0.3]
    values = np.tile(np.concatenate([force, gyro]), (len(time_s), 1))
    assert find_tilt_and_evidence(values) is not None
    levelled = level_imu_by_gravity(time_s, values, None)
    assert levelled.mounting is not None
    assert levelled.mounting.left_up_rad == pytest.approx(np.radians(30.0), abs=1e-9)
    np.testing.assert_allclose(levelled.yaw_rate_radps, 0.3, atol=1e-9)


def test_a_rolled_mount_in_a_bend_is_still_found() -> None:
    """Left axis 4 degrees up: gravity shows on it by sin, the bend's 10 m/s * w by cos."""
    rng = np.random.default_rng(2)
    time_s = np.arange(0.0, 60.0, 0.02)
    w = np.where(time_s > 30.0, 0.2, 0.0) + 0.05 * np.sin(time_s)
    roll = np.radians(4.0)
    level = np.stack([np.zeros_like(w), 10.0 * w, np.full_like(w, 9.80665)], axis=1) + rng.normal(
        0.0, 0.05, (len(w), 3)
    )
    turn = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(roll), np.sin(roll)], [0.0, -np.sin(roll), np.cos(roll)]])
    values = np.column_stack([level @ turn.T, np.stack([0.0 * w, 0.0 * w, w], axis=1) @ turn.T])
    levelled = level_imu_by_gravity(time_s, values, None)
    assert levelled.mounting is not None
    assert levelled.mounting.left_up_rad == pytest.approx(roll, abs=np.radians(0.1))
    np.testing.assert_allclose(levelled.yaw_rate_radps, w, atol=1e-3)
