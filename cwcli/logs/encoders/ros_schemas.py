"""ROS 2 message definitions that cwcli writes: standard ones, and its own messages as `cwcli_msgs`.

The standard ones are those of common_interfaces, geometry2 and rcl_interfaces, the same from Humble to Rolling; without
comments and constants. A message of `cwcli_msgs` has the fields of its `cwcli.v1` twin under the same names.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from cwcli.logs.codecs.protobuf_tables import is_repeated_field
from cwcli.logs.codecs.ros2msg import (
    PRIMITIVE_DTYPES,
    STRING_TYPE,
    package_slash_message_name,
    parse_message_definitions,
)

if TYPE_CHECKING:
    from google.protobuf.descriptor import Descriptor, FieldDescriptor

CWCLI_ROS_PACKAGE = "cwcli_msgs"
"""The ROS 2 package name of cwcli's own messages."""
CWCLI_PROTOBUF_PACKAGE = "cwcli.v1"
"""The protobuf package name of cwcli's own messages."""
DEFINITION_SEPARATOR = "=" * 80
"""The line between two message definitions in a `ros2msg` schema (MCAP registry)."""

_XYZ_FIELDS = "float64 x\nfloat64 y\nfloat64 z\n"
"""The fields of points and vectors in `geometry_msgs`."""
_STANDARD_DEFINITIONS = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "geometry_msgs/Point": _XYZ_FIELDS,
    "geometry_msgs/Vector3": _XYZ_FIELDS,
    "geometry_msgs/Quaternion": _XYZ_FIELDS + "float64 w\n",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    "geometry_msgs/PoseStamped": "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance\n",
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n",
    "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist\nfloat64[36] covariance\n",
    "geometry_msgs/TwistStamped": "std_msgs/Header header\ngeometry_msgs/Twist twist\n",
    "geometry_msgs/QuaternionStamped": "std_msgs/Header header\ngeometry_msgs/Quaternion quaternion\n",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n"
    ),
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "nav_msgs/Odometry": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n"
        "geometry_msgs/TwistWithCovariance twist\n"
    ),
    "nav_msgs/Path": "std_msgs/Header header\ngeometry_msgs/PoseStamped[] poses\n",
    "sensor_msgs/NavSatStatus": "int8 status\nuint16 service\n",
    "sensor_msgs/NavSatFix": (
        "std_msgs/Header header\nsensor_msgs/NavSatStatus status\nfloat64 latitude\nfloat64 longitude\n"
        "float64 altitude\nfloat64[9] position_covariance\nuint8 position_covariance_type\n"
    ),
    "sensor_msgs/Imu": (
        "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
        "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
        "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n"
    ),
    "autoware_vehicle_msgs/VelocityReport": (
        "std_msgs/Header header\nfloat32 longitudinal_velocity\nfloat32 lateral_velocity\nfloat32 heading_rate\n"
    ),
    "autoware_vehicle_msgs/SteeringReport": "builtin_interfaces/Time stamp\nfloat32 steering_tire_angle\n",
    "diagnostic_msgs/KeyValue": "string key\nstring value\n",
    "diagnostic_msgs/DiagnosticStatus": (
        "byte level\nstring name\nstring message\nstring hardware_id\ndiagnostic_msgs/KeyValue[] values\n"
    ),
    "diagnostic_msgs/DiagnosticArray": "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status\n",
    "rcl_interfaces/Log": (
        "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\nstring function\n"
        "uint32 line\n"
    ),
}
"""Short name of a standard message -> its fields as text (common_interfaces, geometry2, rcl_interfaces)."""

_ROS_TYPE_BY_PROTOBUF_TYPE = {
    1: "float64", 2: "float32", 3: "int64", 4: "uint64", 5: "int32", 6: "uint64", 7: "uint32", 8: "bool",
    9: "string", 13: "uint32", 14: "int32", 15: "int32", 16: "int64", 17: "int32", 18: "int64",
}  # fmt: skip
"""Field type of protobuf (`FieldDescriptorProto.Type`) -> primitive type of ROS; an enum becomes a number."""
_PROTOBUF_TYPE_MESSAGE = 11
"""The field type (`FieldDescriptorProto.Type`) of a message inside a message."""


def is_ros2_message_name(schema_name: str) -> bool:
    """Tell whether a schema's name is that of a ROS 2 message: `package/msg/Name`."""
    return "/msg/" in schema_name


@cache
def ros2msg_schema_text(schema_name: str) -> str:
    """Return the `ros2msg` text of a message: its fields, then the definition of each message inside.

    Raises:
        KeyError: There is no such message.
    """
    root = package_slash_message_name(schema_name)
    bodies = {root: _ros_field_lines_by_short_name(root)}
    waiting = [root]
    while waiting:
        name = waiting.pop(0)
        _, definitions = parse_message_definitions(name, bodies[name])
        for field in definitions[name]:
            if field.type not in PRIMITIVE_DTYPES and field.type != STRING_TYPE and field.type not in bodies:
                bodies[field.type] = _ros_field_lines_by_short_name(field.type)
                waiting.append(field.type)
    parts = [bodies.pop(root), *(f"MSG: {name}\n{body}" for name, body in bodies.items())]
    return f"{DEFINITION_SEPARATOR}\n".join(parts)


def _ros_field_lines_by_short_name(name: str) -> str:
    """Return the field lines of a message by its short name.

    Raises:
        KeyError: There is no such message.
    """
    package, _, message = name.partition("/")
    if package != CWCLI_ROS_PACKAGE:
        return _STANDARD_DEFINITIONS[name]
    from cwcli.logs.encoders.schemas import find_message_schema

    descriptor = find_message_schema(f"{CWCLI_PROTOBUF_PACKAGE}.{message}").descriptor
    return "".join(f"{line}\n" for line in _ros_field_and_constant_lines(descriptor))


def _ros_field_and_constant_lines(descriptor: Descriptor) -> list[str]:
    """Return the field lines of a protobuf message, each after the constants of its enum."""
    lines = []
    for field in sorted(descriptor.fields, key=lambda each: each.number):
        if field.enum_type is not None:
            lines += [f"int32 {value.name}={value.number}" for value in field.enum_type.values]
        lines.append(f"{_ros_type_of_field(field)}{'[]' if is_repeated_field(field) else ''} {field.name}")
    return lines


def _ros_type_of_field(field: FieldDescriptor) -> str:
    if field.type == _PROTOBUF_TYPE_MESSAGE:
        return f"{CWCLI_ROS_PACKAGE}/{field.message_type.name}"
    return _ROS_TYPE_BY_PROTOBUF_TYPE[field.type]
