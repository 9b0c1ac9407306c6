"""Simulated logs: read back with the official decoders, equal by seed, and `sample_logs/` made again byte for byte."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory as ProtobufFactory
from mcap_ros2.decoder import DecoderFactory as Ros2Factory
from pyproj import Geod

from cwcli.errors import OutputError
from cwcli.simulate.sensor_log import write_simulated_log
from cwcli.simulation.catalogue import scenario_text
from cwcli.simulation.drive import SimulatedDrive, simulate_scenario
from cwcli.simulation.scenario import load_scenario, parse_scenario
from tests.drive_truth import true_states_of_vehicle

NS = 1_000_000_000
SAMPLE_DIR = Path(__file__).parents[2] / "sample_logs"
ZSTD_OF_SAMPLES = (1, 5, 7)
"""The compressor that packed the committed logs; another one may pack the same records into other bytes."""


def messages(path: Path, topic: str) -> list[tuple[Any, Any]]:
    """(message record, decoded message) of a topic, by the official reader with CRC checks."""
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[Ros2Factory(), ProtobufFactory()])
        if topic.startswith("/v2x"):
            return [(message, json.loads(message.data)) for _, _, message in reader.iter_messages([topic])]
        return [(message, decoded) for _, _, message, decoded in reader.iter_decoded_messages([topic])]


def stamp_ns(header: Any) -> int:
    return int(header.stamp.sec) * NS + int(header.stamp.nanosec)


@pytest.fixture(scope="module")
def crossing(tmp_path_factory: pytest.TempPathFactory) -> tuple[SimulatedDrive, Path]:
    """The intersection with delays of its own on each topic."""
    overrides = (
        "sensors.gnss.delay_s=0.08",
        "v2x.delay_s=0.03",
        "v2x.drop_probability=0.1",
        "host.length_m=4.2",
        "start_time=2021-06-01T10:59:55.5+03:00",
    )
    drive = simulate_scenario(load_scenario("intersection", overrides), 7)
    path = tmp_path_factory.mktemp("logs") / "crossing.mcap"
    write_simulated_log(drive, path)
    return drive, path


def test_fixes_lie_where_the_map_says(crossing: tuple[SimulatedDrive, Path]) -> None:
    drive, path = crossing
    data, fixes = drive.sensors["gnss"], messages(path, "/gps/fix")
    assert len(fixes) == len(data.stamp_ns) == 201
    assert [stamp_ns(fix.header) for _, fix in fixes] == data.stamp_ns.tolist()
    assert [message.log_time for message, _ in fixes] == (data.stamp_ns + 80_000_000).tolist()
    # Geodesics on the ellipsoid are an independent way to the same place (100 m away: far below a millimetre).
    azimuth, _, distance = Geod(ellps="WGS84").inv(
        np.full(201, 112.9388),
        np.full(201, 28.1795),
        np.array([fix.longitude for _, fix in fixes]),
        np.array([fix.latitude for _, fix in fixes]),
    )
    east_m, north_m = distance * np.sin(np.radians(azimuth)), distance * np.cos(np.radians(azimuth))
    np.testing.assert_allclose(np.column_stack([east_m, north_m]), data.values[:, :2], atol=2e-3)
    assert fixes[0][1].position_covariance == pytest.approx([0.36, 0, 0, 0, 0.36, 0, 0, 0, 0.36])
    assert fixes[0][1].position_covariance_type == 2


def test_heading_speed_and_imu_carry_the_measured_values(crossing: tuple[SimulatedDrive, Path]) -> None:
    drive, path = crossing
    yaw = [2 * np.arctan2(m.quaternion.z, m.quaternion.w) for _, m in messages(path, "/gps/heading")]
    np.testing.assert_allclose(yaw, drive.sensors["gnss_heading"].values[:, 0], atol=1e-9)
    reports = [m for _, m in messages(path, "/vehicle/velocity")]
    speed = [m.longitudinal_velocity for m in reports]
    np.testing.assert_allclose(speed, drive.sensors["speed"].values[:, 0], atol=1e-5)
    assert all(np.isnan(m.heading_rate) for m in reports)
    imu = [m for _, m in messages(path, "/imu/data")]
    expected = drive.sensors["imu"].values
    accel = [[m.linear_acceleration.x, m.linear_acceleration.y, m.linear_acceleration.z] for m in imu]
    gyro = [[m.angular_velocity.x, m.angular_velocity.y, m.angular_velocity.z] for m in imu]
    np.testing.assert_allclose(accel, expected[:, :3], atol=1e-9)
    np.testing.assert_allclose(gyro, expected[:, 3:], atol=1e-9)
    assert imu[0].orientation_covariance[0] == -1
    assert imu[0].linear_acceleration_covariance[4] == pytest.approx(0.049**2)
    assert imu[0].angular_velocity_covariance[8] == pytest.approx(np.radians(0.1) ** 2)


def test_bsm_holds_the_sent_state_in_the_steps_of_j2735(crossing: tuple[SimulatedDrive, Path]) -> None:
    drive, path = crossing
    sent, received = drive.v2x["other"], messages(path, "/v2x/bsm")
    assert len(received) == len(sent.stamp_ns) == 201 - sent.n_lost
    core = [body["coreData"] for _, body in received]
    assert {c["id"] for c in core} == {drive.scenario.vehicles["other"].station_id}
    assert [c["secMark"] for c in core] == ((sent.stamp_ns // 1_000_000) % 60_000).tolist()
    assert [message.log_time for message, _ in received] == (sent.stamp_ns + 30_000_000).tolist()
    assert [c["msgCnt"] for c in core] == (sent.count % 128).tolist()
    np.testing.assert_allclose([c["speed"] * 0.02 for c in core], sent.state[:, 2], atol=0.0101)
    compass = [np.radians(90 - c["heading"] * 0.0125) for c in core]
    off = np.angle(np.exp(1j * (np.array(compass) - sent.state[:, 3])))
    assert np.abs(off).max() < np.radians(0.0063)
    np.testing.assert_allclose([c["accelSet"]["long"] * 0.01 for c in core], sent.state[:, 4], atol=0.0051)
    # A left turn is negative in J2735.
    np.testing.assert_allclose([-c["accelSet"]["yaw"] * 0.01 for c in core], np.degrees(sent.state[:, 5]), atol=0.0051)
    np.testing.assert_allclose([-c["accelSet"]["lat"] * 0.01 for c in core], sent.lateral_accel_mps2, atol=0.0051)
    assert core[0]["size"] == {"width": 180, "length": 450}
    assert core[0]["accuracy"]["semiMajor"] == 3  # 0.15 m in steps of 0.05 m


def test_one_bsm_by_hand(tmp_path: Path) -> None:
    document = {
        "duration_s": 1,
        "origin": {"latitude_deg": 0.0, "longitude_deg": 10.0, "altitude_m": 12.3},
        "vehicles": {
            "host": {"speed_mps": 1, "y_m": 50},
            "bus": {"speed_mps": 10, "heading_deg": 90, "length_m": 12, "width_m": 2.5, "station_id": "0000beef"},
        },
        "v2x": {
            "rate_hz": 1,
            "phase_s": 0.25,
            "position_sigma_m": 0,
            "speed_sigma_mps": 0,
            "heading_sigma_deg": 0,
            "accel_sigma_mps2": 0,
            "yaw_rate_sigma_dps": 0,
        },
    }
    path = tmp_path / "bus.mcap"
    write_simulated_log(simulate_scenario(parse_scenario(document, name="bus")), path)
    ((_, body),) = messages(path, "/v2x/bsm")
    core = body["coreData"]
    # 2.5 m north of the equator: 2.5 / 110574.3 deg = 2.261e-5 deg; 8:00:00.25 UTC; north is course 0.
    assert (core["lat"], core["long"], core["elev"]) == (226, 100_000_000, 123)
    assert (core["secMark"], core["speed"], core["heading"], core["id"]) == (250, 500, 0, "0000beef")
    assert core["accelSet"] == {"long": 0, "lat": 0, "vert": -127, "yaw": 0}
    assert core["size"] == {"width": 250, "length": 1200}


def test_ode_records_decode_to_the_same_state_as_the_bsm(tmp_path: Path) -> None:
    drive = simulate_scenario(load_scenario("intersection", ("v2x.format=ode-json",)), 7)
    write_simulated_log(drive, tmp_path / "ode.mcap")
    records = messages(tmp_path / "ode.mcap", "/v2x/ode_bsm")
    sent = drive.v2x["other"]
    core = [body["payload"]["data"]["coreData"] for _, body in records]
    np.testing.assert_allclose([c["speed"] for c in core], sent.state[:, 2], atol=0.0101)
    yaw_dps = np.degrees(sent.state[:, 5])
    np.testing.assert_allclose([-c["accelSet"]["accelYaw"] for c in core], yaw_dps, atol=0.0051)
    assert records[3][1]["metadata"]["recordGeneratedAt"] == "2016-10-01T08:00:00.150Z"
    assert core[3]["secMark"] == 150


def test_truth_channels_hold_exact_states_in_map_and_wgs84(crossing: tuple[SimulatedDrive, Path]) -> None:
    drive, path = crossing
    for topic, name, ident in (
        ("/truth/ego", "host", "ego"),
        ("/simulation/vehicles", "other", drive.scenario.vehicles["other"].station_id),
    ):
        rows = [state for _, state in messages(path, topic)]
        assert {row.id for row in rows} == {ident}
        got = np.array([[row.x_m, row.y_m, row.speed_mps, row.heading_rad, row.yaw_rate_radps] for row in rows])
        np.testing.assert_allclose(got, true_states_of_vehicle(drive, name)[::50][:, [0, 1, 2, 3, 5]], atol=1e-9)
        distance = Geod(ellps="WGS84").inv(112.9388, 28.1795, rows[0].longitude_deg, rows[0].latitude_deg)[2]
        assert distance == pytest.approx(np.hypot(got[0, 0], got[0, 1]), abs=2e-3)
    assert messages(path, "/truth/ego")[0][1].length_m == 4.2


def test_two_remote_vehicles_share_the_topics_in_order(tmp_path: Path) -> None:
    third = ("vehicles.third.speed_mps=5", "vehicles.third.y_m=50", "v2x.jitter_s=0.1")
    drive = simulate_scenario(load_scenario("rear-end", third), 3)
    written = {entry.topic: entry for entry in write_simulated_log(drive, tmp_path / "three.mcap")}
    received = messages(tmp_path / "three.mcap", "/v2x/bsm")
    assert len(received) == written["/v2x/bsm"].n_messages == 2 * 201
    times = [message.log_time for message, _ in received]
    assert times == sorted(times)
    assert len({body["coreData"]["id"] for _, body in received}) == 2
    assert written["/simulation/vehicles"].n_messages == 2 * 201


def test_metadata_is_enough_to_make_the_log_again(crossing: tuple[SimulatedDrive, Path], tmp_path: Path) -> None:
    _, path = crossing
    with path.open("rb") as stream:
        (record,) = [m.metadata for m in make_reader(stream).iter_metadata() if m.name == "cwcli.scenario"]
    again = simulate_scenario(parse_scenario(json.loads(record["scenario"]), name=record["name"]), int(record["seed"]))
    write_simulated_log(again, tmp_path / "again.mcap")
    assert (tmp_path / "again.mcap").read_bytes() == path.read_bytes()
    resolved = json.loads(record["resolved"])
    assert resolved["sensors"]["gnss"] | {"sigma_m": 0.6, "delay_s": 0.08} == resolved["sensors"]["gnss"]


def test_another_seed_gives_another_log_with_the_same_truth(
    crossing: tuple[SimulatedDrive, Path], tmp_path: Path
) -> None:
    drive, path = crossing
    write_simulated_log(simulate_scenario(drive.scenario, 8), tmp_path / "other.mcap")
    fixes = [[fix.latitude for _, fix in messages(p, "/gps/fix")] for p in (path, tmp_path / "other.mcap")]
    assert not set(fixes[0]) & set(fixes[1])
    truths = [[m.data for m, _ in messages(p, "/truth/ego")] for p in (path, tmp_path / "other.mcap")]
    assert truths[0] == truths[1]


def test_existing_target_is_kept_unless_forced(tmp_path: Path) -> None:
    drive = simulate_scenario(load_scenario("rear-end"))
    target = tmp_path / "log.mcap"
    target.write_text("mine")
    with pytest.raises(OutputError):
        write_simulated_log(drive, target)
    assert target.read_text() == "mine"
    write_simulated_log(drive, target, force=True)
    assert len(messages(target, "/gps/fix")) == 201


def records(path: Path) -> list[tuple[str, object]]:
    """Every record of a log, chunks unpacked: all that it holds, whatever the compressor."""
    with path.open("rb") as stream:
        kept = ("Header", "Schema", "Channel", "Message", "Metadata")
        return [
            (type(r).__name__, r) for r in StreamReader(stream, validate_crcs=True).records if type(r).__name__ in kept
        ]


def test_samples_are_made_again_byte_for_byte(tmp_path: Path) -> None:
    names = sorted(path.stem for path in SAMPLE_DIR.glob("*.mcap"))
    assert names == ["curve", "intersection", "rear-end", "straight"]
    for name in names:
        write_simulated_log(simulate_scenario(load_scenario(name)), tmp_path / f"{name}.mcap")
        (tmp_path / f"{name}.toml").write_text(scenario_text(name), encoding="utf-8")
    for path in sorted(tmp_path.iterdir()):
        committed = SAMPLE_DIR / path.name
        if path.suffix == ".mcap":
            assert records(path) == records(committed)
            assert committed.stat().st_size < 300_000
        if path.suffix == ".toml" or zstandard.ZSTD_VERSION == ZSTD_OF_SAMPLES:
            assert path.read_bytes() == committed.read_bytes()
