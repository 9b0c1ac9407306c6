"""Forty files of fifteen kinds: 36 become the drive that they hold without an option, the others ask."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cwcli.importing.run import plan_import, write_import
from cwcli.importing.tables import AmbiguousError, Answers
from cwcli.logs.read.reader import Log
from tests.unit.importing.drive import DRIVE, METERS_PER_DEGREE
from tests.unit.importing.files import CASES, Case
from tests.unit.importing.oracles import annotated_log

ATOL_M, ATOL_MPS, ATOL_RAD, ATOL_MPS2 = 0.02, 0.02, 0.01, 0.02
"""What the digits in the files allow."""
TILT_RAD = 0.06
"""How well the mounting of a phone is found from this drive, rad."""

RIGHT = {name: case for name, case in CASES.items() if not case.asks}
ASKING = {name: case for name, case in CASES.items() if case.asks}


def test_there_are_forty_files_of_fifteen_kinds() -> None:
    assert len(CASES) == 40
    assert len(RIGHT) == 36
    assert len({case.kind for case in CASES.values()}) >= 15


def column(log: Log, topic: str, path: str) -> np.ndarray:
    return np.asarray(log.columns(topic).fields[path], np.float64)


def check_fix(log: Log, case: Case) -> None:
    north = (column(log, "/gps/fix", "latitude") - DRIVE.lat_deg) * METERS_PER_DEGREE
    east = (column(log, "/gps/fix", "longitude") - DRIVE.lon_deg) * METERS_PER_DEGREE * 0.67
    assert np.hypot(north, east).max() < ATOL_M


def check_plane(log: Log, case: Case) -> None:
    """A plane's positions are on the globe, with their distances kept."""
    latitude, longitude = (column(log, "/gps/fix", name) for name in ("latitude", "longitude"))
    north, east = np.diff(latitude) * METERS_PER_DEGREE, np.diff(longitude) * METERS_PER_DEGREE * np.cos(np.deg2rad(52))
    np.testing.assert_allclose(np.hypot(north, east), np.hypot(np.diff(DRIVE.x_m), np.diff(DRIVE.y_m)), rtol=0.02)


def check_velocity(log: Log, case: Case) -> None:
    east, north = (column(log, "/gps/velocity", f"twist.linear.{axis}") for axis in "xy")
    np.testing.assert_allclose(east, DRIVE.speed_mps * np.cos(DRIVE.heading_rad), atol=ATOL_MPS)
    np.testing.assert_allclose(north, DRIVE.speed_mps * np.sin(DRIVE.heading_rad), atol=ATOL_MPS)


def check_speed(log: Log, case: Case) -> None:
    np.testing.assert_allclose(column(log, "/vehicle/twist", "twist.linear.x"), DRIVE.speed_mps, atol=ATOL_MPS)


def check_yaw_rate(log: Log, case: Case) -> None:
    np.testing.assert_allclose(column(log, "/vehicle/twist", "twist.angular.z"), DRIVE.yaw_rate_radps, atol=ATOL_RAD)


def check_heading(log: Log, case: Case) -> None:
    z, w = (column(log, "/vehicle/heading", f"quaternion.{axis}") for axis in "zw")
    error = np.angle(np.exp(1j * (2.0 * np.arctan2(z, w) - DRIVE.heading_rad)))
    assert np.abs(error).max() < ATOL_RAD


def check_pose(log: Log, case: Case) -> None:
    """The path and the yaw along it."""
    x, y = (column(log, "/pose", f"pose.position.{axis}") for axis in "xy")
    z, w = (column(log, "/pose", f"pose.orientation.{axis}") for axis in "zw")
    np.testing.assert_allclose(x + 1j * y, DRIVE.x_m + 1j * DRIVE.y_m, atol=ATOL_M)
    assert np.abs(np.angle(np.exp(1j * (2.0 * np.arctan2(z, w) - DRIVE.heading_rad)))).max() < ATOL_RAD


def check_imu(log: Log, case: Case) -> None:
    is_phone = case.kind in {"zip", "gnsslogger"}
    ahead, left, up = (column(log, "/imu/data", f"linear_acceleration.{axis}") for axis in "xyz")
    tolerance = ATOL_MPS2
    if is_phone:  # a vertical that is the mean force leans with the mean of the horizontal accelerations
        assert np.hypot(ahead.mean() - DRIVE.accel_mps2.mean(), up.mean() - 9.80665) < 9.8 * TILT_RAD
        ahead, left, up = (each - each.mean() for each in (ahead, left, up))
        tolerance = 0.12
    true = [DRIVE.accel_mps2, DRIVE.speed_mps * DRIVE.yaw_rate_radps, np.full(len(up), 9.80665)]
    for axis, expected in zip((ahead, left, up), true, strict=True):
        np.testing.assert_allclose(axis, expected - expected.mean() if is_phone else expected, atol=tolerance)
    np.testing.assert_allclose(
        column(log, "/imu/data", "angular_velocity.z"), DRIVE.yaw_rate_radps, atol=0.02 if is_phone else 0.001
    )


def check_frames(log: Log, case: Case) -> None:
    frames = list(log.frames("/camera/image"))
    assert len(frames) == 20
    assert [frame.stamp_ns for frame in frames] == DRIVE.stamp_ns[:20].tolist()


def check_remote(log: Log, case: Case) -> None:
    assert len(log.columns("/v2x/bsm")) == len(DRIVE.t_s)


def check_own(log: Log, case: Case) -> None:
    """Every digit that the export printed comes back."""
    with Log.open(annotated_log()) as source:
        states = source.columns("/cwcli/ego/state")
    for topic, path, name in (
        ("/gps/fix", "latitude", "latitude_deg"),
        ("/gps/fix", "longitude", "longitude_deg"),
        ("/vehicle/twist", "twist.linear.x", "speed_mps"),
        ("/vehicle/twist", "twist.angular.z", "yaw_rate_radps"),
    ):
        np.testing.assert_array_equal(column(log, topic, path), np.asarray(states.fields[name]))
    np.testing.assert_array_equal(log.columns("/gps/fix").log_time_ns, np.asarray(states.fields["stamp_ns"], np.int64))


CHECKS = {name.removeprefix("check_"): check for name, check in list(globals().items()) if name.startswith("check_")}


@pytest.mark.parametrize("name", RIGHT)
def test_file_becomes_the_drive(name: str, tmp_path: Path) -> None:
    case = CASES[name]
    files = case.make(tmp_path)
    plan = plan_import([str(path) for path in files], Answers())
    assert case.kind in plan.kinds.values()
    write_import(plan, str(tmp_path / "log.mcap"))
    with Log.open(tmp_path / "log.mcap") as log:
        for what in case.holds.split():
            CHECKS[what](log, case)
        if case.start is not None and case.holds != "own":
            assert log.start_ns == pytest.approx(case.start, abs=1000)
        elif case.start is None:
            assert log.start_ns == 0


@pytest.mark.parametrize("name", ASKING)
def test_file_is_refused_with_its_question(name: str, tmp_path: Path) -> None:
    case = CASES[name]
    with pytest.raises(AmbiguousError, match=case.asks) as found:
        plan_import([str(path) for path in case.make(tmp_path)], Answers())
    assert found.value.hint.startswith("--")
    assert found.value.exit_code == 4
