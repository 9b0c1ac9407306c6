"""What a user reads first: at most twelve lines of 80 columns, with what happened and whether to believe it."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_PIPE_CLOSED
from cwcli.evaluation.doubts import find_doubts
from cwcli.logs.read.reader import Log
from cwcli.report.build import build_report
from tests.cli.conftest import ROOT, SAMPLES, Run

SHARED_LOGS = ROOT.parent / "shared" / "logs"
OPTIONS = {"psu-testtrack-1obu": ["--ego-station", "2a3c600d"]}
DOUBTFUL = {
    "psu-follow-2obu.mcap": "no sensor measures which way the car points while it stands",
    "wydot-bsm.mcap": "the track is",
    "balzer-dresden-2014-03-26.ros2.mcap": "the track is",
}
"""Logs of which it is known that the estimate is wrong -> how the first sentence on them begins."""
UNCOMMON_WORDS = ("no channel holds", "ego", "sigma", "likelihood", "covariance", "NIS", "truth of")
"""Words that a reader who has never seen cwcli does not know."""
PATH_OF_CWCLI = {"PYTHONPATH": str(ROOT)}
LOGS = sorted([*SAMPLES.glob("*.mcap"), *SHARED_LOGS.glob("*.mcap")])


def check_lines(shown: str) -> list[str]:
    """The lines of a digest, which must be few and short."""
    lines = shown.splitlines()
    assert 3 <= len(lines) <= 12
    assert max(map(len, lines)) <= 80
    return lines


@pytest.mark.parametrize("log", LOGS, ids=[log.name for log in LOGS])
def test_every_log_has_a_digest_that_says_what_happened_and_whether_to_believe_it(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "annotated.mcap"
    assert run_command_line(["run", str(log), "-o", str(target), *OPTIONS.get(log.stem, [])]) == 0
    lines = check_lines(capsys.readouterr().out)
    labels = [line[:7].strip() for line in lines[1:]]
    named = [label for label in labels if label]
    assert [label for label in named if label != "also"] in (
        ["what", "doubt", "wrote", "next"],
        ["what", "trust", "wrote", "next"],
    )
    assert named[1] != "also"  # what happened, then at once whether to believe it
    text = " ".join(line[7:] for line in lines)
    in_words = re.sub(r"--[a-z-]+", "", text)  # an option is what the user typed
    assert [word for word in UNCOMMON_WORDS if word in in_words] == []
    if log.parent == SAMPLES:
        assert "trust" in labels
    if log.name not in DOUBTFUL:
        return
    assert f"Do not trust this as it is: {DOUBTFUL[log.name]}" in text
    html = build_report(str(target)).html.decode()
    headline = re.search(r"<h1>(.*?)</h1>", html, re.DOTALL)
    assert headline is not None
    assert headline.group(1).startswith(f"Do not trust this as it is: {DOUBTFUL[log.name]}")


@pytest.mark.parametrize("command", ["estimate", "measure", "control"])
def test_command_of_a_stage_has_a_digest(cwcli: Run, command: str) -> None:
    source = SAMPLES / "intersection.mcap"
    if command == "measure":
        assert cwcli("estimate", source, "-o", "e.mcap").returncode == 0
        source = Path("e.mcap")
    done = cwcli(command, source, details=False)
    assert done.returncode == 0
    assert done.stderr == b""
    text = " ".join(line[7:] for line in check_lines(done.stdout.decode())[1:])
    assert {
        "estimate": "The car's motion was estimated from /gps/fix, /vehicle/velocity, /gps/heading and /imu/data.",
        "measure": "The car encountered vehicle d9583520: their outlines overlap.",
        "control": "Warned encounters that end in a crash: 1 of 1 with nobody braking, 0 of 1 with the controller",
    }[command] in text


def next_step(shown: bytes) -> list[str]:
    """The words of the command behind `next`, without the program's name."""
    text = " ".join(line[7:] for line in shown.decode().splitlines() if line[:7].strip() in ("next", ""))
    command = re.search(r"cwcli ([^()]*?)(?: \(|$)", text[text.rindex("cwcli ") :])
    assert command is not None, text
    return shlex.split(command.group(1))


@pytest.mark.parametrize("log", ["intersection", "curve"])
def test_every_next_line_can_be_pasted(log: str, cwcli: Run, tmp_path: Path) -> None:
    shutil.copy(SAMPLES / f"{log}.mcap", tmp_path / "drive.mcap")
    words = ["estimate", "drive.mcap"]
    commands = []
    for _ in range(6):
        commands.append(words[0])
        done = cwcli(*words, details=False)
        assert done.returncode == 0, (words, done.stderr)
        if words[0] == "report":
            break
        words = next_step(done.stdout)
    stages = ["estimate", "estimate", "predict"]  # nobody is heard on the curve: nothing to warn of
    assert commands == [*stages, *(["warn"] if log == "intersection" else []), "report"]


