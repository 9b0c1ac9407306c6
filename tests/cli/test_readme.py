"""What README.md claims: its commands run, its numbers come out, and its picture is small.

Its digest and exit codes are compared in test_reference.py, its demo runs in .ci/run.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import ROOT, Run

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


def test_the_script_without_cwcli_is_as_long_and_as_good_as_said(cwcli: Run, tmp_path: Path) -> None:
    script, log = ROOT / "docs" / "without_cwcli.py", ROOT / "sample_logs" / "intersection.mcap"
    n_lines, without_m, with_m = map(
        float, re.findall(r"in (\d+) lines.*\(([\d.]+) m RMSE; `cwcli run`: ([\d.]+) m\)", README, re.DOTALL)[0]
    )
    assert len(script.read_text(encoding="utf-8").splitlines()) == n_lines
    printed = subprocess.run([sys.executable, script, log], capture_output=True, text=True, check=True).stdout
    rmse_m, warned_s = map(float, re.findall(r"[\d.]+", printed))
    assert rmse_m == pytest.approx(without_m, abs=0.01)
    assert 4.7 < warned_s < 5.0
    assert cwcli("run", log, "-o", tmp_path / "a.mcap").returncode == 0
    evaluated = cwcli("evaluate", tmp_path / "a.mcap").stdout.decode()
    ours = re.search(r"^ego\.position_rmse_m +([\d.]+)", evaluated, re.MULTILINE)
    assert ours is not None
    assert float(ours.group(1)) == pytest.approx(with_m, abs=0.01)


def test_the_picture_is_small() -> None:
    (picture,) = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", README)
    assert (ROOT / picture).stat().st_size < MAX_PICTURE_BYTES
