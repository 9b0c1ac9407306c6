"""The log of a rendered drive, read back by the official reader and decoders."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory as ProtobufDecoder
from mcap_ros2.decoder import DecoderFactory as Ros2Decoder

from cwcli.errors import UsageError
from cwcli.simulate.road_log import RoadLogConfig, parse_road_log_config, plan_configured_drive, write_road_log
from cwcli.simulation.road.drive import RoadDriveConfig

CONFIG = RoadLogConfig(RoadDriveConfig(weather="overcast", seed=3, duration_s=1.0, rate_hz=10.0), format="png")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("road") / "road.mcap"
    write_road_log(plan_configured_drive(CONFIG), CONFIG, path)
    return path


def messages(path: Path, topic: str) -> list[Any]:
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[ProtobufDecoder(), Ros2Decoder()])
        if topic == "/truth/lanes":
            return [json.loads(message.data) for _, _, message in reader.iter_messages([topic])]
        return [decoded for _, _, _, decoded in reader.iter_decoded_messages([topic])]


def test_frames_are_those_of_the_drive(log: Path) -> None:
    drive = plan_configured_drive(CONFIG)
    images = messages(log, "/camera/image")
    assert len(images) == 11
    for index in (0, 10):
        grey = cv2.imdecode(np.frombuffer(images[index].data, np.uint8), cv2.IMREAD_UNCHANGED)
        assert np.array_equal(np.asarray(grey), drive.render_frame_at(index).grey)
        assert images[index].format == "png"


def test_same_configuration_same_bytes(log: Path, tmp_path: Path) -> None:
    write_road_log(plan_configured_drive(CONFIG), CONFIG, tmp_path / "again.mcap")
    assert (tmp_path / "again.mcap").read_bytes() == log.read_bytes()


def test_lanes_are_tusimples_form_and_exact(log: Path) -> None:
    drive = plan_configured_drive(CONFIG)
    found = messages(log, "/truth/lanes")
    truth = drive.lane_truth_at(5)
    message = found[5]
    rows = np.array(message["h_samples"])
    for lane, u, visible in zip(
        message["lanes"],
        (truth.left_u_px, truth.right_u_px),
        (truth.left_visible, truth.right_visible),
        strict=True,
    ):
        assert len(lane) == len(rows)
        assert lane == [round(float(u[v])) if visible[v] else -2 for v in rows]
    assert message["ground_left_y_m"][1] == pytest.approx(truth.boundary_y_m("left", np.array([10.0]))[0], abs=1e-6)
    assert message["timestamp"] == {"sec": 1475308800, "nsec": 500_000_000}


def test_boundaries_have_the_papers_signs(log: Path) -> None:
    drive = plan_configured_drive(CONFIG)
    message = messages(log, "/truth/boundaries")[5]
    y_m, direction, curvature = drive.lane_truth_at(5).lane_centre_at_preview(33.5)
    made = (message.lateral_deviation_m, message.heading_deviation_rad, message.curvature_1pm)
    assert made == pytest.approx((-y_m, -direction, -curvature))
    rows = np.arange(140, 200)
    left = message.left
    fitted = (left.a * (240 - rows) + left.b) * (240 - rows) + left.c - 1
    np.testing.assert_allclose(fitted, drive.lane_truth_at(5).left_u_px[rows], atol=3.0)


def test_calibration_and_mounting_put_the_truth_where_the_image_has_it(log: Path) -> None:
    drive = plan_configured_drive(CONFIG)
    calibration, transform = messages(log, "/camera/calibration")[0], messages(log, "/tf")[0]
    q = transform.rotation
    x, y, z, w = q.x, q.y, q.z, q.w
    body_from_optical = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    point = np.array([20.0, 1.5, 0.0]) - [0.0, 0.0, transform.translation.z]
    u, v, depth = np.array(calibration.K).reshape(3, 3) @ (body_from_optical.T @ point)
    expected = drive.camera.project_to_image_px(np.array([20.0]), np.array([1.5]), np.array([0.0]))
    assert (u / depth, v / depth) == pytest.approx((expected[0][0], expected[1][0]))


def test_motion_channels_measure_the_truth(log: Path) -> None:
    speed = [message.longitudinal_velocity for message in messages(log, "/vehicle/velocity")]
    gyro = np.array([message.angular_velocity.z for message in messages(log, "/imu/data")])
    truth = np.array([message.yaw_rate_radps for message in messages(log, "/truth/lateral")])
    assert np.mean(speed) == pytest.approx(25.0, abs=0.05)
    assert len(gyro) == 101
    assert np.sqrt(np.mean((gyro[::10] - truth) ** 2)) < 0.006  # sigma 0.002
    assert len(messages(log, "/truth/ego")) == 11


def test_config_of_the_command_line() -> None:
    config = parse_road_log_config(
        "rain", 3, ("size=640x480", "camera=wide", "duration_s=2.5", "road=complex", "format=png")
    )
    assert (config.size, config.camera, config.format) == ((640, 480), "wide", "png")
    assert config.drive == RoadDriveConfig(weather="rain", road="complex", seed=3, duration_s=2.5)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("size=640", "expected WIDTHxHEIGHT"),
        ("camera=fisheye", "not one of paper, wide"),
        ("duration_s=long", "not a number"),
        ("duration_s=nan", "not a finite number"),
        ("colour=red", "there is no key colour"),
        ("size", "expected KEY=VALUE"),
        ("seed=-1", "must not be negative"),
    ],
)
def test_wrong_settings_are_refused(override: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        parse_road_log_config(None, None, (override,))
