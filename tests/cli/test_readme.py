"""What README.md claims: its commands run, its numbers come out, and its picture is small.

Its claims on imports and copies are tried where those are tested: each kind of file in
unit/importing/test_forty_files.py, messages byte for byte in unit/logs_write. Its digest and exit codes are compared in
test_reference.py, its demo runs in .ci/run, and what it says of a script without cwcli is tried in
peers/test_without_cwcli.py.
"""

from __future__ import annotations

import re
import shlex
import shutil
import socket
import tomllib
from pathlib import Path

import pytest

from cwcli.cli.main import run_command_line
from cwcli.importing.readers import DESCRIPTION_PLACE_BY_FILE_KIND
from tests.cli.conftest import ROOT, SAMPLES, Run
from tests.unit.importing.files import can_asc, csv_logger, sensor_logger

README = (ROOT / "README.md").read_text(encoding="utf-8")
MAX_PICTURE_BYTES = 120_000
"""Most bytes of the picture at the top: what a slow phone loads in a second."""


def test_the_three_commands_run(cwcli: Run, tmp_path: Path) -> None:
    block = README[README.index("<!-- three -->") :].partition("<!-- end -->")[0]
    commands = [shlex.split(line, comments=True)[1:] for line in block.splitlines() if line.startswith("    cwcli ")]
    assert [command[0] for command in commands] == ["info", "run", "report"]
    for command in commands:
        arguments = [str(ROOT / word) if word.startswith("sample_logs/") else word for word in command]
        assert cwcli(*arguments).returncode == 0
    assert (tmp_path / "report.html").read_bytes().startswith(b"<!")


def test_the_picture_is_small() -> None:
    (picture,) = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", README)
    assert (ROOT / picture).stat().st_size < MAX_PICTURE_BYTES


KIND_BY_WORD = {
    "CSV": "csv", "Parquet": "parquet", "GPX": "gpx", "KML": "kml", "NMEA": "nmea", "RTKLIB": "rtklib", "VBOX": "vbox",
    "u-blox": "ubx", "TUM": "tum", "KITTI": "kitti", "EuRoC": "euroc", "Sensor Logger": "zip", "phyphox": "zip",
    "GNSSLogger": "gnsslogger", "ASC": "asc", "BLF": "blf", "TRC": "trc", "candump": "candump",
}  # fmt: skip
"""Words of the table of what it reads -> the kind of file that can be imported."""


def table_of_inputs() -> list[tuple[str, str]]:
    """The rows of the table "You have, it reads"."""
    section = README[README.index("## You have, it reads") :].partition("\n## ")[0]
    rows = re.findall(r"^\| (.+?) \| (.+) \|$", section, re.MULTILINE)
    return [row for row in rows if row[0] != "you have"]


def test_every_kind_that_is_named_can_be_imported() -> None:
    named = [
        word
        for have, reads in table_of_inputs()
        if "cwcli import" in reads
        for word in re.split(r", | \(|\)| and a DBC", have)
        if word not in {"", "a phone", "CAN traces"}
    ]
    assert sorted(named) == sorted(KIND_BY_WORD)
    assert {KIND_BY_WORD[word] for word in named} <= set(DESCRIPTION_PLACE_BY_FILE_KIND)


def test_commands_of_the_table_run(cwcli: Run, tmp_path: Path) -> None:
    commands = [
        shlex.split(command)[1:] for _, reads in table_of_inputs() for command in re.findall(r"`(cwcli [^`]+)`", reads)
    ]
    assert [command[0] for command in commands] == ["import", "import", "import", "run", "simulate"]
    shutil.move(csv_logger(tmp_path)[0], tmp_path / "drive.csv")
    shutil.move(sensor_logger(tmp_path)[0], tmp_path / "recording.zip")
    trace, dbc = can_asc(tmp_path)
    shutil.move(trace, tmp_path / "trace.asc")
    shutil.move(dbc, tmp_path / "car.dbc")
    (tmp_path / "logs").mkdir()
    shutil.copy(SAMPLES / "intersection.mcap", tmp_path / "logs")
    for command in commands:
        done = cwcli(*command, "--force")  # the imports write the same file
        assert done.returncode == 0, (command, done.stderr.decode())
    assert (tmp_path / "out/manifest.json").is_file()


def test_it_works_offline(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: object, **options: object) -> None:
        raise AssertionError("it wants a network")

    for name in ("socket", "create_connection", "getaddrinfo"):
        monkeypatch.setattr(socket, name, refuse)
    annotated, page = str(tmp_path / "a.mcap"), tmp_path / "r.html"
    assert run_command_line(["run", str(SAMPLES / "intersection.mcap"), "-o", annotated, "-q"]) == 0
    assert run_command_line(["report", annotated, "-o", str(page), "-q"]) == 0
    assert not re.search(rb"""(?:src|href)=["']?https?:""", page.read_bytes())


def test_it_needs_what_it_says() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    version = project["requires-python"].removeprefix(">=")
    assert f"Linux, Python {version} or newer" in " ".join(README.split())
    assert [each for each in project["classifiers"] if each.startswith("Operating System")] == [
        "Operating System :: POSIX :: Linux"
    ]
