"""One message of a good log with a time that is none: it is left out and told, and the estimate stays what it was."""

from __future__ import annotations

import csv
import json
import os
import struct
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cwcli.channels.published import EGO_ONLINE
from cwcli.cli.main import run_command_line
from cwcli.signals.clocks import CLOCK_JUMP_REASON, INVALID_LOG_TIME_REASON, NO_STAMP_REASON, STRAY_LOG_TIME_REASON
from tests.cli.bounded import LAUNCHER, LIMIT_BYTES
from tests.cli.conftest import ROOT, SAMPLES, Run
from tests.cli.rewritten_logs import Logged, read, write
from tests.sampled import diagonal
from tests.work import HANG_S

NS_PER_S = 1_000_000_000
TEN_YEARS_S = 10 * 365 * 86_400
STAMP_AT = 4  # behind the encapsulation header of CDR
ATOL_PART = 0.05
MOST_MB = 150
LOGS = ROOT.parent / "shared" / "logs"
KITTI = LOGS / "kitti-2011-10-03-drive-0027.first240s.mcap"
UDACITY = LOGS / "udacity-obj-pose.ros2.mcap"
SENSORS = ("/gps/fix", "/gps/heading", "/vehicle/velocity", "/imu/data")
OTHERS = ("/v2x/bsm", "/truth/ego", "/simulation/vehicles")


@dataclass(frozen=True)
class Estimated:
    """What came out of one run: its position error against the truth, and what became of each topic's messages."""

    position_error_m: float
    position_nees: float
    inputs: dict[str, dict[str, Any]]
    peak_mb: float


def estimate(log: Path, *options: str) -> Estimated:
    """Run `cwcli estimate` as a process of its own, which must end with 0."""
    metrics, shown = log.with_suffix(".csv"), log.with_suffix(".json")
    took = log.with_suffix(".took")
    launcher = [sys.executable, "-S", "-c", LAUNCHER, str(took), str(LIMIT_BYTES), str(round(HANG_S))]
    command = [sys.executable, "-m", "cwcli", "estimate", str(log), "--json", "--metrics", str(metrics), *options]
    with shown.open("wb") as stdout:
        subprocess.run(
            [*launcher, *command], cwd=ROOT, stdout=stdout, env=os.environ | {"PYTHONPATH": str(ROOT)}, check=True
        )
    code, peak_mb = json.loads(took.read_text())
    assert code == 0
    stage = json.loads(shown.read_text())["stages"]["estimate"]
    with metrics.open() as stream:
        nees = next(float(row["value"]) for row in csv.DictReader(stream) if "nees_mean" in row.values())
    error = next(row for row in stage["sections"]["errors"] if row["error_of"] == "position on one axis")
    return Estimated(error["estimated"], nees, {entry["topic"]: entry for entry in stage["inputs"]}, peak_mb)


def edited(messages: list[Logged], topic: str, number: int, edit: Callable[[Logged], Logged]) -> list[Logged]:
    """The messages with that one of a topic changed; a negative number counts from the end."""
    own = [k for k, each in enumerate(messages) if each.topic == topic]
    return [edit(each) if k == own[number] else each for k, each in enumerate(messages)]


def logged_at_one(each: Logged) -> Logged:
    return replace(each, log_time_ns=1)


def logged_years_later(each: Logged) -> Logged:
    return replace(each, log_time_ns=each.log_time_ns + TEN_YEARS_S * NS_PER_S)


def stamped(seconds: Callable[[int], int]) -> Callable[[Logged], Logged]:
    """With another whole second in its header."""

    def edit(each: Logged) -> Logged:
        data = bytearray(each.data)
        (stamp_s,) = struct.unpack_from("<i", data, STAMP_AT)
        struct.pack_into("<i", data, STAMP_AT, seconds(stamp_s))
        return replace(each, data=bytes(data))

    return edit


stamped_1970 = stamped(lambda _: 0)
stamped_years_later = stamped(lambda stamp_s: stamp_s + TEN_YEARS_S)


def stamped_with_too_many_nanoseconds(each: Logged) -> Logged:
    """4.3 s in a field that holds less than one."""
    return replace(each, data=each.data[: STAMP_AT + 4] + b"\xff" * 4 + each.data[STAMP_AT + 8 :])


FAULTS: dict[str, tuple[int, tuple[Callable[[Logged], Logged], ...], str]] = {
    "logged at 1 ns, the first": (0, (logged_at_one,), STRAY_LOG_TIME_REASON),
    "logged and stamped in 1970": (100, (logged_at_one, stamped_1970), STRAY_LOG_TIME_REASON),
    "the last logged years later": (-1, (logged_years_later,), STRAY_LOG_TIME_REASON),
    "the last logged and stamped years later": (-1, (logged_years_later, stamped_years_later), STRAY_LOG_TIME_REASON),
    "stamped years later": (100, (stamped_years_later,), CLOCK_JUMP_REASON),
    "the first stamped years earlier": (0, (stamped(lambda stamp_s: stamp_s - TEN_YEARS_S),), CLOCK_JUMP_REASON),
    "stamped with too many nanoseconds": (100, (stamped_with_too_many_nanoseconds,), NO_STAMP_REASON),
    "not stamped": (
        100,
        (stamped_1970, lambda each: replace(each, data=without_nanoseconds(each.data))),
        NO_STAMP_REASON,
    ),
}
"""Which message, what is done to it, and what is told."""


