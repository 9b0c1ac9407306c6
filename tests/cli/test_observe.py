"""`cwcli observe`, `predict-lane`, `warn-lane` as a user runs them: the whole pipe, exit codes, words."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from cwcli.dynamics.vehicle import load_vehicle
from tests.unit.stages.lateral_logs import IMU, SPEED, drive, write_lane_log

Run = Callable[..., CompletedProcess[bytes]]
EXAMPLE = Path(__file__).parents[2] / "cwcli" / "dynamics" / "vehicles" / "zhang2011.toml"
SECONDS, RATE_HZ = 6, 10


@pytest.fixture(scope="module")
def lanes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_lane_log(tmp_path_factory.mktemp("lanes") / "lanes.mcap", drive(seconds=6.0))


def test_the_whole_pipe_from_rendered_frames_to_warnings(cwcli: Run, tmp_path: Path) -> None:
    (tmp_path / "vehicle.toml").write_bytes(EXAMPLE.read_bytes())
    commands: list[tuple[str, ...]] = [
        ("simulate", "road", "--seed", "5", "--set", f"duration_s={SECONDS}", "--set", f"rate_hz={RATE_HZ}"),
        ("lanes", "-", "--camera-height", "1.3"),
        ("observe", "-", "--vehicle", "vehicle.toml", "--metrics", "observer.parquet"),
        ("predict-lane", "-", "--horizon", "2.0", "--metrics", "prediction.csv"),
    ]
    data = None
    for command in commands:
        source: dict[str, Any] = {} if data is None else {"input": data}
        done = cwcli(*command, "-o", "-", **source)
        assert done.returncode == 0, done.stderr.decode()
        data = done.stdout
    done = cwcli("warn-lane", "-", "-o", "warned.mcap", "--json", input=data)
    assert done.returncode == 0, done.stderr.decode()
    frames = SECONDS * RATE_HZ + 1
    sections = json.loads(done.stdout)["stages"]["warn-lane"]["sections"]
    assert {"result": "frames", "count": frames} in sections["lane_frames"]
    found: dict[str, list[object]] = {}
    with (tmp_path / "warned.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        topics = ["/cwcli/observer", "/cwcli/observer/path", "/truth/lateral"]
        for _, channel, _, message in reader.iter_decoded_messages(topics=topics):
            found.setdefault(channel.topic, []).append(message)
        records = {record.name for record in reader.iter_metadata()}
    assert {name: len(messages) for name, messages in found.items()} == {
        "/cwcli/observer": frames,
        "/cwcli/observer/path": frames,
        "/truth/lateral": frames,
    }
    assert {"cwcli.run.lanes", "cwcli.run.observe", "cwcli.run.predict-lane", "cwcli.run.warn-lane"} <= records
    path = found["/cwcli/observer/path"][-1]
    assert (path.horizon_s, len(path.x_m), path.frame_id) == (2.0, 41, "odom")  # type: ignore[attr-defined]
    true, seen = (
        np.array([message.yaw_rate_radps for message in found[topic]])  # type: ignore[attr-defined]
        for topic in ("/truth/lateral", "/cwcli/observer")
    )
    assert np.degrees(np.sqrt(np.mean((seen - true)[20:] ** 2))) < 0.3  # with the gyroscope, from 2 s on
    table = pq.read_table(tmp_path / "observer.parquet")
    assert table.num_rows == frames
    assert table.schema.field("yaw_rate_radps").metadata[b"unit"] == b"rad/s"
    assert (tmp_path / "prediction.csv").read_text().startswith('"vehicle","model","horizon_s","n",')


@pytest.mark.parametrize("method", ["cwcli", "zhang2011"])
def test_both_methods_show_their_errors_where_there_is_a_truth(cwcli: Run, lanes: Path, method: str) -> None:
    done = cwcli("observe", lanes, "--method", method, "--vehicle", "zhang2011", "--load", "half", "--json")
    assert done.returncode == 0, done.stderr.decode()
    summary = json.loads(done.stdout)["stages"]["observe"]
    errors = {row["state"]: row["rms"] for row in summary["sections"]["observer_errors"]}
    assert np.degrees(errors["yaw_rate_radps"]) < 1.0
    assert errors["lateral_speed_mps"] < 0.1


def test_the_shipped_car_is_noted_when_none_is_named(cwcli: Run, lanes: Path) -> None:
    done = cwcli("observe", lanes)
    assert done.returncode == 0
    assert "the bundled car zhang2011 is assumed" in " ".join(done.stderr.decode().split())


def test_missing_speed_is_exit_code_4(cwcli: Run, tmp_path: Path) -> None:
    done = cwcli("observe", write_lane_log(tmp_path / "l.mcap", drive(seconds=2.0), without=(SPEED, IMU)))
    assert done.returncode == 4
    assert "no channel holds the ego speed (needed by `cwcli observe`)" in done.stderr.decode()


def test_a_log_without_lanes_is_exit_code_4(cwcli: Run, intersection: Path) -> None:
    done = cwcli("observe", intersection, "-o", "observed.mcap")
    assert done.returncode == 4
    assert "cwcli lanes" in done.stderr.decode()
    assert cwcli("predict-lane", intersection).returncode == 4
    assert cwcli("warn-lane", intersection).returncode == 4


def test_a_span_behind_the_log_is_exit_code_2(cwcli: Run, lanes: Path) -> None:
    done = cwcli("observe", lanes, "--start", "500")
    assert done.returncode == 2
    assert "--start 500 is after the end of the log" in done.stderr.decode()


def test_a_speed_on_another_clock_is_exit_code_5(cwcli: Run, tmp_path: Path) -> None:
    path = write_lane_log(tmp_path / "l.mcap", drive(seconds=2.0), clock_offset_ns=10**12, without=(IMU,))
    done = cwcli("observe", path)
    assert done.returncode == 5
    assert "covers none of the frames" in done.stderr.decode()


def test_speed_zero_and_boundaries_missing_for_seconds_are_no_errors(cwcli: Run, tmp_path: Path) -> None:
    from cwcli.simulation.lane_camera import LaneSensorNoise

    blind = drive(seconds=6.0, noise=LaneSensorNoise(blind_s=((1.0, 5.0),)))
    for name, options in (("still", {"speed_factor": 0.0}), ("driving", {})):
        path = write_lane_log(tmp_path / f"{name}.mcap", blind, without=(IMU,), **options)  # type: ignore[arg-type]
        done = cwcli("observe", path, "--json")
        assert done.returncode == 0, done.stderr.decode()
        rows = json.loads(done.stdout)["stages"]["observe"]["sections"]["observer"]
        found = {row["quantity"]: row["value"] for row in rows}
        assert found["frames predicted"] > 0
        assert found["frames lost"] > 0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("front_stiffness_nprad = 60000.0", "front_stiffness_nprad = -60000.0"), "front_stiffness_nprad is -60000.0"),
        (("rear_axle_m = 1.06", "rear_axle_m = -1.06"), "rear_axle_m is -1.06; permitted: 0.1 to 10"),
        (("half = 1215.0", "half = -1215.0"), "load_kg.half is -1215.0"),
        (("yaw_inertia_kgm2 = 2100.0", ""), "yaw_inertia_kgm2 is missing"),
        (('load = "half"', 'load = "ballast"'), "use.load is 'ballast'; permitted: empty, half, full"),
    ],
)
def test_reversed_signs_in_the_cars_file_are_exit_code_2_and_one_line(
    cwcli: Run, tmp_path: Path, lanes: Path, change: tuple[str, str], words: str
) -> None:
    text = EXAMPLE.read_text()
    assert change[0] in text
    (tmp_path / "car.toml").write_text(text.replace(*change, 1))
    done = cwcli("observe", lanes, "--vehicle", "car.toml", "-o", "observed.mcap")
    assert done.returncode == 2
    assert words in done.stderr.decode()
    assert "car.toml" in done.stderr.decode()
    assert not (tmp_path / "observed.mcap").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("observe", "--method", "nonsense"), "nonsense"),
        (("observe", "--start", "4", "--end", "3"), "--end 3 is not after --start 4"),
        (("observe", "--vehicle", "nothing"), "there is no vehicle 'nothing'"),
        (("observe", "--load", "ballast"), "load 'ballast' is unknown; permitted: empty, half, full"),
        (("observe", "--coast", "-1"), "--coast -1"),
        (("predict-lane", "--model", "ctra"), "must be one of lateral"),
        (("predict-lane", "--horizon", "-2"), "horizon"),
        (("warn", "--rules", "ttc,nonsense"), "there is no warning rule 'nonsense'"),
        (("warn-lane", "--line-crossing", "-1"), "warn_s is -1"),
    ],
)
def test_wrong_use_is_exit_code_2(cwcli: Run, lanes: Path, arguments: tuple[str, ...], words: str) -> None:
    command, *options = arguments
    done = cwcli(command, lanes, *options)
    assert done.returncode == 2, done.stderr.decode()
    assert words in done.stderr.decode()


def test_the_car_of_the_record_is_used_for_the_paths(cwcli: Run, tmp_path: Path, lanes: Path) -> None:
    text = EXAMPLE.read_text().replace("camera_forward_m = 0.0", "camera_forward_m = 1.5")
    (tmp_path / "car.toml").write_text(text)
    assert cwcli("observe", lanes, "--vehicle", "car.toml", "-o", "observed.mcap").returncode == 0
    from cwcli.logs.read.reader import Log
    from cwcli.pipeline.records import vehicle_and_notes_from_log

    with Log.open(tmp_path / "observed.mcap") as log:
        car, _ = vehicle_and_notes_from_log(log)
    assert car.camera_forward_m == 1.5
    assert car.mass_kg == load_vehicle().mass_kg
