"""The camera's pitch: found by the lanes, pooled, and used again."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from cwcli.estimation.calibration import Calibration, Constant, ConstantStatus, parse_calibration_table
from cwcli.estimation.pooling import DriveEvidence, calibrate_from_drives
from cwcli.estimation.result import Track
from cwcli.logs.read.reader import Log
from cwcli.pipeline.call import run_stage
from cwcli.pipeline.camera_pitch import estimate_camera_pitch
from cwcli.pipeline.records import read_configuration, read_run_records
from cwcli.simulate.road_log import parse_road_log_config, plan_configured_drive, write_road_log
from cwcli.stages import STAGES
from cwcli.stages.lanes import LanesConfig
from cwcli.vision.mounting import MountingChoice

TRUE_RAD = math.atan(1.65 / 33.5)
CAMERA = "/camera/image"


@pytest.fixture(scope="module")
def road(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six seconds of a rendered road, without the transforms that tell the camera's mounting."""
    folder = tmp_path_factory.mktemp("road")
    config = parse_road_log_config("clear", 2, ("duration_s=6", "size=480x360"))
    write_road_log(plan_configured_drive(config), config, folder / "whole.mcap")
    with (folder / "whole.mcap").open("rb") as source, (folder / "road.mcap").open("wb") as target:
        writer = Writer(target)
        writer.start()
        schemas: dict[int, int] = {}
        channels: dict[int, int] = {}
        for schema, channel, message in make_reader(source).iter_messages():
            if schema is None or "FrameTransform" in schema.name:
                continue
            if schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
            if channel.id not in channels:
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schemas[schema.id]
                )
            writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
        writer.finish()
    return folder / "road.mcap"


def with_lanes(log: Log, config: LanesConfig) -> Log:
    result = run_stage(STAGES["lanes"], log, config)
    return log.with_channels(result.channels, {"cwcli.run.lanes": result.metadata})


def test_pitch_is_found_where_nobody_told_it(road: Path) -> None:
    with Log.open(road) as log:
        found = estimate_camera_pitch(with_lanes(log, LanesConfig()))
    assert found is not None
    assert found.topic == CAMERA
    assert abs(found.pitch_rad - TRUE_RAD) < 3.0 * found.sigma_rad < math.radians(0.3)


def test_a_pitch_that_was_given_is_not_found_again(road: Path) -> None:
    with Log.open(road) as log:
        assert estimate_camera_pitch(with_lanes(log, LanesConfig(mounting=MountingChoice(pitch_rad=0.03)))) is None
        assert estimate_camera_pitch(log) is None


def test_lanes_take_the_calibration_s_pitch_and_say_so(road: Path) -> None:
    table = {"cwcli_calibration": 1, CAMERA: {"camera": {"pitch_rad": {"value": 0.05, "sigma": 0.001}}}}
    table |= {topic: {"imu": {"nose_up_rad": {"value": 0.0}}} for topic in ("/imu/data", "/vehicle/velocity")}
    calibration = parse_calibration_table(table, "car.toml")
    with Log.open(road) as log:
        result = run_stage(STAGES["lanes"], log, LanesConfig(calibration=calibration))
        again = with_lanes(log, LanesConfig(calibration=calibration))
        assert read_configuration(read_run_records(again)["lanes"])["mounting"]["pitch_rad"] == 0.05
        assert estimate_camera_pitch(again) is None
        own = LanesConfig(calibration=calibration, mounting=MountingChoice(pitch_rad=0.04))
        assert read_configuration(read_run_records(with_lanes(log, own))["lanes"])["mounting"]["pitch_rad"] == 0.04
    assert "the camera's pitch is 2.86 degrees, by the calibration car.toml" in result.summary.notes


def test_pitches_of_drives_are_pooled() -> None:
    """Sigmas of 1 and 2 mrad: weights 4 to 1."""
    track = Track(
        np.zeros(0, np.int64), np.zeros((0, 8)), np.zeros((0, 8, 8)), np.zeros(0, np.uint8), manoeuvre_sigmas=MOTION
    )
    drives = [
        DriveEvidence(name, track, {CAMERA: said}) for name, said in (("a", (0.050, 0.001)), ("b", (0.052, 0.002)))
    ]
    found: Calibration = calibrate_from_drives(drives)
    pitch: Constant = found.find_constant_or_unknown(CAMERA, "camera", "pitch_rad")
    assert pitch.status is ConstantStatus.FOUND
    assert pitch.value == pytest.approx(0.0504)
    assert pitch.sigma == pytest.approx(0.001 / math.sqrt(1.25))


MOTION = {"jerk_sigma_mps3": 1.0, "yaw_accel_sigma_radps2": 0.1}
