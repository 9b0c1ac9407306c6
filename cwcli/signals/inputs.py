"""The registry of inputs: which schema can fill which role, which leaf fields that takes, and who builds the signal.

To add a message type: write its builder in a file, and add one entry here. Other packages add theirs in the group
`cwcli.inputs`: an entry point named like the schema, for an `Input` or a tuple of them.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import TYPE_CHECKING

from cwcli.registry import Plugin, Registry, accept_dataclass_of
from cwcli.signals.builders.base import Fields, Input, Reading
from cwcli.signals.detection_inputs import DETECTION_INPUTS
from cwcli.signals.input_rows import (
    ODOMETRY_RANK,
    OWN_V2X_RANK,
    LazyFields,
    builder_imported_at_first_call,
    does_topic_name_receiver,
    foxglove_leaf_fields,
    header_free_leaf_fields,
    inputs_of_message,
    is_body_twist_topic,
    is_ego_truth_topic,
    is_measured_pose_topic,
    is_target_truth_topic,
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


_FIX_PATHS = ("latitude", "longitude", "altitude", "position_covariance", "position_covariance_type")
"""The leaf paths that both fix messages share."""
_POSE_PATHS = (*xyz_leaf_paths("pose.position"), *quaternion_leaf_paths("pose.orientation"))
"""The leaf paths of a pose."""
_POSE_COVARIANCE_PATHS = (*(f"pose.{path}" for path in _POSE_PATHS), "pose.covariance")
"""The leaf paths of a pose with its covariance."""
_TWIST_PATHS = ("twist.linear.x", "twist.linear.y", "twist.angular.z")
"""The leaf paths of a twist."""
_TIME_PART_NAMES = ("sec", "nanosec", "secs", "nsec", "nsecs")
"""The names that the parts of a ROS time have in different encodings."""
_CAMERA_CALIBRATION_PATHS = ("width", "height", "distortion_model", "d", "k", "r", "p", "D", "K", "R", "P")
"""The leaf paths of a camera's calibration."""


def _schema_names_of_foxglove_messages(*names: str) -> tuple[str, ...]:
    """Return the schemas of foxglove messages in protobuf and JSON, and in CDR."""
    return tuple(f"{package}{name}" for package in ("foxglove.", "foxglove_msgs/") for name in names)


def _fix_inputs(fields: Fields) -> tuple[Input, ...]:
    build = builder_imported_at_first_call("builders.position.build_fix")
    return (Input(Role.EGO_POSITION, fields, build), Input(Role.TRUTH, fields, build, fits_topic=is_ego_truth_topic))


def _twist_inputs(fields: Fields) -> tuple[Input, ...]:
    build = builder_imported_at_first_call("builders.motion.build_twist")
    return (
        Input(Role.EGO_VELOCITY, fields, build, fits_topic=does_topic_name_receiver),
        Input(Role.EGO_SPEED, fields, build, fits_topic=is_body_twist_topic),
    )


def _pose_inputs(fields: Fields, first_rank: int = 0) -> tuple[Input, ...]:
    build, build_target = (
        builder_imported_at_first_call("builders.pose.build_pose"),
        builder_imported_at_first_call("builders.targets.build_pose_truth"),
    )
    return (
        Input(Role.TRUTH, fields, build, rank=first_rank, fits_topic=is_ego_truth_topic),
        Input(Role.TARGET_TRUTH, fields, build_target, rank=first_rank, fits_topic=is_target_truth_topic),
        Input(Role.EGO_POSITION, fields, build, rank=ODOMETRY_RANK + first_rank, fits_topic=is_measured_pose_topic),
    )


def _odometry_inputs() -> tuple[Input, ...]:
    twist = (*xyz_leaf_paths("twist.twist.linear"), *xyz_leaf_paths("twist.twist.angular"), "twist.covariance")
    fields = ros_leaf_fields("child_frame_id", *_POSE_COVARIANCE_PATHS, *twist)
    return (*_pose_inputs(fields), *inputs_of_message(fields, ODOMETRY_RANK, ego_speed="pose.build_odometry_speed"))


