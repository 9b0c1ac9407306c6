"""`simulate road`: a rendered drive as a log, with exact truth."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.write.writer import LogWriter
from cwcli.signals.columns import (
    FloatArray,
    Int64Array,
    OutputChannel,
    OutputField,
    Ragged,
    StreamedChannel,
    repeat_string,
)
from cwcli.signals.units import NS_PER_S, STANDARD_GRAVITY_MPS2
from cwcli.simulate.cdr import ROS_MESSAGE_DEFINITIONS, encode_imu_messages, encode_velocity_reports
from cwcli.simulate.sensor_log import WrittenChannel
from cwcli.simulation.road.camera import CAMERA_MAKERS_BY_NAME, PAPER_PREVIEW_M
from cwcli.simulation.road.car import BEARING, LATERAL_SPEED, STEER, YAW_RATE, X, Y
from cwcli.simulation.road.drive import RoadDrive, RoadDriveConfig, plan_road_drive
from cwcli.simulation.road.lane_frames import plan_drifting_drive
from cwcli.simulation.road.truth import LaneTruth
from cwcli.simulation.sensors import SensorData
from cwcli.simulation.streams import random_stream, seconds_to_ns
from cwcli.version import __version__

CAMERA_TOPIC = "/camera/image"
"""Topic of the rendered frames."""
CALIBRATION_TOPIC = "/camera/calibration"
"""Topic of the camera's calibration."""
TRANSFORM_TOPIC = "/tf"
"""Topic of the camera's mounting in the body frame."""
SPEED_TOPIC = "/vehicle/velocity"
"""Topic of the speed sensor."""
IMU_TOPIC = "/imu/data"
"""Topic of the IMU."""
TRUE_LANES_TOPIC = "/truth/lanes"
"""Topic of the true lane labels in TuSimple's format."""
TRUE_BOUNDARIES_TOPIC = "/truth/boundaries"
"""Topic of the true boundaries as parabolas in the image."""
TRUE_LATERAL_MOTION_TOPIC = "/truth/lateral"
"""Topic of the true lateral motion."""
TRUE_EGO_TOPIC = "/truth/ego"
"""Topic of the true track of the car."""
METADATA_NAME = "cwcli.road"
"""Name of the metadata record with the configuration of the drive."""

CAMERA_FRAME_ID = "camera"
"""Frame id of the camera."""
BODY_FRAME_ID = "base_link"
"""Frame id of the body frame, below the camera."""
DRIVE_START_STAMP_NS = 1_475_308_800_000_000_000
"""Stamp of the drive's start, ns since 1970: 2016-10-01T08:00:00Z, as in the scenarios."""
CAMERA_STAMP_TO_LOG_TIME_DELAY_NS, SENSOR_STAMP_TO_LOG_TIME_DELAY_NS = 20_000_000, 5_000_000
"""Time from the stamp of a frame, or of a sensor's message, to its log time, ns. Chosen by hand; not fitted."""
SPEED_RATE_HZ, IMU_RATE_HZ = 50.0, 100.0
"""Message rates of the speed sensor and of the IMU, Hz. Chosen by hand as usual rates."""
SPEED_SENSOR_SIGMA_MPS = 0.05
"""Standard deviation of the speed sensor's noise, m/s. Chosen by hand; not fitted."""
IMU_NOISE_SIGMAS_MPS2_RADPS = np.array([0.05, 0.05, 0.05, 0.002, 0.002, 0.002])
"""Standard deviations of the IMU's noise, shape (6,): accelerations in m/s^2, then angular rates in rad/s. Chosen by
hand."""
FRAME_JPEG_QUALITY_PERCENT = 95
"""JPEG quality of the frames, 0 to 100. Chosen by hand; not fitted."""
DISTANCES_AHEAD_OF_LANE_LABEL_POINTS_M = (5.0, 10.0, 20.0, 30.0)
"""Distances ahead at which the lane labels give the boundaries in the body frame, m. Chosen by hand."""
DISTANCES_AHEAD_OF_TRUE_LANE_POINTS_M: FloatArray = np.arange(1.0, 68.0) / 2.0
"""Distances ahead at which the lateral truth gives the lane, m, up to the paper's preview point; a straight line
between them errs by less than 2 mm in a bend of 23 m."""

