"""`cwcli run` over many logs, when things go wrong: one line each, before the work where that is possible."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cwcli.cli.fleet import MAX_PRINTED_ERRORS, distinct_errors
from tests.cli.conftest import ROOT, Run
from tests.cli.fleet_logs import cut


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds of the intersection."""
    return cut(ROOT / "sample_logs/intersection.mcap", tmp_path_factory.mktemp("short") / "short.mcap", seconds=2.0)


@pytest.mark.parametrize("options", [["--quiet"], ["--json"], []], ids=str)
def test_each_reason_is_told_once_even_when_quiet(cwcli: Run, tmp_path: Path, options: list[str]) -> None:
    (tmp_path / "a.mcap").write_bytes(b"")
    for name in ("b", "c\x1b[31m\n", "d"):
        (tmp_path / f"{name}.mcap").write_bytes(b"no log at all")
    done = cwcli("run", "*.mcap", "-d", "out", "--jobs", "1", *options)
    told = [line for line in done.stderr.decode().splitlines() if line.startswith("error: ")]
    assert done.returncode == 3
    assert told == ["error: a.mcap: the file is empty", "error: b.mcap: it is not an MCAP file (and 2 other logs)"]
    assert b"\x1b" not in done.stdout + done.stderr


def test_many_reasons_are_not_all_told() -> None:
    entries = [
        {"id": f"{k}", "source": "s", "error": {"what": f"it is {k}", "where": "/gps", "found": ["x"], "hint": "h"}}
        for k in range(MAX_PRINTED_ERRORS + 5)
    ]
    told = distinct_errors(entries)
    assert len(told) == MAX_PRINTED_ERRORS + 1
    assert (told[0].where, told[0].what, told[0].found, told[0].hint) == ("s: /gps", "it is 0", ("x",), "h")
    assert told[-1].what == "5 more reasons are in the manifest"


def test_force_never_removes_what_the_run_reads(cwcli: Run, short: Path, tmp_path: Path) -> None:
    again = ("run", f"{short.parent}/*.mcap", "-d", "out", "-q", "--stage", "estimate")
    assert cwcli(*again).returncode == 0
    done = cwcli("run", "out/logs/*/annotated.mcap", "-d", "out", "--force")
    assert (done.returncode, done.stdout) == (2, b"")
    assert b"is in the output folder" in done.stderr
    assert (tmp_path / "out/logs/short/annotated.mcap").is_file()


@pytest.mark.parametrize("name", ["", "-"])
def test_a_folder_without_a_name_is_refused(cwcli: Run, short: Path, tmp_path: Path, name: str) -> None:
    done = cwcli("run", short, "-d", name)
    assert done.returncode == 2
    assert done.stderr.startswith(b"error: the output folder can't be")
    assert not list(tmp_path.iterdir())


def test_workers_import_nothing_from_the_current_folder(short: Path, tmp_path: Path) -> None:
    """As after `pip install .`, in a checkout whose sources nobody has built."""
    checkout = tmp_path / "checkout"
    (checkout / "cwcli").mkdir(parents=True)
    (checkout / "cwcli/__init__.py").touch()
    script = tmp_path / "cwcli-script"
    script.write_text('if __name__ == "__main__":\n    from cwcli.cli.main import main\n\n    main()\n')
    done = subprocess.run(
        [sys.executable, str(script), "run", str(short), "-d", "out", "--jobs", "1", "--quiet"],
        cwd=checkout,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        check=False,
        timeout=600,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")


@pytest.mark.parametrize("delay_s", [0.0, 0.3, 0.6])
def test_ctrl_c_while_workers_start_is_one_line(short: Path, tmp_path: Path, delay_s: float) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "cwcli", "run", str(short), "-d", "out", "--jobs", "1"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    while process.poll() is None and not (tmp_path / "out/manifest.json").exists():
        time.sleep(0.01)
    time.sleep(delay_s)
    os.killpg(process.pid, signal.SIGINT)
    out, error = process.communicate(timeout=600)
    assert (out, error) == (b"", b"interrupted\n")
    assert process.returncode in (130, -signal.SIGINT)  # as Python was importing; a shell calls both 130


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--warn-rule", "nope"], "there is no warning rule 'nope'"),
        (["--warn-rules", "ttc,nope"], "there is no warning rule 'nope'"),
        (["--warn-max-age", "-1"], "a max age of -1 is not positive"),
        (["--predict-horizon", "-1"], "a horizon of -1 s is not"),
        (["--predict-model", "nope"], "there is no motion model 'nope'"),
        (["--stage", "lanes,predict-lane", "--predict-lane-model", "ctrv"], "must be one of lateral"),
        (["--lanes-method", "nope"], "there is no lane method 'nope'"),
        (["--lanes-seed", "-1"], "--seed -1 must lie between"),
        (["--lanes-camera-height", "-3"], "--camera-height"),
        (["--lanes-render", "no topic"], "--render 'no topic' is not the name of a topic"),
        (["--stage", "control", "--control-predictor", "nope"], "there is no motion model 'nope'"),
        (["--stage", "control", "--control-horizon", "-1"], "a horizon of -1 s is not a positive number of seconds"),
        (["--topic", "x"], "expected ROLE=/topic"),
        (["--topic", "ego=/x"], "there is no role ego"),
        (["--start", "x"], "neither seconds nor"),
        (["--end", "-1"], "is not a time in the log"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_options_that_fit_no_log_are_refused_before_the_work(
    cwcli: Run, tmp_path: Path, options: list[str], words: str
) -> None:
    done = cwcli("run", "drive.mcap", "-d", "out", *options)
    assert (done.returncode, done.stdout) == (2, b"")
    assert done.stderr.startswith(b"error: ") and words in done.stderr.decode()
    assert not list(tmp_path.iterdir())
