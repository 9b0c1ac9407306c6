"""`cwcli reproduce zhang2011`: small, as a user runs it."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from tests.cli.conftest import Run

SMALL = ("reproduce", "zhang2011", "--frames", "10", "--seeds", "3")


def test_lanes_and_motion_stand_beside_the_paper_s(cwcli: Run, tmp_path: Path) -> None:
    done = cwcli(*SMALL, "--json", "--metrics", "z.csv", "--plots", "figures")
    assert done.returncode == 0, done.stderr.decode()
    document = json.loads(done.stdout)
    assert (document["paper"], document["seeds"], document["frames"]) == ("zhang2011", 3, 10)
    assert [row["paper"] for row in document["sections"]["conclusion_1"] if row["paper"] is not None] == [100.0, 90.0]
    assert {"fig_14", "fig_17", "table_4"} <= set(document["sections"])
    assert [row["paper ms"] for row in document["sections"]["table_4"] if row["paper ms"]] == [210.0, 150.0, 30.0]
    with (tmp_path / "z.csv").open() as stream:
        figures = {row["figure"] for row in csv.DictReader(stream)}
    assert {"conclusion 1", "eq 13", "fig 14", "fig 19"} <= figures
    assert "table 4" not in figures  # times differ from run to run
    drawn = {path.name for path in (tmp_path / "figures").iterdir()}
    assert {"lanes-good.png", "lanes-complex.png", "lanes-hard.png", "fig-14.png"} <= drawn


@pytest.mark.parametrize(
    ("options", "said"),
    [(("zhang2011", "--frames", "0"), b"--frames"), (("song2016", "--frames", "9"), b"renders no frames")],
)
def test_what_it_refuses(cwcli: Run, options: tuple[str, ...], said: bytes) -> None:
    done = cwcli("reproduce", *options)
    assert done.returncode == 2
    assert said in done.stderr
