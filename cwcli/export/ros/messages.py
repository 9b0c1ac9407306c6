"""Conversions of cwcli's messages to ROS 2 messages: a table, and a function for each that changes fields.

States, targets and paths become the standard messages that RViz and evo read; values without a field there
(accelerations, flags, models) are in the annotated log only. Other messages become messages of `cwcli_msgs`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from cwcli.channels.published import OWN_TOPIC_PREFIX, PUBLISHED_CHANNELS
from cwcli.channels.vehicle_state import read_vehicle_states
from cwcli.errors import DataError
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.codecs.ros2msg import Definitions, find_message_fields, parse_message_definitions
from cwcli.logs.encoders.cdr_encoder import encode_cdr
from cwcli.logs.encoders.column_tree import ColumnError
from cwcli.logs.encoders.ros_schemas import CWCLI_PROTOBUF_PACKAGE, CWCLI_ROS_PACKAGE, ros2msg_schema_text
from cwcli.signals.columns import (
    Columns,
    FloatArray,
    Int64Array,
    OutputField,
    Ragged,
    Repeated,
    Strings,
    encode_strings,
    repeat_string,
    slice_column,
)
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.leaf_fields import (
    find_field,
    read_integers,
    read_matrix,
    read_numbers,
    read_stamps,
    read_texts,
    read_vector,
    unusable_field_error,
)
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import BODY_FRAME, EGO_ID, HEADING, MAP_FRAME, SPEED, YAW_RATE, X, Y

Fields = Mapping[str, OutputField]
POSE_COVARIANCE_SIZE = 36
"""Number of values in the 6 x 6 covariance of x, y, z, roll, pitch and yaw (geometry_msgs/PoseWithCovariance)."""
YAW_ROW_OF_POSE_COVARIANCE = 5
"""The row and column of yaw in a 6 x 6 covariance of position and rotation (geometry_msgs/PoseWithCovariance)."""
WARNING_STATE_CLEARED = 3
"""The value of `cwcli.v1.Warning.State` for a cleared warning."""
DIAGNOSTIC_LEVEL_OK, DIAGNOSTIC_LEVEL_WARN = 0, 1
"""The values of OK and WARN for the level of a `diagnostic_msgs/DiagnosticStatus`."""
ROS_LOG_LEVEL_PER_FOXGLOVE_LEVEL = 10
"""Factor from levels of foxglove.Log (1, 2, ...) to those of rcl_interfaces/Log (10, 20, ...)."""
MAX_FOXGLOVE_LOG_LEVEL = 25
"""Largest level of foxglove.Log whose converted level, ten times as large, still fits into a byte."""
_OWN_AND_ROS_PREFIX = (f"{CWCLI_PROTOBUF_PACKAGE}.", f"{CWCLI_ROS_PACKAGE}/msg/")
"""Beginnings of the names of an own message and of its ROS twin, which has the same fields."""
SERVICE_GPS = 1
"""The value of SERVICE_GPS in sensor_msgs/NavSatStatus."""
NAVSATFIX_COVARIANCE_TYPES = (0, 1, 2, 3)
"""The values of position_covariance_type in sensor_msgs/NavSatFix."""
ROS_TIME_LIMIT_S = 1 << 31
"""Bound of the seconds in a ROS time, an int32."""
NUMERIC_WARNING_FIELDS_OF_DIAGNOSTIC_STATUS = (
    "time_to_event_s",
    "predicted_distance_m",
    "ttc_s",
    "probability",
    "alert_probability",
)
"""Numeric fields of a warning that become key-value pairs of a diagnostic status."""


@dataclass(frozen=True)
class RosConversion:
    """The ROS message that a message is converted to.

    Attributes:
        schema: Name of the ROS message, `package/msg/Name`.
        make_fields: Function from the channel's columns, and the log's map or None, to the fields of the ROS message.
    """

    schema: str
    make_fields: Callable[[Columns, LocalMap | None], Fields]


def _copy_fields_of_same_name(columns: Columns, _map: LocalMap | None) -> Fields:
    """Copy the fields that the ROS message has under the same names."""
    schema = ROS_CONVERSIONS[columns.schema_name].schema
    unknown = names_of_fields_left_out_of_ros(columns)
    fields = {path: column for path, column in columns.fields.items() if path not in unknown}
    for path, column in fields.items():
        try:
            encode_cdr(schema, {path: slice_column(column, 0, 0)}, 0)
        except ColumnError as error:
            raise unusable_field_error(columns, path) from error
    return fields


def names_of_fields_left_out_of_ros(columns: Columns) -> list[str]:
    """Names of the fields of a channel copied field by field that the ROS message does not have."""
    message = ROS_CONVERSIONS[columns.schema_name]
    if message.make_fields is not _copy_fields_of_same_name:
        return []
    root, definitions = parse_message_definitions(message.schema, ros2msg_schema_text(message.schema))
    return [path for path in columns.fields if not _has_field(definitions, root, path)]


def _has_field(definitions: Definitions, name: str, path: str) -> bool:
    """Whether a message definition has a field of this path, of any type."""
    head, _, rest = path.partition(".")
    for field in find_message_fields(definitions, name):
        if field.name == head:
            return not rest or field.type not in definitions or _has_field(definitions, field.type, rest)
    return False


def _odometry_fields_of_states(columns: Columns, local_map: LocalMap | None) -> Fields:
    """Convert states to odometry in the map of this log; a truth with another map origin is moved there."""
    has_covariance = isinstance(find_field(columns, "sigma"), np.ndarray)
    states = read_vehicle_states(columns, with_covariance=has_covariance)
    state = states.state.copy()
    if local_map is not None and not columns.topic.startswith(OWN_TOPIC_PREFIX):
        lat_deg, lon_deg = (read_numbers(columns, name) for name in ("latitude_deg", "longitude_deg"))
        x_m, y_m, _ = local_map.map_from_wgs84(lat_deg, lon_deg, np.full(len(state), np.nan))
        has_position = np.isfinite(x_m)
        state[has_position, X], state[has_position, Y] = x_m[has_position], y_m[has_position]
    child = Strings(states.ids.codes, tuple(BODY_FRAME if name == EGO_ID else name for name in states.ids.values))
    pose, twist = np.zeros((2, len(state), 6, 6))
    if has_covariance:
        covariance = states.covariance
        for a, row in ((X, 0), (Y, 1), (HEADING, YAW_ROW_OF_POSE_COVARIANCE)):
            for b, column in ((X, 0), (Y, 1), (HEADING, YAW_ROW_OF_POSE_COVARIANCE)):
                pose[:, row, column] = covariance[:, a, b]
        for a, row in ((SPEED, 0), (YAW_RATE, YAW_ROW_OF_POSE_COVARIANCE)):
            for b, column in ((SPEED, 0), (YAW_RATE, YAW_ROW_OF_POSE_COVARIANCE)):
                twist[:, row, column] = covariance[:, a, b]
    x_m, y_m, speed, heading = state[:, [X, Y, SPEED, HEADING]].T
    motion = speed, heading, state[:, YAW_RATE]
    frame = repeat_string(MAP_FRAME, len(state))
    return _odometry_fields(states.stamp_ns, frame, child, (x_m, y_m), motion, (pose, twist))


def _odometry_fields_of_targets(columns: Columns, _map: LocalMap | None) -> Fields:
    """Convert targets to odometry in their own frame, the map's or the car's."""
    n = len(columns)
    x_m, y_m, vx, vy = (read_numbers(columns, name, required=True) for name in ("x_m", "y_m", "vx_mps", "vy_mps"))
    heading = np.arctan2(vy, vx)
    covariance = read_matrix(columns, "covariance", 16).reshape(n, 4, 4)
    pose, twist = np.zeros((2, n, 6, 6))
    pose[:, :2, :2] = covariance[:, :2, :2]
    cosine, sine = np.cos(heading), np.sin(heading)
    body_from_frame = np.stack([np.stack([cosine, sine], axis=1), np.stack([-sine, cosine], axis=1)], axis=1)
    twist[:, :2, :2] = body_from_frame @ covariance[:, 2:, 2:] @ body_from_frame.transpose(0, 2, 1)
    yaw_rate = np.nan_to_num(read_numbers(columns, "yaw_rate_radps"))
    stamp_ns, _ = read_integers(columns, "stamp_ns", required=True)
    frame, ids = (read_texts(columns, name, required=True) for name in ("frame_id", "id"))
    return _odometry_fields(stamp_ns, frame, ids, (x_m, y_m), (np.hypot(vx, vy), heading, yaw_rate), (pose, twist))


def _odometry_fields(
    stamp_ns: Int64Array,
    frame: Strings,
    child: Strings,
    place: tuple[FloatArray, FloatArray],
    motion: tuple[FloatArray, FloatArray, FloatArray],
    covariances: tuple[FloatArray, FloatArray],
) -> Fields:
    """Make the fields of `nav_msgs/Odometry`, twist in the body frame; height, roll and pitch are zero and exact."""
    speed, heading, yaw_rate = motion
    pose, twist = (np.nan_to_num(each.reshape(len(stamp_ns), POSE_COVARIANCE_SIZE)) for each in covariances)
    return {
        **_header_fields(stamp_ns, frame),
        "child_frame_id": child,
        "pose.pose.position.x": place[0],
        "pose.pose.position.y": place[1],
        **_quaternion_z_w_fields_of_heading("pose.pose.orientation", heading),
        "pose.covariance": pose,
        "twist.twist.linear.x": speed,
        "twist.twist.angular.z": yaw_rate,
        "twist.covariance": twist,
    }


def _nav_path_fields(columns: Columns, _map: LocalMap | None) -> Fields:
    """Make the fields of `nav_msgs/Path`; the stamp of each point is its predicted time."""
    stamp_ns, _ = read_integers(columns, "stamp_ns", required=True)
    x_m, y_m, heading = (_read_ragged_numbers(columns, name) for name in ("x_m", "y_m", "heading_rad"))
    for name, other in (("y_m", y_m), ("heading_rad", heading)):
        if not np.array_equal(other.offsets, x_m.offsets):
            raise DataError(f"{name} has not as many points as x_m", where=columns.topic)
    frames = read_texts(columns, "frame_id", required=True)
    frame = Strings(frames.codes, tuple(name or MAP_FRAME for name in frames.values))
    counts = np.diff(x_m.offsets)
    row = np.repeat(np.arange(len(columns)), counts)
    step = np.arange(len(row)) - np.repeat(x_m.offsets[:-1], counts)
    with np.errstate(over="ignore"):
        ahead_s = step * read_numbers(columns, "step_s", required=True, takes_impossible_numbers=True)[row]
    if not (np.abs(ahead_s) < ROS_TIME_LIMIT_S).all():
        raise DataError("step_s is not a time between points", where=columns.topic)
    ahead_ns = np.round(ahead_s * NS_PER_S).astype(np.int64)
    points: Fields = {
        **_header_fields(stamp_ns[row] + ahead_ns, frame.select_rows(row)),
        "pose.position.x": x_m.values,
        "pose.position.y": y_m.values,
        **_quaternion_z_w_fields_of_heading("pose.orientation", np.asarray(heading.values, np.float64)),
    }
    return {**_header_fields(stamp_ns, frame), "poses": Repeated(x_m.offsets, points)}


def _read_ragged_numbers(columns: Columns, name: str) -> Ragged:
    """Read a repeated numeric field of n rows; all rows are empty if the field is missing."""
    field, n = find_field(columns, name), len(columns)
    if field is None:
        return Ragged(np.zeros(0), np.zeros(n + 1, np.int64))
    if isinstance(field, Ragged):
        return field
    if isinstance(field, np.ndarray) and field.ndim == 2:
        return Ragged(field.ravel(), np.arange(n + 1, dtype=np.int64) * field.shape[1])
    raise unusable_field_error(columns, name)


def _diagnostics_fields(columns: Columns, _map: LocalMap | None) -> Fields:
    """Make the fields of `diagnostic_msgs/DiagnosticArray` with one status: WARN until the warning is cleared."""
    n = len(columns)
    stamp_ns, _ = read_integers(columns, "known_ns", "stamp_ns", required=True)
    state = read_integers(columns, "state", required=True)[0]
    event = read_integers(columns, "event_id", required=True)[0]
    values_by_field = {name: read_numbers(columns, name) for name in NUMERIC_WARNING_FIELDS_OF_DIAGNOSTIC_STATUS}
    values = [
        {
            "event_id": str(event[k]),
            **{name: f"{each[k]:.6g}" for name, each in values_by_field.items() if np.isfinite(each[k])},
        }
        for k in range(n)
    ]
    offsets = np.cumsum([0, *map(len, values)]).astype(np.int64)
    pairs: Fields = {
        "key": encode_strings([key for row in values for key in row]),
        "value": encode_strings([value for row in values for value in row.values()]),
    }
    rule = read_texts(columns, "rule", required=True)
    status: Fields = {
        "level": np.where(state == WARNING_STATE_CLEARED, DIAGNOSTIC_LEVEL_OK, DIAGNOSTIC_LEVEL_WARN),
        "name": Strings(rule.codes, tuple(f"cwcli warn: {name}" for name in rule.values)),
        "message": read_texts(columns, "message", required=True),
        "hardware_id": read_texts(columns, "other_id", required=True),
        "values": Repeated(offsets, pairs),
    }
    return {"header.stamp": stamp_ns, "status": _one_element_per_row(n, status)}


def _rcl_log_fields(columns: Columns, _map: LocalMap | None) -> Fields:
    return {
        "stamp": read_stamps(columns)[0],
        "level": ROS_LOG_LEVEL_PER_FOXGLOVE_LEVEL
        * np.clip(read_integers(columns, "level", required=True)[0], 0, MAX_FOXGLOVE_LOG_LEVEL),
        "name": read_texts(columns, "name", required=True),
        "msg": read_texts(columns, "message", required=True),
    }


def _nav_sat_fix_fields(columns: Columns, _map: LocalMap | None) -> Fields:
    covariance = read_matrix(columns, "position_covariance", 9)
    kind = read_numbers(columns, "position_covariance_type").copy()
    kind[~(np.isfinite(covariance).all(axis=1) & np.isin(kind, NAVSATFIX_COVARIANCE_TYPES))] = 0.0
    return {
        **_header_fields(read_stamps(columns)[0], read_texts(columns, "frame_id", required=True)),
        "status.service": np.full(len(columns), SERVICE_GPS),
        **{name: read_numbers(columns, name) for name in ("latitude", "longitude", "altitude")},
        "position_covariance": np.nan_to_num(covariance),
        "position_covariance_type": kind,
    }


def _pose_stamped_fields(columns: Columns, _map: LocalMap | None) -> Fields:
    return {
        **_header_fields(read_stamps(columns)[0], read_texts(columns, "frame_id", required=True)),
        **_copy_vector_fields(columns, "pose.position", "xyz"),
        **_copy_quaternion_fields(columns, "pose.orientation"),
    }


def _transform_fields(columns: Columns, _map: LocalMap | None) -> Fields:
    each: Fields = {
        **_header_fields(read_stamps(columns)[0], read_texts(columns, "parent_frame_id", required=True)),
        "child_frame_id": read_texts(columns, "child_frame_id", required=True),
        **{f"transform.{name}": v for name, v in _copy_vector_fields(columns, "translation", "xyz").items()},
        **{f"transform.{name}": v for name, v in _copy_quaternion_fields(columns, "rotation").items()},
    }
    return {"transforms": _one_element_per_row(len(columns), each)}


def _one_element_per_row(n: int, fields: Fields) -> Repeated:
    return Repeated(np.arange(n + 1, dtype=np.int64), fields)


def _header_fields(stamp_ns: Int64Array, frame: Strings) -> dict[str, OutputField]:
    return {"header.stamp": stamp_ns, "header.frame_id": frame}


def _quaternion_z_w_fields_of_heading(path: str, heading_rad: FloatArray) -> dict[str, OutputField]:
    return {f"{path}.z": np.sin(0.5 * heading_rad), f"{path}.w": np.cos(0.5 * heading_rad)}


def _copy_vector_fields(columns: Columns, path: str, names: str) -> dict[str, OutputField]:
    values = read_vector(columns, path, tuple(names))
    return {f"{path}.{name}": values[:, k] for k, name in enumerate(names)}


def _copy_quaternion_fields(columns: Columns, path: str) -> dict[str, OutputField]:
    """Copy a quaternion; missing ones become the identity."""
    turn = read_vector(columns, path, ("x", "y", "z", "w"))
    turn[~np.isfinite(turn).all(axis=1)] = 0.0, 0.0, 0.0, 1.0
    return {f"{path}.{name}": turn[:, k] for k, name in enumerate("xyzw")}


ROS_CONVERSIONS = {
    **{
        each.schema: RosConversion(each.schema.replace(*_OWN_AND_ROS_PREFIX), _copy_fields_of_same_name)
        for each in PUBLISHED_CHANNELS
        if each.schema.startswith(_OWN_AND_ROS_PREFIX[0])
    },
    "cwcli.v1.VehicleState": RosConversion("nav_msgs/msg/Odometry", _odometry_fields_of_states),
    "cwcli.v1.Target": RosConversion("nav_msgs/msg/Odometry", _odometry_fields_of_targets),
    "cwcli.v1.PredictedPath": RosConversion("nav_msgs/msg/Path", _nav_path_fields),
    "cwcli.v1.Warning": RosConversion("diagnostic_msgs/msg/DiagnosticArray", _diagnostics_fields),
    "foxglove.LocationFix": RosConversion("sensor_msgs/msg/NavSatFix", _nav_sat_fix_fields),
    "foxglove.PoseInFrame": RosConversion("geometry_msgs/msg/PoseStamped", _pose_stamped_fields),
    "foxglove.FrameTransform": RosConversion("tf2_msgs/msg/TFMessage", _transform_fields),
    "foxglove.Log": RosConversion("rcl_interfaces/msg/Log", _rcl_log_fields),
}
"""Schema of a channel -> its ROS message; that of the same name for an own one that is not told here. Scenes and image
annotations are left out, because they only draw paths, targets and lanes, which are converted themselves."""
