"""A speed that reads more in bends, against the accelerometer of an IMU, and what is no slip."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from cwcli.estimation.measurements import Kind, Measurements
from tests.unit.estimation.made_drive import made_drive
from tests.unit.estimation.test_source_judgement import ALL, _drive, _judge, _with_fault

TIME_S, VALUES = made_drive()
YAW_RATE = VALUES[Kind.YAW_RATE]


def _slipping(factor: float) -> list[Measurements]:
    return _with_fault(_drive(*ALL), Kind.SPEED, lambda v: np.where(YAW_RATE[:, None] != 0.0, factor * v, v))


@pytest.mark.parametrize("factor", [1.05, 0.93])
def test_a_speed_that_differs_in_bends_is_named_and_set_aside_there(factor: float) -> None:
    judged = _judge(_slipping(factor))
    (correction,) = judged.corrections
    assert str(correction.who) == "ego_speed (/speed)"
    told = re.match(r"reads (\d\.\d+) times the speed in bends", correction.fault)
    assert told is not None
    assert float(told[1]) == pytest.approx(factor, abs=0.005)
    # Six bends of 4 s at 20 Hz, and up to half a second on both sides of each.
    assert 6 * 4 * 20 <= correction.n_set_aside <= 6 * 5 * 20
    speed = next(p.series for p in judged.prepared if p.series.kind is Kind.SPEED)
    assert not np.isin(speed.time_s, TIME_S[YAW_RATE != 0.0]).any()


@pytest.mark.parametrize(("in_bends", "everywhere"), [(1.1, 1.1), (1.05, 1.15), (1.2, 0.9)])
def test_a_speed_that_slips_is_scaled_as_on_straight_roads(in_bends: float, everywhere: float) -> None:
    both = _with_fault(_slipping(in_bends), Kind.SPEED, lambda v: everywhere * v)
    slipping, scaled = _judge(both).corrections
    assert (slipping.name, scaled.name) == ("bends", "scaled")
    told = re.match(r"reads (\d\.\d+) times the way between the fixes", scaled.fault)
    assert told is not None
    assert float(told[1]) == pytest.approx(everywhere, abs=0.003)


def test_a_trusted_speed_keeps_its_rows() -> None:
    assert _judge(_slipping(1.05), trusted={"/speed"}).corrections == ()


@pytest.mark.parametrize(("ahead_m", "left_m"), [(-2.0, 0.0), (3.0, 0.5), (0.0, -1.0)])
def test_a_lever_arm_of_the_imu_is_no_slip(ahead_m: float, left_m: float) -> None:
    """It reads -x w^2 - y w' more ahead, and x w' - y w^2 more to the left."""
    change = np.gradient(YAW_RATE, TIME_S)

    def moved(values: np.ndarray) -> np.ndarray:
        ahead, left = -ahead_m * YAW_RATE**2 - left_m * change, ahead_m * change - left_m * YAW_RATE**2
        return values + np.column_stack([ahead, left, *(np.zeros((4, len(ahead))))])

    assert _judge(_with_fault(_drive(*ALL), Kind.IMU, moved)).corrections == ()


@pytest.mark.parametrize("late_s", [0.0, 0.3])
def test_a_speed_of_another_scale_that_is_late_is_no_slip(late_s: float) -> None:
    right = [
        replace(m, stamp_ns=m.stamp_ns + round(1e9 * late_s), values=1.04 * m.values) if m.kind is Kind.SPEED else m
        for m in _drive(*ALL)
    ]
    assert _judge(right).corrections == ()
