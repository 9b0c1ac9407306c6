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
"""The path prefix of the GroundTruth in a SensorView."""
EMBEDDED = f"sensor_view.{WORLD}"
"""The path prefix of the GroundTruth in a SensorData, inside its SensorView."""
STATIONARY, PROJECTION = "stationary_object", "proj_string"
"""The fields of a GroundTruth that are counted and not used: stationary objects, and the map projection."""
DETECTED_STATIONARY = f"{STATIONARY}.base.position.x"
"""The path that counts the stationary objects that a sensor detected."""
_MOTION = ("position.x", "position.y", "orientation.yaw", "velocity.x", "velocity.y", "orientation_rate.yaw")
"""The leaf paths of position and motion of an object."""
_BASE = (*_MOTION, "acceleration.x", "acceleration.y", "dimension.length", "dimension.width")
"""The leaf paths of an object's base: position, motion and size."""
_OBJECT = (
    "id.value",
    "type",
    *(f"base.{leaf}" for leaf in _BASE),
    "vehicle_attributes.bbcenter_to_rear.x",
    "vehicle_attributes.bbcenter_to_rear.y",
)
"""The leaf paths of a moving object."""


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
"""The leaf fields of a GroundTruth, by encoding."""
_SENSOR_VIEW: Fields = {"protobuf": (*_times(), "host_vehicle_id.value", *_world(WORLD))}
"""The leaf fields of a SensorView, by encoding."""
_SENSOR_DATA_WORLD: Fields = {"protobuf": (*_times(), "sensor_view.host_vehicle_id.value", *_world(EMBEDDED))}
"""The leaf fields of the GroundTruth inside a SensorData, by encoding."""
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
"""The leaf fields of the detections of a SensorData, by encoding."""
_HOST_VEHICLE_DATA: Fields = {
    "protobuf": (
        *_times(),
        *(f"{part}.{leaf}" for part in ("location", "vehicle_motion") for leaf in _MOTION),
        *(f"location_rmse.{leaf}" for leaf in ("position.x", "position.y", "orientation.yaw")),
        *(f"vehicle_localization.{leaf}" for leaf in _MOTION[:3]),
        *(f"vehicle_localization.geodetic_position.{name}" for name in ("latitude", "longitude", "altitude")),
    )
}
"""The leaf fields of a HostVehicleData, by encoding."""


def _builder(name: str) -> Build:
    """Return the builder `osi.module.name`, imported when a channel is built."""

    def build(columns: Columns, reading: Reading) -> tuple[Signal, Quality]:
        made: tuple[Signal, Quality] = in_signals(name)(columns, reading)
        return made

    return build


def _world_inputs(fields: Fields, module: str, rank: int) -> tuple[Input, ...]:
    """Return the registry rows of ego and truth in a GroundTruth; a sensor of the same log is preferred."""
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
"""The registry rows of `osi3.HostVehicleData`."""
GROUND_TRUTH = (*_world_inputs(_GROUND_TRUTH, "ground_truth", 4), _remote(_GROUND_TRUTH, "ground_truth", 4))
"""The registry rows of `osi3.GroundTruth`."""
SENSOR_VIEW = (*_world_inputs(_SENSOR_VIEW, "sensor_view", 5), _remote(_SENSOR_VIEW, "sensor_view", 5))
"""The registry rows of `osi3.SensorView`."""
SENSOR_DATA = (
    *_world_inputs(_SENSOR_DATA_WORLD, "sensor_data", 6),
    Input(Role.DETECTIONS, _DETECTED, _builder("osi.sensor_data.build_detections"), says_what_it_is=True),
)
"""The registry rows of `osi3.SensorData`."""
