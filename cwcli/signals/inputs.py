"""The registry of inputs: which schema can fill which role, which leaf fields that takes, and who builds the signal.

To add a message type: write its builder in a file, and add one entry here. Other packages add theirs in the group
`cwcli.inputs`: an entry point named like the schema, for an `Input` or a tuple of them.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING

from cwcli.registry import Plugin, Registry, accept_dataclass_of
from cwcli.signals.builders.base import Fields, Input, Reading
from cwcli.signals.detection_inputs import DETECTION_INPUTS
from cwcli.signals.input_rows import (
    ODOMETRY_RANK,
    OWN_V2X_RANK,
    LazyFields,
    foxglove_leaf_fields,
    is_body_twist_topic,
    is_ego_topic,
    is_gnss_topic,
    is_measured_pose_topic,
    is_target_topic,
    lazy_builder,
    lazy_v2x_builder,
    load_from_signals,
    quaternion_leaf_paths,
    ros_leaf_fields,
    xyz_leaf_paths,
)
from cwcli.signals.receiver_inputs import RECEIVER_INPUTS
from cwcli.signals.role import Role

if TYPE_CHECKING:
    from cwcli.signals.columns import Columns


@lru_cache(maxsize=256)
def normalise_schema_name(schema_name: str) -> str:
    """Return one spelling of a schema name: `sensor_msgs/msg/NavSatFix`, `sensor_msgs/NavSatFix` and the DDS form are
    the same."""
    name = schema_name.replace("::", "/").replace("/dds_/", "/").removesuffix("_")
    return re.sub(r"/msg/", "/", name)


_build_pose_truth = lazy_builder("targets.build_pose_truth")
_build_state_truth = lazy_builder("targets.build_state_truth")
_build_target_truth = lazy_builder("targets.build_target_truth")
_build_camera_info = lazy_builder("camera.build_camera_info")
_build_imu = lazy_builder("imu.build_imu")
_build_quaternion_heading = lazy_builder("motion.build_quaternion_heading")
_build_twist = lazy_builder("motion.build_twist")
_build_velocity_report = lazy_builder("motion.build_velocity_report")
_build_steering_report = lazy_builder("steer.build_steering_report")
_build_odometry_speed = lazy_builder("pose.build_odometry_speed")
_build_pose = lazy_builder("pose.build_pose")
_build_vehicle_state = lazy_builder("pose.build_vehicle_state")
_build_fix = lazy_builder("position.build_fix")

_FIX_PATHS = ("latitude", "longitude", "altitude", "position_covariance", "position_covariance_type")
"""The leaf paths that both fix messages share."""
_ROS_FIX_FIELDS = ros_leaf_fields("status.status", *_FIX_PATHS)
"""The leaf fields of a `NavSatFix`, by encoding."""
_FOXGLOVE_FIX_FIELDS = foxglove_leaf_fields(*_FIX_PATHS)
"""The leaf fields of a `LocationFix`, by encoding."""
_IMU_FIELDS = ros_leaf_fields(
    *xyz_leaf_paths("linear_acceleration"),
    "linear_acceleration_covariance",
    *xyz_leaf_paths("angular_velocity"),
    "angular_velocity_covariance",
)
"""The leaf fields of an `Imu`'s measurements, by encoding."""
_IMU_ORIENTATION_FIELDS = ros_leaf_fields(*quaternion_leaf_paths("orientation"), "orientation_covariance")
"""The leaf fields of an `Imu`'s orientation, by encoding."""
_TWIST_FIELDS = ros_leaf_fields("twist.linear.x", "twist.linear.y", "twist.angular.z")
"""The leaf fields of a `TwistStamped`, by encoding."""
_TWIST_COVARIANCE_FIELDS = ros_leaf_fields(
    "twist.twist.linear.x", "twist.twist.linear.y", "twist.twist.angular.z", "twist.covariance"
)
"""The leaf fields of a `TwistWithCovarianceStamped`, by encoding."""
_ODOMETRY_FIELDS = ros_leaf_fields(
    "child_frame_id",
    *xyz_leaf_paths("pose.pose.position"),
    *quaternion_leaf_paths("pose.pose.orientation"),
    "pose.covariance",
    *xyz_leaf_paths("twist.twist.linear"),
    *xyz_leaf_paths("twist.twist.angular"),
    "twist.covariance",
)
"""The leaf fields of an `Odometry`, by encoding."""
_POSE_COVARIANCE_FIELDS = ros_leaf_fields(
    *xyz_leaf_paths("pose.pose.position"), *quaternion_leaf_paths("pose.pose.orientation"), "pose.covariance"
)
"""The leaf fields of a `PoseWithCovarianceStamped`, by encoding."""
_POSE_STAMPED_FIELDS = ros_leaf_fields(*xyz_leaf_paths("pose.position"), *quaternion_leaf_paths("pose.orientation"))
"""The leaf fields of a `PoseStamped`, by encoding."""
_POSE_IN_FRAME_FIELDS = foxglove_leaf_fields(
    *xyz_leaf_paths("pose.position"), *quaternion_leaf_paths("pose.orientation")
)
"""The leaf fields of a `PoseInFrame`, by encoding."""
_VELOCITY_REPORT_FIELDS = ros_leaf_fields("longitudinal_velocity", "lateral_velocity", "heading_rate")
"""The leaf fields of a `VelocityReport`, by encoding."""
_STEERING_REPORT_FIELDS: Fields = dict.fromkeys(("cdr", "json"), ("stamp.sec", "stamp.nanosec", "steering_tire_angle"))
"""The leaf fields of a `SteeringReport`, by encoding."""
_KINEMATIC_STATE_FIELDS = ros_leaf_fields(
    *("state.x", "state.y", "state.heading.real", "state.heading.imag", "state.heading_rate_rps"),
    *(*xyz_leaf_paths("state.pose.position"), *quaternion_leaf_paths("state.pose.orientation")),
    *("state.longitudinal_velocity_mps", "state.lateral_velocity_mps"),
)
"""The leaf fields of a `VehicleKinematicState`, by encoding."""
_ACKERMANN_FIELDS = ros_leaf_fields("drive.steering_angle")
"""The leaf fields of an `AckermannDriveStamped`, by encoding."""
_TIME_PART_NAMES = ("sec", "nanosec", "secs", "nsec", "nsecs")
"""The names that the parts of a ROS time have in different encodings."""
_TRAJECTORY_TIME_PATHS = tuple(f"points.time_from_start.{name}" for name in _TIME_PART_NAMES)
"""The leaf paths of the times of a trajectory's points."""
_TRAJECTORY_FIELDS = ros_leaf_fields(
    *_TRAJECTORY_TIME_PATHS, *xyz_leaf_paths("points.pose.position"), "points.longitudinal_velocity_mps"
)
"""The leaf fields of a `Trajectory`, by encoding."""
_PATH_FIELDS = ros_leaf_fields(
    *(f"poses.header.stamp.{name}" for name in _TIME_PART_NAMES), *xyz_leaf_paths("poses.pose.position")
)
"""The leaf fields of a `nav_msgs/Path`, by encoding."""
_CAMERA_INFO_FIELDS = ros_leaf_fields("width", "height", "distortion_model", "d", "k", "r", "p", "D", "K", "R", "P")
"""The leaf fields of a `CameraInfo`, by encoding."""
_CAMERA_CALIBRATION_FIELDS = foxglove_leaf_fields(
    "width", "height", "distortion_model", "D", "K", "R", "P", "d", "k", "r", "p"
)
"""The leaf fields of a `CameraCalibration`, by encoding."""
_VEHICLE_STATE_FIELDS: Fields = {
    "protobuf": (
        "stamp_ns",
        "id",
        "x_m",
        "y_m",
        "speed_mps",
        "heading_rad",
        "accel_mps2",
        "yaw_rate_radps",
        "latitude_deg",
        "longitude_deg",
    ),
}
"""The leaf fields of a `cwcli.v1.VehicleState`, by encoding."""
_TARGET_FIELDS: Fields = {
    "protobuf": ("stamp_ns", "id", "frame_id", "x_m", "y_m", "vx_mps", "vy_mps"),
}
"""The leaf fields of a `cwcli.v1.Target`, by encoding."""
_NO_FIELDS: Fields = {}
"""The leaf fields of camera images: none, because images are streamed frame by frame."""