LANES_SCHEMA = {
    "title": "TuSimpleLanes",
    "type": "object",
    "properties": {
        "timestamp": {
            "type": "object",
            "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
        },
        "h_samples": {"type": "array", "items": {"type": "integer"}},
        "lanes": {"type": "array", "items": {"type": "array", "items": {"type": "integer"}}},
        "raw_file": {"type": "string"},
        "lateral_offset_m": {"type": "number"},
        "heading_rad": {"type": "number"},
        "curvature_1pm": {"type": "number"},
        "lane_width_m": {"type": "number"},
        "camera_pitch_rad": {"type": "number"},
        "ground_x_m": {"type": "array", "items": {"type": "number"}},
        "ground_left_y_m": {"type": "array", "items": {"type": "number"}},
        "ground_right_y_m": {"type": "array", "items": {"type": "number"}},
    },
}
"""JSON schema of the lane labels: TuSimple's format, and the same in the ground plane."""


@dataclass(frozen=True)
class RoadLogConfig:
    """The configuration of `cwcli simulate road`.

    Attributes:
        drive: Road, weather and motion.
        camera: A name of `CAMERA_MAKERS_BY_NAME`.
        size: Image width and height, pixels.
        format: `jpeg` or `png`.
    """

    drive: RoadDriveConfig
    camera: str = "paper"
    size: tuple[int, int] = (320, 240)
    format: str = "jpeg"


def parse_road_log_config(weather: str | None, seed: int | None, overrides: Sequence[str]) -> RoadLogConfig:
    """Parse the configuration from the command line.

    Args:
        weather: Name of the weather; None for the default.
        seed: Seed; None for the default.
        overrides: `KEY=VALUE`: `camera`, `size` (640x480), `format`, `drift` (m/s, left positive), or a field of
            `RoadDriveConfig`.

    Raises:
        UsageError: A key or a value is wrong.
    """
    config = RoadLogConfig(RoadDriveConfig())
    kinds = {f.name: type(f.default) for f in fields(RoadDriveConfig)}
    for override in overrides:
        key, equals, value = override.partition("=")
        if not equals:
            raise UsageError(f"--set {override}: expected KEY=VALUE")
        if key == "size":
            config = replace(config, size=_parse_image_size(value))
        elif key == "camera":
            config = replace(config, camera=_require_one_of(key, value, tuple(CAMERA_MAKERS_BY_NAME)))
        elif key == "format":
            config = replace(config, format=_require_one_of(key, value, ("jpeg", "png")))
        elif key == "drift":
            drift: dict[str, Any] = {"drift_mps": _parse_field_value(key, value, float)}
            config = replace(config, drive=replace(config.drive, **drift))
        elif key in kinds:
            change: dict[str, Any] = {key: _parse_field_value(key, value, kinds[key])}
            config = replace(config, drive=replace(config.drive, **change))
        else:
            known = ", ".join(("size", "camera", "format", "drift", *kinds))
            raise UsageError(f"--set {override}: there is no key {key}", hint=f"known keys: {known}")
    if weather is not None:
        config = replace(config, drive=replace(config.drive, weather=weather))
    if seed is not None:
        config = replace(config, drive=replace(config.drive, seed=seed))
    if config.drive.seed < 0:
        raise UsageError(f"the seed {config.drive.seed} must not be negative")
    return config


def _parse_image_size(text: str) -> tuple[int, int]:
    """Parse WIDTHxHEIGHT; refuse other text."""
    width, by, height = text.lower().partition("x")
    if not (by and width.isdecimal() and height.isdecimal()):
        raise UsageError(f"--set size={text}: expected WIDTHxHEIGHT, e.g. 640x480")
    return int(width), int(height)


