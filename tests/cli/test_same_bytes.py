"""Outputs are the same bytes whatever the locale, time zone, seed of hashes and number of threads and jobs are."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import ROOT, SAMPLES

LOGS: tuple[Path | tuple[str, ...], ...] = (
    *sorted(SAMPLES.glob("*.mcap")),
    ("simulate", "city", "--seed", "3"),
    ("simulate", "rear-end", "--seed", "7"),
)
"""Bundled logs, and commands that make others."""
ENVIRONMENTS = (
    {"PYTHONHASHSEED": "0", "TZ": "UTC", "LC_ALL": "C", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    {"PYTHONHASHSEED": "7", "TZ": "Asia/Kathmandu", "LC_ALL": "C.UTF-8", "OMP_NUM_THREADS": "2"},
    {"PYTHONHASHSEED": "99", "TZ": "America/St_Johns", "LC_ALL": "POSIX", "OMP_NUM_THREADS": "4", "COLUMNS": "40"},
)
COMMANDS = (
    ("run", "LOG", "-o", "all.mcap", "--metrics-dir", "tables"),
    ("estimate", "LOG", "-o", "states.mcap"),
    ("cut", "LOG", "--start", "1", "--end", "3", "-o", "cut.mcap"),
    ("export", "all.mcap", "--what", "ego", "-o", "ego.csv"),
    ("export", "all.mcap", "--format", "ros2", "-o", "ros.mcap"),
    ("export", "all.mcap", "--what", "ego", "--format", "gpx", "-o", "ego.gpx"),
    ("import", "ego.gpx", "-o", "again.mcap"),
    ("report", "all.mcap", "-o", "page.html"),
    ("layout", "all.mcap", "-o", "layout.json"),
)
"""In this order: some read what those before them have written."""
COMMANDS_FOR_OTHER_VEHICLES = (
    ("warn", "paths.mcap", "-o", "warned.mcap"),
    ("control", "all.mcap", "-o", "controlled.mcap", "--replace"),
    ("measure", "all.mcap", "-o", "measured.mcap", "--replace"),
    ("compare", "all.mcap", "measured.mcap", "--markdown", "compared.md", "--metrics", "compared.csv"),
)
"""Those that need other vehicles in the log."""
LOGS_WITHOUT_OTHER_VEHICLES = {3, 4}
"""Numbers of the logs that hold no other vehicle."""
MORE_COMMANDS = (
    ("predict", "states.mcap", "-o", "paths.mcap"),
    ("join", "LOG", "OTHER", "--role", "remote", "-o", "joined.mcap"),
    ("calibrate", "LOG", "OTHER", "-o", "car.toml"),
    ("find", "all.mcap", "all", "-o", "found.csv", "--clips", "clips", "--report", "found.html"),
    ("evaluate", "all.mcap", "--metrics", "scores.csv", "--junit", "scores.xml", "--markdown", "scores.md"),
    ("plot", "all.mcap", "-o", "plot.svg"),
    ("export", "all.mcap", "--format", "osi", "-o", "trace.mcap"),
    ("simulate", "rear-end", "--seed", "7", "-o", "simulated.mcap"),
    ("run", "LOG", "OTHER", "-d", "shards/1", "--shard", "1/2", "--tables"),
    ("run", "LOG", "OTHER", "-d", "shards/2", "--shard", "2/2", "--tables"),
    ("merge", "shards/1", "shards/2", "-d", "merged"),
)
"""Those that the long tests run, too, behind the others."""
CAMERA_AND_RADAR_COMMANDS = (
    ("simulate", "departure", "--seed", "3", "--set", "size=320x240", "-o", "departure.mcap"),
    ("run", "departure.mcap", "-o", "lanes.mcap", "--metrics-dir", "lanes"),
    ("simulate", "xiang2019-turn", "--seed", "3", "-o", "turn.mcap"),
    ("run", "turn.mcap", "-o", "tracks.mcap", "--metrics-dir", "tracks"),
    ("conform", "nhtsa-fcw", "--junit", "trials.xml", "--markdown", "trials.md", "--html", "trials.html"),
)
"""The stages of cameras and detections, and trials."""
SAME = {".mcap", ".csv", ".parquet", ".html", ".json", ".gpx", ".toml", ".xml", ".md", ".svg"}
NEVER_SAME = {"run_times.json"}
"""It says how long each log took, and where it lay (docs/fleet.md)."""


def cwcli(folder: Path, environment: dict[str, str], *arguments: str) -> None:
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("LC_", "LANG"))}
    subprocess.run(
        [sys.executable, "-m", "cwcli", *arguments, "--quiet"],
        cwd=folder,
        env={**kept, "PYTHONPATH": str(ROOT), **environment},
        check=True,
        capture_output=True,
    )


def contents(folder: Path) -> dict[str, bytes]:
    paths = (path for path in folder.rglob("*") if path.suffix in SAME and path.name not in NEVER_SAME)
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


def assert_same(made: list[dict[str, bytes]]) -> None:
    first = made[0]
    assert first
    for other in made[1:]:
        assert first.keys() == other.keys()
        assert [name for name in first if first[name] != other[name]] == []


def log_of(folder: Path, k: int) -> Path:
    """One of the six logs."""
    log = LOGS[k]
    if isinstance(log, Path):
        return log
    cwcli(folder, {}, *log, "-o", f"simulated-{k}.mcap")
    return folder / f"simulated-{k}.mcap"


def check_environments(
    folder: Path,
    commands: tuple[tuple[str, ...], ...],
    environments: tuple[dict[str, str], ...] = ENVIRONMENTS,
    **logs: Path,
) -> None:
    """Run commands in folders of their own, one for each environment; words that name a log stand for it."""
    made = []
    for k, environment in enumerate(environments):
        (folder / str(k)).mkdir()
        for command in commands:
            cwcli(folder / str(k), environment, *(str(logs.get(each, each)) for each in command))
        made.append(contents(folder / str(k)))
    assert_same(made)


@pytest.mark.parametrize("number", [0, *(pytest.param(k, marks=pytest.mark.long) for k in range(1, len(LOGS)))])
def test_outputs_are_the_same_bytes_in_every_environment(tmp_path: Path, number: int) -> None:
    other = LOGS[number - 1 if number in (2, 3) else 2]
    assert isinstance(other, Path)
    commands: tuple[tuple[str, ...], ...] = COMMANDS + MORE_COMMANDS if number else COMMANDS
    if number and number not in LOGS_WITHOUT_OTHER_VEHICLES:
        commands += COMMANDS_FOR_OTHER_VEHICLES
    # the first log, of every run, in the two that differ in everything; those of `--long` in all
    environments = ENVIRONMENTS if number else ENVIRONMENTS[::2]
    check_environments(tmp_path, commands, environments, LOG=log_of(tmp_path, number), OTHER=other)


@pytest.mark.long
def test_outputs_of_cameras_detections_and_trials_are_the_same_bytes_in_every_environment(tmp_path: Path) -> None:
    check_environments(tmp_path, CAMERA_AND_RADAR_COMMANDS)


@pytest.mark.parametrize("n_logs", [2, pytest.param(len(LOGS), marks=pytest.mark.long)])
def test_outputs_are_the_same_bytes_with_any_number_of_jobs(n_logs: int, tmp_path: Path) -> None:
    logs = [str(log_of(tmp_path, k)) for k in range(n_logs)]
    made = []
    for n in (1, 2, 4):
        folder = tmp_path / str(n)
        folder.mkdir()
        cwcli(folder, {}, "run", *logs, "-d", "out", "--tables", "--jobs", str(n))
        made.append(contents(folder / "out"))
    assert_same(made)
