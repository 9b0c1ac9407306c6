"""Builders of positions, velocities, speeds, headings, inertial measurements, poses and calibrations."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cwcli.errors import DataError, MissingSignalError
from cwcli.signals.build import build, fields_for, require_rows
from cwcli.signals.build_position import NO_FIX, NOT_A_NUMBER, NULL_ISLAND, OUT_OF_RANGE
from cwcli.signals.canonical import (
    CameraInfoSignal,
    HeadingSignal,
    ImuSignal,
    PoseSignal,
    PositionSignal,
    SpeedSignal,
    VelocitySignal,
)
from cwcli.signals.clocks import LOG_TIME_OUT
from cwcli.signals.codec import Role
from cwcli.signals.columns import Columns, Ragged
from cwcli.signals.covariances import UNUSABLE_COVARIANCE
from cwcli.signals.limits import OUT_OF_RANGE as OUT_OF_LIMIT
from tests.unit.signals.signal_columns import T0_NS, columns_of, stamp_fields

NAN, INF = float("nan"), float("inf")
MS = 1_000_000
STEADY_NS = T0_NS + 100 * MS * np.arange(8)
COVARIANCE = [4.0, 1.0, 0.0, 1.0, 9.0, 0.0, 0.0, 0.0, 16.0]


def fix_columns(latitude: Any, longitude: Any, **more: Any) -> Columns:
    fields = stamp_fields(STEADY_NS[: len(latitude)]) | {
        "latitude": np.array(latitude, dtype=float),
        "longitude": np.array(longitude, dtype=float),
        "altitude": np.full(len(latitude), 100.0),
        "position_covariance": np.tile(COVARIANCE, (len(latitude), 1)),
        "position_covariance_type": np.full(len(latitude), 2),
        "status.status": np.zeros(len(latitude), dtype=np.int8),
    }
    return columns_of("sensor_msgs/msg/NavSatFix", fields | more, topic="/gps/fix")


def test_fix_gives_place_time_and_east_north_covariance() -> None:
    signal, quality = build(Role.EGO_POSITION, fix_columns([51.0, 51.1], [13.0, 13.1]))
    assert isinstance(signal, PositionSignal)
    assert (signal.source, quality.used) == ("/gps/fix", 2)
    np.testing.assert_array_equal(signal.stamp_ns, STEADY_NS[:2])
    np.testing.assert_array_equal(signal.latitude_deg, [51.0, 51.1])
    np.testing.assert_array_equal(signal.covariance_m2, [[4.0, 1.0, 9.0]] * 2)


@pytest.mark.parametrize(
    ("latitude", "longitude", "reason"),
    [
        pytest.param(NAN, 13.0, NOT_A_NUMBER, id="latitude-nan"),
        pytest.param(51.0, INF, NOT_A_NUMBER, id="longitude-infinite"),
        pytest.param(91.0, 13.0, OUT_OF_RANGE, id="latitude-91"),
        pytest.param(-90.1, 13.0, OUT_OF_RANGE, id="latitude-below-the-pole"),
        pytest.param(51.0, 181.0, OUT_OF_RANGE, id="longitude-181"),
        pytest.param(0.0, 0.0, NULL_ISLAND, id="zero-zero"),
    ],
)
def test_fix_that_is_no_place_is_rejected_and_counted(latitude: float, longitude: float, reason: str) -> None:
    signal, quality = build(Role.EGO_POSITION, fix_columns([51.0, latitude, 51.1], [13.0, longitude, 13.1]))
    assert isinstance(signal, PositionSignal)
    assert quality.rejected == {reason: 1}
    assert (quality.read, quality.used) == (3, 2)
    assert quality.first_fault_ns == {reason: int(STEADY_NS[1])}
    np.testing.assert_array_equal(signal.stamp_ns, STEADY_NS[[0, 2]])


@pytest.mark.parametrize("status", [-1, -2])
def test_fix_without_a_fix_is_rejected(status: int) -> None:
    columns = fix_columns([51.0, 51.1], [13.0, 13.1], **{"status.status": np.array([0, status], dtype=np.int8)})
    _, quality = build(Role.EGO_POSITION, columns)
    assert quality.rejected == {NO_FIX: 1}


def test_fix_on_the_equator_or_the_meridian_is_a_place() -> None:
    _, quality = build(Role.EGO_POSITION, fix_columns([0.0, 51.5], [32.0, 0.0]))
    assert quality.used == 2


@pytest.mark.parametrize(
    ("covariance", "kind", "n_repaired"),
    [
        pytest.param([0.0] * 9, 0, 0, id="unknown"),
        pytest.param(COVARIANCE, 0, 0, id="filled-but-said-to-be-unknown"),
        pytest.param([0.0] * 9, 2, 0, id="all-zero"),
        pytest.param([-1.0] + [0.0] * 8, 2, 0, id="minus-one"),
        pytest.param([4.0, 7.0, 0.0, 7.0, 9.0, 0.0, 0.0, 0.0, 1.0], 3, 2, id="not-positive-definite"),
        pytest.param([INF, 0.0, 0.0, 0.0, 9.0, 0.0, 0.0, 0.0, 1.0], 3, 2, id="infinite"),
        pytest.param([-4.0, 0.0, 0.0, 0.0, 9.0, 0.0, 0.0, 0.0, 1.0], 3, 2, id="negative"),
    ],
)
def test_fix_covariance_that_says_nothing_is_nan(covariance: list[float], kind: int, n_repaired: int) -> None:
    columns = fix_columns(
        [51.0, 51.1],
        [13.0, 13.1],
        position_covariance=np.tile(covariance, (2, 1)),
        position_covariance_type=np.full(2, kind),
    )
    signal, quality = build(Role.EGO_POSITION, columns)
    assert isinstance(signal, PositionSignal)
    assert np.isnan(signal.covariance_m2).all()
    assert quality.repaired == ({UNUSABLE_COVARIANCE: n_repaired} if n_repaired else {})


def test_fix_whose_header_was_never_filled_takes_the_log_time() -> None:
    columns = fix_columns([51.0, 51.1], [13.0, 13.1], **stamp_fields(np.zeros(2)))
    signal, quality = build(Role.EGO_POSITION, columns)
    np.testing.assert_array_equal(signal.stamp_ns, columns.log_time_ns)  # type: ignore[union-attr]
    assert quality.repaired == {"no stamp, log time used": 2}


def test_fix_counts_undecodable_messages() -> None:
    fields = {"latitude": [51.0], "longitude": [13.0]}
    _, quality = build(Role.EGO_POSITION, columns_of("sensor_msgs/NavSatFix", fields, n_undecodable=3))
    assert (quality.read, quality.used, quality.rejected) == (4, 1, {"undecodable": 3})


@pytest.mark.parametrize(
    "stamp",
    [
        pytest.param({"timestamp.seconds": [1_570_522_030], "timestamp.nanos": [5]}, id="protobuf"),
        pytest.param({"timestamp.sec": [1_570_522_030], "timestamp.nsec": [5]}, id="json"),
        pytest.param({"timestamp": ["2019-10-08T08:07:10.000000005Z"]}, id="protobuf-as-json"),
        pytest.param({"header.stamp.secs": [1_570_522_030], "header.stamp.nsecs": [5]}, id="ros1-json"),
    ],
)
def test_fix_reads_every_spelling_of_a_stamp(stamp: dict[str, Any]) -> None:
    fields = {"latitude": [51.0], "longitude": [13.0], "altitude": [1.0]} | stamp
    signal, _ = build(Role.EGO_POSITION, columns_of("foxglove.LocationFix", fields, message_encoding="json"))
    assert isinstance(signal, PositionSignal)
    assert signal.stamp_ns.tolist() == [T0_NS + 5]


def twist_columns(frame_id: str, schema: str = "geometry_msgs/msg/TwistWithCovarianceStamped") -> Columns:
    covariance = np.zeros((3, 36))
    covariance[:, 0], covariance[:, 1], covariance[:, 7], covariance[:, 35] = 0.25, 0.05, 0.36, 0.01
    base = "twist.twist" if "Covariance" in schema else "twist"
    fields = stamp_fields(STEADY_NS[:3]) | {
        "header.frame_id": [frame_id] * 3,
        f"{base}.linear.x": np.array([3.0, 3.0, 3.0]),
        f"{base}.linear.y": np.array([4.0, 4.0, 4.0]),
        f"{base}.angular.z": np.array([0.1, 0.0, -0.1]),
    }
    if base == "twist.twist":
        fields["twist.covariance"] = covariance
    return columns_of(schema, fields, topic="/gps/vel")


@pytest.mark.parametrize("frame", ["map", "enu", "/map", "gps", ""])
def test_twist_in_map_axes_is_a_velocity(frame: str) -> None:
    signal, quality = build(Role.EGO_VELOCITY, twist_columns(frame))
    assert isinstance(signal, VelocitySignal)
    np.testing.assert_array_equal(signal.east_mps, [3.0] * 3)
    np.testing.assert_array_equal(signal.north_mps, [4.0] * 3)
    np.testing.assert_array_equal(signal.covariance_m2ps2, [[0.25, 0.05, 0.36]] * 3)
    assert quality.notes == []


@pytest.mark.parametrize("schema", ["geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/TwistWithCovarianceStamped"])
def test_twist_in_body_axes_is_a_speed(schema: str) -> None:
    signal, _ = build(Role.EGO_SPEED, twist_columns("base_link", schema))
    assert isinstance(signal, SpeedSignal)
    np.testing.assert_array_equal(signal.speed_mps, [3.0] * 3)
    np.testing.assert_array_equal(signal.yaw_rate_radps, [0.1, 0.0, -0.1])
    expected = [0.25, 0.01] if "Covariance" in schema else [NAN, NAN]
    np.testing.assert_array_equal([signal.speed_variance_m2ps2[0], signal.yaw_rate_variance_rad2ps2[0]], expected)


def test_twist_frame_id_has_the_last_word_over_the_role() -> None:
    assert isinstance(build(Role.EGO_VELOCITY, twist_columns("base_link"))[0], SpeedSignal)
    assert isinstance(build(Role.EGO_SPEED, twist_columns("map"))[0], VelocitySignal)


def test_twist_named_by_the_user_follows_the_role_with_a_note() -> None:
    velocity, quality = build(Role.EGO_VELOCITY, twist_columns("base_link"), is_override=True)
    assert isinstance(velocity, VelocitySignal)
    assert "base_link" in quality.notes[0]
    speed, quality = build(Role.EGO_SPEED, twist_columns("map"), is_override=True)
    assert isinstance(speed, SpeedSignal)
    np.testing.assert_allclose(speed.speed_mps, [5.0] * 3)
    assert "map axes" in quality.notes[0]


def test_twist_with_a_value_that_is_no_number_is_rejected() -> None:
    columns = twist_columns("map")
    columns.fields["twist.twist.linear.x"][1] = NAN  # type: ignore[index]
    _, quality = build(Role.EGO_VELOCITY, columns)
    assert quality.rejected == {"value not a number": 1}


def test_twist_whose_yaw_rate_is_never_filled_has_none() -> None:
    columns = twist_columns("base_link")
    columns.fields["twist.twist.angular.z"][:] = 0.0  # type: ignore[index]
    signal, quality = build(Role.EGO_SPEED, columns)
    assert isinstance(signal, SpeedSignal)
    assert np.isnan(signal.yaw_rate_radps).all()
    assert quality.notes == ["yaw rate is exactly 0 in every message, taken as not measured"]


def test_velocity_report_is_a_speed_with_yaw_rate() -> None:
    fields = stamp_fields(STEADY_NS[:2]) | {"longitudinal_velocity": [-1.5, -1.0], "heading_rate": [0.2, 0.1]}
    signal, _ = build(Role.EGO_SPEED, columns_of("autoware_vehicle_msgs/msg/VelocityReport", fields))
    assert isinstance(signal, SpeedSignal)
    np.testing.assert_array_equal(signal.speed_mps, [-1.5, -1.0])
    np.testing.assert_array_equal(signal.yaw_rate_radps, [0.2, 0.1])


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
    signal, _ = build(Role.EGO_HEADING, columns_of("geometry_msgs/msg/QuaternionStamped", fields))
    assert isinstance(signal, HeadingSignal)
    np.testing.assert_allclose(signal.heading_rad, yaw, atol=1e-12)
    assert np.isnan(signal.variance_rad2).all()


def test_quaternion_of_no_length_and_imu_without_orientation_give_no_heading() -> None:
    fields = stamp_fields(STEADY_NS[:2]) | quaternion("orientation", [0.5, 0.6])
    fields["orientation_covariance"] = np.array([[0.1] * 9, [-1.0] + [0.0] * 8])
    signal, quality = build(Role.EGO_HEADING, columns_of("sensor_msgs/msg/Imu", fields))
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
    signal, quality = build(Role.IMU, imu_columns())
    assert isinstance(signal, ImuSignal)
    np.testing.assert_array_equal(signal.accel_mps2[1], [0.2, 0.0, 9.8])
    np.testing.assert_array_equal(signal.gyro_radps[:, 2], [0.5, 0.4, 0.3])
    np.testing.assert_array_equal(signal.accel_variance[0], [0.01, 0.02, 0.03])
    assert np.isnan(signal.gyro_variance).all()
    assert quality.n_faults == 0


def test_imu_quantity_that_is_not_measured_is_nan_and_no_fault() -> None:
    signal, quality = build(Role.IMU, imu_columns(angular_velocity_covariance=np.tile([-1.0] + [0.0] * 8, (3, 1))))
    assert isinstance(signal, ImuSignal)
    assert np.isnan(signal.gyro_radps).all()
    assert np.isfinite(signal.accel_mps2).all()
    assert quality.n_faults == 0


def test_imu_row_that_is_not_finite_is_rejected() -> None:
    signal, quality = build(Role.IMU, imu_columns(**{"linear_acceleration.x": np.array([0.1, INF, NAN])}))
    assert isinstance(signal, ImuSignal)
    assert len(signal.stamp_ns) == 1
    assert quality.rejected == {"value not a number": 2}


def test_imu_covariances_of_varying_length_are_read_where_they_have_nine() -> None:
    ragged = Ragged(values=np.array([0.5] * 9), offsets=np.array([0, 9, 9, 9]))
    signal, _ = build(Role.IMU, imu_columns(linear_acceleration_covariance=ragged))
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
    signal, _ = build(Role.EGO_POSITION, odometry_columns("base_link", [0.1, 0.2, 0.3]))
    assert isinstance(signal, PoseSignal)
    np.testing.assert_allclose(signal.yaw_rad, [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(signal.speed_mps, [-3.0] * 3)
    assert signal.frame_id == "odom"
    assert np.isnan(signal.covariance_m2).all()


def test_odometry_without_orientation_has_no_yaw_and_an_unsigned_speed() -> None:
    signal, quality = build(Role.TRUTH, odometry_columns("target", np.zeros(3)))
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
    signal, quality = build(Role.TRUTH, columns_of("nav_msgs/msg/Odometry", fields, log_time_ns=stamp_ns))
    assert isinstance(signal, PoseSignal)
    np.testing.assert_allclose(signal.speed_mps, -10.0, atol=1e-9)
    assert len(quality.notes) == (1 if is_map else 0)


def test_odometry_as_speed_source() -> None:
    signal, _ = build(Role.EGO_SPEED, odometry_columns("base_link", [0.1, 0.2, 0.3]))
    assert isinstance(signal, SpeedSignal)
    np.testing.assert_array_equal(signal.speed_mps, [-3.0] * 3)


def test_vehicle_state_is_a_pose() -> None:
    fields = {
        "stamp_ns": STEADY_NS[:2].astype(np.uint64),
        "x_m": [1.0, 2.0],
        "y_m": [3.0, 4.0],
        "speed_mps": [5.0, 5.0],
        "heading_rad": [3.0, 3.5],
        "yaw_rate_radps": [0.1, 0.1],
    }
    signal, _ = build(Role.TRUTH, columns_of("cwcli.v1.VehicleState", fields, message_encoding="protobuf"))
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
    signal, quality = build(Role.CAMERA_INFO, columns_of("sensor_msgs/msg/CameraInfo", fields))
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
    signal, quality = build(Role.CAMERA_INFO, columns_of("foxglove.CameraCalibration", fields))
    assert isinstance(signal, CameraInfoSignal)
    assert signal.intrinsic[0, 0] == 500.0
    assert (quality.read, quality.used, sum(quality.rejected.values())) == (3, 1, 2)


def test_require_rows_tells_bad_data_from_none() -> None:
    _, quality = build(Role.EGO_POSITION, fix_columns([91.0, NAN], [13.0, 13.0]))
    with pytest.raises(DataError, match="none of its 2 messages can be used"):
        require_rows(quality, where="drive.mcap")
    _, quality = build(Role.EGO_POSITION, fix_columns([], []))
    with pytest.raises(MissingSignalError, match="the channel is empty"):
        require_rows(quality)


def test_fields_for_names_the_leaves_of_each_encoding() -> None:
    assert "timestamp.seconds" in fields_for(Role.EGO_POSITION, "foxglove.LocationFix", "protobuf")
    assert "timestamp.nsec" in fields_for(Role.EGO_POSITION, "foxglove.LocationFix", "json")
    assert fields_for(Role.CAMERA, "foxglove.CompressedImage", "protobuf") == ()
    assert fields_for(Role.IMU, "sensor_msgs/msg/NavSatFix", "cdr") == ()


def test_build_refuses_a_role_that_the_schema_can_not_fill() -> None:
    with pytest.raises(ValueError, match="no builder"):
        build(Role.IMU, fix_columns([51.0], [13.0]))


@pytest.mark.parametrize("value", [1e4, -3e38, 1e300])
def test_speed_that_no_car_drives_is_rejected(value: float) -> None:
    fields = stamp_fields(STEADY_NS[:3]) | {
        "longitudinal_velocity": [1.0, value, 2.0],
        "heading_rate": [0.1, 0.1, value],
    }
    signal, quality = build(Role.EGO_SPEED, columns_of("autoware_vehicle_msgs/msg/VelocityReport", fields))
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
    signal, quality = build(Role.IMU, columns_of("sensor_msgs/msg/Imu", fields))
    assert isinstance(signal, ImuSignal)
    assert (quality.used, quality.rejected) == (2, {OUT_OF_LIMIT: 1})


@pytest.mark.filterwarnings("error")
def test_quaternion_that_overflows_is_no_orientation() -> None:
    fields = stamp_fields(STEADY_NS[:2]) | {f"quaternion.{axis}": [1e308, 0.5] for axis in "xyzw"}
    signal, quality = build(Role.EGO_HEADING, columns_of("geometry_msgs/msg/QuaternionStamped", fields))
    assert isinstance(signal, HeadingSignal)
    assert (quality.used, quality.rejected) == (1, {"orientation not given": 1})


def test_altitude_out_of_range_is_left_out() -> None:
    signal, quality = build(
        Role.EGO_POSITION, fix_columns([51.0, 51.1], [13.0, 13.1], altitude=np.array([100.0, 1e300]))
    )
    assert isinstance(signal, PositionSignal)
    np.testing.assert_array_equal(signal.altitude_m, [100.0, NAN])
    assert quality.repaired == {"altitude out of range, left out": 1}


def test_log_time_beyond_int64_is_rejected() -> None:
    columns = fix_columns([51.0, 51.1, 51.2], [13.0, 13.1, 13.2])
    columns.log_time_ns[1] = -(1 << 63) + 5
    _, quality = build(Role.EGO_POSITION, columns)
    assert (quality.used, quality.rejected) == (2, {LOG_TIME_OUT: 1})