def _require_one_of(key: str, value: str, known: tuple[str, ...]) -> str:
    """Return the value if it is one of the known ones; refuse another."""
    if value not in known:
        raise UsageError(f"--set {key}={value}: not one of {', '.join(known)}")
    return value


def _parse_field_value(key: str, text: str, kind: type) -> str | int | float:
    """Parse the value of a field as its type; refuse other text and numbers that are not finite."""
    try:
        value = kind(text)
    except ValueError:
        raise UsageError(f"--set {key}={text}: not a number") from None
    if kind is float and not np.isfinite(value):
        raise UsageError(f"--set {key}={text}: not a finite number")
    return value  # type: ignore[no-any-return]


def plan_configured_drive(config: RoadLogConfig) -> RoadDrive:
    """Plan the drive of a configuration.

    Raises:
        UsageError: A value is out of its range.
    """
    camera = CAMERA_MAKERS_BY_NAME[config.camera](*config.size)
    if config.drive.drift_mps:
        return plan_drifting_drive(config.drive, camera)
    return plan_road_drive(config.drive, camera)


def write_road_log(
    drive: RoadDrive, config: RoadLogConfig, target: str | Path, *, force: bool = False
) -> tuple[WrittenChannel, ...]:
    """Write a rendered drive as an MCAP log. Frames are rendered while they are written: memory does not grow with
    them.

    Args:
        target: File, or `-` for standard output.

    Raises:
        OutputError: The target can't be written.
    """
    stamp_ns = DRIVE_START_STAMP_NS + seconds_to_ns(drive.time_s)
    truths = [drive.lane_truth_at(index) for index in range(len(drive))]
    with LogWriter(target, force=force) as log:
        channels = [
            _camera_image_channel(drive, config, stamp_ns),
            *_calibration_and_mounting_channels(drive),
            true_boundaries_channel(truths, stamp_ns),
            _lateral_truth_channel(drive, truths, stamp_ns),
            _ego_truth_channel(drive, stamp_ns),
        ]
        written = []
        for channel in channels:
            log.write_columns(channel)
            written.append(WrittenChannel(channel.topic, channel.schema_name, len(channel), 0))
        for topic, schema_name, data, encode in (
            (
                SPEED_TOPIC,
                "autoware_vehicle_msgs/msg/VelocityReport",
                _simulate_speed_sensor(drive),
                encode_velocity_reports,
            ),
            (IMU_TOPIC, "sensor_msgs/msg/Imu", _simulate_imu(drive), encode_imu_messages),
        ):
            schema_id = log.add_schema(schema_name, "ros2msg", ROS_MESSAGE_DEFINITIONS[schema_name].encode())
            log.write_messages(log.add_channel(topic, "cdr", schema_id), data.log_time_ns, encode(data))
            written.append(WrittenChannel(topic, schema_name, len(data.stamp_ns), 0))
        schema_id = log.add_schema("TuSimpleLanes", "jsonschema", json.dumps(LANES_SCHEMA).encode())
        messages = [encode_lane_labels(truth, int(stamp_ns[index]), index) for index, truth in enumerate(truths)]
        log.write_messages(log.add_channel(TRUE_LANES_TOPIC, "json", schema_id), stamp_ns, messages)
        written.append(WrittenChannel(TRUE_LANES_TOPIC, "TuSimpleLanes", len(messages), 0))
        log.add_metadata(METADATA_NAME, _road_record_entries(drive, config))
    return tuple(written)


def _road_record_entries(drive: RoadDrive, config: RoadLogConfig) -> dict[str, str]:
    """The content of the metadata record: version, seed and the whole configuration as JSON."""
    document = {"camera": config.camera, "size": list(config.size), "format": config.format, **asdict(config.drive)}
    return {"version": __version__, "seed": str(config.drive.seed), "resolved": json.dumps(document)}


