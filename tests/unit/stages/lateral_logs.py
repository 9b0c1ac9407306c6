"""Logs of a simulated car in a lane, as after `cwcli lanes`: boundaries, speed, gyroscope, truth; without frames."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cwcli.dynamics.vehicle import Vehicle, load_vehicle
from cwcli.logs.encoders.byte_rows import ByteRows
from cwcli.logs.write.writer import LogWriter
from cwcli.signals.columns import FloatArray, Int64Array, OutputChannel, OutputField, Strings
from cwcli.simulate.cdr import ROS_MESSAGE_DEFINITIONS, encode_imu_messages, encode_velocity_reports
from cwcli.simulation.lane_camera import (
    LaneSensorNoise,
    SensedDrive,
    simulate_lane_sensors_of_run,
)
from cwcli.simulation.lane_drive import LaneDriveTruth, LaneRuns, Road, simulate_lane_runs
from cwcli.simulation.sensors import SensorData
from tests.unit.dynamics.true_lane import true_lane_at_preview

CAR = load_vehicle()
START_NS = 1_700_000_000_000_000_000
BENDS = Road(np.array([0.0, 60.0, 140.0, 260.0, 340.0]), np.array([0.0, 0.0, 0.002, 0.002, 0.0]))
LANES, SPEED, IMU, TRUTH, EGO_TRUTH = "/cwcli/lanes", "/vehicle/velocity", "/imu/data", "/truth/lateral", "/truth/ego"
STEERING = "/vehicle/steering"
DELAY_NS = 20_000_000


@dataclass(frozen=True)
class LaneDrive:
    """One run: truth at 100 Hz, and what was sensed."""

    truth: LaneDriveTruth
    sensed: SensedDrive
    road: Road
    car: Vehicle


def drive(
    *,
    seconds: float = 12.0,
    speed_mps: float = 25.0,
    drift_mps: float = 0.0,
    road: Road = BENDS,
    noise: LaneSensorNoise | None = None,
    seed: int = 3,
    car: Vehicle = CAR,
) -> LaneDrive:
    """One car; a drift begins after 3 s."""
    begins = 3.0 if drift_mps else np.inf
    runs = LaneRuns(np.array([speed_mps]), np.array([drift_mps]), np.array([begins]), 0.0, seconds)
    truth = simulate_lane_runs(road, car, runs, seed=seed)
    return LaneDrive(truth, simulate_lane_sensors_of_run(truth, 0, road, car, noise=noise, seed=seed), road, car)


def write_lane_log(
    path: Path,
    driven: LaneDrive,
    *,
    without: tuple[str, ...] = (),
    lane_order: Int64Array | None = None,
    gyro_sign: float = 1.0,
    speed_gap_s: tuple[float, float] | None = None,
    speed_factor: float = 1.0,
    clock_offset_ns: int = 0,
) -> Path:
    """Write the run; `without` names topics that are left out."""
    truth, sensed = driven.truth, driven.sensed
    with LogWriter(path) as log:
        for channel in (lanes_channel(sensed, lane_order), *truth_channels(driven)):
            if channel.topic not in without:
                log.write_columns(channel)
        if SPEED not in without:
            keep = np.ones(len(sensed.speed.stamp_ns), np.bool_)
            if speed_gap_s is not None:
                at_s = sensed.speed.stamp_ns * 1e-9
                keep = (at_s < speed_gap_s[0]) | (at_s >= speed_gap_s[1])
            stamp_ns = START_NS + sensed.speed.stamp_ns[keep] + clock_offset_ns
            values = speed_factor * sensed.speed.values[keep, None]
            data = SensorData("speed", stamp_ns, stamp_ns + 1_000_000, values, np.array([0.05]), 0)
            _write(log, SPEED, "autoware_vehicle_msgs/msg/VelocityReport", data, encode_velocity_reports(data))
        if IMU not in without:
            stamp_ns = START_NS + sensed.yaw_rate.stamp_ns
            zero = np.zeros(len(stamp_ns))
            turned = gyro_sign * sensed.yaw_rate.values
            values = np.column_stack([zero, zero, zero + 9.81, zero, zero, turned])
            data = SensorData("imu", stamp_ns, stamp_ns + 1_000_000, values, np.full(6, 0.0017), 0)
            _write(log, IMU, "sensor_msgs/msg/Imu", data, encode_imu_messages(data))
        if STEERING not in without:
            rows = slice(None, None, 2)
            stamp_ns = START_NS + np.round(truth.time_s[rows] * 1e9).astype(np.int64)
            messages = [
                json.dumps(
                    {"stamp": {"sec": int(t // 10**9), "nanosec": int(t % 10**9)}, "steering_tire_angle": float(angle)}
                ).encode()
                for t, angle in zip(stamp_ns, truth.steer_rad[rows, 0], strict=True)
            ]
            schema = log.add_schema("autoware_vehicle_msgs/msg/SteeringReport", "jsonschema", b'{"type":"object"}')
            log.write_messages(log.add_channel(STEERING, "json", schema), stamp_ns, messages)
    return path


def lanes_channel(sensed: SensedDrive, order: Int64Array | None = None) -> OutputChannel:
    """`cwcli.v1.Lanes` as `cwcli lanes` writes it."""
    lanes = sensed.lanes
    n = len(lanes)
    rows = np.arange(n) if order is None else order
    fields: dict[str, OutputField] = {"stamp_ns": START_NS + lanes.stamp_ns}
    for side, body in (("left", sensed.left_body), ("right", sensed.right_body)):
        fields[f"{side}.found"] = np.asarray(np.isfinite(body).all(axis=1))
        for k, name in enumerate(("lateral_m", "slope", "ground_curvature_1pm")):
            fields[f"{side}.{name}"] = body[:, k]
    for name in ("lateral_deviation_m", "heading_deviation_rad", "curvature_1pm"):
        fields[name] = getattr(lanes, name)
    for name, sigma in (
        ("lateral_deviation_sigma_m", lanes.lateral_sigma_m),
        ("heading_deviation_sigma_rad", lanes.heading_sigma_rad),
        ("curvature_sigma_1pm", lanes.curvature_sigma_1pm),
    ):
        assert sigma is not None
        fields[name] = sigma
    fields["preview_distance_m"] = np.full(n, 33.5)
    chosen = {name: np.asarray(values)[rows] for name, values in fields.items()}
    return OutputChannel(LANES, "cwcli.v1.Lanes", START_NS + lanes.stamp_ns + DELAY_NS, chosen)


def truth_channels(driven: LaneDrive) -> tuple[OutputChannel, OutputChannel]:
    """The true lateral motion, and the true track with the direction of motion as its heading."""
    truth, index = driven.truth, driven.sensed.index
    stamp_ns = START_NS + driven.sensed.stamp_ns
    preview = true_lane_at_preview(truth, 0, index, driven.road, driven.car)
    at = {name: getattr(truth, name)[index, 0] for name in ("lateral_speed_mps", "yaw_rate_radps", "steer_rad")}
    lateral = OutputChannel(
        TRUTH,
        "cwcli.v1.LateralState",
        stamp_ns,
        {"stamp_ns": stamp_ns, **at, "lateral_deviation_m": preview[:, 0], "heading_deviation_rad": preview[:, 1]},
    )
    return lateral, OutputChannel(EGO_TRUTH, "cwcli.v1.VehicleState", stamp_ns, _state_fields(driven, stamp_ns))


def ego_state_channel(driven: LaneDrive) -> OutputChannel:
    """What `cwcli estimate` would have found, without an error, at times between the frames."""
    stamp_ns = START_NS + np.round(driven.truth.time_s * 1e9).astype(np.int64)
    index = np.arange(0, len(stamp_ns), 5)
    fields = _state_fields(driven, stamp_ns[index], index)
    fields["covariance"] = np.tile((1e-4 * np.eye(8)).ravel(), (len(index), 1))
    return OutputChannel("/cwcli/ego/state", "cwcli.v1.VehicleState", stamp_ns[index], fields)


def _state_fields(driven: LaneDrive, stamp_ns: Int64Array, index: Int64Array | None = None) -> dict[str, OutputField]:
    truth = driven.truth
    rows = driven.sensed.index if index is None else index
    v, lateral = truth.speed_mps[rows, 0], truth.lateral_speed_mps[rows, 0]
    zero: FloatArray = np.zeros(len(rows))
    return {
        "stamp_ns": stamp_ns,
        "id": Strings(np.zeros(len(rows), np.int32), ("ego",)),
        "x_m": truth.x_m[rows, 0],
        "y_m": truth.y_m[rows, 0],
        "speed_mps": np.hypot(v, lateral),
        "heading_rad": truth.yaw_rad[rows, 0] + np.arctan2(lateral, v),
        "accel_mps2": zero,
        "yaw_rate_radps": truth.yaw_rate_radps[rows, 0],
        "jerk_mps3": zero,
        "yaw_accel_radps2": zero,
        "latitude_deg": zero + np.nan,
        "longitude_deg": zero + np.nan,
        "length_m": zero + np.nan,
        "width_m": zero + np.nan,
    }


def _write(log: LogWriter, topic: str, schema: str, data: SensorData, messages: ByteRows | list[bytes]) -> None:
    schema_id = log.add_schema(schema, "ros2msg", ROS_MESSAGE_DEFINITIONS[schema].encode())
    log.write_messages(log.add_channel(topic, "cdr", schema_id), data.log_time_ns, messages)
