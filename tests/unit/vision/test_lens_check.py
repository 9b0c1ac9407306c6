"""Whether another lens than the assumed one is noticed: by exact lanes in a weaving car, and by rendered frames."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from mcap.reader import make_reader
from mcap.writer import Writer

from cwcli.logs.read.reader import Log
from cwcli.signals.resample import Series
from cwcli.simulate.road_log import RoadLogConfig, plan_configured_drive, write_road_log
from cwcli.simulation.road.camera import RoadCamera
from cwcli.simulation.road.car import YAW_RATE
from cwcli.simulation.road.drive import RoadDriveConfig, plan_road_drive
from cwcli.stages.lanes import LanesConfig, lanes
from cwcli.vision.boundary import Boundary
from cwcli.vision.camera import Camera, Mounting, default_camera
from cwcli.vision.fit_columns import FitCollector, FitColumns
from cwcli.vision.lane_tracker import LaneTracker
from cwcli.vision.lens_check import field_of_view_that_contradicts_camera_rad
from cwcli.vision.method import LaneFit, LaneFrame, LaneState

WIDTH_PX, HEIGHT_PX, RATE_HZ, SPEED_MPS = 480, 270, 10.0, 20.0
BOUNDARY = Boundary(0.0, 0.0, 0.0, 1.0, 0.9, True)


def assumed(degrees: float) -> Camera:
    return default_camera(WIDTH_PX, HEIGHT_PX, Mounting(), field_of_view_rad=math.radians(degrees))


def exact_lanes(degrees: float, n: int = 400) -> tuple[FitColumns, np.ndarray, Series, Series]:
    """A car that weaves in bends: heading of the car 0.02 sin(0.8 t) from the lane, curvature 0.003 sin(0.2 t) 1/m."""
    focal_px, height_m = assumed(degrees).fx, 1.5
    time_s = np.arange(n) / RATE_HZ
    right_1pm = 0.003 * np.sin(0.2 * time_s)
    aside_rad = 0.02 * np.sin(0.8 * time_s)
    recorder = FitCollector()
    for angle, bend in zip(aside_rad.tolist(), (right_1pm * focal_px**2 * height_m / 2.0).tolist(), strict=True):
        roads = np.array([[focal_px * angle + 240.5, side * 1.8 / height_m, bend, 0.0] for side in (-1.0, 1.0)])
        recorder.append_fit(LaneFit(BOUNDARY, BOUNDARY, roads=roads, state=LaneState.FOUND))
    stamp_ns = np.round(time_s * 1e9).astype(np.int64)
    yaw_rate = 0.02 * 0.8 * np.cos(0.8 * time_s) - right_1pm * SPEED_MPS
    return recorder.to_columns(), stamp_ns, Series(stamp_ns, np.full(n, SPEED_MPS)), Series(stamp_ns, yaw_rate)


@pytest.mark.parametrize(("true", "told"), [(82.0, 60.0), (60.0, 82.0), (45.0, 60.0)])
def test_the_field_of_view_of_exact_lanes_is_found(true: float, told: float) -> None:
    found = field_of_view_that_contradicts_camera_rad(*exact_lanes(true), assumed(told))
    assert math.degrees(found) == pytest.approx(true, abs=1.0)


def test_a_lens_that_fits_a_short_drive_and_a_wrong_sign_are_not_contradicted() -> None:
    fits, stamp_ns, speed, yaw_rate = exact_lanes(60.0)
    assert math.isnan(field_of_view_that_contradicts_camera_rad(fits, stamp_ns, speed, yaw_rate, assumed(60.0)))
    assert math.isnan(field_of_view_that_contradicts_camera_rad(*exact_lanes(82.0, 150), assumed(60.0)))
    turned_over = Series(yaw_rate.stamp_ns, -yaw_rate.values)
    assert math.isnan(field_of_view_that_contradicts_camera_rad(fits, stamp_ns, speed, turned_over, assumed(60.0)))


def field_of_view_found_in_rendered_drive(true: float, told: float, seed: int) -> float:
    """Degrees; a gyroscope with noise and a bias of 0.2 deg/s."""
    focal_px = assumed(true).fx
    pitch_rad = math.atan(0.05 * HEIGHT_PX / focal_px)
    lens = RoadCamera(WIDTH_PX, HEIGHT_PX, focal_px, focal_px, (WIDTH_PX - 1) / 2, (HEIGHT_PX - 1) / 2, 1.4, pitch_rad)
    drive = plan_road_drive(RoadDriveConfig(seed=seed, duration_s=24.0, rate_hz=RATE_HZ), lens)
    rng, n = np.random.default_rng(seed), len(drive)
    speed = drive.speed_at_mps(drive.time_s) + rng.normal(0.0, 0.05, n)
    yaw_rate = drive.states_at(drive.time_s)[:, YAW_RATE] + rng.normal(0.0035, 0.002, n)
    stamp_ns = np.round(drive.time_s * 1e9).astype(np.int64)
    search, recorder, camera = LaneTracker(), FitCollector(), assumed(told)
    for k, made in enumerate(drive.iter_rendered_frames()):
        told_motion = float(speed[k]), float(yaw_rate[k])
        recorder.append_fit(search.step(LaneFrame(made.grey, camera, int(stamp_ns[k]), k, *told_motion)))
    found_rad = field_of_view_that_contradicts_camera_rad(
        recorder.to_columns(), stamp_ns, Series(stamp_ns, speed), Series(stamp_ns, yaw_rate), camera
    )
    return math.degrees(found_rad)


def test_a_wide_lens_that_is_taken_for_60_degrees_is_noticed() -> None:
    assert field_of_view_found_in_rendered_drive(82.0, 60.0, 41) == pytest.approx(82.0, abs=8.0)


def test_the_assumed_lens_is_believed_where_it_is_right() -> None:
    assert math.isnan(field_of_view_found_in_rendered_drive(60.0, 60.0, 42))


def test_a_calibration_of_another_lens_is_told(tmp_path: Path) -> None:
    """A rendered log of a camera of 60 degrees with the calibration of one of 37 (fx = 1.5 widths)."""
    source, target = tmp_path / "road.mcap", tmp_path / "other.mcap"
    drive = RoadDriveConfig(seed=2, duration_s=24.0, rate_hz=RATE_HZ, bends_1pm=0.012, speed_mps=14.0)
    config = RoadLogConfig(drive, "wide", (320, 180))
    write_road_log(plan_configured_drive(config), config, source)
    with source.open("rb") as file, target.open("wb") as made:
        writer, ids = Writer(made), dict[str, int]()
        writer.start()
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            if channel.topic not in ids:
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                ids[channel.topic] = writer.register_channel(channel.topic, channel.message_encoding, schema_id)
            data = message.data
            if schema.name == "foxglove.CameraCalibration":
                calibration = CameraCalibration.FromString(data)
                for matrix, width in ((calibration.K, 3), (calibration.P, 4)):
                    matrix[0] = matrix[width + 1] = 1.5 * calibration.width
                data = calibration.SerializeToString()
            writer.add_message(ids[channel.topic], message.log_time, data, message.publish_time)
        writer.finish()
    notes = {}
    for path in (source, target):
        with Log.open(path) as log:
            notes[path.stem] = [note for note in lanes(log, LanesConfig()).summary.notes if "field of view" in note]
    assert notes["road"] == []
    [note] = notes["other"]
    assert "not the 37 that" in note