def _camera_image_channel(drive: RoadDrive, config: RoadLogConfig, stamp_ns: Int64Array) -> StreamedChannel:
    """The channel of the frames, rendered and encoded while it is written."""

    def encode_rows(start: int, stop: int) -> Mapping[str, OutputField]:
        images = [_encode_image(drive.render_frame_at(index).grey, config.format) for index in range(start, stop)]
        offsets = np.concatenate([[0], np.cumsum([len(image) for image in images])]).astype(np.int64)
        return {
            "timestamp": stamp_ns[start:stop],
            "frame_id": repeat_string(CAMERA_FRAME_ID, stop - start),
            "data": Ragged(np.concatenate(images) if images else np.zeros(0, np.uint8), offsets),
            "format": repeat_string(config.format, stop - start),
        }

    return StreamedChannel(
        CAMERA_TOPIC, "foxglove.CompressedImage", stamp_ns + CAMERA_STAMP_TO_LOG_TIME_DELAY_NS, make_rows=encode_rows
    )


def _encode_image(grey: npt.NDArray[np.uint8], kind: str) -> npt.NDArray[np.uint8]:
    """Encode a grey image (height, width) as JPEG or PNG; shape (n bytes,)."""
    import cv2

    options = (
        [cv2.IMWRITE_JPEG_QUALITY, FRAME_JPEG_QUALITY_PERCENT] if kind == "jpeg" else [cv2.IMWRITE_PNG_COMPRESSION, 3]
    )
    _, data = cv2.imencode(f".{kind}", grey, options)
    return np.asarray(data, np.uint8).ravel()


def _calibration_and_mounting_channels(drive: RoadDrive) -> tuple[OutputChannel, OutputChannel]:
    """The channels of the camera's calibration and of its mounting at rest, one message per second each."""
    camera = drive.camera
    n = int(drive.time_s[-1]) + 1
    stamp_ns = DRIVE_START_STAMP_NS + seconds_to_ns(np.arange(n, dtype=np.float64))
    k = camera.intrinsic_matrix()
    calibration = OutputChannel(
        CALIBRATION_TOPIC,
        "foxglove.CameraCalibration",
        stamp_ns,
        {
            "timestamp": stamp_ns,
            "frame_id": repeat_string(CAMERA_FRAME_ID, n),
            "width": np.full(n, camera.width_px, np.uint32),
            "height": np.full(n, camera.height_px, np.uint32),
            "K": np.tile(k.ravel(), (n, 1)),
            "R": np.tile(np.eye(3).ravel(), (n, 1)),
            "P": np.tile(np.column_stack([k, np.zeros(3)]).ravel(), (n, 1)),
        },
    )
    # Body from optical axes: (x, y, z, w) = (-1, 1, -1, 1) / 2 looks ahead; the pitch turns it about the body's y.
    half = camera.pitch_rad / 2
    c, s = np.cos(half) / 2, np.sin(half) / 2
    quaternion = {"x": -c - s, "y": c + s, "z": s - c, "w": c - s}
    transform: dict[str, OutputField] = {
        "timestamp": stamp_ns,
        "parent_frame_id": repeat_string(BODY_FRAME_ID, n),
        "child_frame_id": repeat_string(CAMERA_FRAME_ID, n),
        "translation.x": np.zeros(n),
        "translation.y": np.zeros(n),
        "translation.z": np.full(n, camera.height_m),
        **{f"rotation.{axis}": np.full(n, value) for axis, value in quaternion.items()},
    }
    return calibration, OutputChannel(TRANSFORM_TOPIC, "foxglove.FrameTransform", stamp_ns, transform)