def _fix_inputs(fields: Fields) -> tuple[Input, ...]:
    return (
        Input(Role.EGO_POSITION, fields, _build_fix),
        Input(Role.TRUTH, fields, _build_fix, fits_topic=is_ego_topic),
    )


def _twist_inputs(fields: Fields) -> tuple[Input, ...]:
    return (
        Input(Role.EGO_VELOCITY, fields, _build_twist, fits_topic=is_gnss_topic),
        Input(Role.EGO_SPEED, fields, _build_twist, fits_topic=is_body_twist_topic),
    )


def _plain_twist_input(base: str, *more: str) -> Input:
    leaves = (f"{base}linear.x", f"{base}angular.z", *more)
    fields = dict.fromkeys(("cdr", "json"), leaves)
    return Input(Role.EGO_SPEED, fields, lazy_builder("motion.build_plain_twist"), rank=None)


_PLAIN_SPEED_INPUT = Input(
    Role.EGO_SPEED, dict.fromkeys(("cdr", "json"), ("data",)), lazy_builder("motion.build_plain_speed"), rank=None
)
"""The registry row of a speed without a header."""


def _pose_inputs(fields: Fields, after: int = 0) -> tuple[Input, ...]:
    return (
        Input(Role.TRUTH, fields, _build_pose, rank=after, fits_topic=is_ego_topic),
        Input(Role.TARGET_TRUTH, fields, _build_pose_truth, rank=after, fits_topic=is_target_topic),
        Input(Role.EGO_POSITION, fields, _build_pose, rank=ODOMETRY_RANK + after, fits_topic=is_measured_pose_topic),
    )


