"""`cwcli reproduce zhang2011`: small, as a user runs it."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.cli.conftest import ROOT, Run

SMALL = ("reproduce", "zhang2011", "--frames", "10", "--seeds", "3")


def test_lanes_and_motion_stand_beside_the_paper_s(cwcli: Run, tmp_path: Path) -> None:
    done = cwcli(*SMALL, "--json", "--metrics", "z.csv", "--plots", "figures")
    document = json.loads(done.stdout)
    assert (document["paper"], document["seeds"], document["frames"]) == ("zhang2011", 3, 10)
    few = {"conclusion 1: zhang2011, complex: both boundaries right"}  # one drive of ten frames is right or wrong
    assert set(document["failed"]) <= few, done.stderr.decode()
    assert done.returncode == bool(document["failed"])
    shares = [row for row in document["findings"] if row["figure"] == "conclusion 1" and row["paper"] is not None]
    assert [(row["paper"], row["paper_to"]) for row in shares[:1]] == [(100.0, 100.0)]
    assert not any("time of the search" in row["what"] for row in document["findings"])  # timings have no class
    with (tmp_path / "z.csv").open() as stream:
        figures = {row["figure"] for row in csv.DictReader(stream)}
    assert {"conclusion 1", "eq 13", "fig 14", "fig 19", "table 4"} <= figures
    drawn = {path.name for path in (tmp_path / "figures").iterdir()}
    photographs = {f"fig-{number}.png" for number in (*range(3, 11), 13, 14, 15, 16)}
    assert {"lanes-good.png", "lanes-hard.png", "fig-17a.png", *photographs} <= drawn


def test_an_interrupted_study_leaves_no_process_and_no_file(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "cwcli", "reproduce", "zhang2011", "--only", "conclusion1", "--metrics", "z.csv"]
    study = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, env={**os.environ, "PYTHONPATH": str(ROOT)})
    workers: set[int] = set()
    for _ in range(300):
        time.sleep(0.1)
        children = Path(f"/proc/{study.pid}/task/{study.pid}/children").read_text().split()
        workers |= set(map(int, children))
        if len(workers) >= 2:
            break
    study.send_signal(signal.SIGINT)
    assert study.wait(20) == 130
    assert len(workers) >= 2
    time.sleep(0.2)
    assert not [worker for worker in workers if Path(f"/proc/{worker}").exists()]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "said"),
    [(("zhang2011", "--frames", "0"), b"--frames"), (("song2016", "--frames", "9"), b"renders no frames")],
)
def test_what_it_refuses(cwcli: Run, options: tuple[str, ...], said: bytes) -> None:
    done = cwcli("reproduce", *options)
    assert done.returncode == 2
    assert said in done.stderr