def _vehicle_state_inputs() -> tuple[Input, ...]:
    motion = ("x_m", "y_m", "speed_mps", "heading_rad", "accel_mps2", "yaw_rate_radps")
    fields = {"protobuf": ("stamp_ns", "id", *motion, "latitude_deg", "longitude_deg")}
    build, build_target = (
        builder_imported_at_first_call("builders.pose.build_vehicle_state"),
        builder_imported_at_first_call("builders.targets.build_state_truth"),
    )
    return (
        Input(Role.TRUTH, fields, build, fits_topic=is_ego_truth_topic),
        Input(Role.TARGET_TRUTH, fields, build_target, fits_topic=is_target_truth_topic),
    )


def _imu_inputs() -> tuple[Input, ...]:
    measured = ("linear_acceleration", "angular_velocity")
    fields = ros_leaf_fields(*(leaf for name in measured for leaf in (*xyz_leaf_paths(name), f"{name}_covariance")))
    orientation_fields = ros_leaf_fields(*quaternion_leaf_paths("orientation"), "orientation_covariance")
    return (
        *inputs_of_message(fields, imu="imu.build_imu"),
        *inputs_of_message(orientation_fields, None, ego_heading="motion.build_quaternion_heading"),
    )


_EGO_V2X_BUILDER_NAMES_BY_ROLE = {
    Role.EGO_POSITION: "build_ego_position",
    Role.EGO_SPEED: "build_ego_speed",
    Role.EGO_HEADING: "build_ego_heading",
}
"""The function of `builders.v2x` that builds the signal, by role of the ego."""


def _v2x_inputs(codec: str, fields: Fields, *, says_who_is_ego: bool = False) -> tuple[Input, ...]:
    """Return the registry rows of a V2X schema: remote vehicles, and the ego's own messages where these are known."""
    own = (
        Input(
            role,
            fields,
            builder_imported_at_first_call(f"builders.v2x.{name}", codec),
            rank=OWN_V2X_RANK,
            needs_ego_station=not says_who_is_ego,
        )
        for role, name in _EGO_V2X_BUILDER_NAMES_BY_ROLE.items()
    )
    return (Input(Role.REMOTE, fields, builder_imported_at_first_call("builders.v2x.build_remote", codec)), *own)


def _perceived_object_inputs(codec: str, fields: Fields) -> tuple[Input, ...]:
    """Return the registry row of a schema whose messages tell of other objects or events only."""
    build = builder_imported_at_first_call("builders.v2x.build_remote", codec)
    return (Input(Role.REMOTE, fields, build, is_additive=True),)


_JSON_BSM_FIELDS = LazyFields("j2735.JSON_LEAF_FIELDS", ("json",))
"""The leaf fields of every JSON message with a BSM."""
_FIELDS_OF_RAW_RADIO_OCTET_MESSAGES = LazyFields("radio.frames.OCTET_FIELD_NAMES")
"""The leaf fields of messages as a radio received them."""


SCHEMAS_BY_RADIO_FORMAT: dict[str, str] = {
    "j2735": "cwcli_radio/J2735",
    "btp": "cwcli_radio/Btp",
    "its": "cwcli_radio/Its",
}
"""The registry entry that reads raw octets, by the format that the user names (`--topic remote=/raw:btp`)."""

