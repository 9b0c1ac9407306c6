"""Each paper's scene at a user's shell, as docs/tutorial.md prints it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Run


@pytest.mark.parametrize("name", ["line", "arc", "weave", "turn"])
def test_a_manoeuvre_of_xiang2019_is_tracked_better_than_it_is_detected(name: str, cwcli: Run) -> None:
    log = cwcli("simulate", f"xiang2019-{name}", "-o", "-").stdout
    printed = cwcli("track", "-", "--filter", "ukf", "--json", input=log).stdout
    (row,) = json.loads(printed)["stages"]["track"]["sections"]["errors"]
    assert row["tracked_percent"] == 100.0
    assert max(row["x_m"], row["y_m"]) < 0.1  # of a single look of the better sensor


def test_a_departure_is_warned_of_before_the_tyre_is_far_beyond_the_line(cwcli: Run, tmp_path: Path) -> None:
    cwcli("simulate", "departure", "--set", "rate_hz=10", "-o", "drive.mcap", "--quiet")
    stages = ("lanes", "observe", "predict-lane", "warn-lane")
    for before, stage in zip(("drive", *stages), stages, strict=False):
        assert cwcli(stage, f"{before}.mcap", "-o", f"{stage}.mcap", "--quiet").returncode == 0
    printed = cwcli("warn-lane", "predict-lane.mcap", "--json").stdout
    (event,) = json.loads(printed)["stages"]["warn-lane"]["sections"]["lane_departures"]
    assert event["side"] == "left"
    scores = json.loads(cwcli("evaluate", "warn-lane.mcap", "--json").stdout)["logs"][0]["metrics"]
    assert scores["lanes.lateral_deviation_rmse_m"]["value"] < 0.1, "truth and search mean the same lane to the end"
