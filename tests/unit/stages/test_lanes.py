"""The stage `lanes` on small logs: channels, annotations, rendered frames, faults of the frames, memory."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from cwcli.channels.published import LANE_LINES, LANES
from cwcli.errors import DataError, InputError, MissingSignalError, UsageError
from cwcli.logs.read.reader import Log
from cwcli.logs.write.annotate import annotate_log
from cwcli.pipeline.result import StageResult
from cwcli.signals.clocks import STRAY_LOG_TIME_REASON
from cwcli.signals.columns import Ragged, StreamedChannel
from cwcli.signals.resample import Series
from cwcli.stages.inputs.frame_motion import MotionSeries
from cwcli.stages.lanes import LanesConfig, lanes
from cwcli.vision.camera import Mounting
from tests.unit.vision.fake_frames import encoded, png_header
from tests.unit.vision.lane_logs import START_NS, STEP_NS, calibration, road_frames, write_log
from tests.unit.vision.scenes import LEFT, RIGHT
from tests.unit.vision.test_video import drive

RENDERED = "/camera/lanes"


def run(path: Path, config: LanesConfig | None = None) -> StageResult:
    with Log.open(path) as log:
        return lanes(log, config or LanesConfig(method="zhang2011"))


def written(path: Path, config: LanesConfig, target: Path) -> dict[str, list[Any]]:
    """Topic -> messages of the annotated log, as the official reader decodes them."""
    with Log.open(path) as log:
        result = lanes(log, config)
        annotate_log(log, result.channels, {"cwcli.run.lanes": result.metadata}, target)
    messages: dict[str, list[Any]] = {}
    with target.open("rb") as file:
        for _, channel, message, decoded in make_reader(
            file, validate_crcs=True, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            messages.setdefault(channel.topic, []).append((message.log_time, decoded))
    return messages


def test_boundaries_are_published_frame_by_frame(tmp_path: Path) -> None:
    source = write_log(tmp_path / "road.mcap", road_frames(14))
    messages = written(source, LanesConfig(method="zhang2011", render=RENDERED), tmp_path / "out.mcap")
    assert len(messages["/camera/image"]) == len(messages[LANES.topic]) == len(messages[LANE_LINES.topic]) == 14
    log_time_ns, last = messages[LANES.topic][-1]
    assert log_time_ns == START_NS + 13 * STEP_NS + 5_000_000
    assert last.stamp_ns == START_NS + 13 * STEP_NS
    y_px = np.arange(1.0, 150.0)
    for side, truth in ((last.left, LEFT), (last.right, RIGHT)):
        assert side.found
        found = (side.a * y_px + side.b) * y_px + side.c
        assert np.mean(np.abs(found - np.polyval(truth, y_px)) < 6.0) > 0.85
    assert (last.search_width_px, last.search_height_px) == (320, 240)
    assert last.preview_distance_m == 33.5
    assert (last.camera_pitch_rad, last.camera_yaw_rad) == (0.0, 0.0)  # as assumed where nothing is known


def test_annotations_lie_on_the_image_of_the_camera(tmp_path: Path) -> None:
    frames = [cv2.resize(np.asarray(cv2.imdecode(np.frombuffer(f, np.uint8), 1)), (640, 480)) for f in road_frames(14)]
    source = write_log(tmp_path / "road.mcap", [encoded(image, ".png") for image in frames])
    messages = written(source, LanesConfig(method="zhang2011"), tmp_path / "out.mcap")
    lane, annotation = messages[LANES.topic][-1][1], messages[LANE_LINES.topic][-1][1]
    assert [line.type for line in annotation.points] == [3, 3]
    for line, side in zip(annotation.points, (lane.left, lane.right), strict=True):
        assert line.timestamp.ToNanoseconds() == lane.stamp_ns
        u, v = np.array([point.x for point in line.points]), np.array([point.y for point in line.points])
        y_px = 240 - ((v + 0.5) / 2 - 0.5)
        x_px = (u + 0.5) / 2 - 0.5 + 1
        np.testing.assert_allclose(x_px, (side.a * y_px + side.b) * y_px + side.c, atol=1e-9)


def test_rendered_frames_are_the_cameras_with_lines(tmp_path: Path) -> None:
    source = write_log(tmp_path / "road.mcap", [*road_frames(5), b"damaged", *road_frames(5, first=5)])
    messages = written(source, LanesConfig(method="zhang2011", render=RENDERED), tmp_path / "out.mcap")
    rendered = messages[RENDERED]
    assert [time for time, _ in rendered] == [time for time, _ in messages[LANES.topic]]
    assert len(rendered) == 10
    originals = {m.timestamp.ToNanoseconds(): m for _, m in messages["/camera/image"]}
    for _, message in rendered:
        assert (message.format, message.frame_id) == ("jpeg", "camera")
        image = np.asarray(cv2.imdecode(np.frombuffer(message.data, np.uint8), 1)).astype(int)
        original = originals[message.timestamp.ToNanoseconds()]
        before = np.asarray(cv2.imdecode(np.frombuffer(original.data, np.uint8), 1)).astype(int)
        changed = np.abs(image - before).max(axis=2) > 60
        assert 0.001 < changed.mean() < 0.1
        assert np.abs(image - before)[:80].mean() < 10.0


def test_same_seed_gives_the_same_bytes_and_another_seed_others(tmp_path: Path) -> None:
    source = write_log(tmp_path / "road.mcap", road_frames(4))
    targets = [tmp_path / f"{name}.mcap" for name in "abc"]
    for target, seed in zip(targets, (1, 1, 2), strict=True):
        written(source, LanesConfig(method="zhang2011", seed=seed, render=RENDERED), target)
    first, again, other = (target.read_bytes() for target in targets)
    assert first == again
    assert first != other


def test_bad_frames_are_counted_and_the_others_used(tmp_path: Path) -> None:
    good = road_frames(6)
    bad = [b"rubbish", good[0][:500], png_header(10_000, 10_000), encoded(np.zeros((1, 1, 3), np.uint8))]
    result = run(write_log(tmp_path / "road.mcap", [*good[:3], *bad, *good[3:]]))
    count = result.summary.inputs[0]
    assert (count.read, count.used) == (10, 6)
    assert dict(count.rejected) == {
        "neither JPEG, PNG nor WebP": 1,
        "cut short": 1,
        "more than 50 megapixels": 1,
        "smaller than 32 x 32 pixels": 1,
    }
    assert np.asarray(result.tables["lanes"].columns["frame"]).tolist() == [0, 1, 2, 7, 8, 9]


def test_black_frames_are_used_and_nothing_is_found(tmp_path: Path) -> None:
    black = encoded(np.zeros((240, 320, 3), np.uint8))
    result = run(write_log(tmp_path / "road.mcap", [black] * 3))
    assert result.summary.inputs[0].used == 3
    table: Mapping[str, Any] = result.tables["lanes"].columns
    assert not table["left_found"].any()
    assert np.isnan(table["lateral_deviation_m"]).all()


def test_no_usable_frame_is_an_error_that_tells_why(tmp_path: Path) -> None:
    path = write_log(tmp_path / "road.mcap", [b"rubbish"] * 3)
    with pytest.raises(DataError) as caught:
        run(path)
    assert caught.value.found == ("3 frames: neither JPEG, PNG nor WebP",)


def test_change_of_size_starts_a_new_search_and_says_so(tmp_path: Path) -> None:
    small = road_frames(3)
    large = [
        encoded(cv2.resize(np.asarray(cv2.imdecode(np.frombuffer(f, np.uint8), 1)), (640, 480)), ".jpg") for f in small
    ]
    result = run(write_log(tmp_path / "road.mcap", [*small, *large]))
    assert any("320 x 240 to 640 x 480 at frame 3" in note for note in result.summary.notes)
    assert np.asarray(result.tables["lanes"].columns["image_width_px"]).tolist() == [320] * 3 + [640] * 3
    sections = {row[0]: row[1] for row in result.summary.sections[0].rows}
    assert sections["searches started"] == 2


@pytest.mark.parametrize(
    ("speed_mps", "step_s", "last_used", "reason"),
    [
        (10.0, 0.1, 12, "the same picture for more than 1 s in a moving car: the camera is frozen"),
        (math.nan, 0.1, 22, "the same picture for more than 2 s: a frozen camera, or a simulated one at standstill"),
        (math.nan, 1.0, 11, "the same picture for more than 2 s: a frozen camera, or a simulated one at standstill"),
        (0.0, 0.1, 31, ""),
    ],
)
def test_frames_that_repeat_a_picture_are_used_unless_the_car_moves(
    speed_mps: float,
    step_s: float,
    last_used: int,
    reason: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In motion 30 equal frames are used for 1 s, at an unknown speed for 2 s and 9 repetitions, at standstill all."""
    step_ns = round(step_s * 1e9)
    stamp_ns = START_NS + np.arange(0 if math.isnan(speed_mps) else 40) * step_ns
    speed = Series(stamp_ns, np.full(len(stamp_ns), speed_mps))
    monkeypatch.setattr("cwcli.stages.lanes.read_ego_motion", lambda *_: MotionSeries(speed))
    before, frozen, after = road_frames(2), road_frames(1, first=2) * 30, road_frames(2, first=3)
    path = write_log(tmp_path / "road.mcap", [*before, *frozen, *after], step_ns=step_ns)
    result = run(path, LanesConfig())
    count = result.summary.inputs[0]
    assert (count.read, count.used) == (34, last_used + 3)
    assert dict(count.rejected) == ({reason: 31 - last_used} if reason else {})
    times = np.asarray(result.tables["lanes"].columns["log_time_ns"])
    assert ((times - times[0]) // step_ns).tolist() == [*range(last_used + 1), 32, 33]


def test_gap_starts_a_new_search(tmp_path: Path) -> None:
    result = run(write_log(tmp_path / "road.mcap", road_frames(3), step_ns=1_000_000_000))
    assert {row[0]: row[1] for row in result.summary.sections[0].rows}["searches started"] == 3


def test_calibration_beside_the_camera_is_used(tmp_path: Path) -> None:
    path = write_log(
        tmp_path / "road.mcap",
        road_frames(3),
        calibrations=[("/other/camera_info", calibration()), ("/camera/camera_info", calibration())],
    )
    result = run(path, LanesConfig(method="zhang2011", mounting=Mounting(1.4)))
    assert [count.topic for count in result.summary.inputs] == ["/camera/image", "/camera/camera_info"]
    assert not result.summary.notes


def test_missing_calibration_and_mounting_are_noted(tmp_path: Path) -> None:
    result = run(write_log(tmp_path / "road.mcap", road_frames(2)))
    assert any("no calibration for /camera/image" in note and "60 degrees" in note for note in result.summary.notes)
    assert any("mounting is not known: 1.3 m" in note for note in result.summary.notes)


def test_unknown_distortion_model_is_told_and_the_calibration_not_used(tmp_path: Path) -> None:
    strange = calibration()
    strange.distortion_model = "double_sphere"
    strange.D.extend([0.6, -0.2])
    path = write_log(tmp_path / "road.mcap", road_frames(3), calibrations=[("/camera/camera_info", strange)])
    bare = write_log(tmp_path / "bare.mcap", road_frames(3))
    config = LanesConfig(mounting=Mounting(1.4))
    found, expected = run(path, config), run(bare, config)
    assert found.summary.notes == (
        "/camera/camera_info is not used: its distortion model 'double_sphere' is unknown (known: plumb_bob, "
        "rational_polynomial, thin_prism, radtan, equidistant, fisheye, kannala_brandt)",
        *expected.summary.notes,
    )
    count = found.summary.inputs[1]
    assert (count.topic, count.used, count.rejected) == (
        "/camera/camera_info",
        0,
        {"calibration with an unknown distortion model": 1},
    )
    curvature = [np.asarray(result.tables["lanes"].columns["curvature_1pm"]) for result in (found, expected)]
    np.testing.assert_array_equal(curvature[0], curvature[1])


@pytest.mark.parametrize(("topic", "coefficients"), [("/camera/image_rect", [0.6, -0.2]), ("/camera/image", [0.0])])
def test_distortion_model_does_not_matter_without_distortion(
    tmp_path: Path, topic: str, coefficients: list[float]
) -> None:
    strange = calibration()
    strange.distortion_model = "double_sphere"
    strange.D.extend(coefficients)
    path = write_log(
        tmp_path / "road.mcap", road_frames(2), topic=topic, calibrations=[("/camera/camera_info", strange)]
    )
    assert run(path, LanesConfig(mounting=Mounting(1.4))).summary.notes == ()


def test_calibration_for_another_shape_is_noted(tmp_path: Path) -> None:
    path = write_log(
        tmp_path / "road.mcap", road_frames(2), calibrations=[("/camera/camera_info", calibration(640, 360))]
    )
    assert any("640 x 360" in note for note in run(path).summary.notes)


def test_span_limits_the_frames(tmp_path: Path) -> None:
    path = write_log(tmp_path / "road.mcap", road_frames(6))
    config = LanesConfig(
        method="zhang2011", start_ns=START_NS + STEP_NS, end_ns=START_NS + 4 * STEP_NS, render=RENDERED
    )
    messages = written(path, config, tmp_path / "out.mcap")
    assert [m.stamp_ns for _, m in messages[LANES.topic]] == [START_NS + k * STEP_NS for k in (1, 2, 3)]
    assert len(messages[RENDERED]) == 3


def test_log_without_camera_says_what_it_holds(tmp_path: Path) -> None:
    path = write_log(tmp_path / "road.mcap", [], calibrations=[("/camera/camera_info", calibration())])
    with pytest.raises(MissingSignalError) as caught:
        run(path)
    assert "no channel holds the camera" in str(caught.value)
    assert caught.value.found == ("/camera/camera_info (foxglove.CameraCalibration)",)


@pytest.mark.parametrize(
    "settings",
    [
        {"method": "nonsense"},
        {"preview_m": 0.0},
        {"preview_m": math.nan},
        {"mounting": Mounting(height_m=-1.0)},
        {"field_of_view_rad": 4.0},
        {"seed": -1},
        {"render": "no topic"},
    ],
)
def test_settings_that_make_no_sense_are_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(UsageError):
        LanesConfig(**settings)


def test_frames_are_not_drawn_onto_the_cameras_own_topic(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="the camera's own topic"):
        run(write_log(tmp_path / "road.mcap", road_frames(1)), LanesConfig(render="/camera/image"))


def test_video_without_a_decoder_is_an_input_error(tmp_path: Path) -> None:
    from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
    from mcap_protobuf.writer import Writer

    path = tmp_path / "video.mcap"
    with path.open("wb") as file, Writer(file) as writer:
        message = CompressedVideo(frame_id="camera", data=b"\x12\x00", format="av1")
        writer.write_message("/camera/video", message, START_NS, START_NS)
    with pytest.raises(InputError, match=r"/camera/video.*AV1.*can't decode"):
        run(path)


def test_a_video_frame_of_no_log_time_is_left_out_but_those_after_it_are_made_from_it(tmp_path: Path) -> None:
    """A key picture, logged at 1 ns: without it nothing comes out until the next one, ten frames later."""
    from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
    from mcap_protobuf.writer import Writer

    path = tmp_path / "video.mcap"
    with path.open("wb") as file, Writer(file) as writer:
        for k, picture in enumerate(drive(12)):
            message = CompressedVideo(frame_id="camera", data=picture, format="h264")
            time_ns = START_NS + k * STEP_NS
            message.timestamp.FromNanoseconds(time_ns)
            writer.write_message("/camera/video", message, 1 if k == 0 else time_ns, time_ns)
    count = run(path, LanesConfig(render="/camera/drawn")).summary.inputs[0]
    assert (count.read, count.used, count.rejected) == (12, 11, {STRAY_LOG_TIME_REASON: 1})
    frames = written(path, LanesConfig(render="/camera/drawn"), tmp_path / "out.mcap")["/camera/drawn"]
    assert [time_ns for time_ns, _ in frames] == [START_NS + k * STEP_NS for k in range(1, 12)]


def test_video_of_an_unknown_format_is_told_as_such(tmp_path: Path) -> None:
    from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
    from mcap_protobuf.writer import Writer

    path = tmp_path / "video.mcap"
    with path.open("wb") as file, Writer(file) as writer:
        for name in ("H.264", "H.264", ""):
            message = CompressedVideo(frame_id="camera", data=b"\0\0\0\1", format=name)
            writer.write_message("/camera/video", message, START_NS, START_NS)
    with pytest.raises(DataError) as caught:
        run(path)
    known = "is not known (known: h264, h265, hevc, vp9)"
    assert caught.value.found == (
        f"2 frames: the video format 'H.264' {known}",
        f"1 frames: the video format '' {known}",
    )


def test_rendered_rows_may_be_asked_for_again(tmp_path: Path) -> None:
    path = write_log(tmp_path / "road.mcap", [*road_frames(4), b"damaged", *road_frames(6, first=4)])
    with Log.open(path) as log:
        result = lanes(log, LanesConfig(method="zhang2011", render=RENDERED))
        channel = next(each for each in result.channels if each.topic == RENDERED)
        assert isinstance(channel, StreamedChannel)

        def files(start: int, stop: int) -> list[bytes]:
            data = channel.make_rows(start, stop)["data"]
            assert isinstance(data, Ragged)
            return [bytes(data.values[a:b]) for a, b in pairwise(data.offsets.tolist())]

        whole = files(0, 10)
        spans = [(0, 2), (0, 4), (3, 7), (5, 7), (7, 7), (7, 10), (2, 3)]
        assert [files(*span) for span in spans] == [whole[start:stop] for start, stop in spans]