_OWN_BUILDER_NAMES_BY_ROLE = {
    Role.EGO_POSITION: "own_position_builder",
    Role.EGO_SPEED: "own_speed_builder",
    Role.EGO_HEADING: "own_heading_builder",
}
"""The function of `builders.v2x` that makes the builder, by role of the ego."""


def _v2x_inputs(find: Callable[[], Fields], codec: str, *, says_who_is_ego: bool = False) -> tuple[Input, ...]:
    """Return the registry rows of a V2X schema: remote vehicles, and the ego's own messages where these are known."""
    fields = LazyFields(find)
    own = (
        Input(role, fields, lazy_v2x_builder(maker, codec), rank=OWN_V2X_RANK, needs_ego_station=not says_who_is_ego)
        for role, maker in _OWN_BUILDER_NAMES_BY_ROLE.items()
    )
    return (Input(Role.REMOTE, fields, lazy_v2x_builder("remote_builder", codec)), *own)


def _make_cam_fields_finder(paths: str) -> Callable[[], Fields]:
    """Return a function that finds the leaf fields of a CAM or VAM in a table of `etsi`."""

    def find_leaf_fields() -> Fields:
        leaves = load_from_signals("etsi.ros_fields")(load_from_signals(f"etsi.{paths}"))
        return {"cdr": leaves, "json": leaves}

    return find_leaf_fields


def _ros_bsm_fields() -> Fields:
    from cwcli.signals import j2735
    from cwcli.signals.bsm_flags import ros_event_flag_paths

    leaves = (*j2735.ROS_PATHS.values(), *ros_event_flag_paths())
    return {"cdr": leaves, "json": leaves}


def _carma_bsm_fields() -> Fields:
    from cwcli.signals import j2735
    from cwcli.signals.bsm_flags import ros_event_flag_paths

    presence = dict.fromkeys(path for _, path, _ in j2735.CARMA_PRESENCE_BITS)
    leaves = (*j2735.ROS_PATHS.values(), *presence, *ros_event_flag_paths())
    return {"cdr": leaves, "json": leaves}


