"""Builders of headings, inertial measurements, poses and calibrations, and the limits of what they hold."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cwcli.signals.build import build_signal
from cwcli.signals.canonical import (
    CameraInfoSignal,
    HeadingSignal,
    ImuSignal,
    PoseSignal,
    SpeedSignal,
)
from cwcli.signals.columns import Columns, Ragged
from cwcli.signals.limits import OUT_OF_RANGE_REASON as OUT_OF_LIMIT
from cwcli.signals.role import Role
from tests.unit.signals.signal_columns import T0_NS, columns_of, stamp_fields

NAN, INF = float("nan"), float("inf")
MS = 1_000_000
STEADY_NS = T0_NS + 100 * MS * np.arange(8)
COVARIANCE = [4.0, 1.0, 0.0, 1.0, 9.0, 0.0, 0.0, 0.0, 16.0]


def quaternion(base: str, yaw_rad: Any, pitch_rad: float = 0.0) -> dict[str, Any]:
    """Yaw about up, then pitch about left."""
    half_yaw, half_pitch = np.asarray(yaw_rad) / 2, pitch_rad / 2
    return {
        f"{base}.x": -np.sin(half_yaw) * np.sin(half_pitch),
        f"{base}.y": np.cos(half_yaw) * np.sin(half_pitch),
        f"{base}.z": np.sin(half_yaw) * np.cos(half_pitch),
        f"{base}.w": np.cos(half_yaw) * np.cos(half_pitch),
    }


@pytest.mark.parametrize("pitch_rad", [0.0, 0.2])
def test_quaternion_heading_is_the_yaw(pitch_rad: float) -> None:
    yaw = np.array([0.0, 1.0, -2.0, 3.1])
    fields = stamp_fields(STEADY_NS[:4]) | quaternion("quaternion", yaw, pitch_rad)
    signal, _ = build_signal(Role.EGO_HEADING, columns_of("geometry_msgs/msg/QuaternionStamped", fields))
    assert isinstance(signal, HeadingSignal)
    np.testing.assert_allclose(signal.heading_rad, yaw, atol=1e-12)
    assert np.isnan(signal.variance_rad2).all()


def test_quaternion_of_no_length_and_imu_without_orientation_give_no_heading() -> None:
    fields = stamp_fields(STEADY_NS[:2]) | quaternion("orientation", [0.5, 0.6])
    fields["orientation_covariance"] = np.array([[0.1] * 9, [-1.0] + [0.0] * 8])
    signal, quality = build_signal(Role.EGO_HEADING, columns_of("sensor_msgs/msg/Imu", fields))
    assert isinstance(signal, HeadingSignal)
    assert signal.heading_rad == pytest.approx([0.5])
    assert signal.variance_rad2 == pytest.approx([0.1])
    assert quality.rejected == {"orientation not given": 1}


def imu_columns(**more: Any) -> Columns:
    fields = stamp_fields(STEADY_NS[:3]) | {
        "linear_acceleration.x": np.array([0.1, 0.2, 0.3]),
        "linear_acceleration.y": np.zeros(3),
        "linear_acceleration.z": np.full(3, 9.8),
        "linear_acceleration_covariance": np.tile([0.01, 0, 0, 0, 0.02, 0, 0, 0, 0.03], (3, 1)),
        "angular_velocity.x": np.zeros(3),
        "angular_velocity.y": np.zeros(3),
        "angular_velocity.z": np.array([0.5, 0.4, 0.3]),
        "angular_velocity_covariance": np.zeros((3, 9)),
    }
    return columns_of("sensor_msgs/Imu", fields | more, message_encoding="json")


def test_imu_gives_vectors_and_the_variances_that_are_given() -> None:
    signal, quality = build_signal(Role.IMU, imu_columns())
    assert isinstance(signal, ImuSignal)
    np.testing.assert_array_equal(signal.accel_mps2[1], [0.2, 0.0, 9.8])
    np.testing.assert_array_equal(signal.gyro_radps[:, 2], [0.5, 0.4, 0.3])
    np.testing.assert_array_equal(signal.accel_variance[0], [0.01, 0.02, 0.03])
    assert np.isnan(signal.gyro_variance).all()
    assert not quality.rejected and not quality.repaired


def test_imu_quantity_that_is_not_measured_is_nan_and_no_fault() -> None:
    signal, quality = build_signal(
        Role.IMU, imu_columns(angular_velocity_covariance=np.tile([-1.0] + [0.0] * 8, (3, 1)))
    )
    assert isinstance(signal, ImuSignal)
    assert np.isnan(signal.gyro_radps).all()
    assert np.isfinite(signal.accel_mps2).all()
    assert not quality.rejected and not quality.repaired


def test_imu_row_that_is_not_finite_is_rejected() -> None:
    signal, quality = build_signal(Role.IMU, imu_columns(**{"linear_acceleration.x": np.array([0.1, INF, NAN])}))
    assert isinstance(signal, ImuSignal)
    assert len(signal.stamp_ns) == 1
    assert quality.rejected == {"value not a number": 2}


def test_imu_covariances_of_varying_length_are_read_where_they_have_nine() -> None:
    ragged = Ragged(values=np.array([0.5] * 9), offsets=np.array([0, 9, 9, 9]))
    signal, _ = build_signal(Role.IMU, imu_columns(linear_acceleration_covariance=ragged))
    assert isinstance(signal, ImuSignal)
    np.testing.assert_array_equal(signal.accel_variance, [[0.5] * 3, [NAN] * 3, [NAN] * 3])


def odometry_columns(child: str, yaw: Any, **more: Any) -> Columns:
    fields = stamp_fields(STEADY_NS[:3]) | quaternion("pose.pose.orientation", yaw)
    fields |= {
        "header.frame_id": ["odom"] * 3,
        "child_frame_id": [child] * 3,
        "pose.pose.position.x": np.array([0.0, 0.3, 0.6]),
        "pose.pose.position.y": np.zeros(3),
        "pose.pose.position.z": np.zeros(3),
        "pose.covariance": np.zeros((3, 36)),
        "twist.twist.linear.x": np.full(3, -3.0),
        "twist.twist.linear.y": np.full(3, 4.0),
        "twist.twist.angular.z": np.full(3, 0.1),
    }
    return columns_of("nav_msgs/msg/Odometry", fields | more, topic="/odom")


def test_odometry_is_a_pose_with_signed_speed() -> None:
    signal, _ = build_signal(Role.EGO_POSITION, odometry_columns("base_link", [0.1, 0.2, 0.3]))
    assert isinstance(signal, PoseSignal)
    np.testing.assert_allclose(signal.yaw_rad, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(signal.speed_mps, [-5.0] * 3)  # of (-3, 4): horizontal, backwards
    assert signal.frame_id == "odom"
    assert np.isnan(signal.covariance_m2).all()


def test_odometry_without_orientation_has_no_yaw_and_an_unsigned_speed() -> None:
    signal, quality = build_signal(Role.TRUTH, odometry_columns("target", np.zeros(3)))
    assert isinstance(signal, PoseSignal)
    assert np.isnan(signal.yaw_rad).all()
    np.testing.assert_allclose(signal.speed_mps, [5.0] * 3)
    assert len(quality.notes) == 2


@pytest.mark.parametrize("is_map", [False, True], ids=["child-frame", "pose-axes"])
def test_odometry_twist_axes_are_found_from_the_way_driven(is_map: bool) -> None:
    # 10 m/s backward on a circle of 50 m: the yaw turns at -0.2 rad/s, the velocity points against it
    stamp_ns = T0_NS + 100 * MS * np.arange(100)
    yaw = 1.0 - 0.2 * 0.1 * np.arange(100)
    velocity = -10.0 * np.exp(1j * yaw)
    position = np.concatenate([[0.0], np.cumsum(0.1 * 0.5 * (velocity[1:] + velocity[:-1]))])
    twist = velocity if is_map else np.full(100, -10.0 + 0.0j)
    fields = stamp_fields(stamp_ns) | quaternion("pose.pose.orientation", yaw)
    fields |= {"pose.pose.position.x": position.real, "pose.pose.position.y": position.imag}
    fields |= {"pose.pose.position.z": np.zeros(100), "twist.twist.angular.z": np.full(100, -0.2)}
    fields |= {"twist.twist.linear.x": twist.real, "twist.twist.linear.y": twist.imag}
    signal, quality = build_signal(Role.TRUTH, columns_of("nav_msgs/msg/Odometry", fields, log_time_ns=stamp_ns))
    assert isinstance(signal, PoseSignal)
    np.testing.assert_allclose(signal.speed_mps, -10.0, atol=1e-9)
    assert len(quality.notes) == (1 if is_map else 0)


def test_odometry_as_speed_source() -> None:
    signal, _ = build_signal(Role.EGO_SPEED, odometry_columns("base_link", [0.1, 0.2, 0.3]))
    assert isinstance(signal, SpeedSignal)
    np.testing.assert_allclose(signal.speed_mps, [-5.0] * 3)


@pytest.mark.parametrize("frame", ["odom", "map"])
def test_odometry_s_twist_is_in_the_child_frame_whatever_the_pose_s_frame_is_called(frame: str) -> None:
    twist = {"twist.twist.linear.y": np.zeros(3), "header.frame_id": [frame] * 3}
    signal, quality = build_signal(Role.EGO_SPEED, odometry_columns("base_link", [0.1, 0.2, 0.3], **twist))
    assert isinstance(signal, SpeedSignal)
    np.testing.assert_allclose(signal.speed_mps, [-3.0] * 3)
    assert quality.notes == []


def test_odometry_without_orientation_may_reverse() -> None:
    columns = odometry_columns("base_link", np.zeros(3), **{"twist.twist.linear.y": np.full(3, 0.1)})
    signal, _ = build_signal(Role.EGO_SPEED, columns)
    assert isinstance(signal, SpeedSignal)
    np.testing.assert_array_equal(signal.speed_mps, [-3.0] * 3)


def test_odometry_says_the_variances_of_speed_yaw_rate_and_heading() -> None:
    twist, pose = np.zeros((3, 6, 6)), np.zeros((3, 6, 6))
    twist[:, 0, 0], twist[:, 1, 1], twist[:, 5, 5], pose[:, 5, 5] = 0.04, np.inf, 0.01, 0.0025
    covariances = {"twist.covariance": twist.reshape(3, 36), "pose.covariance": pose.reshape(3, 36)}
    columns = odometry_columns("base_link", [0.1, 0.2, 0.3], **covariances)
    speed, quality = build_signal(Role.EGO_SPEED, columns)
    assert isinstance(speed, SpeedSignal)
    np.testing.assert_allclose(speed.speed_variance_m2ps2, [0.04] * 3)  # not of y, which is not measured
    np.testing.assert_array_equal(speed.yaw_rate_variance_rad2ps2, [0.01] * 3)
    assert not quality.rejected and not quality.repaired
    heading, _ = build_signal(Role.EGO_POSITION, columns)
    assert isinstance(heading, PoseSignal)
    assert heading.yaw_variance_rad2 is not None
    np.testing.assert_array_equal(heading.yaw_variance_rad2, [0.0025] * 3)


def test_odometry_s_variance_is_turned_with_a_twist_without_orientation() -> None:
    # the twist (-3, 4) points along (-0.6, 0.8): 0.36 * 0.25 - 2 * 0.48 * 0.1 + 0.64 * 0.5 = 0.314
    twist = np.zeros((3, 6, 6))
    twist[:, 0, 0], twist[:, 0, 1], twist[:, 1, 0], twist[:, 1, 1] = 0.25, 0.1, 0.1, 0.5
    columns = odometry_columns("target", np.zeros(3), **{"twist.covariance": twist.reshape(3, 36)})
    signal, _ = build_signal(Role.EGO_SPEED, columns)
    assert isinstance(signal, SpeedSignal)
    np.testing.assert_allclose(signal.speed_mps, 5.0)
    np.testing.assert_allclose(signal.speed_variance_m2ps2, 0.314)


def test_vehicle_state_is_a_pose() -> None:
    fields = {
        "stamp_ns": STEADY_NS[:2].astype(np.uint64),
        "x_m": [1.0, 2.0],
        "y_m": [3.0, 4.0],
        "speed_mps": [5.0, 5.0],
        "heading_rad": [3.0, 3.5],
        "yaw_rate_radps": [0.1, 0.1],
    }
    signal, _ = build_signal(Role.TRUTH, columns_of("cwcli.v1.VehicleState", fields, message_encoding="protobuf"))
    assert isinstance(signal, PoseSignal)
    np.testing.assert_array_equal(signal.stamp_ns, STEADY_NS[:2])
    np.testing.assert_allclose(signal.yaw_rad, [3.0, 3.5 - 2 * np.pi])


@pytest.mark.parametrize("case", ["lower", "upper"])
def test_camera_info_gives_the_calibration(case: str) -> None:
    names = {"d": [[0.1, -0.2, 0.0, 0.0, 0.0]] * 2, "k": [[500.0, 0, 320, 0, 510.0, 240, 0, 0, 1]] * 2}
    names |= {"r": [[0.0] * 9] * 2, "p": [[0.0] * 12] * 2}
    fields: dict[str, Any] = {(name if case == "lower" else name.upper()): np.array(v) for name, v in names.items()}
    fields |= stamp_fields(STEADY_NS[:2])
    fields |= {"width": [640, 640], "height": [480, 480], "distortion_model": ["plumb_bob"] * 2}
    signal, quality = build_signal(Role.CAMERA_INFO, columns_of("sensor_msgs/msg/CameraInfo", fields))
    assert isinstance(signal, CameraInfoSignal)
    assert (signal.width_px, signal.height_px, signal.distortion_model) == (640, 480, "plumb_bob")
    np.testing.assert_array_equal(signal.intrinsic, [[500, 0, 320], [0, 510, 240], [0, 0, 1]])
    np.testing.assert_array_equal(signal.distortion, [0.1, -0.2, 0, 0, 0])
    np.testing.assert_array_equal(signal.rectification, np.eye(3))
    np.testing.assert_array_equal(signal.projection[:, :3], signal.intrinsic)
    assert quality.used == 2


def test_camera_info_that_changes_or_is_empty_is_counted() -> None:
    k = np.array([[0.0] * 9, [500.0, 0, 320, 0, 500, 240, 0, 0, 1], [600.0, 0, 320, 0, 600, 240, 0, 0, 1]])
    fields = {"width": [640] * 3, "height": [480] * 3, "K": k}
    signal, quality = build_signal(Role.CAMERA_INFO, columns_of("foxglove.CameraCalibration", fields))
    assert isinstance(signal, CameraInfoSignal)
    assert signal.intrinsic[0, 0] == 500.0
    assert (quality.read, quality.used, sum(quality.rejected.values())) == (3, 1, 2)


@pytest.mark.parametrize(
    ("place", "value"),
    [(0, np.inf), (4, 0.0), (4, -500.0), (4, np.nan), (2, np.nan), (5, 1e300), (0, 1e300), (0, 1e-300), (4, 5.0)],
)
def test_camera_info_that_no_lens_has_is_rejected(place: int, value: float) -> None:
    k = np.array([[500.0, 0, 320, 0, 500, 240, 0, 0, 1]])
    k[0, place] = value
    fields = {"width": [640], "height": [480], "K": k}
    signal, quality = build_signal(Role.CAMERA_INFO, columns_of("foxglove.CameraCalibration", fields))
    assert isinstance(signal, CameraInfoSignal)
    assert signal.width_px == 0
    assert sum(quality.rejected.values()) == 1


@pytest.mark.parametrize(("width", "height", "d"), [(1e12, 1e12, [0.0] * 5), (640, 480, [0.1, np.nan, 0, 0, 0])])
def test_camera_info_of_impossible_size_or_distortion_is_rejected(width: float, height: float, d: list[float]) -> None:
    k = np.array([[0.8 * width, 0, width / 2, 0, 0.8 * width, height / 2, 0, 0, 1]])
    fields: dict[str, Any] = {"width": [width], "height": [height], "K": k, "D": np.array([d])}
    _, quality = build_signal(Role.CAMERA_INFO, columns_of("foxglove.CameraCalibration", fields))
    assert (quality.used, sum(quality.rejected.values())) == (0, 1)


def test_projection_of_no_lens_is_not_given() -> None:
    k = np.array([[500.0, 0, 320, 0, 500, 240, 0, 0, 1]])
    p = np.array([[500.0, 0, 320, 0, 0, 0.0, 240, 0, 0, 0, 1, 0]])
    fields = {"width": [640], "height": [480], "K": k, "P": p}
    signal, _ = build_signal(Role.CAMERA_INFO, columns_of("foxglove.CameraCalibration", fields))
    assert isinstance(signal, CameraInfoSignal)
    np.testing.assert_array_equal(signal.projection[:, :3], k.reshape(3, 3))


@pytest.mark.parametrize("value", [1e4, -3e38, 1e300])
def test_speed_that_no_car_drives_is_rejected(value: float) -> None:
    fields = stamp_fields(STEADY_NS[:3]) | {
        "longitudinal_velocity": [1.0, value, 2.0],
        "heading_rate": [0.1, 0.1, value],
    }
    signal, quality = build_signal(Role.EGO_SPEED, columns_of("autoware_vehicle_msgs/msg/VelocityReport", fields))
    assert isinstance(signal, SpeedSignal)
    np.testing.assert_array_equal(signal.speed_mps, [1.0, 2.0])
    assert quality.rejected == {OUT_OF_LIMIT: 1}
    if abs(value) > 1e4:
        assert quality.repaired == {"yaw rate out of range, left out": 1}
        assert np.isnan(signal.yaw_rate_radps[1])


@pytest.mark.parametrize("value", [1e30, -1e308])
def test_inertial_value_out_of_range_is_rejected_without_a_word_of_numpy(value: float) -> None:
    fields = stamp_fields(STEADY_NS[:3]) | {
        f"{name}.{axis}": [0.5, value if (name, axis) == ("linear_acceleration", "x") and k else 0.5, 0.5]
        for name in ("linear_acceleration", "angular_velocity")
        for k, axis in enumerate("zyx")
    }
    signal, quality = build_signal(Role.IMU, columns_of("sensor_msgs/msg/Imu", fields))
    assert isinstance(signal, ImuSignal)
    assert (quality.used, quality.rejected) == (2, {OUT_OF_LIMIT: 1})


@pytest.mark.filterwarnings("error")
def test_quaternion_that_overflows_is_no_orientation() -> None:
    fields = stamp_fields(STEADY_NS[:2]) | {f"quaternion.{axis}": [1e308, 0.5] for axis in "xyzw"}
    signal, quality = build_signal(Role.EGO_HEADING, columns_of("geometry_msgs/msg/QuaternionStamped", fields))
    assert isinstance(signal, HeadingSignal)
    assert (quality.used, quality.rejected) == (1, {"orientation not given": 1})
