"""Levelling and invented samples."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.estimation.imu import interpolated_samples, level_imu
from cwcli.estimation.prepare import held_back

TIME = 0.01 * np.arange(2000)


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
    levelled = level_imu(TIME, values, None)
    assert levelled.yaw_rate_radps.mean() == pytest.approx(0.3, abs=0.005)
    assert levelled.accel_mps2.mean() == pytest.approx(-9.81 * np.sin(pitch), abs=0.01)


def test_level_imu_trusts_the_mount_where_gravity_was_taken_out() -> None:
    values = noisy()
    values[:, 2] -= 9.81
    values[:, 5] += 0.2
    np.testing.assert_array_equal(level_imu(TIME, values, None).yaw_rate_radps, values[:, 5])


def test_interpolated_run_is_found_and_nothing_else() -> None:
    values = noisy()
    ends = values[[700, 850]]
    values[700:851] = ends[0] + np.linspace(0, 1, 151)[:, None] * (ends[1] - ends[0])
    found = interpolated_samples(TIME, values)
    assert found[710:840].all()
    assert not found[:690].any()
    assert not found[860:].any()


def test_interpolated_samples_leaves_smooth_signals_alone() -> None:
    assert not interpolated_samples(TIME, noisy()).any()
    clean = np.stack([np.sin(TIME)] * 6, axis=1)
    assert not interpolated_samples(TIME, clean).any()
    assert not interpolated_samples(TIME, np.zeros((2000, 6))).any()


def test_held_back_finds_the_burst_but_not_jitter() -> None:
    rng = np.random.default_rng(1)
    time = np.arange(0.0, 30.0, 0.1)
    jitter = np.sort(time + rng.uniform(-0.04, 0.04, len(time)))
    assert held_back(jitter).sum() == 0
    burst = time.copy()
    burst[100:120] = 11.99 + 0.0005 * np.arange(20)
    late = held_back(np.sort(burst))
    assert late[101:118].all()
    assert late.sum() <= 21