def _radio_payload_fields() -> Fields:
    from cwcli.signals.radio.frames import OCTET_FIELD_NAMES

    return dict.fromkeys(("cdr", "json"), OCTET_FIELD_NAMES)


def _make_object_fields_finder(module: str) -> Callable[[], Fields]:
    """Return a function that finds the leaf fields of a message with perceived objects or events."""

    def find_leaf_fields() -> Fields:
        return dict.fromkeys(("cdr", "json"), load_from_signals(f"{module}.ros_fields")())

    return find_leaf_fields


def _json_bsm_fields() -> Fields:
    from cwcli.signals import j2735

    return {"json": j2735.json_bsm_leaf_fields()}


def _perceived_object_inputs(module: str, codec: str) -> tuple[Input, ...]:
    """Return the registry row of a schema whose messages tell of other objects or events only."""
    build = lazy_v2x_builder("remote_builder", f"{module}.{codec}")
    return (Input(Role.REMOTE, LazyFields(_make_object_fields_finder(module)), build, is_additive=True),)


_CAMERA_INPUTS = (Input(Role.CAMERA, _NO_FIELDS, None),)
"""The registry row of camera images."""


SCHEMAS_BY_RADIO_FORMAT: dict[str, str] = {
    "j2735": "cwcli_radio/J2735",
    "btp": "cwcli_radio/Btp",
    "its": "cwcli_radio/Its",
}
"""The registry entry that reads raw octets, by the format that the user names (`--topic remote=/raw:btp`)."""

