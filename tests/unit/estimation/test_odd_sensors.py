"""When a sensor is taken for odd, and when not."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.odd_sensors import find_impossible_imu_values, is_first_row_contradicted, stuck_row_mask

TIME_S = 0.1 * np.arange(100.0)


def _imu(force: tuple[float, float, float], yaw_rate: float) -> np.ndarray:
    return np.column_stack([np.tile([*force, 0.0, 0.0], (100, 1)), yaw_rate * np.sin(TIME_S)])


def test_an_imu_in_g_upside_down_and_in_degrees_becomes_one_in_si_units() -> None:
    values = _imu((0.0, 0.0, -1.0), 20.0)
    found = find_impossible_imu_values(values)
    assert [(each.name, evidence) for each, evidence in found] == [
        ("g", "gravity reads 1.00"),
        ("x,-y,-z", "gravity points upward"),
        ("degrees/s", "yaw rates reach 20"),
    ]
    stamp_ns = np.rint(1e9 * TIME_S).astype(np.int64)
    m = Measurements("/imu", Kind.IMU, stamp_ns, values, np.ones((100, 6)))
    for hypothesis, _ in found:
        m = hypothesis.correct_measurements(m)
    np.testing.assert_allclose(m.values[:, 2], 9.80665)
    np.testing.assert_allclose(m.values[:, 5], -np.radians(20.0) * np.sin(TIME_S))
    assert m.covariance is not None
    np.testing.assert_allclose(np.diag(m.covariance[0]), [9.80665**2] * 3 + [np.radians(1.0) ** 2] * 3)


@pytest.mark.parametrize(
    "force",
    [(0.0, 0.0, 9.81), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (3.3, 0.0, 9.2), (0.0, 0.0, 1.62)],
    ids=["as usual", "without gravity", "steady acceleration", "pitched by 20 degrees", "something else"],
)
def test_an_imu_in_si_units_is_left_as_it_is(force: tuple[float, float, float]) -> None:
    given = _imu(force, 1.2)  # rad/s: as fast as a car turns round
    assert find_impossible_imu_values(given) == []


def test_the_counts_of_a_converter_are_in_no_unit() -> None:
    assert find_impossible_imu_values(_imu((0.0, 0.0, 16384.0), 3626.0)) == []
    assert [each.name for each, _ in find_impossible_imu_values(_imu((0.0, 0.0, 1000.0), 2900.0))] == ["milliradians/s"]
    assert find_impossible_imu_values(_imu((0.0, 0.0, 9.81), 3100.0)) == []  # 3.1 rad/s, if it were in milliradians


def test_a_first_speed_of_zero_is_apart_from_a_drive_at_15_mps_but_not_from_a_start() -> None:
    rng = np.random.default_rng(0)
    cruise: np.ndarray = (15.0 + 0.1 * rng.standard_normal(100))[:, None]
    assert not is_first_row_contradicted(Kind.SPEED, TIME_S, cruise)
    cruise[0] = 0.0
    assert is_first_row_contradicted(Kind.SPEED, TIME_S, cruise)
    start: np.ndarray = (3.0 * TIME_S + 0.1 * rng.standard_normal(100))[:, None]  # 3 m/s^2
    assert not is_first_row_contradicted(Kind.SPEED, TIME_S, start)
    cruise[1:, 0] = np.where(np.arange(99) % 2, 15.0, 0.0)  # rows that do not agree with each other prove nothing
    assert not is_first_row_contradicted(Kind.SPEED, TIME_S, cruise)


def test_a_first_fix_in_the_gulf_of_guinea_is_apart() -> None:
    xy: np.ndarray = np.stack([10.0 * TIME_S, 0.0 * TIME_S], axis=1)
    assert not is_first_row_contradicted(Kind.POSITION, TIME_S, xy)
    xy[0] = -5.3e6, -8.1e5
    assert is_first_row_contradicted(Kind.POSITION, TIME_S, xy)


def test_a_speed_sticks_only_where_it_is_not_zero_and_usually_changes() -> None:
    rng = np.random.default_rng(1)
    speed: np.ndarray = (12.0 + 0.1 * rng.standard_normal(100))[:, None]
    speed[40:80] = speed[40]
    assert np.flatnonzero(stuck_row_mask(Kind.SPEED, TIME_S, speed)).tolist() == list(range(41, 80))
    standing = speed.copy()
    standing[40:80] = 0.0
    assert not stuck_row_mask(Kind.SPEED, TIME_S, standing).any()
    coarse = np.round(speed)  # whole m/s
    assert not stuck_row_mask(Kind.SPEED, TIME_S, coarse).any()
    assert not stuck_row_mask(Kind.POSITION, TIME_S, np.tile([1.0, 2.0], (100, 1))).any()
