"""`cwcli lanes` as a user runs it: files, exit codes and what is said."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from subprocess import CompletedProcess

import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader

from cwcli.signals.clocks import INVALID_LOG_TIME_REASON, STRAY_LOG_TIME_REASON
from tests.cli.rewritten_logs import read, write
from tests.unit.vision.fake_frames import encoded, gradient, png_header
from tests.unit.vision.lane_logs import START_NS, STEP_NS, calibration, road_frames, write_log

Run = Callable[..., CompletedProcess[bytes]]
DEVELOPMENT_LOG = Path(__file__).parents[2].parent / "shared" / "logs" / "udacity-solid-white-right.mcap"


def test_lanes_writes_log_and_metrics(cwcli: Run, tmp_path: Path) -> None:
    source = write_log(tmp_path / "road.mcap", road_frames(8))
    done = cwcli("lanes", source, "-o", "out.mcap", "--metrics", "lanes.parquet", "--render", "/camera/lanes", "--json")
    assert done.returncode == 0, done.stderr.decode()
    summary = json.loads(done.stdout)["stages"]["lanes"]
    assert summary["inputs"][0]["used"] == 8
    table = pq.read_table(tmp_path / "lanes.parquet")
    assert table.num_rows == 8
    assert {"left_a", "right_found", "lateral_deviation_m", "lateral_deviation_sigma_m"} <= set(table.column_names)
    with (tmp_path / "out.mcap").open("rb") as file:
        summary = make_reader(file, validate_crcs=True).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    counts = {summary.channels[k].topic: n for k, n in summary.statistics.channel_message_counts.items()}
    assert counts == {
        "/camera/image": 8,
        "/cwcli/lanes": 8,
        "/cwcli/lanes/annotations": 8,
        "/camera/lanes": 8,
    }


def test_lanes_tells_what_it_assumed(cwcli: Run, tmp_path: Path) -> None:
    done = cwcli("lanes", write_log(tmp_path / "road.mcap", road_frames(2)))
    assert done.returncode == 0
    words = " ".join(done.stderr.decode().split())
    assert "no calibration for /camera/image" in words
    assert "mounting is not known" in words
    quiet = cwcli(
        "lanes",
        write_log(tmp_path / "known.mcap", road_frames(2), calibrations=[("/camera/camera_info", calibration())]),
        *("--camera-height", "1.4", "--camera-pitch", "2"),
    )
    assert "calibration" not in quiet.stderr.decode()
    assert "mounting" not in quiet.stderr.decode()


@pytest.mark.parametrize("log_time_ns", [0, 1, 10**18, 3 * 10**18, 2**63 + 5, 2**64 - 1])
def test_a_frame_with_a_log_time_that_is_none_is_left_out_and_counted(
    cwcli: Run, tmp_path: Path, log_time_ns: int
) -> None:
    """The frames are of 1.7e18 ns; every other one is found as without it."""
    messages = read(write_log(tmp_path / "road.mcap", road_frames(8)))
    messages[5] = replace(messages[5], log_time_ns=log_time_ns)
    write(tmp_path / "stray.mcap", messages)
    done = cwcli("lanes", "stray.mcap", "--metrics", "lanes.parquet", "-o", "out.mcap", "--json")
    assert done.returncode == 0, done.stderr.decode()
    camera = json.loads(done.stdout)["stages"]["lanes"]["inputs"][0]
    reason = INVALID_LOG_TIME_REASON if log_time_ns >= 2**63 else STRAY_LOG_TIME_REASON
    assert (camera["read"], camera["used"], camera["rejected"]) == (8, 7, {reason: 1})
    stamps = pq.read_table(tmp_path / "lanes.parquet")["stamp_ns"].to_pylist()
    assert stamps == [START_NS + k * STEP_NS for k in (0, 1, 2, 3, 4, 6, 7)]


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("--method", "nonsense"), 2, "no lane method 'nonsense'"),
        (("--camera-fov", "200"), 2, "--camera-fov"),
        (("--camera-fov", "1e-9"), 2, "--camera-fov"),
        (("--camera-height", "1e-6"), 2, "--camera-height 1e-06 must lie between 0.2 and 5 m"),
        (("--camera-offset", "1e6"), 2, "--camera-offset 1e+06 must lie between -5 and 5 m"),
        (("--camera-pitch", "90"), 2, "--camera-pitch 90 must lie between -45 and 45 degrees"),
        (("--camera-yaw", "-180"), 2, "--camera-yaw -180 must lie between -45 and 45 degrees"),
        (("--preview", "1e300"), 2, "--preview"),
        (("--render", ""), 2, "is not the name of a topic"),
        (("--render", "nonsense"), 2, "is not the name of a topic"),
        (("--render", "/a b"), 2, "is not the name of a topic"),
        (("--render", "/camera/image"), 2, "the camera's own topic"),
        (("--render", "/cwcli/lanes"), 2, "the topic of cwcli.v1.Lanes"),
        (("--render", "/camera/camera_info", "--replace"), 2, "the topic of foxglove.CameraCalibration"),
        (("--topic", "camera=/nothing"), 2, "the log has no topic /nothing"),
        (("--start", "100"), 2, "is after the end of the log"),
    ],
)
def test_wrong_options_have_their_exit_codes(
    cwcli: Run, tmp_path: Path, arguments: tuple[str, ...], code: int, words: str
) -> None:
    source = write_log(tmp_path / "road.mcap", road_frames(2), calibrations=[("/camera/camera_info", calibration())])
    done = cwcli("lanes", source, *arguments, "-o", "out.mcap")
    assert done.returncode == code, done.stderr.decode()
    assert words in done.stderr.decode()
    assert not (tmp_path / "out.mcap").exists()


def test_seed_of_400_digits_in_a_configuration_is_exit_code_2(cwcli: Run, tmp_path: Path) -> None:
    (tmp_path / "p.toml").write_text(f"[lanes]\nseed = {10**400}\n")
    done = cwcli("lanes", write_log(tmp_path / "road.mcap", road_frames(1)), "--config", "p.toml")
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 2)
    assert b"--seed 1000" in done.stderr
    assert b"hint:  --seed comes from lanes.seed in p.toml" in done.stderr


def test_no_camera_is_exit_code_4(cwcli: Run, intersection: Path) -> None:
    done = cwcli("lanes", intersection)
    assert done.returncode == 4
    assert "no channel holds the camera" in done.stderr.decode()


def test_two_cameras_are_exit_code_4_and_the_option(cwcli: Run, tmp_path: Path) -> None:
    from mcap_protobuf.writer import Writer

    from tests.unit.vision.lane_logs import START_NS, frame

    path = tmp_path / "two.mcap"
    with path.open("wb") as file, Writer(file) as writer:
        for topic in ("/camera/left", "/camera/right"):
            writer.write_message(topic, frame(road_frames(1)[0], START_NS), START_NS, START_NS)
    done = cwcli("lanes", path)
    assert done.returncode == 4
    assert "--topic camera=/camera/left" in done.stderr.decode()
    assert cwcli("lanes", path, "--topic", "camera=/camera/left").returncode == 0


def test_unusable_frames_are_exit_code_5_with_the_reasons(cwcli: Run, tmp_path: Path) -> None:
    bomb, dot = png_header(10_000, 10_000), encoded(gradient(1, 1))
    done = cwcli("lanes", write_log(tmp_path / "bad.mcap", [bomb, dot, b"rubbish"]))
    assert done.returncode == 5
    said = done.stderr.decode()
    for reason in ("more than 50 megapixels", "smaller than 32 x 32", "neither JPEG, PNG nor WebP"):
        assert reason in said


def test_strict_refuses_a_damaged_frame(cwcli: Run, tmp_path: Path) -> None:
    path = write_log(tmp_path / "road.mcap", [*road_frames(2), b"rubbish"])
    assert cwcli("lanes", path).returncode == 0
    assert cwcli("lanes", path, "--strict").returncode == 5


@pytest.mark.skipif(not DEVELOPMENT_LOG.exists(), reason="the development logs in ../shared/logs are not here")
def test_unknown_distortion_model_is_one_line_and_with_strict_exit_code_5(cwcli: Run, tmp_path: Path) -> None:
    strange = calibration()
    strange.distortion_model = "double_sphere"
    strange.D.extend([0.6, -0.2])
    source = write_log(tmp_path / "road.mcap", road_frames(2), calibrations=[("/camera/camera_info", strange)])
    done = cwcli("lanes", source)
    told = " ".join(done.stderr.decode().split())
    assert done.returncode == 0
    assert (
        "note: /camera/camera_info is not used: its distortion model 'double_sphere' is unknown (known: plumb_" in told
    )
    strict = cwcli("lanes", source, "--strict")
    assert strict.returncode == 5
    assert "/camera/camera_info rejected: 1 calibration with an unknown distortion model" in strict.stderr.decode()


def test_real_video_is_searched_in_full(cwcli: Run) -> None:
    done = cwcli("lanes", DEVELOPMENT_LOG, "--method", "zhang2011", "--json")
    assert done.returncode == 0
    counts = json.loads(done.stdout)["stages"]["lanes"]["inputs"]
    assert counts[0] == {
        "topic": "/camera/image",
        "role": "camera",
        "read": 221,
        "used": 221,
        "rejected": {},
        "repaired": {},
        "set_aside": {},
    }
