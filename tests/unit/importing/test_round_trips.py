"""What `cwcli export` writes, `cwcli import` reads: every printed digit comes back."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from cwcli.importing.mapping import read_mapping
from cwcli.importing.run import plan_import, write_import
from cwcli.importing.tables import Answers
from cwcli.logs.read.reader import Log
from cwcli.signals.columns import Columns
from tests.unit.importing.oracles import annotated_log, exported

METER_STEP = 0.5e-6
"""Half of the last printed digit of poses, m."""


def states() -> Columns:
    with Log.open(annotated_log()) as log:
        return log.columns("/cwcli/ego/state")


def imported(folder: Path, name: str, answers: Answers | None = None) -> dict[str, Columns]:
    plan = plan_import([str(exported(folder, name))], answers or Answers())
    write_import(plan, str(folder / "log.mcap"))
    with Log.open(folder / "log.mcap") as log:
        return {channel.topic: log.columns(channel.topic) for channel in log.channels}


def test_gpx(tmp_path: Path) -> None:
    found = imported(tmp_path, "ego.gpx")["/gps/fix"]
    text = (tmp_path / "ego.gpx").read_text()
    np.testing.assert_array_equal(found.log_time_ns, states().fields["stamp_ns"])
    for name in ("lat", "lon"):
        printed = [float(value) for value in re.findall(f' {name}="([-0-9.]+)"', text)]
        np.testing.assert_array_equal(found.fields[{"lat": "latitude", "lon": "longitude"}[name]], printed)


def check_poses(found: Columns, own: Columns) -> None:
    for axis in "xy":
        np.testing.assert_allclose(
            np.asarray(found.fields[f"pose.position.{axis}"]),
            np.asarray(own.fields[f"{axis}_m"]),
            atol=1.01 * METER_STEP,
            rtol=0,
        )
    z, w = (np.asarray(found.fields[f"pose.orientation.{axis}"]) for axis in "zw")
    error = np.angle(np.exp(1j * (2 * np.arctan2(z, w) - np.asarray(own.fields["heading_rad"]))))
    assert np.abs(error).max() < 1e-11


def test_tum(tmp_path: Path) -> None:
    found, own = imported(tmp_path, "ego.tum")["/pose"], states()
    np.testing.assert_array_equal(found.log_time_ns, own.fields["stamp_ns"])
    check_poses(found, own)


def test_kitti(tmp_path: Path) -> None:
    own = states()
    times = tmp_path / "stamps.txt"
    times.write_text("\n".join(str(stamp) for stamp in np.asarray(own.fields["stamp_ns"]).tolist()))
    found = imported(tmp_path, "ego.kitti", Answers(frame_times=str(times)))["/pose"]
    np.testing.assert_array_equal(found.log_time_ns, own.fields["stamp_ns"])
    check_poses(found, own)


@pytest.mark.parametrize("name", ["ego.csv", "ego.parquet"])
def test_tables(name: str, tmp_path: Path) -> None:
    channels, own = imported(tmp_path, name), states()
    for topic, path, field in (
        ("/gps/fix", "latitude", "latitude_deg"),
        ("/gps/fix", "longitude", "longitude_deg"),
        ("/vehicle/twist", "twist.linear.x", "speed_mps"),
        ("/vehicle/twist", "twist.angular.z", "yaw_rate_radps"),
    ):
        np.testing.assert_array_equal(channels[topic].fields[path], own.fields[field])
    z, w = (np.asarray(channels["/vehicle/heading"].fields[f"quaternion.{axis}"]) for axis in "zw")
    error = np.angle(np.exp(1j * (2 * np.arctan2(z, w) - np.asarray(own.fields["heading_rad"]))))
    assert np.abs(error).max() < 1e-12


@pytest.mark.parametrize("name", ["csv-logger", "csv-local", "csv-with-imu", "sensor-logger", "nmea", "can-asc", "tum"])
def test_mapping_given_again_gives_the_same_log(name: str, tmp_path: Path) -> None:
    from tests.unit.importing.files import CASES

    files = [str(path) for path in CASES[name].make(tmp_path)]
    first = plan_import(files, Answers())
    (tmp_path / "mapping.toml").write_text(first.mapping_text())
    second = plan_import(files, read_mapping(str(tmp_path / "mapping.toml")))
    assert [topic[:3] for topic in second.topics] == [topic[:3] for topic in first.topics]
    for (_, one), (_, other) in zip(first.channels, second.channels, strict=True):
        for path, values in one.fields.items():
            if isinstance(values, np.ndarray):
                np.testing.assert_array_equal(other.fields[path], values)
