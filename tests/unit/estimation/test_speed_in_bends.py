"""A speed that reads more in bends, against the accelerometer of an IMU, and what is no slip."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.speed_in_bends import speed_of_steered_wheels_beyond_axle_mps_per_m2
from cwcli.signals.vehicle_state import HEADING, SPEED
from cwcli.simulation.scenario import EGO_VEHICLE_KEY
from tests.drive_truth import true_states_of_vehicle, truth_stamps_ns
from tests.studies.lying_sensors import judged, simulated
from tests.studies.sensor_model import measurements_of
from tests.unit.estimation.made_drive import made_drive
from tests.unit.estimation.test_source_judgement import ALL, _drive, _judge, _with_fault

TIME_S, VALUES = made_drive()
YAW_RATE = VALUES[Kind.YAW_RATE]


def _slipping(factor: float) -> list[Measurements]:
    return _with_fault(_drive(*ALL), Kind.SPEED, lambda v: np.where(YAW_RATE[:, None] != 0.0, factor * v, v))


@pytest.mark.parametrize("factor", [1.15, 0.93])
def test_a_speed_that_differs_in_bends_is_named_and_set_aside_there(factor: float) -> None:
    found = _judge(_slipping(factor))
    (correction,) = found.corrections
    assert str(correction.who) == "ego_speed (/speed)"
    told = re.match(r"reads (\d\.\d+) times the speed in bends", correction.fault)
    assert told is not None
    assert float(told[1]) == pytest.approx(factor, rel=0.005)
    # Six bends of 4 s at 20 Hz, and up to half a second on both sides of each.
    assert 6 * 4 * 20 <= correction.n_set_aside <= 6 * 5 * 20
    speed = next(p.series for p in found.prepared if p.series.kind is Kind.SPEED)
    assert not np.isin(speed.time_s, TIME_S[YAW_RATE != 0.0]).any()


@pytest.mark.parametrize(("in_bends", "everywhere"), [(1.15, 1.1), (0.95, 1.15), (1.2, 0.9)])
def test_a_speed_that_slips_is_scaled_as_on_straight_roads(in_bends: float, everywhere: float) -> None:
    both = _with_fault(_slipping(in_bends), Kind.SPEED, lambda v: everywhere * v)
    slipping, scaled = _judge(both).corrections
    assert (slipping.name, scaled.name) == ("bends", "scaled")
    told = re.match(r"reads (\d\.\d+) times the way between the fixes", scaled.fault)
    assert told is not None
    assert float(told[1]) == pytest.approx(everywhere, abs=0.003)


@pytest.mark.parametrize("n_skipped", [20, 0], ids=["slow", "without-gyroscope"])
def test_the_first_imu_that_is_fast_enough_judges_the_bends(n_skipped: int) -> None:
    """Before it come one with a row a second, or an accelerometer alone."""
    position, speed, heading, imu = _slipping(1.15)
    first = (
        replace(imu, source="/a", values=imu.values[::n_skipped], stamp_ns=imu.stamp_ns[::n_skipped])
        if n_skipped
        else Measurements("/a", Kind.ACCEL, imu.stamp_ns, imu.values[:, :1])
    )
    (correction,) = _judge([position, speed, heading, first, imu]).corrections
    assert correction.name == "bends"
    assert correction.evidence.endswith("by accelerations of /imu")


def test_a_trusted_speed_keeps_its_rows() -> None:
    assert _judge(_slipping(1.15), trusted={"/speed"}).corrections == ()


@pytest.mark.parametrize(("ahead_m", "left_m"), [(-2.0, 0.0), (3.0, 0.5), (0.0, -1.0)])
def test_a_lever_arm_of_the_imu_is_no_slip(ahead_m: float, left_m: float) -> None:
    """It reads -x w^2 - y w' more ahead, and x w' - y w^2 more to the left."""
    change = np.gradient(YAW_RATE, TIME_S)

    def moved(values: np.ndarray) -> np.ndarray:
        ahead, left = -ahead_m * YAW_RATE**2 - left_m * change, ahead_m * change - left_m * YAW_RATE**2
        return values + np.column_stack([ahead, left, *(np.zeros((4, len(ahead))))])

    assert _judge(_with_fault(_drive(*ALL), Kind.IMU, moved)).corrections == ()


@pytest.mark.parametrize("bias_radps", [-0.03, 0.0, 0.03])
@pytest.mark.parametrize(("factor", "n_expected"), [(1.0, 0), (1.15, 1), (0.93, 1)])
def test_bends_of_an_oval_are_told_from_its_straights(bias_radps: float, factor: float, n_expected: int) -> None:
    """A car that turns to the left for most of the time has no median turn rate of 0."""
    _, oval = made_drive(is_oval=True)
    is_bend = oval[Kind.YAW_RATE][:, None] != 0.0
    wrong = _with_fault(_drive(*ALL, made=oval), Kind.SPEED, lambda v: np.where(is_bend, factor * v, v))
    judged = _judge(_with_fault(wrong, Kind.IMU, lambda v: v + bias_radps * np.array([0, 0, 0, 0, 0, 1])))
    assert len(judged.corrections) == n_expected
    for correction in judged.corrections:
        told = re.match(r"reads (\d\.\d+) times the speed in bends", correction.fault)
        assert told is not None
        assert float(told[1]) == pytest.approx(factor, rel=0.025)  # a lever arm to the side looks much like it there
        speed = next(p.series for p in judged.prepared if p.series.kind is Kind.SPEED)
        assert not np.isin(speed.time_s, TIME_S[is_bend[:, 0]]).any()
        assert len(speed) > 0.9 * (~is_bend).sum() - 6 * 20  # half a second on both sides of six bends


def _of_front_wheels(speed_mps: np.ndarray, yaw_rate_radps: np.ndarray, wheelbase_m: float) -> np.ndarray:
    """Speed of the rear axle -> that of the front wheels: 1 / cos(arctan(l w / v)) times as much."""
    return np.asarray(np.hypot(speed_mps, wheelbase_m * yaw_rate_radps))


@pytest.mark.parametrize("wheelbase_m", [2.7, 3.2, 4.5, 6.1])
def test_front_wheels_drive_farther_in_bends_and_do_not_slip(wheelbase_m: float) -> None:
    """All bends have 15 m, where 2.7 m make 1.6 % and 6.1 m of a truck 8 %."""
    noise = _drive(*ALL)[1].values[:, 0] - VALUES[Kind.SPEED]
    steered = noise + _of_front_wheels(VALUES[Kind.SPEED], YAW_RATE, wheelbase_m)
    assert _judge(_with_fault(_drive(*ALL), Kind.SPEED, lambda _: steered[:, None])).corrections == ()


def test_front_wheels_are_as_much_faster_in_reverse() -> None:
    """3 m/s and 0.3 rad/s are a radius of 10 m: with a wheelbase of 2 m, 3 (sqrt(1 + 0.2^2) - 1) = 0.0594 m/s."""
    found = speed_of_steered_wheels_beyond_axle_mps_per_m2(np.array([3.0, -3.0]), np.array([0.3, 0.3]))
    np.testing.assert_allclose(2.0**2 * found, [0.0594, -0.0594], rtol=0.015)


@pytest.mark.parametrize(("factor", "n_expected"), [(1.0, 0), (1.05, 1), (0.96, 1)])
def test_front_wheels_in_a_simulated_town_are_named_where_they_slip(factor: float, n_expected: int) -> None:
    """Bends of 10 to 170 m tell slip from the wheelbase of 3.2 m."""
    drive = simulated("city", 30303)
    true = true_states_of_vehicle(drive, EGO_VEHICLE_KEY)
    true_s = 1e-9 * (truth_stamps_ns(drive) - drive.scenario.start_ns)
    rate = np.gradient(true[:, HEADING], true_s)
    measurements = []
    for m in measurements_of(drive):
        own = m
        if m.kind is Kind.SPEED:
            v, w = (np.interp(1e-9 * (m.stamp_ns - drive.scenario.start_ns), true_s, x) for x in (true[:, SPEED], rate))
            read = np.where(np.abs(w) > 0.05, factor, 1.0) * _of_front_wheels(v, w, 3.2)
            own = replace(m, values=m.values + (read - v)[:, None])
        measurements.append(own)
    found = judged(measurements)
    assert [each.name for each in found.corrections] == n_expected * ["bends"]
    assert found.contradictions == ()


@pytest.mark.parametrize("late_s", [0.0, 0.3])
def test_a_speed_of_another_scale_that_is_late_is_no_slip(late_s: float) -> None:
    right = [
        replace(m, stamp_ns=m.stamp_ns + round(1e9 * late_s), values=1.04 * m.values) if m.kind is Kind.SPEED else m
        for m in _drive(*ALL)
    ]
    assert _judge(right).corrections == ()
