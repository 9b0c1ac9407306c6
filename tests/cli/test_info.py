"""`cwcli info`: quick, complete, and honest about what is missing."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import Run

HEAVY = (
    *("numpy", "pyarrow", "pydantic", "rich", "mcap", "google.protobuf", "cv2", "pyproj", "scipy"),
    *("matplotlib", "plotly", "jinja2", "ray", "fsspec"),
)


def test_info_tells_channels_rates_roles_and_commands(cwcli: Run, intersection: Path) -> None:
    done = cwcli("info", intersection)
    shown = done.stdout.decode()
    assert done.returncode == 0
    assert done.stderr == b""
    for expected in ("/gps/fix", "sensor_msgs/msg/", "cdr", "ego_position", "20.0", "10.0 s", "201"):
        assert expected in shown
    assert max(map(len, shown.splitlines())) <= 80
    assert "\x1b" not in shown


def test_info_json(cwcli: Run, intersection: Path) -> None:
    from mcap.reader import make_reader

    document = json.loads(cwcli("info", intersection, "--json").stdout)
    with intersection.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert document["messages"] == summary.statistics.message_count
    assert document["start_ns"] == summary.statistics.message_start_time
    assert document["end_ns"] == summary.statistics.message_end_time
    assert document["chunks"] == summary.statistics.chunk_count
    assert {channel["topic"]: channel["messages"] for channel in document["channels"]} == {
        channel.topic: summary.statistics.channel_message_counts[channel.id] for channel in summary.channels.values()
    }
    assert document["commands"]["estimate"] == {
        "ready": True,
        "after": [],
        "missing": [],
        "choose": [],
        "would_use": ["ego_velocity"],
    }
    assert document["commands"]["warn"]["after"] == ["estimate", "predict"]


def test_info_names_what_is_missing(cwcli: Run, intersection: Path) -> None:
    straight = intersection.with_name("straight.mcap")
    document = json.loads(cwcli("info", straight, "--json").stdout)
    assert document["commands"]["warn"] == {
        "ready": False,
        "after": [],
        "missing": ["remote"],
        "choose": [],
        "would_use": [],
    }


def test_info_imports_nothing_heavy(intersection: Path) -> None:
    code = f"""
import sys
from cwcli.cli.main import run_command_line
assert run_command_line(["info", {str(intersection)!r}]) == 0
loaded = [name for name in {HEAVY!r} if name in sys.modules]
print("loaded:", loaded, file=sys.stderr)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == "loaded: []\n"


@pytest.mark.parametrize(
    ("content", "code"), [(b"", 3), (b"no log at all", 3), (b"\x89MCAP0\r\n", 3)], ids=["empty", "text", "magic-only"]
)
def test_info_of_what_is_no_log(cwcli: Run, tmp_path: Path, content: bytes, code: int) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    done = cwcli("info", path)
    assert done.returncode == code
    assert done.stdout == b""
    assert done.stderr.startswith(b"error: ")
    assert b"Traceback" not in done.stderr


def test_info_of_a_file_that_is_not_there(cwcli: Run) -> None:
    done = cwcli("info", "none.mcap")
    assert done.returncode == 3
    assert b"none.mcap" in done.stderr


def test_info_reads_standard_input(cwcli: Run, intersection: Path) -> None:
    with intersection.open("rb") as file:
        done = cwcli("info", "-", "--json", stdin=file)
    assert done.returncode == 0
    assert json.loads(done.stdout)["name"] == "<stdin>"


def test_info_quiet_prints_nothing(cwcli: Run, intersection: Path) -> None:
    done = cwcli("info", intersection, "--quiet")
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")