def without_nanoseconds(data: bytes) -> bytes:
    return data[: STAMP_AT + 4] + bytes(4) + data[STAMP_AT + 8 :]


CleanOf = Callable[[Path], tuple[list[Logged], Estimated]]


def options_of(log: Path) -> tuple[str, ...]:
    """How a log is estimated: on the longer drives one message less moves a found latency, and that the position."""
    if log == KITTI:
        return ("--topic", "truth=/truth/pose_imu", "--truth-origin", "48.9825,8.3904,116.4")
    return ("--latency", "none") if log.stem in ("straight", "curve") else ()


@pytest.fixture(scope="session")
def clean_of(tmp_path_factory: pytest.TempPathFactory) -> CleanOf:
    """The messages of a log, and what is estimated from it as it is."""
    known: dict[Path, tuple[list[Logged], Estimated]] = {}

    def find(log: Path) -> tuple[list[Logged], Estimated]:
        if log not in known:
            messages, copy = read(log), tmp_path_factory.mktemp(log.stem) / "in.mcap"
            write(copy, messages)
            known[log] = messages, estimate(copy, *options_of(log))
        return known[log]

    return find


def check(found: Estimated, clean: Estimated, topic: str, told: str) -> None:
    assert found.position_error_m == pytest.approx(clean.position_error_m, rel=ATOL_PART)
    assert 0.0 < found.position_nees < 2.0 * clean.position_nees
    assert found.peak_mb < max(MOST_MB, 1.1 * clean.peak_mb)
    for name, entry in found.inputs.items():
        assert {**entry["rejected"], **entry["repaired"]} == ({told: 1} if name == topic else {}), name
        assert entry["read"] == clean.inputs[name]["read"]
        assert entry["used"] == entry["read"] - sum(entry["rejected"].values())


CHANNELS = [
    *((SAMPLES / "intersection.mcap", topic) for topic in (*SENSORS, *OTHERS)),
    *((SAMPLES / "rear-end.mcap", topic) for topic in (*SENSORS, *OTHERS)),
    *((SAMPLES / f"{name}.mcap", topic) for name in ("straight", "curve") for topic in (*SENSORS, "/truth/ego")),
    *((KITTI, topic) for topic in ("/gps/fix", "/imu/data", "/truth/pose_imu")),
]
"""Each channel of one log and one of each other log in every run, the others with `--long`."""


@pytest.mark.parametrize(
    ("log", "topic"),
    [
        pytest.param(
            *each,
            marks=() if each[0].stem == "intersection" or each[1] == "/imu/data" else pytest.mark.long,
            id=f"{each[0].stem[:12]}-{each[1]}",
        )
        for each in CHANNELS
    ],
)
def test_message_logged_at_one_nanosecond_is_left_out(clean_of: CleanOf, tmp_path: Path, log: Path, topic: str) -> None:
    if not log.exists():
        pytest.skip(f"the development log {log.name} is not in ../shared/logs")
    messages, clean = clean_of(log)
    write(tmp_path / "in.mcap", edited(messages, topic, 100, logged_at_one))
    check(estimate(tmp_path / "in.mcap", *options_of(log)), clean, topic, STRAY_LOG_TIME_REASON)


@pytest.mark.parametrize(("topic", "fault"), diagonal(SENSORS, FAULTS))
def test_message_with_an_absurd_time_leaves_the_estimate_as_it_was(
    clean_of: CleanOf, tmp_path: Path, topic: str, fault: str
) -> None:
    damaged, clean = clean_of(SAMPLES / "intersection.mcap")
    number, edits, told = FAULTS[fault]
    for edit in edits:
        damaged = edited(damaged, topic, number, edit)
    write(tmp_path / "in.mcap", damaged)
    check(estimate(tmp_path / "in.mcap"), clean, topic, told)


def test_strict_refuses_a_message_logged_at_one_nanosecond(cwcli: Run, clean_of: CleanOf, tmp_path: Path) -> None:
    messages, _ = clean_of(SAMPLES / "intersection.mcap")
    write(tmp_path / "in.mcap", edited(messages, "/imu/data", 100, logged_at_one))
    done = cwcli("estimate", "in.mcap", "-o", "out.mcap", "--strict")
    assert done.returncode == 5
    assert f"/imu/data rejected: 1 {STRAY_LOG_TIME_REASON}" in done.stderr.decode()
    assert [path.name for path in tmp_path.iterdir()] == ["in.mcap"]


