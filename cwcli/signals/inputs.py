"""The registry of inputs: which schema can fill which role, which leaf fields that takes, and who builds the signal.

To add a message type: write its builder in a file, and add one entry here.
"""

from __future__ import annotations

import re

from cwcli.signals import etsi, j2735
from cwcli.signals.build_camera import build_camera_info
from cwcli.signals.build_imu import build_imu
from cwcli.signals.build_motion import build_quaternion_heading, build_twist, build_velocity_report
from cwcli.signals.build_pose import build_odometry_speed, build_pose, build_vehicle_state
from cwcli.signals.build_position import build_fix
from cwcli.signals.build_v2x import OWN_BUILDERS, remote_builder
from cwcli.signals.codec import Input, Role
from cwcli.signals.leaves import CDR_FOXGLOVE_STAMP, HEADER_STAMP, JSON_STAMPS, PROTOBUF_STAMP
from cwcli.signals.remote_rows import V2xCodec

GNSS_WORDS = frozenset({"gps", "gnss", "ins", "navsat", "ublox", "novatel", "septentrio", "enu", "map"})

Fields = dict[str, tuple[str, ...]]


def normalise(schema_name: str) -> str:
    """One spelling for a schema: `sensor_msgs/msg/NavSatFix`, `sensor_msgs/NavSatFix` and the DDS form are the same."""
    name = schema_name.replace("::", "/").replace("/dds_/", "/").removesuffix("_")
    return re.sub(r"/msg/", "/", name)


def is_gnss_topic(topic: str) -> bool:
    """A topic whose twist is taken for a velocity over ground before its frame_id is known."""
    return not GNSS_WORDS.isdisjoint(re.split(r"[/_]+", topic.lower()))


def is_vehicle_topic(topic: str) -> bool:
    """A topic whose twist is taken for a body twist before its frame_id is known: every other one."""
    return not is_gnss_topic(topic)


def _ros(*leaves: str) -> Fields:
    """Leaf fields of a ROS message with a header: CDR, or JSON with the same names."""
    named = (*HEADER_STAMP, "header.frame_id", *leaves)
    return {"cdr": named, "json": (*named, *JSON_STAMPS)}


def _foxglove(*leaves: str) -> Fields:
    """Leaf fields of a foxglove message: protobuf, JSON, or CDR (`foxglove_msgs`)."""
    return {
        "protobuf": (*PROTOBUF_STAMP, "frame_id", *leaves),
        "json": (*JSON_STAMPS, "frame_id", *leaves),
        "cdr": (*CDR_FOXGLOVE_STAMP, "frame_id", *leaves),
    }


def _xyz(path: str) -> tuple[str, ...]:
    return tuple(f"{path}.{axis}" for axis in "xyz")


def _quaternion(path: str) -> tuple[str, ...]:
    return tuple(f"{path}.{axis}" for axis in "xyzw")


_FIX = ("latitude", "longitude", "altitude", "position_covariance", "position_covariance_type")
_ROS_FIX = _ros("status.status", *_FIX)
_FOXGLOVE_FIX = _foxglove(*_FIX)
_IMU = _ros(
    *_xyz("linear_acceleration"),
    "linear_acceleration_covariance",
    *_xyz("angular_velocity"),
    "angular_velocity_covariance",
)
_IMU_ORIENTATION = _ros(*_quaternion("orientation"), "orientation_covariance")
_TWIST = _ros("twist.linear.x", "twist.linear.y", "twist.angular.z")
_TWIST_COVARIANCE = _ros("twist.twist.linear.x", "twist.twist.linear.y", "twist.twist.angular.z", "twist.covariance")
_ODOMETRY = _ros(
    "child_frame_id",
    *_xyz("pose.pose.position"),
    *_quaternion("pose.pose.orientation"),
    "pose.covariance",
    "twist.twist.linear.x",
    "twist.twist.linear.y",
    "twist.twist.angular.z",
)
_POSE_STAMPED = _ros(*_xyz("pose.position"), *_quaternion("pose.orientation"))
_POSE_IN_FRAME = _foxglove(*_xyz("pose.position"), *_quaternion("pose.orientation"))
_VELOCITY_REPORT = _ros("longitudinal_velocity", "lateral_velocity", "heading_rate")
_CAMERA_INFO = _ros("width", "height", "distortion_model", "d", "k", "r", "p", "D", "K", "R", "P")
_CALIBRATION = _foxglove("width", "height", "distortion_model", "D", "K", "R", "P")
_EN_CAM = tuple(etsi.EN_PATHS.values())
_TS_CAM = tuple(etsi.TS_PATHS.values())
_CARMA_FLAGS = tuple(dict.fromkeys(path for path, _ in j2735.CARMA_PRESENCE.values()))
_STATE: Fields = {
    "protobuf": ("stamp_ns", "id", "x_m", "y_m", "speed_mps", "heading_rad", "yaw_rate_radps"),
}
_FRAMES: Fields = {}
"""Cameras are streamed frame by frame: no columns."""


def _both(leaves: tuple[str, ...]) -> Fields:
    return {"cdr": leaves, "json": leaves}


def _fix(fields: Fields) -> tuple[Input, ...]:
    return (Input(Role.EGO_POSITION, fields, build_fix), Input(Role.TRUTH, fields, build_fix))


