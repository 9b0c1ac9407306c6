"""`simulate`: a simulated drive as a log, and the logs of `sample_logs/`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.logs.encoders.schemas import schema_folder
from cwcli.logs.write.writer import LogWriter
from cwcli.output_stream import OutputStream
from cwcli.signals.columns import (
    Field,
    FloatArray,
    Int64Array,
    OutputChannel,
    Strings,
    repeat_string,
    select_column_rows,
)
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import STATE_NAMES
from cwcli.simulate.cdr import (
    BODY_FRAME_ID,
    ROS_MESSAGE_DEFINITIONS,
    encode_gnss_headings,
    encode_imu_messages,
    encode_navsat_fixes,
    encode_velocity_reports,
)
from cwcli.simulate.v2x import BSM_SCHEMA, ODE_SCHEMA, encode_bsm_json, encode_ode_json
from cwcli.simulation.detectors import DetectionScans, positions_and_velocities_in_host_body_frame
from cwcli.simulation.drive import SimulatedDrive
from cwcli.simulation.scenario import EGO_VEHICLE_KEY, Scenario, ScenarioVehicle
from cwcli.simulation.spec import SCENARIO_TOP_LEVEL_KEYS
from cwcli.simulation.streams import seconds_to_ns
from cwcli.version import __version__

SENSOR_TOPICS = {
    "gnss": ("/gps/fix", "sensor_msgs/msg/NavSatFix"),
    "gnss_heading": ("/gps/heading", "geometry_msgs/msg/QuaternionStamped"),
    "speed": ("/vehicle/velocity", "autoware_vehicle_msgs/msg/VelocityReport"),
    "imu": ("/imu/data", "sensor_msgs/msg/Imu"),
}
"""Topic and schema of each sensor of a scenario."""
DETECTION_TOPICS = {"lidar": "/lidar/detections", "radar": "/radar/detections"}
"""Topic of the detections of each sensor of other vehicles."""
DETECTIONS_SCHEMA_NAME = "cwcli.Detections"
"""Schema name of the messages of detections, which are JSON."""
DETECTION_DECIMALS = 9
"""Digits behind the point of detected values, so that the last bits of a processor's sine can't change a log."""
DETECTION_VALUE_NAMES = {"lidar": ("x_m", "y_m"), "radar": ("range_m", "azimuth_rad", "range_rate_mps")}
"""Sensor -> names of the values that it detects, as in schemas/detections.schema.json."""
TARGET_TRUTH_TOPIC = "/truth/targets"
"""Topic of the true motion of what lidar and radar detect, in the car's frame (`cwcli.v1.Target`). It is written where
the log has no GNSS, since tracks are in the car's frame then."""
V2X_TOPICS = {"bsm-json": ("/v2x/bsm", BSM_SCHEMA), "ode-json": ("/v2x/ode_bsm", ODE_SCHEMA)}
"""Topic and JSON schema of each V2X format."""
EGO_TRUTH_TOPIC = "/truth/ego"
"""Topic of the ego's true states."""
OTHER_VEHICLES_TOPIC = "/simulation/vehicles"
"""Topic of the other vehicles' true states. It is not under `/truth`, so that the ego's truth stays the log's only
truth channel."""

METADATA_NAME = "cwcli.scenario"
"""Name of the metadata record with the scenario."""


@dataclass(frozen=True)
class WrittenChannel:
    """The number of messages written to one topic, and of those that the scenario lost on the way."""

    topic: str
    schema_name: str
    n_messages: int
    n_lost: int


def write_simulated_log(
    drive: SimulatedDrive, target: str | Path | OutputStream, *, force: bool = False
) -> tuple[WrittenChannel, ...]:
    """Write a simulated drive as an MCAP log; the same drive gives the same bytes.

    Args:
        drive: See `cwcli.simulation.drive.simulate_scenario`.
        target: File, `-` for standard output, or an open output, which stays open.

    Returns:
        One entry per topic, in the order of the file's channels.

    Raises:
        OutputError: The target can't be written.
    """
    scenario = drive.scenario
    local_map = LocalMap(*(scenario.origin[name] for name in ("latitude_deg", "longitude_deg", "altitude_m")))
    with LogWriter(target, force=force) as log:
        topics = [
            *_write_sensor_channels(log, drive, local_map),
            *_write_detection_channels(log, drive),
            *_write_v2x_channel(log, drive, local_map),
            *_write_truth_channels(log, scenario, local_map),
        ]
        log.add_metadata(METADATA_NAME, scenario_record_entries(drive))
    return tuple(topics)


