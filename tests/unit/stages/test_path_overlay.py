"""The path on the camera's image, from a log and back into one: annotations, burnt-in frames, what is missing."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from cwcli.channels.published import OBSERVER_PATH_LINES
from cwcli.errors import MissingSignalError, UsageError
from cwcli.logs.read.reader import Log
from cwcli.logs.write.annotate import annotate_log
from cwcli.prediction.paths import Paths
from cwcli.simulate.road_log import parse_road_log_config, plan_configured_drive, write_road_log
from cwcli.simulation.road.camera import wide_camera
from cwcli.stages.lanes import LanesConfig, lanes
from cwcli.stages.observe import ObserveConfig, observe
from cwcli.stages.predict_lane import PredictLaneConfig, draw_paths_into_images, predict_lane
from cwcli.vision.camera import Mounting
from cwcli.vision.path_overlay import PATH_RGB

SIZE = (480, 270)
RENDERED = "/camera/annotated"
SETTINGS = ["camera=wide", f"size={SIZE[0]}x{SIZE[1]}", "duration_s=1.5", "rate_hz=10"]
SEEN = wide_camera(*SIZE)
MOUNTING = Mounting(height_m=SEEN.height_m, pitch_rad=SEEN.pitch_rad)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Log]:
    """A rendered drive with its lanes, in memory."""
    path = tmp_path_factory.mktemp("overlay") / "road.mcap"
    config = parse_road_log_config(None, 3, SETTINGS)
    write_road_log(plan_configured_drive(config), config, path)
    with Log.open(path) as source:
        made = lanes(source, LanesConfig(method="zhang2011", mounting=MOUNTING))
        yield source.with_channels(made.channels, {"cwcli.run.lanes": made.metadata})


def stamps(log: Log) -> tuple[np.ndarray, np.ndarray]:
    columns = log.columns("/cwcli/lanes")
    return np.asarray(columns.fields["stamp_ns"], np.int64), columns.log_time_ns


def straight(n: int) -> Paths:
    """40 m straight ahead in 2 s, 0.2 m of sigma across."""
    time_s = np.linspace(0.0, 2.0, 41)
    zero = np.zeros((n, 41))
    covariance = np.zeros((n, 41, 3))
    covariance[:, :, 2] = 0.04
    return Paths(time_s, zero + 20.0 * time_s, zero, zero, zero + 20.0, covariance)


def decoded(path: Path) -> dict[str, list[Any]]:
    messages: dict[str, list[Any]] = {}
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, body in reader.iter_decoded_messages(topics=[OBSERVER_PATH_LINES.topic, RENDERED]):
            messages.setdefault(channel.topic, []).append((message.log_time, body))
    return messages


def test_annotations_and_rendered_frames_hold_the_projected_path(log: Log, tmp_path: Path) -> None:
    stamp_ns, log_time_ns = stamps(log)
    n = len(stamp_ns)
    paths = straight(n)
    paths.y_m[4] = np.nan
    channels, notes = draw_paths_into_images(
        log, paths, stamp_ns=stamp_ns, log_time_ns=log_time_ns, width_m=1.6, config=PredictLaneConfig(render=RENDERED)
    )
    assert notes == ()
    annotate_log(log, channels, {}, tmp_path / "out.mcap")
    messages = decoded(tmp_path / "out.mcap")
    drawn = messages[OBSERVER_PATH_LINES.topic]
    assert [time for time, _ in drawn] == log_time_ns.tolist()
    assert [len(body.points) for _, body in drawn] == [0 if k == 4 else 4 for k in range(n)]
    band, centre, left, _ = drawn[7][1].points
    assert (band.type, centre.type) == (2, 3)
    assert band.fill_color.a > 0.0 and band.timestamp.ToNanoseconds() == stamp_ns[7]
    u, v = np.array([(point.x, point.y) for point in centre.points]).T
    np.testing.assert_allclose(u, SEEN.cx, atol=1e-6)
    np.testing.assert_allclose(
        v[-1], SEEN.project_to_image_px(np.array([40.0]), np.zeros(1), np.zeros(1))[1][0], atol=1e-6
    )
    assert left.points[0].x < SEEN.cx
    frames = messages[RENDERED]
    assert len(frames) == n
    assert frames[7][1].timestamp.ToNanoseconds() == stamp_ns[7]
    assert frames[7][1].frame_id == "camera"
    with_path, without = (
        np.asarray(cv2.imdecode(np.frombuffer(frames[k][1].data, np.uint8), cv2.IMREAD_COLOR)).astype(int)
        for k in (7, 4)
    )
    assert with_path.shape == (SIZE[1], SIZE[0], 3)
    at = (200, round(SEEN.cx))
    expected = np.array([round(255 * part) for part in reversed(PATH_RGB)])
    assert np.abs(with_path[at] - expected).max() < 60
    assert np.ptp(without[at]) < 20, "grey: no path in this frame"


def test_predict_lane_publishes_its_path_on_the_frames(log: Log) -> None:
    made = observe(log, ObserveConfig(use_gyro=False))
    observed = log.with_channels(made.channels, {"cwcli.run.observe": made.metadata})
    result = predict_lane(observed, PredictLaneConfig(horizon_s=2.0, render=RENDERED))
    by_topic = {channel.topic: channel for channel in result.channels}
    n = len(stamps(log)[0])
    assert len(by_topic[OBSERVER_PATH_LINES.topic]) == len(by_topic[RENDERED]) == n
    plain = predict_lane(observed, PredictLaneConfig(horizon_s=2.0))
    assert {channel.topic for channel in plain.channels} == set(by_topic) - {RENDERED}


def test_paths_without_a_frame_are_left_out_and_counted(log: Log) -> None:
    stamp_ns, log_time_ns = stamps(log)
    moved = stamp_ns.copy()
    moved[-2:] += 1
    channels, notes = draw_paths_into_images(
        log, straight(len(moved)), stamp_ns=moved, log_time_ns=log_time_ns, width_m=1.6
    )
    assert len(channels[0]) == len(moved) - 2
    assert "2 of" in notes[0]


def test_missing_lanes_and_the_cameras_own_topic_are_refused(log: Log) -> None:
    stamp_ns, log_time_ns = stamps(log)
    given: dict[str, Any] = {"stamp_ns": stamp_ns, "log_time_ns": log_time_ns, "width_m": 1.6}
    with pytest.raises(UsageError, match="own topic"):
        draw_paths_into_images(log, straight(len(stamp_ns)), **given, config=PredictLaneConfig(render="/camera/image"))
    with pytest.raises(UsageError, match=r"the topic of cwcli\.v1\.PredictedPath"):
        draw_paths_into_images(
            log, straight(len(stamp_ns)), **given, config=PredictLaneConfig(render="/cwcli/observer/path")
        )
    with Log.open(log.name) as bare, pytest.raises(MissingSignalError, match="/cwcli/lanes"):
        draw_paths_into_images(bare, straight(len(stamp_ns)), **given)
