"""Names of the leaf fields of OSI messages, and the rows of the input registry that take them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cwcli.signals.builders.base import Build, Fields, Input, Reading
from cwcli.signals.input_rows import in_signals
from cwcli.signals.role import Role

if TYPE_CHECKING:  # binding channels to roles takes no numpy
    from cwcli.signals.canonical import Signal
    from cwcli.signals.columns import Columns
    from cwcli.signals.quality import Quality

WORLD = "global_ground_truth."
"""Where a SensorView holds the GroundTruth."""
EMBEDDED = f"sensor_view.{WORLD}"
"""Where a SensorData holds the one of its SensorView."""
STATIONARY, PROJECTION = "stationary_object", "proj_string"
"""What of a GroundTruth is counted and not used: parked cars and obstacles, and where the world lies on the globe."""
DETECTED_STATIONARY = f"{STATIONARY}.base.position.x"
_MOTION = ("position.x", "position.y", "orientation.yaw", "velocity.x", "velocity.y", "orientation_rate.yaw")
_BASE = (*_MOTION, "acceleration.x", "acceleration.y", "dimension.length", "dimension.width")
_OBJECT = (
    "id.value",
    "type",
    *(f"base.{leaf}" for leaf in _BASE),
    "vehicle_attributes.bbcenter_to_rear.x",
    "vehicle_attributes.bbcenter_to_rear.y",
)


def _times(prefix: str = "") -> tuple[str, ...]:
    return (f"{prefix}timestamp.seconds", f"{prefix}timestamp.nanos")


def _world(prefix: str) -> tuple[str, ...]:
    return (
        *_times(prefix),
        f"{prefix}host_vehicle_id.value",
        f"{prefix}{STATIONARY}.id.value",
        f"{prefix}{PROJECTION}",
        *(f"{prefix}moving_object.{leaf}" for leaf in _OBJECT),
    )


_GROUND_TRUTH: Fields = {"protobuf": _world("")}
_SENSOR_VIEW: Fields = {"protobuf": (*_times(), "host_vehicle_id.value", *_world(WORLD))}
_SENSOR_DATA_WORLD: Fields = {"protobuf": (*_times(), "sensor_view.host_vehicle_id.value", *_world(EMBEDDED))}
_DETECTED: Fields = {
    "protobuf": (
        *_times(),
        "last_measurement_time.seconds",
        "last_measurement_time.nanos",
        *(f"mounting_position.position.{axis}" for axis in "xy"),
        "mounting_position.orientation.yaw",
        *(f"moving_object.base.{leaf}" for leaf in _BASE),
        *(f"moving_object.base_rmse.position.{axis}" for axis in "xy"),
        "moving_object.reference_point",
        DETECTED_STATIONARY,
        *_SENSOR_DATA_WORLD["protobuf"],
    )
}
_HOST_VEHICLE_DATA: Fields = {
    "protobuf": (
        *_times(),
        *(f"{part}.{leaf}" for part in ("location", "vehicle_motion") for leaf in _MOTION),
        *(f"location_rmse.{leaf}" for leaf in ("position.x", "position.y", "orientation.yaw")),
        *(f"vehicle_localization.{leaf}" for leaf in _MOTION[:3]),
        *(f"vehicle_localization.geodetic_position.{name}" for name in ("latitude", "longitude", "altitude")),
    )
}


def _builder(name: str) -> Build:
    """The builder `osi.module.name`, imported when a channel is built."""

    def build(columns: Columns, reading: Reading) -> tuple[Signal, Quality]:
        made: tuple[Signal, Quality] = in_signals(name)(columns, reading)
        return made

    return build


def _world_inputs(fields: Fields, module: str, rank: int) -> tuple[Input, ...]:
    """The ego, its truth and the truth of all others out of a GroundTruth; a sensor of the same log comes first."""
    return tuple(
        Input(role, fields, _builder(f"osi.{module}.build_{name}"), rank=rank, says_what_it_is=True)
        for role, name in (
            (Role.EGO_POSITION, "pose"),
            (Role.EGO_SPEED, "speed"),
            (Role.TRUTH, "pose"),
            (Role.TARGET_TRUTH, "target_truth"),
        )
    )


def _remote(fields: Fields, module: str, rank: int) -> Input:
    return Input(Role.REMOTE, fields, _builder(f"osi.{module}.build_remote"), rank=rank, says_what_it_is=True)


HOST_VEHICLE_DATA = tuple(
    Input(role, _HOST_VEHICLE_DATA, _builder(f"osi.host_vehicle_data.build_{name}"), rank=3, says_what_it_is=True)
    for role, name in ((Role.EGO_POSITION, "pose"), (Role.EGO_SPEED, "speed"))
)
GROUND_TRUTH = (*_world_inputs(_GROUND_TRUTH, "ground_truth", 4), _remote(_GROUND_TRUTH, "ground_truth", 4))
SENSOR_VIEW = (*_world_inputs(_SENSOR_VIEW, "sensor_view", 5), _remote(_SENSOR_VIEW, "sensor_view", 5))
SENSOR_DATA = (
    *_world_inputs(_SENSOR_DATA_WORLD, "sensor_data", 6),
    Input(Role.DETECTIONS, _DETECTED, _builder("osi.sensor_data.build_detections"), says_what_it_is=True),
)