def scenario_record_entries(drive: SimulatedDrive) -> dict[str, str]:
    """The content of the metadata record `cwcli.scenario`: enough to make the log again.

    `scenario` is the file's content after overrides, `resolved` the same with every default filled in, both JSON.
    """
    scenario = drive.scenario
    resolved: dict[str, Any] = {
        **{key: getattr(scenario, key) for key in SCENARIO_TOP_LEVEL_KEYS},
        "seed": drive.seed,
        "origin": dict(scenario.origin),
        "sensors": {
            name: {key: value for key, value in settings.items() if value is not None}
            for name, settings in scenario.sensors.items()
        },
        "v2x": None
        if scenario.v2x is None
        else {key: value for key, value in scenario.v2x.items() if value is not None},
    }
    return {
        "name": scenario.name,
        "version": __version__,
        "seed": str(drive.seed),
        "start_ns": str(scenario.start_ns),
        "origin_latitude_deg": repr(scenario.origin["latitude_deg"]),
        "origin_longitude_deg": repr(scenario.origin["longitude_deg"]),
        "origin_altitude_m": repr(scenario.origin["altitude_m"]),
        "stations": _format_json({name: vehicle.station_id for name, vehicle in scenario.vehicles.items()}),
        "scenario": _format_json(scenario.document),
        "resolved": _format_json(resolved),
    }


def _write_sensor_channels(log: LogWriter, drive: SimulatedDrive, local_map: LocalMap) -> list[WrittenChannel]:
    """Write one channel per sensor of the host."""
    topics = []
    for sensor, data in drive.sensors.items():
        topic, schema_name = SENSOR_TOPICS[sensor]
        if sensor == "gnss":
            messages = encode_navsat_fixes(data, local_map)
        else:
            encode = {
                "gnss_heading": encode_gnss_headings,
                "speed": encode_velocity_reports,
                "imu": encode_imu_messages,
            }[sensor]
            messages = encode(data)
        schema_id = log.add_schema(schema_name, "ros2msg", ROS_MESSAGE_DEFINITIONS[schema_name].encode())
        log.write_messages(log.add_channel(topic, "cdr", schema_id), data.log_time_ns, messages)
        topics.append(WrittenChannel(topic, schema_name, len(messages), data.n_lost))
    return topics


def _write_detection_channels(log: LogWriter, drive: SimulatedDrive) -> list[WrittenChannel]:
    """Write one channel for the lidar and one for the radar, and the true motion of what they detect."""
    topics = []
    for sensor, scans in drive.detections.items():
        messages = _encode_detections(scans)
        schema_id = log.add_schema(
            DETECTIONS_SCHEMA_NAME, "jsonschema", (schema_folder() / "detections.schema.json").read_bytes()
        )
        channel_id = log.add_channel(DETECTION_TOPICS[sensor], "json", schema_id)
        log.write_messages(channel_id, scans.log_time_ns, messages)
        topics.append(WrittenChannel(DETECTION_TOPICS[sensor], DETECTIONS_SCHEMA_NAME, len(messages), scans.n_lost))
    if drive.detections and "gnss" not in drive.sensors:
        channel = _target_truth_channel(drive.scenario)
        log.write_columns(channel)
        topics.append(WrittenChannel(channel.topic, channel.schema_name, len(channel), 0))
    return topics


def _encode_detections(scans: DetectionScans) -> list[bytes]:
    """Encode the scans of one sensor as JSON messages, one a scan, with the noise that is in them."""
    names = DETECTION_VALUE_NAMES[scans.sensor]
    sigmas = [round(float(sigma), DETECTION_DECIMALS) for sigma in scans.sigma]
    if scans.sensor == "lidar":
        noise = {"covariance_xx_m2": sigmas[0] ** 2, "covariance_xy_m2": 0.0, "covariance_yy_m2": sigmas[1] ** 2}
    else:
        noise = dict(zip(("range_sigma_m", "azimuth_sigma_rad", "range_rate_sigma_mps"), sigmas, strict=True))
    rows = [
        {**dict(zip(names, (round(value, DETECTION_DECIMALS) for value in row), strict=True)), **noise}
        for row in scans.values.tolist()
    ]
    messages = []
    for stamp_ns, first, last in zip(
        scans.stamp_ns.tolist(), scans.first[:-1].tolist(), scans.first[1:].tolist(), strict=True
    ):
        sec, nsec = divmod(stamp_ns, NS_PER_S)
        document: dict[str, Any] = {
            "timestamp": {"sec": int(sec), "nsec": int(nsec)},
            "frame_id": BODY_FRAME_ID,
            "detections": rows[first:last],
        }
        messages.append(json.dumps(document).encode())
    return messages


