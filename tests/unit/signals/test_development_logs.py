"""The development logs of ../shared/logs through the official decoders: times, units, signs."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from cwcli.channels.binding import ALL_ROLE_NAMES, bind_roles
from cwcli.errors import MissingSignalError
from cwcli.signals.build import build_signal
from cwcli.signals.canonical import (
    HeadingSignal,
    ImuSignal,
    PoseSignal,
    PositionSignal,
    RemoteSignal,
    SpeedSignal,
    VelocitySignal,
)
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.quality import Quality
from cwcli.signals.role import Role
from tests.unit.signals.signal_columns import development_log, official_columns

MS = 1_000_000
DRESDEN = "balzer-dresden-2014-03-26.ros2.mcap"
KITTI = "kitti-2011-10-03-drive-0027.first240s.mcap"
OPENACC_22 = "openacc-dynamic-part22.ros2.mcap"
OPENACC_23 = "openacc-dynamic-part23.ros2.mcap"
PSU_FOLLOW = "psu-follow-2obu.mcap"
PSU_ONE = "psu-testtrack-1obu.mcap"
WYDOT = "wydot-bsm.mcap"
OBJECTS = "udacity-obj-pose.ros2.mcap"
OPTIONAL = tuple(role for role in ALL_ROLE_NAMES if role != Role.EGO_POSITION)


@cache
def built(log: str, topic: str, role: Role) -> tuple[Any, Quality]:
    signal, quality = build_signal(role, official_columns(development_log(log), topic))
    assert quality.read == quality.used + sum(quality.rejected.values()) + sum(quality.set_aside.values())
    return signal, quality


@pytest.mark.parametrize(
    ("log", "expected"),
    [
        (DRESDEN, {"ego_position": "/gps/fix", "ego_velocity": "/gps/vel", "imu": "/imu/data"}),
        (KITTI, {"ego_position": "/gps/fix", "imu": "/imu/data"}),
        (OPENACC_22, {"ego_position": "/gps/fix", "ego_speed": "/vehicle/twist", "remote": "/v2x/cam"}),
        (OPENACC_23, {"ego_position": "/gps/fix", "ego_speed": "/vehicle/twist", "remote": "/v2x/cam"}),
        (PSU_FOLLOW, {"ego_position": "/gps/fix", "remote": "/v2x/bsm"}),
        (PSU_ONE, {"remote": "/v2x/bsm"}),
        (WYDOT, dict.fromkeys(["ego_position", "ego_speed", "ego_heading", "remote"], "/v2x/ode_bsm")),
        (OBJECTS, {"detections": "/lidar/objects", "target_truth": "/truth/target"}),
        ("udacity-solid-white-right.mcap", {"camera": "/camera/image"}),
        ("tusimple-0313-dev.mcap", {"camera": "/camera/image"}),
    ],
)
def test_bind_finds_what_each_log_holds(log: str, expected: dict[str, str]) -> None:
    with development_log(log).open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    channels = [
        Found(c.topic, summary.schemas[c.schema_id].name, c.message_encoding) for c in summary.channels.values()
    ]
    bindings = bind_roles(channels, {}, required=(), optional=ALL_ROLE_NAMES)
    assert {str(role): bindings.first_topic_of_role(role) for role in bindings.by_role} == expected
    assert len(bindings.notes) == (1 if log == KITTI else 0)  # its two truth channels
    if "ego_position" not in expected:
        with pytest.raises(MissingSignalError, match="no channel holds the ego position"):
            bind_roles(channels, {}, required=[Role.EGO_POSITION], optional=OPTIONAL)


class Found:
    def __init__(self, topic: str, schema_name: str, message_encoding: str) -> None:
        self.topic, self.schema_name, self.message_encoding = topic, schema_name, message_encoding


@pytest.mark.parametrize(
    ("log", "topic", "role", "delay_ms"),
    [
        (DRESDEN, "/gps/fix", Role.EGO_POSITION, 80),
        (DRESDEN, "/gps/vel", Role.EGO_VELOCITY, 80),
        (DRESDEN, "/imu/data", Role.IMU, 5),
        (KITTI, "/gps/fix", Role.EGO_POSITION, 80),
        (KITTI, "/imu/data", Role.IMU, 5),
        (KITTI, "/truth/pose_imu", Role.TRUTH, 5),
        (OPENACC_22, "/vehicle/twist", Role.EGO_SPEED, 5),
        (OPENACC_22, "/v2x/cam", Role.REMOTE, 5),
        (OPENACC_23, "/v2x/cam", Role.REMOTE, 5),
        (PSU_FOLLOW, "/v2x/bsm", Role.REMOTE, 5),
        (PSU_ONE, "/v2x/bsm", Role.REMOTE, 5),
        (WYDOT, "/v2x/ode_bsm", Role.EGO_POSITION, 5),
        (OBJECTS, "/truth/target", Role.TRUTH, 5),
    ],
)
def test_stamps_lie_the_log_s_fixed_delay_before_its_log_times(log: str, topic: str, role: Role, delay_ms: int) -> None:
    signal, quality = built(log, topic, role)
    delay_ns = signal.log_time_ns - signal.stamp_ns
    assert np.abs(delay_ns - delay_ms * MS).max() <= 1
    assert quality.repaired == {}
    assert np.all(np.diff(signal.stamp_ns) >= 0)


def test_dresden_velocity_is_east_and_north() -> None:
    position, _ = built(DRESDEN, "/gps/fix", Role.EGO_POSITION)
    velocity, _ = built(DRESDEN, "/gps/vel", Role.EGO_VELOCITY)
    assert isinstance(position, PositionSignal)
    assert isinstance(velocity, VelocitySignal)
    local = LocalMap(position.latitude_deg[0], position.longitude_deg[0], position.altitude_m[0])
    x_m, y_m, _ = local.map_from_wgs84(position.latitude_deg, position.longitude_deg, position.altitude_m)
    time_s = (position.stamp_ns - position.stamp_ns[0]) * 1e-9
    for along_m, across_m, speed_mps in ((x_m, y_m, velocity.east_mps), (y_m, x_m, velocity.north_mps)):
        said_mps = np.interp(position.stamp_ns, velocity.stamp_ns, speed_mps)
        assert np.corrcoef(np.gradient(along_m, time_s), said_mps)[0, 1] > 0.95
        assert abs(np.corrcoef(np.gradient(across_m, time_s), said_mps)[0, 1]) < 0.5
    assert np.isfinite(position.covariance_m2).all()
    assert position.covariance_m2[0] == pytest.approx([8.286, 0.0, 8.286], abs=1e-3)


def test_dresden_imu_is_as_mounted() -> None:
    imu, _ = built(DRESDEN, "/imu/data", Role.IMU)
    assert isinstance(imu, ImuSignal)
    assert imu.accel_mps2.mean(axis=0) == pytest.approx([-1.76, 0.22, 9.61], abs=0.01)  # its provenance record
    assert np.isnan(imu.accel_variance).all()


def test_kitti_json_imu_has_its_covariances() -> None:
    imu, quality = built(KITTI, "/imu/data", Role.IMU)
    assert isinstance(imu, ImuSignal)
    assert quality.used == 23_863
    assert imu.gyro_variance[0] == pytest.approx([3.0625e-8] * 3)
    assert imu.accel_variance[0] == pytest.approx([1e-4] * 3)
    assert [gap.duration_s for gap in quality.gaps] == pytest.approx([1.92], abs=0.01)


def test_kitti_fixes_lie_on_the_truth() -> None:
    position, _ = built(KITTI, "/gps/fix", Role.EGO_POSITION)
    truth, _ = built(KITTI, "/truth/pose_imu", Role.TRUTH)
    assert isinstance(position, PositionSignal)
    assert isinstance(truth, PoseSignal)
    local = LocalMap(48.9825, 8.3904, 116.4)
    x_m, y_m, _ = local.map_from_wgs84(position.latitude_deg, position.longitude_deg, position.altitude_m)
    inside = (position.stamp_ns >= truth.stamp_ns[0]) & (position.stamp_ns <= truth.stamp_ns[-1])
    error_x = x_m[inside] - np.interp(position.stamp_ns[inside], truth.stamp_ns, truth.x_m)
    error_y = y_m[inside] - np.interp(position.stamp_ns[inside], truth.stamp_ns, truth.y_m)
    assert np.sqrt(np.mean(error_x**2 + error_y**2)) == pytest.approx(0.34, abs=0.02)  # the README's number
    moving = np.hypot(np.diff(truth.x_m), np.diff(truth.y_m)) > 0.3
    course = np.arctan2(np.diff(truth.y_m), np.diff(truth.x_m))[moving]
    assert np.median(np.abs(np.angle(np.exp(1j * (truth.yaw_rad[:-1][moving] - course))))) < 0.05


@pytest.mark.parametrize(("log", "n_cars", "car"), [(OPENACC_22, 8, "1008"), (OPENACC_23, 7, "1007")])
def test_openacc_cars_drive_where_they_head_at_the_speed_they_say(log: str, n_cars: int, car: str) -> None:
    remote, _ = built(log, "/v2x/cam", Role.REMOTE)
    assert isinstance(remote, RemoteSignal)
    assert len(remote.station.values) == n_cars
    assert np.allclose(remote.length_m, 4.5, atol=1e-12)
    assert np.isnan(remote.width_m).all()
    assert np.isnan(remote.yaw_rate_radps).all()
    assert np.isnan(remote.position_covariance_m2).all()
    local = LocalMap(remote.latitude_deg[0], remote.longitude_deg[0], remote.altitude_m[0])
    x_m, y_m, _ = local.map_from_wgs84(remote.latitude_deg, remote.longitude_deg, remote.altitude_m)
    rows = np.flatnonzero(remote.station.codes == remote.station.values.index(car))
    step_s = np.diff(remote.stamp_ns[rows]) * 1e-9
    velocity = (np.diff(x_m[rows]) + 1j * np.diff(y_m[rows])) / step_s
    said = remote.speed_mps[rows] * np.exp(1j * remote.heading_rad[rows])
    assert np.median(np.abs(velocity - said[:-1])) < 0.5


def test_openacc_twist_is_a_speed_without_yaw_rate() -> None:
    speed, quality = built(OPENACC_22, "/vehicle/twist", Role.EGO_SPEED)
    assert isinstance(speed, SpeedSignal)
    assert speed.speed_mps[0] == pytest.approx(8.146984, abs=1e-6)
    assert np.isnan(speed.yaw_rate_radps).all()
    assert len(quality.notes) == 1


def test_psu_messages_hold_a_position_and_nothing_else() -> None:
    remote, quality = built(PSU_FOLLOW, "/v2x/bsm", Role.REMOTE)
    assert isinstance(remote, RemoteSignal)
    assert remote.station.values == ("2a3c603c",)
    assert (remote.latitude_deg[0], remote.longitude_deg[0], remote.altitude_m[0]) == pytest.approx(
        (40.8646987, -77.8304602, 335.6)
    )
    for name in ("speed_mps", "heading_rad", "accel_mps2", "yaw_rate_radps", "length_m", "width_m"):
        assert np.isnan(getattr(remote, name)).all(), name
    assert max(gap.duration_s for gap in quality.gaps) == pytest.approx(13.78, abs=0.01)
    assert any(note.startswith("672 messages repeat") for note in quality.notes)


def test_psu_bursts_are_noted_and_what_can_not_be_placed_in_time_is_counted() -> None:
    _, quality = built(PSU_ONE, "/v2x/bsm", Role.REMOTE)
    # 88 messages have the log time and secMark of the one before: 31 of them its position too.
    assert quality.rejected == {"duplicate message": 31, "repeated stamp with other values": 57}
    assert (quality.read, quality.used) == (3016, 2928)
    assert any("in bursts" in note for note in quality.notes)


def test_wydot_ego_and_remote_are_told_apart_and_timed_by_sec_mark() -> None:
    remote, quality = built(WYDOT, "/v2x/ode_bsm", Role.REMOTE)
    assert isinstance(remote, RemoteSignal)
    assert remote.station.values == ("31325431",)
    assert (quality.used, quality.set_aside) == (93, {"sent by the ego station": 129})
    ahead_ms = (remote.stamp_ns - remote.log_time_ns) / MS
    assert 88 <= ahead_ms.min() <= ahead_ms.max() <= 100  # secMark is 93 to 105 ms after recordGeneratedAt, less 5 ms
    assert np.allclose(remote.length_m, 5.7, atol=1e-12)
    assert np.allclose(remote.width_m, 1.9, atol=1e-12)
    assert remote.heading_rad[0] == pytest.approx(np.deg2rad(90.0 - 250.9125))
    assert remote.position_covariance_m2[0] == pytest.approx([12.7**2, 0.0, 12.7**2])
    heading, _ = built(WYDOT, "/v2x/ode_bsm", Role.EGO_HEADING)
    speed, _ = built(WYDOT, "/v2x/ode_bsm", Role.EGO_SPEED)
    assert isinstance(heading, HeadingSignal)
    assert isinstance(speed, SpeedSignal)
    assert heading.heading_rad[0] == pytest.approx(np.deg2rad(90.0 - 205.975))
    assert speed.speed_mps[:3] == pytest.approx([0.22, 0.26, 0.28])


def test_object_truth_whose_twist_is_in_map_axes_has_the_right_speed() -> None:
    truth, quality = built(OBJECTS, "/truth/target", Role.TRUTH)
    assert isinstance(truth, PoseSignal)
    step_s = np.diff(truth.stamp_ns) * 1e-9
    driven_mps = np.hypot(np.diff(truth.x_m), np.diff(truth.y_m)) / step_s
    np.testing.assert_allclose(0.5 * (truth.speed_mps[:-1] + truth.speed_mps[1:]), driven_mps, atol=0.02)
    assert quality.notes == [
        "the twist is in the axes of the pose, not of the child frame: it is used without rotation"
    ]