def test_next_line_keeps_the_options_and_the_files(cwcli: Run, tmp_path: Path) -> None:
    shutil.copy(SAMPLES / "intersection.mcap", tmp_path / "drive.mcap")
    (tmp_path / "annotated.mcap").write_bytes(b"")
    options = ["--end", "5", "--rate", "10"]
    done = cwcli("estimate", "drive.mcap", *options, details=False)
    assert next_step(done.stdout) == ["estimate", "drive.mcap", *options, "-o", "annotated-2.mcap"]


def test_next_line_of_standard_input_is_in_words(cwcli: Run, intersection: Path) -> None:
    done = cwcli("estimate", "-", details=False, input=intersection.read_bytes())
    assert b"next   the same command with -o annotated.mcap added" in done.stdout


def test_table_of_a_drive_is_no_damaged_file(cwcli: Run, tmp_path: Path) -> None:
    rows = [f"{k / 10},{48 + k * 1e-5 + k % 3 * 1e-7:.7f},11" for k in range(300)]
    (tmp_path / "drive.csv").write_text("\n".join(["t,lat,lon", *rows]))
    done = cwcli("run", "drive.csv")
    assert done.returncode == 0
    assert b"damaged" not in done.stdout
    assert b"cwcli import drive.csv --preview" in done.stderr


def test_prediction_says_how_far_it_is_off(cwcli: Run, predicted: Path) -> None:
    done = cwcli("predict", predicted, "--replace", details=False)
    said = " ".join(done.stdout.decode().split())
    assert "Predicted positions 2.5 s ahead differ from the later track by 0.3 m for the car and 2.0 m for the" in said


def test_details_come_behind_the_digest(cwcli: Run, intersection: Path) -> None:
    short = cwcli("estimate", intersection, details=False)
    long = cwcli("estimate", intersection)
    before_next = short.stdout[: short.stdout.index(b"\nnext ")]  # the next command repeats --details
    assert long.stdout.startswith(before_next)
    assert b"Sensors of the ego: measurements accepted" in long.stdout[len(before_next) :]
    assert b"note: " in long.stderr


def test_quiet_prints_nothing(cwcli: Run, intersection: Path) -> None:
    done = cwcli("estimate", intersection, "--quiet")
    assert (done.stdout, done.stderr) == (b"", b"")


def test_digest_goes_to_stderr_where_stdout_has_the_log(cwcli: Run, intersection: Path) -> None:
    done = cwcli("estimate", intersection, "-o", "-", details=False)
    assert done.stdout.startswith(b"\x89MCAP")
    assert done.stderr.startswith(b"estimate ")


def test_a_pipe_that_nobody_reads_ends_the_digest_quietly(intersection: Path, tmp_path: Path) -> None:
    """The log is whole all the same."""
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "cwcli", "estimate", str(intersection), "-o", "estimated.mcap"]
    done = subprocess.run(
        command, cwd=tmp_path, stdout=writer, stderr=subprocess.PIPE, check=False, env={**os.environ, **PATH_OF_CWCLI}
    )
    os.close(writer)
    assert (done.returncode, done.stderr) == (EXIT_PIPE_CLOSED, b"")
    with Log.open(str(tmp_path / "estimated.mcap")) as log:
        assert find_doubts(log) == ()


CLEAN_DRIVES = ("city", "cut-in", "following", "near-miss-crossing", "oncoming-left-turn")
"""Scenarios of which one drive is tried; with `--long` two are tried of these and of the others."""
MORE_CLEAN_DRIVES = ("brake-and-release", "parallel-lanes", "phone", "stopped-behind-curve", "xiang2019-weave")


@pytest.mark.parametrize(
    "name", [*CLEAN_DRIVES, *(pytest.param(each, marks=pytest.mark.long) for each in MORE_CLEAN_DRIVES)]
)
@pytest.mark.parametrize("seed", [11, pytest.param(12, marks=pytest.mark.long)])
def test_clean_drive_is_not_doubted(name: str, seed: int, tmp_path: Path) -> None:
    log, target = tmp_path / "log.mcap", tmp_path / "annotated.mcap"
    assert run_command_line(["simulate", name, "--seed", str(seed), "-o", str(log), "-q"]) == 0
    assert run_command_line(["run", str(log), "-o", str(target), "-q"]) == 0
    with Log.open(str(target)) as annotated:
        assert find_doubts(annotated) == ()