def true_boundaries_channel(truths: Sequence[LaneTruth], stamp_ns: Int64Array) -> OutputChannel:
    """The true boundaries as `cwcli.v1.Lanes`: parabolas in pixels, and the lane at 33.5 m in the paper's signs."""
    y_m, direction, curvature = np.array([truth.lane_centre_at_preview(PAPER_PREVIEW_M) for truth in truths]).T
    n = len(truths)
    columns: dict[str, OutputField] = {
        "stamp_ns": stamp_ns,
        "lateral_deviation_m": -y_m,
        "heading_deviation_rad": -direction,
        "curvature_1pm": -curvature,
        "lateral_deviation_sigma_m": np.zeros(n),
        "heading_deviation_sigma_rad": np.zeros(n),
        "curvature_sigma_1pm": np.zeros(n),
        "preview_distance_m": np.full(n, PAPER_PREVIEW_M),
    }
    for side in ("left", "right"):
        parabolas = np.array([truth.fit_boundary_parabola_px(side) for truth in truths])
        found = np.isfinite(parabolas[:, 0])
        columns |= {f"{side}.{name}": parabolas[:, k] for k, name in enumerate("abc")}
        columns[f"{side}.score"] = np.full(n, np.nan)
        columns[f"{side}.probability"] = found.astype(np.float64)
        columns[f"{side}.found"] = found
    return OutputChannel(TRUE_BOUNDARIES_TOPIC, "cwcli.v1.Lanes", stamp_ns, columns)