_BUILTIN_INPUTS: dict[str, tuple[Input, ...] | str] = {
    "sensor_msgs/NavSatFix": _fix_inputs(ros_leaf_fields("status.status", *_FIX_PATHS)),
    **dict.fromkeys(_schema_names_of_foxglove_messages("LocationFix"), _fix_inputs(foxglove_leaf_fields(*_FIX_PATHS))),
    "sensor_msgs/Imu": _imu_inputs(),
    "geometry_msgs/TwistStamped": _twist_inputs(ros_leaf_fields(*_TWIST_PATHS)),
    "geometry_msgs/TwistWithCovarianceStamped": _twist_inputs(
        ros_leaf_fields(*(f"twist.{path}" for path in _TWIST_PATHS), "twist.covariance")
    ),
    # without a header, and often what was commanded
    "geometry_msgs/Twist": inputs_of_message(
        header_free_leaf_fields("linear.x", "angular.z"), None, ego_speed="motion.build_speed_from_unstamped_twist"
    ),
    "geometry_msgs/TwistWithCovariance": inputs_of_message(
        header_free_leaf_fields("twist.linear.x", "twist.angular.z", "covariance"),
        None,
        ego_speed="motion.build_speed_from_unstamped_twist",
    ),
    **dict.fromkeys(
        ("std_msgs/Float32", "std_msgs/Float64"),
        inputs_of_message(header_free_leaf_fields("data"), None, ego_speed="motion.build_speed_from_unstamped_float"),
    ),
    "geometry_msgs/QuaternionStamped": inputs_of_message(
        ros_leaf_fields(*quaternion_leaf_paths("quaternion")), ego_heading="motion.build_quaternion_heading"
    ),
    "geometry_msgs/PoseStamped": _pose_inputs(ros_leaf_fields(*_POSE_PATHS)),
    # a localisation publishes it beside its odometry
    "geometry_msgs/PoseWithCovarianceStamped": _pose_inputs(ros_leaf_fields(*_POSE_COVARIANCE_PATHS), first_rank=1),
    "nav_msgs/Odometry": _odometry_inputs(),
    **dict.fromkeys(
        _schema_names_of_foxglove_messages("PoseInFrame"), _pose_inputs(foxglove_leaf_fields(*_POSE_PATHS))
    ),
    **dict.fromkeys(
        ("autoware_vehicle_msgs/VelocityReport", "autoware_auto_vehicle_msgs/VelocityReport"),
        inputs_of_message(
            ros_leaf_fields("longitudinal_velocity", "lateral_velocity", "heading_rate"),
            ego_speed="motion.build_velocity_report",
        ),
    ),
    **dict.fromkeys(
        ("autoware_vehicle_msgs/SteeringReport", "autoware_auto_vehicle_msgs/SteeringReport"),
        inputs_of_message(
            header_free_leaf_fields("stamp.sec", "stamp.nanosec", "steering_tire_angle"),
            ego_steer="motion.build_steering_report",
        ),
    ),
    **dict.fromkeys(
        ("autoware_auto_vehicle_msgs/VehicleKinematicState", "autoware_auto_msgs/VehicleKinematicState"),
        inputs_of_message(
            ros_leaf_fields(
                *("state.x", "state.y", "state.heading.real", "state.heading.imag", "state.heading_rate_rps"),
                *(f"state.{path}" for path in _POSE_PATHS),
                *("state.longitudinal_velocity_mps", "state.lateral_velocity_mps"),
            ),
            ODOMETRY_RANK,
            ego_position="pose.build_kinematic_state_pose",
            ego_speed="pose.build_kinematic_state_speed",
        ),
    ),
    # often what was commanded, not what was measured
    "ackermann_msgs/AckermannDriveStamped": inputs_of_message(
        ros_leaf_fields("drive.steering_angle"), None, ego_steer="motion.build_steering_report"
    ),
    **dict.fromkeys(
        ("autoware_planning_msgs/Trajectory", "autoware_auto_planning_msgs/Trajectory"),
        inputs_of_message(
            ros_leaf_fields(
                *(f"points.time_from_start.{name}" for name in _TIME_PART_NAMES),
                *(*xyz_leaf_paths("points.pose.position"), "points.longitudinal_velocity_mps"),
            ),
            planned_path="path.build_trajectory",
        ),
    ),
    "nav_msgs/Path": inputs_of_message(
        ros_leaf_fields(
            *(f"poses.header.stamp.{name}" for name in _TIME_PART_NAMES), *xyz_leaf_paths("poses.pose.position")
        ),
        planned_path="path.build_path",
    ),
    **dict.fromkeys(
        (
            *("sensor_msgs/CompressedImage", "sensor_msgs/Image"),
            *_schema_names_of_foxglove_messages("CompressedImage", "RawImage", "CompressedVideo"),
        ),
        (Input(Role.CAMERA, {}, None),),  # streamed frame by frame
    ),
    "sensor_msgs/CameraInfo": inputs_of_message(
        ros_leaf_fields(*_CAMERA_CALIBRATION_PATHS), camera_info="camera.build_camera_info"
    ),
    **dict.fromkeys(
        _schema_names_of_foxglove_messages("CameraCalibration"),
        inputs_of_message(foxglove_leaf_fields(*_CAMERA_CALIBRATION_PATHS), camera_info="camera.build_camera_info"),
    ),
    **RECEIVER_INPUTS,
    "etsi_its_cam_msgs/CAM": _v2x_inputs("etsi.CAM_AND_VAM_CODEC", LazyFields("etsi.CAM_LEAF_FIELDS")),
    "etsi_its_cam_ts_msgs/CAM": _v2x_inputs("etsi.CAM_AND_VAM_CODEC", LazyFields("etsi.CAM_TS_LEAF_FIELDS")),
    "etsi_its_vam_ts_msgs/VAM": _v2x_inputs("etsi.CAM_AND_VAM_CODEC", LazyFields("etsi.VAM_LEAF_FIELDS")),
    "etsi_its_denm_msgs/DENM": _perceived_object_inputs("denm.ROS_DENM_CODEC", LazyFields("denm.ROS_LEAF_FIELDS")),
    "etsi_its_cpm_ts_msgs/CollectivePerceptionMessage": _perceived_object_inputs(
        "cpm.ROS_CPM_CODEC", LazyFields("cpm.ROS_LEAF_FIELDS")
    ),
    "j3224_v2x_msgs/SensorDataSharingMessage": _perceived_object_inputs(
        "sdsm.ROS_SDSM_CODEC", LazyFields("sdsm.ROS_LEAF_FIELDS")
    ),
    "carma_v2x_msgs/SensorDataSharingMessage": _perceived_object_inputs(
        "sdsm.CARMA_SDSM_CODEC", LazyFields("sdsm.ROS_LEAF_FIELDS")
    ),
    "j2735_v2x_msgs/BSM": _v2x_inputs("j2735.ROS_BSM_CODEC", LazyFields("j2735.ROS_LEAF_FIELDS")),
    "carma_v2x_msgs/BSM": _v2x_inputs("j2735.CARMA_BSM_CODEC", LazyFields("j2735.CARMA_LEAF_FIELDS")),
    **dict.fromkeys(
        ("carma_driver_msgs/ByteArray", "cwcli_radio/J2735"),
        _v2x_inputs("radio.codec.J2735_CODEC", _FIELDS_OF_RAW_RADIO_OCTET_MESSAGES),
    ),
    **dict.fromkeys(
        ("cwcli_radio/Btp", "udp_msgs/UdpPacket"),
        _v2x_inputs("radio.codec.BTP_CODEC", _FIELDS_OF_RAW_RADIO_OCTET_MESSAGES),
    ),
    "cwcli_radio/Its": _v2x_inputs("radio.codec.ITS_CODEC", _FIELDS_OF_RAW_RADIO_OCTET_MESSAGES),
    **dict.fromkeys(("BasicSafetyMessage", "MessageFrame"), _v2x_inputs("j2735.JSON_BSM_CODEC", _JSON_BSM_FIELDS)),
    **dict.fromkeys(
        ("OdeBsmData", "OdeBsmJson", "OdeMessageFrameData"),
        _v2x_inputs("j2735.JSON_BSM_CODEC", _JSON_BSM_FIELDS, says_who_is_ego=True),
    ),
    **DETECTION_INPUTS,
    "cwcli.v1.Target": inputs_of_message(
        {"protobuf": ("stamp_ns", "id", "frame_id", "x_m", "y_m", "vx_mps", "vy_mps")},
        target_truth="targets.build_target_truth",
    ),
    "cwcli.v1.VehicleState": _vehicle_state_inputs(),
    "cwcli.v1.LateralState": (Input(Role.LATERAL_TRUTH, {}, None),),
    "osi3.GroundTruth": "cwcli.signals.osi.leaves:GROUND_TRUTH_INPUTS",
    "osi3.SensorView": "cwcli.signals.osi.leaves:SENSOR_VIEW_INPUTS",
    "osi3.SensorData": "cwcli.signals.osi.leaves:SENSOR_DATA_INPUTS",
    "osi3.HostVehicleData": "cwcli.signals.osi.leaves:HOST_VEHICLE_DATA_INPUTS",
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


INPUTS_BY_SCHEMA_NAME: Registry[tuple[Input, ...]] = Registry(
    "input", "cwcli.inputs", _BUILTIN_INPUTS, _accept_plugin_inputs, spell=normalise_schema_name
)
"""The registry of inputs: the rows of this package and of plug-ins, by schema name."""


@lru_cache(maxsize=256)
def inputs_of_schema(schema_name: str) -> tuple[Input, ...]:
    """Return the registry's rows for a schema name in any spelling, () for an unknown one."""
    name = normalise_schema_name(schema_name)
    return INPUTS_BY_SCHEMA_NAME.get(name) or INPUTS_BY_SCHEMA_NAME.get(name.rsplit(".", 1)[-1], ())


def find_input_for_role(role: str, schema_name: str) -> Input | None:
    """Return the registry row of a schema for a role, or None."""
    return next((entry for entry in inputs_of_schema(schema_name) if entry.role == role), None)
