"""The script that README.md compares cwcli with, of mcap, pandas, pyproj and evo: its length, and how good both are."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LOG = ROOT / "sample_logs" / "intersection.mcap"


def run(*command: str | Path) -> str:
    return subprocess.run(
        [sys.executable, *map(str, command)], capture_output=True, text=True, check=True, cwd=ROOT
    ).stdout


def test_the_script_without_cwcli_is_as_long_and_as_good_as_said(tmp_path: Path) -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    script = ROOT / "docs" / "without_cwcli.py"
    (said,) = re.findall(r"in (\d+) lines.*\(([\d.]+) m RMSE; `cwcli run`: ([\d.]+) m\)", readme, re.DOTALL)
    n_lines, without_m, with_m = map(float, said)
    assert len(script.read_text(encoding="utf-8").splitlines()) == n_lines
    rmse_m, warned_s = map(float, re.findall(r"[\d.]+", run(script, LOG)))
    assert rmse_m == pytest.approx(without_m, abs=0.01)
    assert 4.7 < warned_s < 5.0
    run("-m", "cwcli", "run", LOG, "-o", tmp_path / "a.mcap", "--quiet")
    ours = re.search(
        r"^ego\.position_rmse_m +([\d.]+)", run("-m", "cwcli", "evaluate", tmp_path / "a.mcap"), re.MULTILINE
    )
    assert ours is not None
    assert float(ours.group(1)) == pytest.approx(with_m, abs=0.01)