def encode_lane_labels(truth: LaneTruth, stamp_ns: int, index: int) -> bytes:
    """Encode the true lane of one frame as a JSON message of `LANES_SCHEMA`."""
    height = truth.camera.height_px
    h_samples = np.arange(height // 3, height, max(2, round(height / 72)))
    x_m = np.array(DISTANCES_AHEAD_OF_LANE_LABEL_POINTS_M)
    seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
    document = {
        "timestamp": {"sec": seconds, "nsec": nanoseconds},
        "h_samples": h_samples.tolist(),
        "lanes": truth.tusimple_lane_columns(h_samples),
        "raw_file": f"{index:06d}",
        "lateral_offset_m": round(truth.lateral_offset_m, 6),
        "heading_rad": round(truth.heading_rad, 8),
        "curvature_1pm": round(truth.curvature_1pm, 10),
        "lane_width_m": round(truth.lane_width_m, 6),
        "camera_pitch_rad": round(truth.camera.pitch_rad, 8),
        "ground_x_m": list(DISTANCES_AHEAD_OF_LANE_LABEL_POINTS_M),
        "ground_left_y_m": truth.boundary_y_m("left", x_m).round(6).tolist(),
        "ground_right_y_m": truth.boundary_y_m("right", x_m).round(6).tolist(),
    }
    return json.dumps(document, separators=(",", ":")).encode()


def _lateral_truth_channel(drive: RoadDrive, truths: Sequence[LaneTruth], stamp_ns: Int64Array) -> OutputChannel:
    """The channel of the true lateral motion, and of the lane ahead in the paper's signs."""
    states = drive.states_at(drive.time_s)
    preview = np.array([truth.lane_centre_at_preview(PAPER_PREVIEW_M) for truth in truths])
    ahead = np.array(
        [truth.lane_centre_y_direction_curvature(DISTANCES_AHEAD_OF_TRUE_LANE_POINTS_M) for truth in truths]
    )
    columns: dict[str, OutputField] = {
        "stamp_ns": stamp_ns,
        "lateral_speed_mps": states[:, LATERAL_SPEED],
        "yaw_rate_radps": states[:, YAW_RATE],
        "lateral_deviation_m": -preview[:, 0],
        "heading_deviation_rad": -preview[:, 1],
        "steer_rad": states[:, STEER],
        "preview_distance_m": np.full(len(truths), PAPER_PREVIEW_M),
        "ahead_m": np.tile(DISTANCES_AHEAD_OF_TRUE_LANE_POINTS_M, (len(truths), 1)),
        "ahead_lateral_deviation_m": -ahead[:, 0],
        "ahead_heading_deviation_rad": -ahead[:, 1],
    }
    return OutputChannel(TRUE_LATERAL_MOTION_TOPIC, "cwcli.v1.LateralState", stamp_ns, columns)


def _ego_truth_channel(drive: RoadDrive, stamp_ns: Int64Array) -> OutputChannel:
    """The channel of the car's true track, in the frame of its start; the heading is its direction of motion."""
    states = drive.states_at(drive.time_s)
    n = len(stamp_ns)
    along = drive.speed_at_mps(drive.time_s)
    columns: dict[str, OutputField] = {
        "stamp_ns": stamp_ns,
        "id": repeat_string("ego", n),
        "x_m": states[:, X],
        "y_m": states[:, Y],
        "speed_mps": np.hypot(along, states[:, LATERAL_SPEED]),
        "heading_rad": states[:, BEARING] + np.arctan2(states[:, LATERAL_SPEED], along),
        "accel_mps2": np.full(n, drive.config.accel_mps2),
        "yaw_rate_radps": states[:, YAW_RATE],
        "jerk_mps3": np.zeros(n),
        "yaw_accel_radps2": np.gradient(drive.fine_states[:, YAW_RATE], drive.fine_time_s)[
            np.searchsorted(drive.fine_time_s, drive.time_s).clip(max=len(drive.fine_time_s) - 1)
        ],
        "latitude_deg": np.full(n, np.nan),
        "longitude_deg": np.full(n, np.nan),
    }
    return OutputChannel(TRUE_EGO_TOPIC, "cwcli.v1.VehicleState", stamp_ns, columns)


def _sensor_times_s(drive: RoadDrive, rate_hz: float) -> FloatArray:
    """The times of a sensor's messages over the drive, shape (n,), s."""
    return np.asarray(np.arange(int(drive.time_s[-1] * rate_hz + 1e-9) + 1) / rate_hz)


def _add_noise_and_stamps(
    name: str, time_s: FloatArray, values: FloatArray, sigma: FloatArray, seed: int
) -> SensorData:
    """Add noise, stamps and log times to exact values (n, k) of a sensor."""
    noise = random_stream(seed, "road-drive", name).standard_normal(values.shape) * sigma
    stamp_ns = DRIVE_START_STAMP_NS + seconds_to_ns(time_s)
    return SensorData(name, stamp_ns, stamp_ns + SENSOR_STAMP_TO_LOG_TIME_DELAY_NS, values + noise, sigma, 0)


def _simulate_speed_sensor(drive: RoadDrive) -> SensorData:
    time_s = _sensor_times_s(drive, SPEED_RATE_HZ)
    return _add_noise_and_stamps(
        "speed", time_s, drive.speed_at_mps(time_s)[:, None], np.array([SPEED_SENSOR_SIGMA_MPS]), drive.config.seed
    )


def _simulate_imu(drive: RoadDrive) -> SensorData:
    """Simulate the IMU at the centre of gravity of a level car.

    It reads the accelerations dv/dt - v_y gamma, dv_y/dt + v gamma and g, and the yaw rate.
    """
    time_s = _sensor_times_s(drive, IMU_RATE_HZ)
    states, along = drive.states_at(time_s), drive.speed_at_mps(time_s)
    v_y, yaw_rate = states[:, LATERAL_SPEED], states[:, YAW_RATE]
    dv_y = np.interp(time_s, drive.fine_time_s, np.gradient(drive.fine_states[:, LATERAL_SPEED], drive.fine_time_s))
    zero = np.zeros(len(time_s))
    accel = [drive.config.accel_mps2 - v_y * yaw_rate, dv_y + along * yaw_rate, zero + STANDARD_GRAVITY_MPS2]
    return _add_noise_and_stamps(
        "imu", time_s, np.column_stack([*accel, zero, zero, yaw_rate]), IMU_NOISE_SIGMAS_MPS2_RADPS, drive.config.seed
    )
