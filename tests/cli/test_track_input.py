"""`cwcli track`: bad and odd detections, and the messages in which they come."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from tests.cli.conftest import ROOT, Run
from tests.cli.detection_logs import (
    LIDAR,
    MS,
    RADAR,
    T0_NS,
    at_rate,
    counted,
    rejected,
    scan,
    summary,
    targets_of,
    write_scans,
)

MAX_MEMORY_KB = 300_000
PATHS = {"PYTHONPATH": str(ROOT)}


def test_no_detections_is_a_missing_signal(cwcli: Run, intersection: Path) -> None:
    done = cwcli("track", intersection)
    assert done.returncode == 4
    assert b"no channel holds detections" in done.stderr
    assert b"/gps/fix" in done.stderr


@pytest.mark.parametrize(
    ("option", "said"),
    [
        ("/lidar/objects", "not TOPIC:KEY=VALUE"),
        ("/lidar/objects:z=1", "unknown key 'z'"),
        ("/lidar/objects:x=nan", "'nan' can't be x"),
        ("/lidar/objects:sigma=-1", "'-1' can't be sigma"),
        ("/lidar/objects:x=1,x=2", "x comes twice"),
        ("/camera:x=1", "no detections are read"),
    ],
)
def test_sensor_options_that_are_wrong(cwcli: Run, tmp_path: Path, option: str, said: str) -> None:
    write_scans(tmp_path / "a.mcap", {LIDAR: at_rate([[{"x_m": 1.0, "y_m": 0.0}]] * 3)})
    done = cwcli("track", "a.mcap", "--sensor", option)
    assert done.returncode == 2
    assert said in done.stderr.decode()


def test_mounting_and_the_paper_s_axes(cwcli: Run, tmp_path: Path) -> None:
    """A target that stands 10 m ahead and 2 m to the left, seen by a sensor in the paper's axes 1 m ahead."""
    here = [{"x_m": -2.0, "y_m": 9.0}]  # right is negative left, forward counts from the sensor
    write_scans(tmp_path / "a.mcap", {LIDAR: at_rate([here] * 30)})
    done = cwcli("track", "a.mcap", "-o", "t.mcap", "--sensor", f"{LIDAR}:x=1,axes=paper")
    assert done.returncode == 0, done.stderr.decode()
    from mcap_protobuf.decoder import DecoderFactory

    with (tmp_path / "t.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        last = [m for *_, m in reader.iter_decoded_messages(topics=["/cwcli/targets"])][-1]
    assert (last.x_m, last.y_m) == pytest.approx((10.0, 2.0), abs=1e-6)
    assert last.frame_id == "base_link"


def test_bad_detections_are_counted(cwcli: Run, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    lidar = at_rate(
        [[{"x_m": 5.0 + 0.5 * k + 0.1 * rng.standard_normal(), "y_m": 0.1 * rng.standard_normal()}] for k in range(60)],
        frame="lidar",
    )
    lidar[10][1]["detections"][0]["x_m"] = None  # what JSON has for a number that is none
    lidar[20][1]["frame_id"] = "elsewhere"
    lidar[30] = (lidar[30][0], scan(T0_NS + 2500 * MS - 5_000 * MS, lidar[30][1]["detections"], "lidar"))
    radar = at_rate(
        [[{"range_m": 5.0 + 0.5 * k, "azimuth_rad": 0.0, "range_rate_mps": 5.0}] for k in range(60)], frame="radar"
    )
    radar[40][1]["detections"][0]["range_m"] = -3.0
    write_scans(tmp_path / "a.mcap", {LIDAR: lidar, RADAR: radar})
    told = summary(cwcli("track", "a.mcap", "--json", "-o", "t.mcap"))
    assert rejected(told) == {
        LIDAR: {"not finite": 1, "wrong frame id": 1, "time went backwards or jumped": 1},
        RADAR: {"negative range": 1},
    }
    assert counted(told)
    assert [row["target"] for row in told["sections"]["targets"]] == ["1"]
    strict = cwcli("track", "a.mcap", "--strict", "-o", "s.mcap")
    assert strict.returncode == 5
    assert b"negative range" in strict.stderr
    assert not (tmp_path / "s.mcap").exists()


def test_ten_thousand_detections_in_one_scan(cwcli: Run, tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    scans: list[list[dict[str, float]]] = [[{"x_m": 20.0 - 0.3 * k, "y_m": 1.0}] for k in range(30)]
    scans[15] += [dict(zip(("x_m", "y_m"), map(float, rng.uniform(-200, 200, 2)), strict=True)) for _ in range(9_999)]
    write_scans(tmp_path / "a.mcap", {LIDAR: at_rate(scans)})
    told = summary(cwcli("track", "a.mcap", "--json", "-o", "t.mcap"))
    assert counted(told)
    (line,) = told["sections"]["sensors"]
    assert line["detections"] == 10_029
    assert line["used"] + line["no_track"] + line["faulty"] == 10_029
    assert len(told["sections"]["targets"]) >= 1
    code = (
        "from cwcli.cli.main import run_command_line; assert run_command_line(['track', 'a.mcap', '-q']) == 0; "
        "print(next(line.split()[1] for line in open('/proc/self/status') if line.startswith('VmHWM')))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, cwd=tmp_path, env=PATHS)
    assert int(done.stdout) < MAX_MEMORY_KB


def test_a_target_that_starts_at_the_origin(cwcli: Run, tmp_path: Path) -> None:
    ranges = [[{"range_m": 0.4 * k, "azimuth_rad": 0.0, "range_rate_mps": 4.0}] for k in range(40)]
    write_scans(tmp_path / "a.mcap", {RADAR: at_rate(ranges)})
    told = summary(cwcli("track", "a.mcap", "--json", "--no-tune"))
    (line,) = told["sections"]["targets"]
    assert (line["states"], line["seen_percent"]) == (40, 100.0)
    assert rejected(told) == {RADAR: {}}


def test_empty_scans_only(cwcli: Run, tmp_path: Path) -> None:
    write_scans(tmp_path / "a.mcap", {LIDAR: at_rate([[]] * 10)})
    done = cwcli("track", "a.mcap", "-o", "t.mcap")
    assert done.returncode == 0, done.stderr.decode()
    assert b"no target was found" in done.stderr
    assert targets_of(tmp_path / "t.mcap") == []


def test_a_pipe_gives_the_same_targets(cwcli: Run, tmp_path: Path) -> None:
    write_scans(tmp_path / "a.mcap", {LIDAR: at_rate([[{"x_m": 10.0 + k, "y_m": 0.0}] for k in range(20)])})
    assert cwcli("track", "a.mcap", "-o", "t.mcap").returncode == 0
    with (tmp_path / "a.mcap").open("rb") as stream:
        done = cwcli("track", "-", "-o", "-", stdin=stream)
    assert done.returncode == 0
    (tmp_path / "p.mcap").write_bytes(done.stdout)
    assert targets_of(tmp_path / "p.mcap") == targets_of(tmp_path / "t.mcap")
    again = cwcli("track", "t.mcap", "-o", "u.mcap")
    assert again.returncode != 0
    assert b"--replace" in again.stderr
    assert cwcli("track", "t.mcap", "-o", "u.mcap", "--replace").returncode == 0
    assert targets_of(tmp_path / "u.mcap") == targets_of(tmp_path / "t.mcap")


def test_radar_tracks_and_drawn_cubes_are_tracked(cwcli: Run, tmp_path: Path) -> None:
    """One target ahead at 10 m, driving away at 5 m/s, as RadarTracks and as cubes, in JSON."""
    from mcap.writer import Writer

    for name, schema, message in (
        ("tracks", "radar_msgs/msg/RadarTracks", radar_track),
        ("cubes", "foxglove.SceneUpdate", cube),
    ):
        with (tmp_path / f"{name}.mcap").open("wb") as stream:
            writer = Writer(stream)
            writer.start()
            channel = writer.register_channel("/sensor", "json", writer.register_schema(schema, "jsonschema", b"{}"))
            for k in range(50):
                at = T0_NS + 100 * MS * k
                writer.add_message(channel, at, json.dumps(message(at, 10.0 + 0.5 * k)).encode(), at)
            writer.finish()
        told = summary(cwcli("track", f"{name}.mcap", "--no-tune", "--json"))
        (row,) = told["sections"]["targets"]
        assert (row["states"], row["max_speed_mps"]) == (50, pytest.approx(5.0, abs=0.3))


def radar_track(at: int, x_m: float) -> dict[str, Any]:
    stamp = {"sec": at // 10**9, "nanosec": at % 10**9}
    one = {"position": {"x": x_m, "y": 0.0, "z": 0.0}, "velocity": {"x": 5.0, "y": 0.0, "z": 0.0}}
    return {"header": {"stamp": stamp, "frame_id": "radar"}, "tracks": [one]}


def cube(at: int, x_m: float) -> dict[str, Any]:
    stamp = {"sec": at // 10**9, "nsec": at % 10**9}
    one = {"pose": {"position": {"x": x_m, "y": 0.0, "z": 0.0}}}
    return {"entities": [{"timestamp": stamp, "frame_id": "lidar", "cubes": [one]}]}
