"""Sources that say nothing, one value or next to nothing: judging them never fails, and what is wrong is told."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from cwcli.estimation.imu_against_motion import StepAccelerations, bounds_of_ratio, compute_step_accelerations
from cwcli.estimation.map_stretch import stretch_of_map_or_nan
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.slow_accel import high_pass_time_constant_of_accelerometer_s
from cwcli.estimation.speed_in_bends import find_excess_in_bends
from cwcli.estimation.step_motion import compute_step_motion_by_source, step_edges_s
from tests.unit.estimation.made_drive import drive_series, made_drive
from tests.unit.estimation.test_source_judgement import ALL, LEAN, G, _drive, _judge, _with_fault

TIME_S, VALUES = made_drive()


def _set_columns(*columns: int, to: Sequence[float] | float) -> Callable[[np.ndarray], np.ndarray]:
    def change(values: np.ndarray) -> np.ndarray:
        changed = values.copy()
        changed[:, columns] = to
        return changed

    return change


@pytest.mark.parametrize("kinds", [ALL, LEAN], ids=["all", "lean"])
@pytest.mark.parametrize(
    ("columns", "to", "told"),
    [
        ((0, 1), 0.0, ["accel"]),
        ((0, 1, 2), (0.0, 0.0, G), ["accel"]),
        ((0, 1, 2), (0.1, -0.2, G), ["accel"]),
        ((0, 1, 2), 0.0, ["accel"]),
        ((3, 4, 5), 0.0, ["yaw rate"]),
        ((0, 1, 2, 3, 4, 5), (0.0, 0.0, G, 0.0, 0.0, 0.0), ["accel", "yaw rate"]),
        ((0, 1, 2, 3, 4, 5), 0.0, ["accel", "yaw rate"]),
    ],
    ids=["level-zero", "gravity-alone", "one-value", "no-accel", "no-gyro", "still", "zero"],
)
def test_an_imu_that_does_not_move_is_told(
    kinds: tuple[Kind, ...], columns: tuple[int, ...], to: Sequence[float] | float, told: list[str]
) -> None:
    found = _judge(_with_fault(_drive(*kinds), Kind.IMU, _set_columns(*columns, to=to))).contradictions
    assert [str(each.who) for each in found] == [f"imu {what} (/imu)" for what in told]


@pytest.mark.parametrize("kind", ALL[1:], ids=[kind.name for kind in ALL[1:]])
@pytest.mark.parametrize("n_rows", [0, 1, 2, 30])
def test_a_source_of_few_or_unknown_rows_fails_nothing(kind: Kind, n_rows: int) -> None:
    right = _drive(*ALL)
    few = [m.select_rows(np.arange(len(m)) < n_rows) if m.kind is kind else m for m in right]
    unknown = [replace(m, values=_values_behind_unknown(m, n_rows)) if m.kind is kind else m for m in right]
    for measurements in (few, unknown):
        judged = _judge(measurements)
        assert judged.corrections == ()
        assert judged.contradictions == ()


def _values_behind_unknown(m: Measurements, n_rows: int) -> np.ndarray:
    return np.where(np.arange(len(m))[:, None] < n_rows, m.values, np.nan)


NOTHING, NO_STEPS = np.zeros((40, 2)), np.zeros(0)


def _accelerations(measured: np.ndarray, reference: np.ndarray) -> StepAccelerations:
    fixes = compute_step_motion_by_source(drive_series(VALUES, TIME_S, Kind.POSITION)[0], np.array([0.0, 1.0]))
    return StepAccelerations(measured, reference, NOTHING, NO_STEPS, "", NO_STEPS, NO_STEPS, fixes, NO_STEPS)


@pytest.mark.parametrize("measured", [NOTHING, NOTHING + np.nan], ids=["zero", "nan"])
@pytest.mark.parametrize("reference", [NOTHING, NOTHING + 1.0, NOTHING + np.nan], ids=["zero", "one", "nan"])
def test_accelerations_that_tell_nothing_have_no_ratio_and_show_no_stretch(
    measured: np.ndarray, reference: np.ndarray
) -> None:
    assert all(math.isnan(each) for each in bounds_of_ratio(_accelerations(measured, reference)))
    fixes = drive_series(VALUES, TIME_S, Kind.POSITION)[0]
    assert math.isnan(stretch_of_map_or_nan(fixes, lambda _: (measured, reference)))


@pytest.mark.parametrize("n_edges", [0, 1, 2, 5])
def test_few_steps_hold_no_accelerations(n_edges: int) -> None:
    fixes = drive_series(VALUES, TIME_S, Kind.POSITION)
    assert compute_step_accelerations(TIME_S, np.ones((len(TIME_S), 6)), fixes, np.arange(0.0, n_edges)) is None


@pytest.mark.parametrize("factor", [0.0, np.nan], ids=["zero", "nan"])
def test_a_series_that_tells_nothing_shows_no_filter_and_no_excess(factor: float) -> None:
    """An accelerometer that reads 0 is left out before a speed is compared with it; see above."""
    fixes, speed, accel, turning = drive_series(VALUES, TIME_S, Kind.POSITION, Kind.SPEED, Kind.ACCEL, Kind.YAW_RATE)
    edges_s = step_edges_s([fixes], 4.0)
    by_accel, by_fixes = (compute_step_motion_by_source(s, edges_s) for s in (_scaled(accel, factor), fixes))
    assert math.isnan(high_pass_time_constant_of_accelerometer_s(by_accel, by_fixes, 4.0))
    for own, other in ((_scaled(speed, factor), turning), (speed, _scaled(turning, factor))):
        excess = find_excess_in_bends(own, accel, other, fixes)
        assert excess is None or not excess.is_clear


def _scaled(s: SensorSeries, factor: float) -> SensorSeries:
    return replace(s, values=factor * s.values)