_BUILTIN_INPUTS: dict[str, tuple[Input, ...] | str] = {
    "sensor_msgs/NavSatFix": _fix_inputs(_ROS_FIX_FIELDS),
    "foxglove.LocationFix": _fix_inputs(_FOXGLOVE_FIX_FIELDS),
    "foxglove_msgs/LocationFix": _fix_inputs(_FOXGLOVE_FIX_FIELDS),
    "sensor_msgs/Imu": (
        Input(Role.IMU, _IMU_FIELDS, _build_imu),
        Input(Role.EGO_HEADING, _IMU_ORIENTATION_FIELDS, _build_quaternion_heading, rank=None),
    ),
    "geometry_msgs/TwistStamped": _twist_inputs(_TWIST_FIELDS),
    "geometry_msgs/TwistWithCovarianceStamped": _twist_inputs(_TWIST_COVARIANCE_FIELDS),
    # without a header, and often what was commanded
    "geometry_msgs/Twist": (_plain_twist_input(""),),
    "geometry_msgs/TwistWithCovariance": (_plain_twist_input("twist.", "covariance"),),
    "std_msgs/Float32": (_PLAIN_SPEED_INPUT,),
    "std_msgs/Float64": (_PLAIN_SPEED_INPUT,),
    "geometry_msgs/QuaternionStamped": (
        Input(Role.EGO_HEADING, ros_leaf_fields(*quaternion_leaf_paths("quaternion")), _build_quaternion_heading),
    ),
    "geometry_msgs/PoseStamped": _pose_inputs(_POSE_STAMPED_FIELDS),
    # a localisation publishes it beside its odometry
    "geometry_msgs/PoseWithCovarianceStamped": _pose_inputs(_POSE_COVARIANCE_FIELDS, after=1),
    "nav_msgs/Odometry": (
        *_pose_inputs(_ODOMETRY_FIELDS),
        Input(Role.EGO_SPEED, _ODOMETRY_FIELDS, _build_odometry_speed, rank=ODOMETRY_RANK),
    ),
    "foxglove.PoseInFrame": _pose_inputs(_POSE_IN_FRAME_FIELDS),
    "foxglove_msgs/PoseInFrame": _pose_inputs(_POSE_IN_FRAME_FIELDS),
    "autoware_vehicle_msgs/VelocityReport": (Input(Role.EGO_SPEED, _VELOCITY_REPORT_FIELDS, _build_velocity_report),),
    "autoware_auto_vehicle_msgs/VelocityReport": (
        Input(Role.EGO_SPEED, _VELOCITY_REPORT_FIELDS, _build_velocity_report),
    ),
    "autoware_vehicle_msgs/SteeringReport": (Input(Role.EGO_STEER, _STEERING_REPORT_FIELDS, _build_steering_report),),
    "autoware_auto_vehicle_msgs/SteeringReport": (
        Input(Role.EGO_STEER, _STEERING_REPORT_FIELDS, _build_steering_report),
    ),
    **{
        f"{package}/VehicleKinematicState": (
            Input(
                Role.EGO_POSITION,
                _KINEMATIC_STATE_FIELDS,
                lazy_builder("kinematic_state.build_pose"),
                rank=ODOMETRY_RANK,
            ),
            Input(
                Role.EGO_SPEED, _KINEMATIC_STATE_FIELDS, lazy_builder("kinematic_state.build_speed"), rank=ODOMETRY_RANK
            ),
        )
        for package in ("autoware_auto_vehicle_msgs", "autoware_auto_msgs")
    },
    # often what was commanded, not what was measured
    "ackermann_msgs/AckermannDriveStamped": (
        Input(Role.EGO_STEER, _ACKERMANN_FIELDS, _build_steering_report, rank=None),
    ),
    "autoware_planning_msgs/Trajectory": (
        Input(Role.PLANNED_PATH, _TRAJECTORY_FIELDS, lazy_builder("path.build_trajectory")),
    ),
    "autoware_auto_planning_msgs/Trajectory": (
        Input(Role.PLANNED_PATH, _TRAJECTORY_FIELDS, lazy_builder("path.build_trajectory")),
    ),
    "nav_msgs/Path": (Input(Role.PLANNED_PATH, _PATH_FIELDS, lazy_builder("path.build_path")),),
    "sensor_msgs/CompressedImage": _CAMERA_INPUTS,
    "sensor_msgs/Image": _CAMERA_INPUTS,
    "foxglove.CompressedImage": _CAMERA_INPUTS,
    "foxglove.RawImage": _CAMERA_INPUTS,
    "foxglove_msgs/CompressedImage": _CAMERA_INPUTS,
    "foxglove_msgs/RawImage": _CAMERA_INPUTS,
    "foxglove.CompressedVideo": _CAMERA_INPUTS,
    "foxglove_msgs/CompressedVideo": _CAMERA_INPUTS,
    "sensor_msgs/CameraInfo": (Input(Role.CAMERA_INFO, _CAMERA_INFO_FIELDS, _build_camera_info),),
    "foxglove.CameraCalibration": (Input(Role.CAMERA_INFO, _CAMERA_CALIBRATION_FIELDS, _build_camera_info),),
    "foxglove_msgs/CameraCalibration": (Input(Role.CAMERA_INFO, _CAMERA_CALIBRATION_FIELDS, _build_camera_info),),
    **RECEIVER_INPUTS,
    "etsi_its_cam_msgs/CAM": _v2x_inputs(_make_cam_fields_finder("CAM_PATHS"), "etsi.CAM"),
    "etsi_its_cam_ts_msgs/CAM": _v2x_inputs(_make_cam_fields_finder("CAM_TS_PATHS"), "etsi.CAM"),
    "etsi_its_vam_ts_msgs/VAM": _v2x_inputs(_make_cam_fields_finder("VAM_PATHS"), "etsi.CAM"),
    "etsi_its_denm_msgs/DENM": _perceived_object_inputs("denm", "ROS_DENM"),
    "etsi_its_cpm_ts_msgs/CollectivePerceptionMessage": _perceived_object_inputs("cpm", "ROS_CPM"),
    "j3224_v2x_msgs/SensorDataSharingMessage": _perceived_object_inputs("sdsm", "ROS_SDSM"),
    "carma_v2x_msgs/SensorDataSharingMessage": _perceived_object_inputs("sdsm", "CARMA_SDSM"),
    "j2735_v2x_msgs/BSM": _v2x_inputs(_ros_bsm_fields, "j2735.ROS_BSM"),
    "carma_v2x_msgs/BSM": _v2x_inputs(_carma_bsm_fields, "j2735.CARMA_BSM"),
    "carma_driver_msgs/ByteArray": _v2x_inputs(_radio_payload_fields, "radio.codec.J2735"),
    "cwcli_radio/J2735": _v2x_inputs(_radio_payload_fields, "radio.codec.J2735"),
    "cwcli_radio/Btp": _v2x_inputs(_radio_payload_fields, "radio.codec.BTP"),
    "cwcli_radio/Its": _v2x_inputs(_radio_payload_fields, "radio.codec.ITS"),
    "udp_msgs/UdpPacket": _v2x_inputs(_radio_payload_fields, "radio.codec.BTP"),
    "BasicSafetyMessage": _v2x_inputs(_json_bsm_fields, "j2735.JSON_BSM"),
    "MessageFrame": _v2x_inputs(_json_bsm_fields, "j2735.JSON_BSM"),
    "OdeBsmData": _v2x_inputs(_json_bsm_fields, "j2735.JSON_BSM", says_who_is_ego=True),
    "OdeBsmJson": _v2x_inputs(_json_bsm_fields, "j2735.JSON_BSM", says_who_is_ego=True),
    "OdeMessageFrameData": _v2x_inputs(_json_bsm_fields, "j2735.JSON_BSM", says_who_is_ego=True),
    **DETECTION_INPUTS,
    "cwcli.v1.Target": (Input(Role.TARGET_TRUTH, _TARGET_FIELDS, _build_target_truth),),
    "cwcli.v1.VehicleState": (
        Input(Role.TRUTH, _VEHICLE_STATE_FIELDS, _build_vehicle_state, fits_topic=is_ego_topic),
        Input(Role.TARGET_TRUTH, _VEHICLE_STATE_FIELDS, _build_state_truth, fits_topic=is_target_topic),
    ),
    "cwcli.v1.LateralState": (Input(Role.LATERAL_TRUTH, {}, None),),
    "osi3.GroundTruth": "cwcli.signals.osi.leaves:GROUND_TRUTH",
    "osi3.SensorView": "cwcli.signals.osi.leaves:SENSOR_VIEW",
    "osi3.SensorData": "cwcli.signals.osi.leaves:SENSOR_DATA",
    "osi3.HostVehicleData": "cwcli.signals.osi.leaves:HOST_VEHICLE_DATA",
}
"""The registry rows of this package, by schema name."""


