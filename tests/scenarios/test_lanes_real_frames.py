"""The default lane method on the development logs: labelled highway frames judged alone, and a video."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cwcli.evaluation.evaluate_log import evaluate_log
from cwcli.logs.read.reader import Log
from cwcli.metrics.lane_scores import lane_width_stability, max_step_between_frames
from cwcli.stages.lanes import LanesConfig, lanes

LOGS = Path(__file__).parents[2].parent / "shared" / "logs"
LABELLED, VIDEO = LOGS / "tusimple-0313-dev.mcap", LOGS / "udacity-solid-white-right.mcap"
needs_logs = pytest.mark.skipif(not LABELLED.exists(), reason="the development logs in ../shared/logs are not here")


@needs_logs
def test_labelled_highway_frames_each_judged_alone() -> None:
    with Log.open(LABELLED) as log:
        result = lanes(log, LanesConfig())
        scores = evaluate_log(log.with_channels(result.channels))
    found = {row["metric"]: row for row in scores.rows_as_dicts()}
    assert found["lanes.truth_accuracy"]["n"] == 40
    assert found["lanes.truth_accuracy"]["value"] >= 0.935
    assert found["lanes.truth_false_share"]["value"] <= 0.06
    assert found["lanes.truth_missed_share"]["value"] <= 0.06


@needs_logs
def test_video_without_calibration() -> None:
    with Log.open(VIDEO) as log:
        result = lanes(log, LanesConfig())
    table: Mapping[str, Any] = result.tables["lanes"].columns
    found = np.asarray(table["left_found"], bool) & np.asarray(table["right_found"], bool)
    assert len(found) == 221
    assert found.all()
    assert lane_width_stability(np.asarray(table["lane_width_m"], float)).share_near >= 0.95
    for side in ("left", "right"):
        assert max_step_between_frames(np.asarray(table[f"{side}_lateral_m"], float)) <= 0.15
    assert max_step_between_frames(np.asarray(table["lateral_deviation_m"], float)) <= 0.15
    for side, kind in (("left", "dashed"), ("right", "solid")):  # what a look at the video tells
        assert set(table[f"{side}_kind"]) == {kind}
        assert set(table[f"{side}_colour"]) == {"white"}
