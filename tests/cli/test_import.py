"""`cwcli import`: the log, the mapping beside it, and what it prints."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_DONE, EXIT_PIPE_CLOSED, EXIT_USAGE
from cwcli.logs.format.faults import not_mcap_error
from cwcli.logs.read.reader import Log
from tests.cli.conftest import ROOT

ROWS = "".join(f"{1_700_000_000 + k},{48.1 + k * 1e-4:.5f},11.5,40.03\n" for k in range(60))
"""A car that drives north at 11.12 m/s, 40.03 km/h."""


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    path = tmp_path / "drive.csv"
    path.write_text("time,lat,lon,speed\n" + ROWS)
    return path


def test_import_writes_a_log_and_its_mapping(drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "log.mcap"
    assert run_command_line(["import", str(drive), "-o", str(target)]) == 0
    said = capsys.readouterr().out
    assert "kmh" in said
    assert "likely" in said
    with Log.open(target) as log:
        assert {channel.topic for channel in log.channels} == {"/gps/fix", "/vehicle/twist"}
        assert "cwcli.import" in dict(log.metadata)
    assert 'speed = "speed*kmh"  # likely: 3.6' in (tmp_path / "log.import.toml").read_text()


def test_log_on_standard_output_is_that_in_a_file(drive: Path, tmp_path: Path) -> None:
    """The process that imports has a standard output of its own, for what it answers."""
    assert run_command_line(["import", str(drive), "-o", str(tmp_path / "log.mcap"), "--quiet"]) == 0
    command = [sys.executable, "-m", "cwcli", "import", str(drive), "-o", "-", "--quiet"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, check=True)
    assert done.stdout == (tmp_path / "log.mcap").read_bytes()
    closed = subprocess.run(
        ["bash", "-c", '"$@" | head -c 8; exit ${PIPESTATUS[0]}', "-", *command], cwd=ROOT, check=False
    )
    assert closed.returncode in {EXIT_DONE, EXIT_PIPE_CLOSED}


def test_estimate_reads_the_log_without_an_option(drive: Path, tmp_path: Path) -> None:
    target = tmp_path / "log.mcap"
    assert run_command_line(["import", str(drive), "-o", str(target), "--quiet"]) == 0
    assert run_command_line(["estimate", str(target), "-o", str(tmp_path / "states.mcap"), "--quiet"]) == 0


def test_url_is_no_file_to_import(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    url = "https://user:pl4nt3d@host/drive.csv?sig=pl4nt3d"
    assert run_command_line(["import", url, "-o", str(tmp_path / "log.mcap")]) == EXIT_USAGE
    said = capsys.readouterr().err
    assert "imported from this machine alone" in said and "pl4nt3d" not in said
    hint = not_mcap_error("https://host/drive.csv", b"time,lat,lon\n").hint
    assert hint.endswith("cwcli import FILE -o log.mcap")


def test_preview_writes_nothing(drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["import", str(drive), "--preview", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [each["topic"] for each in document["channels"]] == ["/gps/fix", "/vehicle/twist"]
    assert document["guesses"][0] == {
        "table": str(drive), "quantity": "time", "column": "time", "unit": "s", "confidence": "likely",
        "why": "the numbers are s since 1970",
    }  # fmt: skip
    assert document["written"] is None
    assert sorted(path.name for path in tmp_path.iterdir()) == ["drive.csv"]


def test_mapping_that_was_edited(drive: Path, tmp_path: Path) -> None:
    target, again = tmp_path / "log.mcap", tmp_path / "again.mcap"
    assert run_command_line(["import", str(drive), "-o", str(target), "--quiet"]) == 0
    mapping = tmp_path / "log.import.toml"
    mapping.write_text(mapping.read_text().replace('speed = "speed*kmh"', 'speed = ""'))
    assert run_command_line(["import", str(drive), "-o", str(again), "--mapping", str(mapping), "--quiet"]) == 0
    with Log.open(again) as log:
        assert [channel.topic for channel in log.channels] == ["/gps/fix"]


def test_question_is_one_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "drive.csv"
    path.write_text("time,speed\n1700000000,1\n1700000001,2\n1700000002,4\n")
    assert run_command_line(["import", str(path), "-o", str(tmp_path / "log.mcap")]) == 4
    said = capsys.readouterr().err
    assert said.startswith(f"error: {path}: 'speed' has no unit")
    assert "hint:  --column speed='speed*mps' or --column speed='speed*kmh'" in said
    assert not (tmp_path / "log.mcap").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["drive.csv"], "no output is named"),
        (["drive.csv", "-o", "log.mcap", "--column", "velocity=v"], "there is no quantity 'velocity'"),
        (["drive.csv", "-o", "log.mcap", "--column", "speed"], "expected QUANTITY=COLUMN"),
        (["drive.csv", "-o", "log.mcap", "--date-order", "ydm"], "it must be one of dmy, mdy and ymd"),
        (["drive.csv", "-o", "log.mcap", "--mapping", "nowhere.toml"], "the mapping can't be read"),
    ],
)
def test_wrong_usage(
    arguments: list[str], words: str, drive: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(drive.parent)
    assert run_command_line(["import", *arguments]) == 2
    assert words in capsys.readouterr().err


def test_file_that_exists_is_not_overwritten(drive: Path, tmp_path: Path) -> None:
    (tmp_path / "log.import.toml").write_text("my own\n")
    assert run_command_line(["import", str(drive), "-o", str(tmp_path / "log.mcap")]) == 6
    assert not (tmp_path / "log.mcap").exists()
    assert (tmp_path / "log.import.toml").read_text() == "my own\n"


@pytest.mark.parametrize("command", ["info", "estimate", "evaluate"])
def test_other_commands_name_import(command: str, drive: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line([command, str(drive)]) != 0
    assert f"cwcli import {drive} -o log.mcap" in capsys.readouterr().err


def test_run_imports_by_itself(drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "states.mcap"
    drive = drive.rename(tmp_path / "my drive.csv")
    assert run_command_line(["run", str(drive), "--stage", "estimate", "-o", str(target)]) == 0
    printed = capsys.readouterr()
    assert f"cwcliimport'{drive}'--preview".replace(" ", "") in "".join(printed.err.split())
    assert len(printed.out.splitlines()) + 1 <= 12
    assert "damaged" not in printed.out
    with Log.open(target) as log:
        assert "/cwcli/ego/state" in {channel.topic for channel in log.channels}


def test_run_asks_where_a_file_is_ambiguous(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "drive.csv"
    path.write_text("time,speed\n1700000000,1\n1700000001,2\n1700000002,4\n")
    assert run_command_line(["run", str(path)]) == 4
    assert f"cwcli import {path} -o log.mcap, with --column speed" in capsys.readouterr().err