def _target_truth_channel(scenario: Scenario) -> OutputChannel:
    """The channel of the other vehicles' true motion in the car's frame, time by time; steps of 1e-9."""
    n = int(np.floor(scenario.duration_s * scenario.truth_rate_hz + 1e-9)) + 1
    time_s: FloatArray = np.arange(n, dtype=np.float64) / scenario.truth_rate_hz
    host = scenario.vehicles[EGO_VEHICLE_KEY].motion.states_at(time_s)
    others = [vehicle for name, vehicle in scenario.vehicles.items() if name != EGO_VEHICLE_KEY]
    relative = np.stack(
        [positions_and_velocities_in_host_body_frame(host, each.motion.states_at(time_s)) for each in others], axis=1
    )
    rows = relative.reshape(-1, 4).round(9) + 0.0
    ids = Strings(np.tile(np.arange(len(others), dtype=np.int32), n), tuple(each.station_id for each in others))
    stamp_ns = np.repeat(scenario.start_ns + seconds_to_ns(time_s), len(others))
    fields: dict[str, Field] = {
        "stamp_ns": stamp_ns,
        "id": ids,
        **dict(zip(("x_m", "y_m", "vx_mps", "vy_mps"), rows.T, strict=True)),
        "frame_id": repeat_string(BODY_FRAME_ID, len(stamp_ns)),
    }
    return OutputChannel(TARGET_TRUTH_TOPIC, "cwcli.v1.Target", stamp_ns, fields)


def _write_v2x_channel(log: LogWriter, drive: SimulatedDrive, local_map: LocalMap) -> list[WrittenChannel]:
    """Write all vehicles' V2X messages to one topic, in the order of reception."""
    settings = drive.scenario.v2x
    if settings is None:
        return []
    topic, schema = V2X_TOPICS[settings["format"]]
    encode = {"bsm-json": encode_bsm_json, "ode-json": encode_ode_json}[settings["format"]]
    messages: list[bytes] = []
    log_times: list[Int64Array] = [np.zeros(0, np.int64)]
    for received in drive.v2x.values():
        messages += encode(received, local_map)
        log_times.append(received.log_time_ns)
    log_time_ns = np.concatenate(log_times)
    order = np.argsort(log_time_ns, kind="stable")
    schema_id = log.add_schema(schema["title"], "jsonschema", json.dumps(schema).encode())
    channel_id = log.add_channel(topic, "json", schema_id)
    log.write_messages(channel_id, log_time_ns[order], [messages[i] for i in order.tolist()])
    n_lost = sum(received.n_lost for received in drive.v2x.values())
    return [WrittenChannel(topic, schema["title"], len(messages), n_lost)]


def _write_truth_channels(log: LogWriter, scenario: Scenario, local_map: LocalMap) -> list[WrittenChannel]:
    """Write the true states of the ego and, on a topic of their own, of the others."""
    n = int(np.floor(scenario.duration_s * scenario.truth_rate_hz + 1e-9)) + 1
    time_s: FloatArray = np.arange(n, dtype=np.float64) / scenario.truth_rate_hz
    others = {name: vehicle for name, vehicle in scenario.vehicles.items() if name != EGO_VEHICLE_KEY}
    groups = [(EGO_TRUTH_TOPIC, {EGO_VEHICLE_KEY: scenario.vehicles[EGO_VEHICLE_KEY]})] + (
        [(OTHER_VEHICLES_TOPIC, others)] if others else []
    )
    topics = []
    for topic, vehicles in groups:
        channel = _vehicle_truth_channel(topic, vehicles, time_s, scenario.start_ns, local_map)
        log.write_columns(channel)
        topics.append(WrittenChannel(topic, channel.schema_name, len(channel), 0))
    return topics


def _vehicle_truth_channel(
    topic: str, vehicles: Mapping[str, ScenarioVehicle], time_s: FloatArray, start_ns: int, local_map: LocalMap
) -> OutputChannel:
    """The channel of true `cwcli.v1.VehicleState` of some vehicles, time by time; steps of 1e-9 (1e-11 deg)."""
    n_vehicles, n_times = len(vehicles), len(time_s)
    states = np.stack([vehicle.motion.states_at(time_s) for vehicle in vehicles.values()], axis=1).reshape(-1, 8)
    lat_deg, lon_deg, _ = local_map.wgs84_from_map(states[:, 0], states[:, 1], np.zeros(len(states)))
    stamp_ns = np.repeat(start_ns + seconds_to_ns(time_s), n_vehicles)
    ids = tuple("ego" if name == EGO_VEHICLE_KEY else vehicle.station_id for name, vehicle in vehicles.items())
    fields: dict[str, Field] = {
        "stamp_ns": stamp_ns,
        "id": Strings(np.tile(np.arange(n_vehicles, dtype=np.int32), n_times), ids),
        **{name: states[:, i].round(9) + 0.0 for i, name in enumerate(STATE_NAMES)},
        "latitude_deg": lat_deg.round(11),
        "longitude_deg": lon_deg.round(11),
        "length_m": np.tile([vehicle.length_m for vehicle in vehicles.values()], n_times),
        "width_m": np.tile([vehicle.width_m for vehicle in vehicles.values()], n_times),
    }
    present = np.stack([vehicle.motion.is_present_at(time_s) for vehicle in vehicles.values()], axis=1).ravel()
    rows = np.flatnonzero(present)
    fields = {name: select_column_rows(column, rows) for name, column in fields.items()}
    return OutputChannel(topic, "cwcli.v1.VehicleState", stamp_ns[rows], fields)


def _format_json(value: Any) -> str:
    """Format a value as JSON; times become text."""
    return json.dumps(value, default=str)
