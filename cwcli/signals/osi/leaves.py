"""Names of the leaf fields of OSI messages, and the rows of the input registry that take them."""

from __future__ import annotations

from cwcli.signals.builders.base import Fields, Input
from cwcli.signals.input_rows import builder_imported_at_first_call
from cwcli.signals.role import Role

GROUND_TRUTH_PATH_PREFIX_IN_GROUND_TRUTH_MESSAGE = ""
"""The path prefix of the GroundTruth in a message that is one."""
GROUND_TRUTH_PATH_PREFIX_IN_SENSOR_VIEW = "global_ground_truth."
"""The path prefix of the GroundTruth in a SensorView."""
GROUND_TRUTH_PATH_PREFIX_IN_SENSOR_DATA = f"sensor_view.{GROUND_TRUTH_PATH_PREFIX_IN_SENSOR_VIEW}"
"""The path prefix of the GroundTruth in a SensorData, inside its SensorView."""
STATIONARY_OBJECT_FIELD, PROJECTION_FIELD = "stationary_object", "proj_string"
"""The fields of a GroundTruth that are counted and not used: stationary objects, and the map projection."""
PATH_THAT_COUNTS_DETECTED_STATIONARY_OBJECTS = f"{STATIONARY_OBJECT_FIELD}.base.position.x"
"""The path that counts the stationary objects that a sensor detected."""
_MOTION_PATHS = ("position.x", "position.y", "orientation.yaw", "velocity.x", "velocity.y", "orientation_rate.yaw")
"""The leaf paths of position and motion of an object."""
_BASE_PATHS = (*_MOTION_PATHS, "acceleration.x", "acceleration.y", "dimension.length", "dimension.width")
"""The leaf paths of an object's base: position, motion and size."""
_MOVING_OBJECT_PATHS = (
    "id.value",
    "type",
    *(f"base.{leaf}" for leaf in _BASE_PATHS),
    "vehicle_attributes.bbcenter_to_rear.x",
    "vehicle_attributes.bbcenter_to_rear.y",
)
"""The leaf paths of a moving object."""


def _timestamp_paths(prefix: str = "") -> tuple[str, ...]:
    return (f"{prefix}timestamp.seconds", f"{prefix}timestamp.nanos")


def _ground_truth_paths(prefix: str) -> tuple[str, ...]:
    return (
        *_timestamp_paths(prefix),
        f"{prefix}host_vehicle_id.value",
        f"{prefix}{STATIONARY_OBJECT_FIELD}.id.value",
        f"{prefix}{PROJECTION_FIELD}",
        *(f"{prefix}moving_object.{leaf}" for leaf in _MOVING_OBJECT_PATHS),
    )


_GROUND_TRUTH_FIELDS: Fields = {"protobuf": _ground_truth_paths("")}
"""The leaf fields of a GroundTruth, by encoding."""
_SENSOR_VIEW_FIELDS: Fields = {
    "protobuf": (
        *_timestamp_paths(),
        "host_vehicle_id.value",
        *_ground_truth_paths(GROUND_TRUTH_PATH_PREFIX_IN_SENSOR_VIEW),
    )
}
"""The leaf fields of a SensorView, by encoding."""
_GROUND_TRUTH_FIELDS_IN_SENSOR_DATA: Fields = {
    "protobuf": (
        *_timestamp_paths(),
        "sensor_view.host_vehicle_id.value",
        *_ground_truth_paths(GROUND_TRUTH_PATH_PREFIX_IN_SENSOR_DATA),
    )
}
"""The leaf fields of the GroundTruth inside a SensorData, by encoding."""
_DETECTED_OBJECT_FIELDS: Fields = {
    "protobuf": (
        *_timestamp_paths(),
        "last_measurement_time.seconds",
        "last_measurement_time.nanos",
        *(f"mounting_position.position.{axis}" for axis in "xy"),
        "mounting_position.orientation.yaw",
        *(f"moving_object.base.{leaf}" for leaf in _BASE_PATHS),
        *(f"moving_object.base_rmse.position.{axis}" for axis in "xy"),
        "moving_object.reference_point",
        PATH_THAT_COUNTS_DETECTED_STATIONARY_OBJECTS,
        *_GROUND_TRUTH_FIELDS_IN_SENSOR_DATA["protobuf"],
    )
}
"""The leaf fields of the detections of a SensorData, by encoding."""
_HOST_VEHICLE_DATA_FIELDS: Fields = {
    "protobuf": (
        *_timestamp_paths(),
        *(f"{part}.{leaf}" for part in ("location", "vehicle_motion") for leaf in _MOTION_PATHS),
        *(f"location_rmse.{leaf}" for leaf in ("position.x", "position.y", "orientation.yaw")),
        *(f"vehicle_localization.{leaf}" for leaf in _MOTION_PATHS[:3]),
        *(f"vehicle_localization.geodetic_position.{name}" for name in ("latitude", "longitude", "altitude")),
    )
}
"""The leaf fields of a HostVehicleData, by encoding."""


def _lazy_input(role: Role, fields: Fields, rank: int, *builder_and_first_arguments: str) -> Input:
    return Input(
        role,
        fields,
        builder_imported_at_first_call(*(f"osi.{place}" for place in builder_and_first_arguments)),
        rank=rank,
        says_what_it_is=True,
    )


def _ground_truth_inputs(fields: Fields, prefix: str, rank: int, *, with_remote: bool = True) -> tuple[Input, ...]:
    """Return the registry rows of a GroundTruth behind a prefix; a sensor of the same log is preferred."""
    builder_names_by_role = {
        Role.EGO_POSITION: "build_pose",
        Role.EGO_SPEED: "build_speed",
        Role.TRUTH: "build_pose",
        Role.TARGET_TRUTH: "build_target_truth",
        **({Role.REMOTE: "build_remote"} if with_remote else {}),
    }
    return tuple(
        _lazy_input(role, fields, rank, f"roles.{name}", f"leaves.{prefix}")
        for role, name in builder_names_by_role.items()
    )


HOST_VEHICLE_DATA_INPUTS = (
    _lazy_input(Role.EGO_POSITION, _HOST_VEHICLE_DATA_FIELDS, 3, "host_vehicle_data.build_pose"),
    _lazy_input(Role.EGO_SPEED, _HOST_VEHICLE_DATA_FIELDS, 3, "host_vehicle_data.build_speed"),
)
"""The registry rows of `osi3.HostVehicleData`."""
GROUND_TRUTH_INPUTS = _ground_truth_inputs(_GROUND_TRUTH_FIELDS, "GROUND_TRUTH_PATH_PREFIX_IN_GROUND_TRUTH_MESSAGE", 4)
"""The registry rows of `osi3.GroundTruth`."""
SENSOR_VIEW_INPUTS = _ground_truth_inputs(_SENSOR_VIEW_FIELDS, "GROUND_TRUTH_PATH_PREFIX_IN_SENSOR_VIEW", 5)
"""The registry rows of `osi3.SensorView`: the GroundTruth that a sensor is given. Its host carries the sensor."""
SENSOR_DATA_INPUTS = (
    *_ground_truth_inputs(
        _GROUND_TRUTH_FIELDS_IN_SENSOR_DATA, "GROUND_TRUTH_PATH_PREFIX_IN_SENSOR_DATA", 6, with_remote=False
    ),
    _lazy_input(Role.DETECTIONS, _DETECTED_OBJECT_FIELDS, 0, "sensor_data.build_detections"),
)
"""The registry rows of `osi3.SensorData`."""
