"""The predicted paths as viewers draw them, decoded by the official library."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from cwcli.channels.path_scene import DRAWN_PATH_LIFETIME_NS, POINTS_PER_DRAWN_PATH, make_path_scene_channel
from cwcli.channels.predicted_path import PredictedPaths
from cwcli.channels.published import PATH_SCENE
from cwcli.logs.write.writer import LogWriter
from cwcli.prediction.paths import Paths
from cwcli.signals.columns import OutputChannel, encode_strings

MS = 1_000_000
K = 51


def paths(ids: list[str], times_ms: list[int]) -> PredictedPaths:
    """Paths that run east from (row, 0) to (row + 50, 0) in metres, one metre a point."""
    n = len(times_ms)
    log_time_ns = np.array(times_ms, np.int64) * MS
    nothing = np.zeros((n, K))
    along = np.arange(n, dtype=np.float64)[:, None] + np.arange(K)
    whole = Paths(0.05 * np.arange(float(K)), along, nothing, nothing, nothing, np.zeros((n, K, 3)))
    return PredictedPaths(encode_strings(ids), log_time_ns - 5 * MS, log_time_ns, "cv", whole)


def scenes(channel: OutputChannel, folder: Path) -> list[tuple[int, Any]]:
    with LogWriter(folder / "scene.mcap") as log:
        log.write_columns(channel)
    with (folder / "scene.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        return [(row.message.log_time, row.decoded_message) for row in reader.iter_decoded_messages(PATH_SCENE.topic)]


def test_a_path_is_a_line_with_its_first_and_last_point(tmp_path: Path) -> None:
    [(log_time_ns, scene)] = scenes(make_path_scene_channel([paths(["ego"], [1000])]), tmp_path)
    [entity] = scene.entities
    [line] = entity.lines
    assert log_time_ns == 1000 * MS
    assert (entity.id, entity.frame_id, entity.timestamp.ToNanoseconds()) == ("ego", "map", 995 * MS)
    assert entity.lifetime.ToNanoseconds() == DRAWN_PATH_LIFETIME_NS
    assert [point.x for point in line.points] == [5.0 * k for k in range(POINTS_PER_DRAWN_PATH)]
    assert line.pose.orientation.w == 1.0 and line.thickness > 0 and line.color.a > 0


def test_each_vehicle_is_thinned_for_itself_and_all_stand_in_log_time_order(tmp_path: Path) -> None:
    times = list(range(0, 1000, 50))  # 20 Hz
    ego = paths(["ego"] * 20, times)
    others = paths(["a", "b"] * 20, [t + 3 for t in times for _ in range(2)])
    drawn = scenes(make_path_scene_channel([ego, others]), tmp_path)
    names = [scene.entities[0].id for _, scene in drawn]
    assert [time for time, _ in drawn] == sorted(time for time, _ in drawn)
    assert {name: names.count(name) for name in names} == {"ego": 6, "a": 6, "b": 6}  # 950 ms in periods of 190
    colors = {scene.entities[0].id: scene.entities[0].lines[0].color.r for _, scene in drawn}
    assert colors["a"] == colors["b"] != colors["ego"]


def test_five_a_second_are_all_drawn_and_no_path_makes_an_empty_channel(tmp_path: Path) -> None:
    assert len(scenes(make_path_scene_channel([paths(["ego"] * 30, list(range(0, 6000, 200)))]), tmp_path)) == 30
    assert len(make_path_scene_channel([]).log_time_ns) == 0
