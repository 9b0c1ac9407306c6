"""docs/cookbook.md: each recipe's commands, run word for word on a log like the one that it is about."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from mcap_ros2.writer import Writer

from cwcli.cli.main import run_command_line
from tests.cli.conftest import ROOT, SAMPLES
from tests.cli.rewritten_logs import read, write
from tests.cli.test_evaluate_system import flag
from tests.cli.test_map import DBC, write_log
from tests.laws.receiver_messages import DEFINITIONS, RECEIVER_SAMPLES

PAGE = (ROOT / "docs" / "cookbook.md").read_text(encoding="utf-8")
RECIPES: dict[str, str] = dict(re.findall(r"<!-- recipe: ([\w ]+) -->\n(.*?)<!-- end -->", PAGE, re.DOTALL))
T0_NS = 1_700_000_000_000_000_000


def ublox(folder: Path) -> None:
    with (folder / "drive.mcap").open("wb") as stream:
        writer = Writer(stream)
        schema = writer.register_msgdef("ublox_msgs/msg/NavPVT", DEFINITIONS["ublox_msgs/NavPVT"])
        for k in range(100):  # north at 10 m/s: 2 m are 1.798e-5 degrees there
            message, _ = RECEIVER_SAMPLES["ublox_msgs/NavPVT"](0)
            sec, nano = divmod(200_000_000 * k, 1_000_000_000)
            message |= {"sec": 10 + sec, "nano": nano, "lat": 481_250_000 + round(179.8 * k), "h_acc": 500}
            message |= {"vel_n": 10_000, "vel_e": 0, "head_veh": 0}
            at_ns = T0_NS + k * 200_000_000
            writer.write_message("/ublox/navpvt", schema, message, at_ns, at_ns)
        writer.finish()


def two_receivers(folder: Path) -> None:
    """The bundled curve's fixes, every second of which comes from another topic."""
    messages, n = [], 0
    for each in read(SAMPLES / "curve.mcap"):
        if each.topic == "/gps/fix":
            n += 1
            messages.append(replace(each, topic="/gps/front" if n % 2 else "/gps/rear"))
        else:
            messages.append(each)
    write(folder / "drive.mcap", messages)


def can(folder: Path) -> None:
    write_log(folder / "my.mcap")
    (folder / "car.dbc").write_text(DBC)


def split(folder: Path) -> None:
    messages = read(SAMPLES / "intersection.mcap")
    (folder / "drive").mkdir()
    for k in range(3):
        write(folder / "drive" / f"drive_{k}.mcap", messages[k * len(messages) // 3 : (k + 1) * len(messages) // 3])


def fcw(folder: Path) -> None:
    messages = read(SAMPLES / "intersection.mcap")
    both = sorted([*messages, *flag(messages[0].log_time_ns)], key=lambda each: each.log_time_ns)
    write(folder / "drive.mcap", both)


LOGS: dict[str, Callable[[Path], None]] = {
    "ublox": ublox,
    "two receivers": two_receivers,
    "can": can,
    "field": can,
    "split": split,
    "fcw": fcw,
    "critical": fcw,
}
MADE = {
    "ublox": ("drive.gpx", b"<trkpt"),
    "two receivers": ("motion.png", b"\x89PNG"),
    "can": ("estimated.mcap", b"/cwcli/ego/state"),
    "field": ("estimated.mcap", b"/cwcli/ego/state"),
    "split": ("annotated.mcap", b"/cwcli/warnings"),
    "fcw": ("report.html", b"other system"),
    "critical": ("measures.csv", b"ttc_s"),
}
"""What the last command leaves, and something in it."""


def test_every_recipe_is_run() -> None:
    assert set(RECIPES) == set(LOGS) == set(MADE)


@pytest.mark.parametrize("name", LOGS)
def test_recipe(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    LOGS[name](tmp_path)
    monkeypatch.chdir(tmp_path)
    commands = [shlex.split(line.strip()) for line in RECIPES[name].splitlines() if line.strip()]
    assert commands
    for program, *arguments in commands:
        assert program == "cwcli"
        assert run_command_line(arguments) == 0, capsys.readouterr().err
    file, content = MADE[name]
    assert content in (tmp_path / file).read_bytes()


def test_both_receivers_are_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    two_receivers(tmp_path)
    monkeypatch.chdir(tmp_path)
    (first, _) = (shlex.split(line.strip())[1:] for line in RECIPES["two receivers"].splitlines())
    assert run_command_line([*first, "--details"]) == 0
    told = capsys.readouterr().out
    assert re.search(r"/gps/front +position +\d", told) and re.search(r"/gps/rear +position +\d", told)
