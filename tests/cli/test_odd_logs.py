"""Logs that are whole and still odd: the command line says what is wrong, or counts it and goes on."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path

import pytest

from tests.cli.conftest import Run
from tests.cli.rewritten_logs import Edit, Logged, of, read, write

HOUR_NS = 3_600_000_000_000
STAMP_AT = 4  # behind the encapsulation header
SENSORS = ("/gps/fix", "/gps/heading", "/vehicle/velocity", "/imu/data")


@pytest.fixture(scope="session")
def messages(intersection: Path) -> list[Logged]:
    """Those of the bundled log."""
    return read(intersection)


def unknown_encoding(each: Logged) -> Logged:
    return replace(each, encoding="ros1")


def endless_array(each: Logged) -> Logged:
    text = b"float64[4000000000] latitude\nfloat64 longitude\n"
    return replace(each, schema=(each.schema[0], "ros2msg", text))


def beyond_int64(each: Logged) -> Logged:
    return replace(each, log_time_ns=(1 << 63) + each.log_time_ns % HOUR_NS)


@pytest.mark.parametrize(
    ("edit", "code", "words"),
    [
        (of("/gps/fix", unknown_encoding), 3, "ros1"),
        (of("/gps/fix", endless_array), 3, "too long"),
        (beyond_int64, 5, "log time"),
    ],
    ids=["unknown encoding", "array of 4e9 elements", "log times of 2^63"],
)
def test_odd_log_is_refused_in_one_line(
    cwcli: Run, messages: list[Logged], tmp_path: Path, edit: Edit, code: int, words: str
) -> None:
    write(tmp_path / "in.mcap", map(edit, messages))
    done = cwcli("run", "in.mcap", "-o", "out.mcap")
    shown = done.stderr.decode()
    assert done.returncode == code, shown
    assert shown.startswith("error: in.mcap")
    assert words in shown.splitlines()[0]
    assert [path.name for path in tmp_path.iterdir()] == ["in.mcap"]


def test_pause_of_five_hours_has_no_states(cwcli: Run, messages: list[Logged], tmp_path: Path) -> None:
    half_ns = messages[len(messages) // 2].log_time_ns

    def after_the_pause(each: Logged) -> Logged:
        if each.log_time_ns <= half_ns:
            return each
        data = bytearray(each.data)
        if each.topic in SENSORS:
            (seconds,) = struct.unpack_from("<i", data, STAMP_AT)
            struct.pack_into("<i", data, STAMP_AT, seconds + 5 * 3600)
        return replace(each, log_time_ns=each.log_time_ns + 5 * HOUR_NS, data=bytes(data))

    kept = [each for each in messages if not each.topic.startswith(("/truth", "/simulation"))]
    write(tmp_path / "in.mcap", map(after_the_pause, kept))
    done = cwcli("run", "in.mcap", "-o", "out.mcap", "--json")
    assert done.returncode == 0, done.stderr.decode()
    inputs = json.loads(done.stdout)["stages"]["predict"]["inputs"]
    ego = next(entry for entry in inputs if entry["topic"] == "/cwcli/ego/online")
    assert 190 <= ego["read"] <= 202


def test_run_without_a_usable_message_of_another_vehicle_leaves_out_the_warnings(
    cwcli: Run, messages: list[Logged], tmp_path: Path
) -> None:
    write(tmp_path / "in.mcap", map(of("/v2x/bsm", lambda each: replace(each, data=b"{")), messages))
    done = cwcli("run", "in.mcap", "-o", "out.mcap", "--json")
    assert done.returncode == 0, done.stderr.decode()
    document = json.loads(done.stdout)
    assert document["left_out"]["warn"] == "no message of another vehicle could be used"
    assert list(document["stages"]) == ["estimate", "predict"]
