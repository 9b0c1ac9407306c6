"""V2X messages as a whole: each dress of the same message gives the same signal; own messages; odd ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cwcli.errors import MissingSignalError
from cwcli.signals.build import require_usable_rows
from cwcli.signals.canonical import HeadingSignal, PositionSignal, RemoteSignal, SpeedSignal
from cwcli.signals.columns import Columns
from cwcli.signals.etsi import VAM_PATHS
from cwcli.signals.j2735 import STANDARD_JSON_PATHS_BY_QUANTITY
from cwcli.signals.quality import Quality
from cwcli.signals.role import Role
from tests.unit.signals.signal_columns import T0_NS, columns_of
from tests.unit.signals.signal_columns import build_known_signal as build_signal
from tests.unit.signals.v2x_messages import (
    CAM,
    LOG_NS,
    MS,
    RAW_BSM,
    cam,
    carma_bsm,
    json_bsm,
    ode_bsm,
    packed_bsm,
    packed_cam,
    radio,
    ros_bsm,
    ros_paths,
)


def remote(columns: Columns, **options: Any) -> tuple[RemoteSignal, Quality]:
    signal, quality = build_signal(Role.REMOTE, columns, **options)
    assert isinstance(signal, RemoteSignal)
    assert quality.read == quality.used + sum(quality.rejected.values()) + sum(quality.set_aside.values())
    return signal, quality


BSMS = {
    "json": json_bsm(),
    "json-in-a-message-frame": json_bsm(prefix="MessageFrame.value.BasicSafetyMessage.", schema="MessageFrame"),
    "json-in-a-new-ode-record": json_bsm(prefix="payload.data.value.BasicSafetyMessage.", schema="OdeMessageFrameData"),
    "json-with-numbers-as-strings": json_bsm({n: str(v) for n, v in RAW_BSM.items() if n != "transmission"}),
    "ode": ode_bsm(),
    "ros": ros_bsm(),
    "carma": carma_bsm(),
}


RADIO = {
    "bsm-off-the-radio": radio("carma_driver_msgs/ByteArray", "content", packed_bsm()),
    "cam-off-the-radio": radio("udp_msgs/UdpPacket", "data", b"\x07\xd1\x00\x00" + packed_cam()),
}
CAMS = {"cam": cam(), "cam-ts": cam(is_ts=True)}


@pytest.mark.parametrize("columns", [*BSMS.values(), *CAMS.values(), *RADIO.values()], ids=[*BSMS, *CAMS, *RADIO])
def test_every_dress_of_the_same_message_gives_the_same_car(columns: Columns) -> None:
    signal, quality = remote(columns)
    assert not quality.rejected and not quality.repaired
    assert signal.station.values == (
        ("1001",) if "cam" in columns.schema_name or "udp" in columns.schema_name else ("2a3c603c",)
    )
    assert signal.stamp_ns.tolist() == [T0_NS + 80 * MS]
    assert signal.log_time_ns.tolist() == [T0_NS + 100 * MS]
    expected = {
        "latitude_deg": 40.8646987,
        "longitude_deg": -77.8304602,
        "altitude_m": 335.6,
        "speed_mps": 10.0,
        "heading_rad": np.pi,
        "accel_mps2": -3.5,
        "lateral_accel_mps2": 1.0,
        "yaw_rate_radps": np.deg2rad(10.0),
        "length_m": 4.5,
        "width_m": 1.8,
    }
    assert {name: getattr(signal, name)[0] for name in expected} == pytest.approx(expected, abs=1e-9)
    np.testing.assert_allclose(signal.position_covariance_m2, [[4.0, 0.0, 1.0]], atol=0.01)


def test_a_vam_has_a_yaw_rate_only_where_it_says_so() -> None:
    paths = ros_paths(VAM_PATHS)
    values = {name: value for name, value in CAM.items() if name in paths}
    for is_there in (True, False):
        fields = {paths[name]: [value] for name, value in values.items()} | {paths["has_yaw_rate_degps"]: [is_there]}
        signal, _ = remote(columns_of("etsi_its_vam_ts_msgs/msg/VAM", fields, log_time_ns=LOG_NS))
        assert signal.station.values == ("1001",)
        assert np.isfinite(signal.yaw_rate_radps[0]) == is_there
        assert np.isnan(signal.length_m[0])


def test_cam_confidences_are_95_percent_bounds() -> None:
    signal, _ = remote(cam())
    assert signal.speed_sigma_mps[0] == pytest.approx(0.5, abs=1e-4)  # 0.98 / 1.96
    assert signal.heading_sigma_rad[0] == pytest.approx(np.deg2rad(1.0) / 1.96, rel=1e-4)
    assert signal.accel_sigma_mps2[0] == pytest.approx(0.2 / 1.96, rel=1e-4)
    assert signal.yaw_rate_sigma_radps[0] == pytest.approx(np.deg2rad(1.0) / 1.96, rel=1e-4)
    np.testing.assert_allclose(
        signal.position_covariance_m2, [[4.9**2 / 5.9915, 0.0, 2.45**2 / 5.9915]], rtol=1e-4, atol=1e-9
    )


UNAVAILABLE_BSM = {
    "altitude_m": -4096,
    "semi_major_m": 255,
    "semi_minor_m": 255,
    "semi_major_compass_deg": 65_535,
    "transmission": "unavailable",
    "speed_mps": 8191,
    "heading_compass_deg": 28_800,
    "accel_mps2": 2001,
    "lateral_accel_mps2": 2001,
    "yaw_rate_degps": 0,
    "width_m": 0,
    "length_m": 0,
}
UNAVAILABLE_CAM = {
    "altitude_m": 800_001,
    "semi_major_m": 4095,
    "semi_minor_m": 4095,
    "semi_major_compass_deg": 3601,
    "heading_compass_deg": 3601,
    "heading_95_deg": 127,
    "speed_mps": 16_383,
    "speed_95_mps": 127,
    "drive_direction": 2,
    "accel_mps2": 161,
    "accel_95_mps2": 102,
    "lateral_accel_mps2": 161,
    "yaw_rate_degps": 32_767,
    "yaw_rate_confidence": 8,
    "length_m": 1023,
    "width_m": 62,
}
NULL_ODE = dict.fromkeys(UNAVAILABLE_BSM, None) | {"yaw_rate_degps": 0.0, "width_m": 0, "length_m": 0}
QUANTITIES = (
    "altitude_m",
    "speed_mps",
    "heading_rad",
    "accel_mps2",
    "lateral_accel_mps2",
    "yaw_rate_radps",
    "length_m",
    "width_m",
    "speed_sigma_mps",
    "heading_sigma_rad",
    "accel_sigma_mps2",
    "yaw_rate_sigma_radps",
)


@pytest.mark.parametrize(
    "columns",
    [
        pytest.param(json_bsm(UNAVAILABLE_BSM), id="json"),
        pytest.param(ros_bsm(UNAVAILABLE_BSM | {"transmission": 7}), id="ros"),
        pytest.param(ode_bsm(NULL_ODE), id="ode"),
        pytest.param(carma_bsm(absent=tuple(UNAVAILABLE_BSM)), id="carma"),
        pytest.param(cam(UNAVAILABLE_CAM), id="cam"),
        pytest.param(cam(UNAVAILABLE_CAM, is_ts=True), id="cam-ts"),
    ],
)
def test_message_with_a_position_only_is_nan_elsewhere_and_no_fault(columns: Columns) -> None:
    signal, quality = remote(columns)
    assert (quality.used, quality.rejected, quality.repaired) == (1, {}, {})
    for name in QUANTITIES:
        assert np.isnan(getattr(signal, name)).all(), name
    assert np.isnan(signal.position_covariance_m2).all()
    assert signal.latitude_deg[0] == pytest.approx(40.8646987)


@pytest.mark.parametrize(
    "columns",
    [
        pytest.param(json_bsm({"latitude_deg": 900_000_001}), id="bsm-unavailable"),
        pytest.param(json_bsm({"longitude_deg": 1_800_000_001}), id="bsm-longitude-unavailable"),
        pytest.param(json_bsm({"latitude_deg": 910_000_000}), id="bsm-latitude-91"),
        pytest.param(ode_bsm({"latitude_deg": 91.0}), id="ode-latitude-91"),
        pytest.param(ode_bsm({"latitude_deg": None}), id="ode-null"),
        pytest.param(carma_bsm(absent=("latitude_deg",)), id="carma-absent"),
        pytest.param(cam({"latitude_deg": 900_000_001}), id="cam-unavailable"),
        pytest.param(cam({"latitude_deg": 0, "longitude_deg": 0}), id="cam-zero-zero"),
        pytest.param(cam({"semi_major_m": 4094}), id="cam-position-not-to-be-trusted"),
    ],
)
def test_message_without_a_position_is_rejected_and_counted(columns: Columns) -> None:
    signal, quality = remote(columns)
    assert len(signal.stamp_ns) == 0
    assert sum(quality.rejected.values()) == 1


@pytest.mark.parametrize(
    "columns",
    [
        pytest.param(json_bsm({"transmission": "reverseGears"}), id="json-name"),
        pytest.param(json_bsm({"transmission": 3}), id="json-number"),
        pytest.param(ode_bsm({"transmission": "REVERSEGEARS"}), id="ode"),
        pytest.param(ros_bsm({"transmission": 3}), id="ros"),
        pytest.param(carma_bsm({"transmission": 3}), id="carma"),
    ],
)
def test_bsm_in_reverse_keeps_the_heading_of_its_front(columns: Columns) -> None:
    signal, _ = remote(columns)
    assert signal.speed_mps[0] == pytest.approx(-10.0)
    assert signal.heading_rad[0] == pytest.approx(np.pi)


def test_bsm_in_reverse_as_an_object() -> None:
    columns = json_bsm()
    fields = {
        path: field for path, field in columns.fields.items() if path != STANDARD_JSON_PATHS_BY_QUANTITY["transmission"]
    }
    as_object = {"coreData.transmission.reverseGears": ["x"]}
    signal, _ = remote(
        columns_of("BasicSafetyMessage", fields | as_object, message_encoding="json", log_time_ns=LOG_NS)
    )
    assert signal.speed_mps[0] == pytest.approx(-10.0)


@pytest.mark.parametrize("is_ts", [False, True])
def test_cam_driving_backward_turns_the_heading_of_the_velocity_round(is_ts: bool) -> None:
    signal, _ = remote(cam({"drive_direction": 1}, is_ts=is_ts))
    assert signal.speed_mps[0] == pytest.approx(-10.0)
    assert signal.heading_rad[0] == pytest.approx(0.0, abs=1e-12)
    velocity = signal.speed_mps[0] * np.exp(1j * signal.heading_rad[0])
    assert velocity == pytest.approx(-10.0)  # still due west


@pytest.mark.parametrize(
    ("changes", "quantity"),
    [
        ({"speed_95_mps": 126}, "speed_mps"),
        ({"heading_95_deg": 126}, "heading_rad"),
        ({"accel_95_mps2": 101}, "accel_mps2"),
        ({"yaw_rate_confidence": 7}, "yaw_rate_radps"),
        ({"has_lateral_accel_mps2": 0}, "lateral_accel_mps2"),
    ],
)
def test_cam_value_that_is_not_to_be_trusted_is_left_out(changes: dict[str, int], quantity: str) -> None:
    signal, _ = remote(cam(changes))
    assert np.isnan(getattr(signal, quantity)).all()
    assert np.isfinite(getattr(remote(cam())[0], quantity)).all()


@pytest.mark.parametrize("changes", [{"station_type": 15}, {"container": 1}])
def test_cam_of_a_roadside_unit_is_set_aside(changes: dict[str, int]) -> None:
    _, quality = remote(cam(changes))
    assert quality.set_aside == {"sent by a roadside unit": 1}
    assert not quality.rejected and not quality.repaired


def test_bsm_code_outside_its_range_is_left_out_and_counted() -> None:
    signal, quality = remote(json_bsm({"speed_mps": 9000}))
    assert np.isnan(signal.speed_mps[0])
    assert quality.repaired == {"Speed outside its range, left out": 1}


@pytest.mark.parametrize("dsecond_ms", [65_535, 40_000])
def test_bsm_whose_clock_can_not_be_used_takes_the_log_time(dsecond_ms: int) -> None:
    signal, quality = remote(json_bsm({"dsecond_ms": dsecond_ms}))
    assert signal.stamp_ns.tolist() == LOG_NS.tolist()
    assert sum(quality.repaired.values()) == 1


def stream(stations: list[str], latitudes: list[int], dsecond_ms: list[int], **more: list[Any]) -> Columns:
    """Several raw JSON messages, logged 20 ms after their secMark."""
    n_rows = len(stations)
    values: dict[str, list[Any]] = {name: [value] * n_rows for name, value in RAW_BSM.items()}
    values |= {"station": stations, "latitude_deg": latitudes, "dsecond_ms": dsecond_ms, **more}
    log_ns = T0_NS + (np.array(dsecond_ms) - 10_000 + 20) * MS
    fields = {STANDARD_JSON_PATHS_BY_QUANTITY[name]: value for name, value in values.items()}
    return columns_of("BasicSafetyMessage", fields, topic="/v2x", message_encoding="json", log_time_ns=log_ns)


def test_stations_are_kept_apart() -> None:
    columns = stream(["a", "b", "a", "b"], [1, 2, 3, 4], [10_000, 10_000, 10_100, 10_100])
    signal, quality = remote(columns)
    assert not quality.rejected and not quality.repaired
    assert [signal.station.values[code] for code in signal.station.codes] == ["a", "b", "a", "b"]


def test_same_message_received_twice_counts_once() -> None:
    signal, quality = remote(stream(["a", "a", "b", "a"], [1, 1, 1, 2], [10_000, 10_000, 10_000, 10_100]))
    assert quality.rejected == {"duplicate message": 1}
    assert len(signal.stamp_ns) == 3


def test_repeated_position_under_a_new_time_is_kept_and_noted() -> None:
    signal, quality = remote(stream(["a", "a", "a"], [1, 1, 2], [10_000, 10_100, 10_200]))
    assert len(signal.stamp_ns) == 3
    assert "1 messages repeat their station's position under a new time" in quality.notes


def test_yaw_rate_of_a_station_that_only_sends_zero_is_not_measured() -> None:
    columns = stream(
        ["a", "b", "a", "b"], [1, 2, 3, 4], [10_000, 10_000, 10_100, 10_100], yaw_rate_degps=[0, 0, 0, 500]
    )
    signal, _ = remote(columns)
    np.testing.assert_allclose(signal.yaw_rate_radps, [np.nan, 0.0, np.nan, -np.deg2rad(5.0)])


def test_ego_station_leaves_the_remote_vehicles_and_becomes_the_ego() -> None:
    columns = stream(["2a3c600d", "b", "2a3c600d"], [10, 20, 30], [10_000, 10_000, 10_100])
    signal, quality = remote(columns, ego_station="2A3C600D")
    assert signal.station.values == ("b",)
    assert quality.set_aside == {"sent by the ego station": 2}
    position, quality = build_signal(Role.EGO_POSITION, columns, ego_station="2A3C600D")
    assert isinstance(position, PositionSignal)
    np.testing.assert_allclose(position.latitude_deg, [1e-6, 3e-6])
    assert quality.set_aside == {"sent by another station": 1}


def test_ode_record_says_whose_message_it_is() -> None:
    own, received = ode_bsm(source="EV"), ode_bsm(source="RV")
    assert len(remote(own)[0].stamp_ns) == 0
    assert len(remote(received)[0].stamp_ns) == 1
    position, _ = build_signal(Role.EGO_POSITION, own)
    speed, _ = build_signal(Role.EGO_SPEED, own)
    heading, _ = build_signal(Role.EGO_HEADING, own)
    assert isinstance(position, PositionSignal)
    assert isinstance(speed, SpeedSignal)
    assert isinstance(heading, HeadingSignal)
    assert position.longitude_deg[0] == pytest.approx(-77.8304602)
    assert speed.speed_mps[0] == pytest.approx(10.0)
    assert heading.heading_rad[0] == pytest.approx(np.pi)
    _, quality = build_signal(Role.EGO_POSITION, received)
    with pytest.raises(MissingSignalError, match="sent by another station"):
        require_usable_rows(quality)


def test_faults_of_other_stations_are_not_counted_for_the_ego() -> None:
    columns = stream(["a", "b"], [1, 900_000_001], [10_000, 10_000], speed_mps=[500, 9000])
    _, quality = build_signal(Role.EGO_POSITION, columns, ego_station="a")
    assert not quality.rejected and not quality.repaired


@pytest.mark.parametrize("make", [ode_bsm, carma_bsm])
def test_values_in_units_are_held_to_the_ranges_of_their_codes(make: Any) -> None:
    """The largest speed is 8190 steps of 0.02 m/s; 8191 says that there is none."""
    for told, kept, n_counted in ((163.8, 163.8, 0), (163.82, np.nan, 0), (163.9, np.nan, 1), (1e300, np.nan, 1)):
        signal, quality = build_signal(Role.REMOTE, make({"speed_mps": told}))
        np.testing.assert_allclose(signal.speed_mps, [kept])
        assert quality.repaired.get("Speed outside its range, left out", 0) == n_counted
    signal, quality = build_signal(Role.REMOTE, make({"semi_major_m": 1e300}))
    assert np.isnan(signal.position_covariance_m2).all()
    assert quality.repaired["SemiMajorAxisAccuracy outside its range, left out"] == 1
