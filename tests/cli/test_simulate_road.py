"""`cwcli simulate road` as a process of its own."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

Run = Callable[..., "subprocess.CompletedProcess[bytes]"]
SHORT = ("--set", "duration_s=0.3", "--set", "rate_hz=10")


def test_writes_a_log_that_info_reads(cwcli: Run, tmp_path: Path) -> None:
    made = cwcli("simulate", "road", "--weather", "rain", "--seed", "3", *SHORT, "-o", "road.mcap", "--json")
    assert made.returncode == 0, made.stderr.decode()
    document = json.loads(made.stdout)
    assert (document["scenario"], document["seed"]) == ("road", 3)
    assert {entry["topic"]: entry["messages"] for entry in document["channels"]}["/camera/image"] == 4
    info = cwcli("info", "road.mcap")
    assert info.returncode == 0
    for role in (b"camera", b"camera_info", b"ego_speed", b"imu", b"truth"):
        assert role in info.stdout


def test_goes_into_a_pipe(cwcli: Run) -> None:
    made = cwcli("simulate", "road", *SHORT, "-o", "-")
    assert made.returncode == 0
    assert made.stdout.startswith(b"\x89MCAP0\r\n")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("road", "--weather", "hail"), b"no weather 'hail'"),
        (("road", "--set", "size=1x1"), b"can't be rendered"),
        (("straight", "--weather", "rain"), b"only a rendered drive has a weather"),
        (("road", "--seed", "-1"), b"must not be negative"),
    ],
)
def test_wrong_use_is_one_line_and_code_2(
    cwcli: Run, tmp_path: Path, arguments: tuple[str, ...], message: bytes
) -> None:
    made = cwcli("simulate", *arguments, "-o", "road.mcap")
    assert made.returncode == 2
    assert message in made.stderr
    assert not (tmp_path / "road.mcap").exists()