def _accept_plugin_inputs(entry: object, plugin: Plugin) -> tuple[Input, ...]:
    """Check a plug-in's inputs, and guard their builders."""
    inputs = entry if isinstance(entry, tuple) else (entry,)
    if any(isinstance(one, Input) and one.build is None for one in inputs):
        raise plugin.plugin_error("has no builder")
    return tuple(accept_dataclass_of(Input, {"build": _check_builder_result})(one, plugin) for one in inputs)


def _check_builder_result(built: object, columns: Columns, reading: Reading) -> object:
    from cwcli.signals.contract import check_builder_result

    return check_builder_result(built, columns, reading)


INPUTS: Registry[tuple[Input, ...]] = Registry(
    "input", "cwcli.inputs", _BUILTIN_INPUTS, _accept_plugin_inputs, spell=normalise_schema_name
)
"""The registry of inputs: the rows of this package and of plug-ins, by schema name."""


@lru_cache(maxsize=256)
def inputs_of_schema(schema_name: str) -> tuple[Input, ...]:
    """Return the registry's rows for a schema name in any spelling, () for an unknown one."""
    name = normalise_schema_name(schema_name)
    return INPUTS.get(name) or INPUTS.get(name.rsplit(".", 1)[-1], ())


def find_input_for_role(role: str, schema_name: str) -> Input | None:
    """Return the registry row of a schema for a role, or None."""
    return next((entry for entry in inputs_of_schema(schema_name) if entry.role == role), None)


def is_additive_input(role: str, schema_name: str) -> bool:
    """Return whether such a channel is bound in addition to the one that is chosen for the role."""
    entry = find_input_for_role(role, schema_name)
    return entry is not None and entry.is_additive
