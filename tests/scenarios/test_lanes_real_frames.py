"""The default lane method on the development logs: labelled highway frames judged alone, and a video."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from cwcli.logs.log import Log
from cwcli.metrics.lane_scores import TuSimpleScore, max_jump, tusimple_score, tusimple_total, width_stability
from cwcli.signals.columns import FloatArray
from cwcli.stages.lanes import LanesConfig, lanes
from cwcli.vision.camera import Mounting, default_camera
from cwcli.vision.overlay import HIGHEST, HORIZON_GAP

LOGS = Path(__file__).parents[2].parent / "shared" / "logs"
LABELLED, VIDEO = LOGS / "tusimple-0313-dev.mcap", LOGS / "udacity-solid-white-right.mcap"
needs_logs = pytest.mark.skipif(not LABELLED.exists(), reason="the development logs in ../shared/logs are not here")


def ego_lanes(label: dict[str, list[list[float]]], width_px: int, height_px: int) -> list[FloatArray]:
    """The labelled lanes next to the image's middle where they reach its lower edge."""
    v = np.array(label["h_samples"], float)
    feet: list[tuple[float, FloatArray]] = []
    for lane in np.array(label["lanes"], float):
        seen = lane >= 0
        if seen.sum() > 1:
            lowest = np.flatnonzero(seen)[-8:]
            feet.append((float(np.polyval(np.polyfit(v[lowest], lane[lowest], 1), height_px)), lane))
    left = [foot for foot in feet if foot[0] < width_px / 2]
    right = [foot for foot in feet if foot[0] >= width_px / 2]
    return [max(left, key=lambda foot: foot[0])[1]] * bool(left) + [min(right, key=lambda foot: foot[0])[1]] * bool(
        right
    )


@needs_logs
def test_labelled_highway_frames_each_judged_alone() -> None:
    with LABELLED.open("rb") as file:
        labels = [
            json.loads(message.data) for _, _, message in make_reader(file).iter_messages(topics=["/truth/lanes"])
        ]
    with Log.open(LABELLED) as log:
        result = lanes(log, LanesConfig())
    table = result.tables["lanes"].columns
    assert len(labels) == len(np.asarray(table["stamp_ns"])) == 40
    scores: list[TuSimpleScore] = []
    for k, label in enumerate(labels):
        width, height = float(table["search_width_px"][k]), float(table["search_height_px"][k])
        v = (np.array(label["h_samples"], float) + 0.5) * height / 720.0 - 0.5
        y = height - v
        horizon = default_camera(int(width), int(height), Mounting()).horizon_v_px(np.array(table["pitch_rad"][k]))
        top = min(height - float(horizon) - HORIZON_GAP * height, HIGHEST * height)
        predicted = []
        for side in ("left", "right"):
            if table[f"{side}_found"][k]:
                x = (table[f"{side}_a"][k] * y + table[f"{side}_b"][k]) * y + table[f"{side}_c"][k]
                u = (x - 0.5) * 1280.0 / width - 0.5
                predicted.append(np.where((y <= top) & (u >= 0) & (u < 1280), u, np.nan))
        scores.append(tusimple_score(predicted, ego_lanes(label, 1280, 720), label["h_samples"]))
    total = tusimple_total(scores)
    assert total.accuracy >= 0.85
    assert total.false_positive <= 0.15


@needs_logs
def test_video_without_calibration() -> None:
    with Log.open(VIDEO) as log:
        result = lanes(log, LanesConfig())
    table = result.tables["lanes"].columns
    found = np.asarray(table["left_found"], bool) & np.asarray(table["right_found"], bool)
    assert len(found) == 221
    assert found.mean() >= 0.98
    assert width_stability(np.asarray(table["lane_width_m"], float)).share_near >= 0.95
    for side in ("left", "right"):
        assert max_jump(np.asarray(table[f"{side}_lateral_m"], float)) <= 0.3
    assert max_jump(np.asarray(table["lateral_deviation_m"], float)) <= 0.3