def _twist(fields: Fields) -> tuple[Input, ...]:
    return (
        Input(Role.EGO_VELOCITY, fields, build_twist, fits=is_gnss_topic),
        Input(Role.EGO_SPEED, fields, build_twist, fits=is_vehicle_topic),
    )


def _pose(fields: Fields) -> tuple[Input, ...]:
    return (Input(Role.TRUTH, fields, build_pose), Input(Role.EGO_POSITION, fields, build_pose, rank=2))


def _v2x(fields: Fields, codec: V2xCodec, *, says_who_is_ego: bool = False) -> tuple[Input, ...]:
    """A V2X schema: remote vehicles, and the ego's own messages where it is known which ones these are."""
    own = (
        Input(role, fields, builder(codec), rank=1, needs_ego_station=not says_who_is_ego)
        for role, builder in OWN_BUILDERS.items()
    )
    return (Input(Role.REMOTE, fields, remote_builder(codec)), *own)


_JSON_BSM: Fields = {"json": j2735.json_fields()}
_CAMERA = (Input(Role.CAMERA, _FRAMES, None),)

INPUTS: dict[str, tuple[Input, ...]] = {
    "sensor_msgs/NavSatFix": _fix(_ROS_FIX),
    "foxglove.LocationFix": _fix(_FOXGLOVE_FIX),
    "foxglove_msgs/LocationFix": _fix(_FOXGLOVE_FIX),
    "sensor_msgs/Imu": (
        Input(Role.IMU, _IMU, build_imu),
        Input(Role.EGO_HEADING, _IMU_ORIENTATION, build_quaternion_heading, rank=None),
    ),
    "geometry_msgs/TwistStamped": _twist(_TWIST),
    "geometry_msgs/TwistWithCovarianceStamped": _twist(_TWIST_COVARIANCE),
    "geometry_msgs/QuaternionStamped": (
        Input(Role.EGO_HEADING, _ros(*_quaternion("quaternion")), build_quaternion_heading),
    ),
    "geometry_msgs/PoseStamped": _pose(_POSE_STAMPED),
    "nav_msgs/Odometry": (*_pose(_ODOMETRY), Input(Role.EGO_SPEED, _ODOMETRY, build_odometry_speed, rank=2)),
    "foxglove.PoseInFrame": _pose(_POSE_IN_FRAME),
    "foxglove_msgs/PoseInFrame": _pose(_POSE_IN_FRAME),
    "autoware_vehicle_msgs/VelocityReport": (Input(Role.EGO_SPEED, _VELOCITY_REPORT, build_velocity_report),),
    "autoware_auto_vehicle_msgs/VelocityReport": (Input(Role.EGO_SPEED, _VELOCITY_REPORT, build_velocity_report),),
    "sensor_msgs/CompressedImage": _CAMERA,
    "sensor_msgs/Image": _CAMERA,
    "foxglove.CompressedImage": _CAMERA,
    "foxglove.RawImage": _CAMERA,
    "foxglove_msgs/CompressedImage": _CAMERA,
    "foxglove_msgs/RawImage": _CAMERA,
    "sensor_msgs/CameraInfo": (Input(Role.CAMERA_INFO, _CAMERA_INFO, build_camera_info),),
    "foxglove.CameraCalibration": (Input(Role.CAMERA_INFO, _CALIBRATION, build_camera_info),),
    "foxglove_msgs/CameraCalibration": (Input(Role.CAMERA_INFO, _CALIBRATION, build_camera_info),),
    "etsi_its_cam_msgs/CAM": _v2x(_both(_EN_CAM), etsi.CAM),
    "etsi_its_cam_ts_msgs/CAM": _v2x(_both(_TS_CAM), etsi.CAM),
    "j2735_v2x_msgs/BSM": _v2x(_both(tuple(j2735.ROS.values())), j2735.ROS_BSM),
    "carma_v2x_msgs/BSM": _v2x(_both((*j2735.ROS.values(), *_CARMA_FLAGS)), j2735.CARMA_BSM),
    "BasicSafetyMessage": _v2x(_JSON_BSM, j2735.JSON_BSM),
    "MessageFrame": _v2x(_JSON_BSM, j2735.JSON_BSM),
    "OdeBsmData": _v2x(_JSON_BSM, j2735.JSON_BSM, says_who_is_ego=True),
    "OdeBsmJson": _v2x(_JSON_BSM, j2735.JSON_BSM, says_who_is_ego=True),
    "OdeMessageFrameData": _v2x(_JSON_BSM, j2735.JSON_BSM, says_who_is_ego=True),
    "cwcli.v1.VehicleState": (
        Input(Role.TRUTH, _STATE, build_vehicle_state),
        Input(Role.EGO_STATE, _STATE, None),
        Input(Role.REMOTE_STATE, _STATE, None),
    ),
    "cwcli.v1.PredictedPath": (Input(Role.EGO_PATH, {}, None), Input(Role.REMOTE_PATH, {}, None)),
}


def inputs_of(schema_name: str) -> tuple[Input, ...]:
    """The registry's entries for a schema name in any spelling, () for an unknown one."""
    name = normalise(schema_name)
    return INPUTS.get(name) or INPUTS.get(name.rsplit(".", 1)[-1], ())


def input_for(role: Role, schema_name: str) -> Input | None:
    """The entry of a schema for a role, or None."""
    return next((entry for entry in inputs_of(schema_name) if entry.role == role), None)
