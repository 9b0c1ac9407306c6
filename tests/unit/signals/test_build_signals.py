"""Builders of positions, velocities and speeds, and what holds for all builders."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cwcli.errors import DataError, MissingSignalError
from cwcli.signals.build import build_signal, require_usable_rows
from cwcli.signals.builders.position import (
    NO_FIX_REASON,
    POSITION_NOT_A_NUMBER_REASON,
    POSITION_OUT_OF_RANGE_REASON,
    ZERO_POSITION_REASON,
)
from cwcli.signals.canonical import (
    PositionSignal,
    SpeedSignal,
    VelocitySignal,
)
from cwcli.signals.clocks import INVALID_LOG_TIME_REASON
from cwcli.signals.columns import Columns
from cwcli.signals.covariances import UNUSABLE_COVARIANCE_REASON
from cwcli.signals.inputs import find_input_for_role
from cwcli.signals.role import Role
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
    signal, quality = build_signal(Role.EGO_POSITION, fix_columns([51.0, 51.1], [13.0, 13.1]))
    assert isinstance(signal, PositionSignal)
    assert (signal.source, quality.used) == ("/gps/fix", 2)
    np.testing.assert_array_equal(signal.stamp_ns, STEADY_NS[:2])
    np.testing.assert_array_equal(signal.latitude_deg, [51.0, 51.1])
    np.testing.assert_array_equal(signal.covariance_m2, [[4.0, 1.0, 9.0]] * 2)


@pytest.mark.parametrize(
    ("latitude", "longitude", "reason"),
    [
        pytest.param(NAN, 13.0, POSITION_NOT_A_NUMBER_REASON, id="latitude-nan"),
        pytest.param(51.0, INF, POSITION_NOT_A_NUMBER_REASON, id="longitude-infinite"),
        pytest.param(91.0, 13.0, POSITION_OUT_OF_RANGE_REASON, id="latitude-91"),
        pytest.param(-90.1, 13.0, POSITION_OUT_OF_RANGE_REASON, id="latitude-below-the-pole"),
        pytest.param(51.0, 181.0, POSITION_OUT_OF_RANGE_REASON, id="longitude-181"),
        pytest.param(0.0, 0.0, ZERO_POSITION_REASON, id="zero-zero"),
    ],
)
def test_fix_that_is_no_place_is_rejected_and_counted(latitude: float, longitude: float, reason: str) -> None:
    signal, quality = build_signal(Role.EGO_POSITION, fix_columns([51.0, latitude, 51.1], [13.0, longitude, 13.1]))
    assert isinstance(signal, PositionSignal)
    assert quality.rejected == {reason: 1}
    assert (quality.read, quality.used) == (3, 2)
    assert quality.first_fault_ns == {reason: int(STEADY_NS[1])}
    np.testing.assert_array_equal(signal.stamp_ns, STEADY_NS[[0, 2]])


@pytest.mark.parametrize("status", [-1, -2])
def test_fix_without_a_fix_is_rejected(status: int) -> None:
    columns = fix_columns([51.0, 51.1], [13.0, 13.1], **{"status.status": np.array([0, status], dtype=np.int8)})
    _, quality = build_signal(Role.EGO_POSITION, columns)
    assert quality.rejected == {NO_FIX_REASON: 1}


def test_fix_on_the_equator_or_the_meridian_is_a_place() -> None:
    _, quality = build_signal(Role.EGO_POSITION, fix_columns([0.0, 51.5], [32.0, 0.0]))
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
    signal, quality = build_signal(Role.EGO_POSITION, columns)
    assert isinstance(signal, PositionSignal)
    assert np.isnan(signal.covariance_m2).all()
    assert quality.repaired == ({UNUSABLE_COVARIANCE_REASON: n_repaired} if n_repaired else {})


def test_fix_whose_header_was_never_filled_takes_the_log_time() -> None:
    columns = fix_columns([51.0, 51.1], [13.0, 13.1], **stamp_fields(np.zeros(2)))
    signal, quality = build_signal(Role.EGO_POSITION, columns)
    assert isinstance(signal, PositionSignal)
    np.testing.assert_array_equal(signal.stamp_ns, columns.log_time_ns)
    assert quality.repaired == {"no stamp, log time used": 2}


def test_fix_counts_undecodable_messages() -> None:
    fields = {"latitude": [51.0], "longitude": [13.0]}
    _, quality = build_signal(Role.EGO_POSITION, columns_of("sensor_msgs/NavSatFix", fields, n_undecodable=3))
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
    signal, _ = build_signal(Role.EGO_POSITION, columns_of("foxglove.LocationFix", fields, message_encoding="json"))
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
    signal, quality = build_signal(Role.EGO_VELOCITY, twist_columns(frame))
    assert isinstance(signal, VelocitySignal)
    np.testing.assert_array_equal(signal.east_mps, [3.0] * 3)
    np.testing.assert_array_equal(signal.north_mps, [4.0] * 3)
    np.testing.assert_array_equal(signal.covariance_m2ps2, [[0.25, 0.05, 0.36]] * 3)
    assert quality.notes == []


@pytest.mark.parametrize("schema", ["geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/TwistWithCovarianceStamped"])
def test_twist_in_body_axes_is_a_speed(schema: str) -> None:
    signal, _ = build_signal(Role.EGO_SPEED, twist_columns("base_link", schema))
    assert isinstance(signal, SpeedSignal)
    np.testing.assert_array_equal(signal.speed_mps, [3.0] * 3)
    np.testing.assert_array_equal(signal.yaw_rate_radps, [0.1, 0.0, -0.1])
    expected = [0.25, 0.01] if "Covariance" in schema else [NAN, NAN]
    np.testing.assert_array_equal([signal.speed_variance_m2ps2[0], signal.yaw_rate_variance_rad2ps2[0]], expected)


def test_twist_frame_id_has_the_last_word_over_the_role() -> None:
    assert isinstance(build_signal(Role.EGO_VELOCITY, twist_columns("base_link"))[0], SpeedSignal)
    assert isinstance(build_signal(Role.EGO_SPEED, twist_columns("map"))[0], VelocitySignal)


def test_twist_named_by_the_user_follows_the_role_with_a_note() -> None:
    velocity, quality = build_signal(Role.EGO_VELOCITY, twist_columns("base_link"), is_override=True)
    assert isinstance(velocity, VelocitySignal)
    assert "base_link" in quality.notes[0]
    speed, quality = build_signal(Role.EGO_SPEED, twist_columns("map"), is_override=True)
    assert isinstance(speed, SpeedSignal)
    np.testing.assert_allclose(speed.speed_mps, [5.0] * 3)
    assert "map axes" in quality.notes[0]


def test_twist_with_a_value_that_is_no_number_is_rejected() -> None:
    columns = twist_columns("map")
    columns.fields["twist.twist.linear.x"][1] = NAN  # type: ignore[index]
    _, quality = build_signal(Role.EGO_VELOCITY, columns)
    assert quality.rejected == {"value not a number": 1}


def test_twist_whose_yaw_rate_is_never_filled_has_none() -> None:
    columns = twist_columns("base_link")
    columns.fields["twist.twist.angular.z"][:] = 0.0  # type: ignore[index]
    signal, quality = build_signal(Role.EGO_SPEED, columns)
    assert isinstance(signal, SpeedSignal)
    assert np.isnan(signal.yaw_rate_radps).all()
    assert quality.notes == ["yaw rate is exactly 0 in every message, taken as not measured"]


def test_velocity_report_is_a_speed_with_yaw_rate() -> None:
    fields = stamp_fields(STEADY_NS[:2]) | {"longitudinal_velocity": [-1.5, -1.0], "heading_rate": [0.2, 0.1]}
    signal, _ = build_signal(Role.EGO_SPEED, columns_of("autoware_vehicle_msgs/msg/VelocityReport", fields))
    assert isinstance(signal, SpeedSignal)
    np.testing.assert_array_equal(signal.speed_mps, [-1.5, -1.0])
    np.testing.assert_array_equal(signal.yaw_rate_radps, [0.2, 0.1])


def test_require_rows_tells_bad_data_from_none() -> None:
    _, quality = build_signal(Role.EGO_POSITION, fix_columns([91.0, NAN], [13.0, 13.0]))
    with pytest.raises(DataError, match="none of its 2 messages can be used"):
        require_usable_rows(quality, where="drive.mcap")
    _, quality = build_signal(Role.EGO_POSITION, fix_columns([], []))
    with pytest.raises(MissingSignalError, match="the channel is empty"):
        require_usable_rows(quality)


def test_a_row_names_the_leaves_of_each_encoding() -> None:
    fix = find_input_for_role(Role.EGO_POSITION, "foxglove.LocationFix")
    assert fix is not None
    assert "timestamp.seconds" in fix.fields["protobuf"]
    assert "timestamp.nsec" in fix.fields["json"]
    camera = find_input_for_role(Role.CAMERA, "foxglove.CompressedImage")
    assert camera is not None and not camera.fields
    assert find_input_for_role(Role.IMU, "sensor_msgs/msg/NavSatFix") is None


def test_build_refuses_a_role_that_the_schema_can_not_fill() -> None:
    with pytest.raises(ValueError, match="no builder"):
        build_signal(Role.IMU, fix_columns([51.0], [13.0]))


def test_altitude_out_of_range_is_left_out() -> None:
    signal, quality = build_signal(
        Role.EGO_POSITION, fix_columns([51.0, 51.1], [13.0, 13.1], altitude=np.array([100.0, 1e300]))
    )
    assert isinstance(signal, PositionSignal)
    np.testing.assert_array_equal(signal.altitude_m, [100.0, NAN])
    assert quality.repaired == {"altitude out of range, left out": 1}


def test_log_time_beyond_int64_is_rejected() -> None:
    columns = fix_columns([51.0, 51.1, 51.2], [13.0, 13.1, 13.2])
    columns.log_time_ns[1] = -(1 << 63) + 5
    _, quality = build_signal(Role.EGO_POSITION, columns)
    assert (quality.used, quality.rejected) == (2, {INVALID_LOG_TIME_REASON: 1})