@pytest.mark.parametrize("topic", ["/lidar/objects", "/radar/scan", "/truth/target"])
def test_detection_logged_at_one_nanosecond_is_left_out(cwcli: Run, tmp_path: Path, topic: str) -> None:
    if not UDACITY.exists():
        pytest.skip(f"the development log {UDACITY.name} is not in ../shared/logs")
    messages = read(UDACITY)
    entries, errors_m = [], []
    for name, logged in (("clean.mcap", messages), ("in.mcap", edited(messages, topic, 100, logged_at_one))):
        write(tmp_path / name, logged)
        done = cwcli("track", name, "--json")
        assert done.returncode == 0, done.stderr.decode()
        stage = json.loads(done.stdout)["stages"]["track"]
        entries.append(next(each for each in stage["inputs"] if each["topic"] == topic))
        (row,) = stage["sections"]["errors"]
        errors_m.append((row["x_m"], row["y_m"]))
    assert entries[1]["rejected"] == {STRAY_LOG_TIME_REASON: 1}
    assert entries[1]["read"] == entries[0]["read"] == entries[1]["used"] + 1
    np.testing.assert_allclose(errors_m[1], errors_m[0], rtol=ATOL_PART)


@pytest.fixture(scope="module")
def road(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Logged], float]:
    """Three seconds of a lane with a camera, and how wrong the lateral deviation of the observer is."""
    log = tmp_path_factory.mktemp("road") / "in.mcap"
    assert run_command_line(["simulate", "road", "-o", str(log), "--quiet", "--set", "duration_s=3"]) == 0
    messages = read(log)
    write(log, messages)
    return messages, lateral_error_m(log)[0]


def lateral_error_m(log: Path) -> tuple[float, dict[str, dict[str, int]]]:
    """That of `cwcli run`, which must end with 0; and what is rejected of each topic by the lanes and the observer."""
    target = log.with_suffix(".json")
    with target.open("wb") as stdout:
        command = [sys.executable, "-m", "cwcli", "run", str(log), "--json"]
        subprocess.run(command, check=True, cwd=ROOT, stdout=stdout, env=os.environ | {"PYTHONPATH": str(ROOT)})
    stages = json.loads(target.read_text())["stages"]
    errors = {each["state"]: each["rms"] for each in stages["observe"]["sections"]["observer_errors"]}
    rejected = {each["topic"]: each["rejected"] for name in ("lanes", "observe") for each in stages[name]["inputs"]}
    return errors["lateral_deviation_m"], rejected


CAMERAS = ("/camera/calibration", "/tf", "/vehicle/velocity", "/imu/data", "/truth/lateral")


@pytest.mark.parametrize(("topic", "time_ns"), diagonal(CAMERAS, [1, 1 << 63, (1 << 64) - 1]))
def test_message_beside_a_camera_that_was_logged_at_no_time(
    road: tuple[list[Logged], float], tmp_path: Path, topic: str, time_ns: int
) -> None:
    messages, clean_m = road
    write(tmp_path / "in.mcap", edited(messages, topic, 2, lambda each: replace(each, log_time_ns=time_ns)))
    found_m, rejected = lateral_error_m(tmp_path / "in.mcap")
    assert found_m == pytest.approx(clean_m, rel=ATOL_PART)
    assert all(sum(each.values()) <= (name == topic) for name, each in rejected.items())


@pytest.mark.parametrize("time_ns", [1, (1 << 64) - 1])
def test_frame_that_was_logged_at_no_time_harms_no_other(
    road: tuple[list[Logged], float], tmp_path: Path, time_ns: int
) -> None:
    """It comes first or last then, and the search begins anew: the lanes are those of a log without it."""
    messages, _ = road
    moved = edited(messages, "/camera/image", 2, lambda each: replace(each, log_time_ns=time_ns))
    write(tmp_path / "in.mcap", moved)
    write(tmp_path / "without.mcap", [each for each in moved if each.log_time_ns != time_ns])
    found_m, _ = lateral_error_m(tmp_path / "in.mcap")
    assert found_m == pytest.approx(lateral_error_m(tmp_path / "without.mcap")[0], rel=ATOL_PART)


@pytest.mark.parametrize("command", ["predict", "warn", "measure", "control"])
def test_a_state_that_was_logged_at_no_time(predicted: Path, tmp_path: Path, cwcli: Run, command: str) -> None:
    """One of the states that the stages start from says 2^64 - 1 ns."""
    log, target = tmp_path / "in.mcap", tmp_path / "out.mcap"
    messages = read(predicted)
    k = [k for k, each in enumerate(messages) if each.topic == EGO_ONLINE.topic][20]
    write(log, [*messages[:k], *messages[k + 1 :], replace(messages[k], log_time_ns=(1 << 64) - 1)])
    done = cwcli(command, log, "-o", target, "--replace", "--json")
    assert done.returncode in (0, 5), done.stderr.decode()
    assert target.exists() == (done.returncode == 0)
    if command == "predict":
        inputs = {each["topic"]: each for each in json.loads(done.stdout)["stages"]["predict"]["inputs"]}
        assert inputs[EGO_ONLINE.topic]["rejected"] == {INVALID_LOG_TIME_REASON: 1}
    if done.returncode:
        assert b"would be logged before 1970" in done.stderr
