"""The registry of inputs: which schema can fill which role, which leaf fields that takes, and who builds the signal.

To add a message type: write its builder in a file, and add one entry here. Other packages add theirs in the group
`cwcli.inputs`: an entry point named like the schema, for an `Input` or a tuple of them.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING

from cwcli.registry import Plugin, Registry, plugin_entry
from cwcli.signals.builders.base import Fields, Input, Reading
from cwcli.signals.detection_inputs import DETECTIONS
from cwcli.signals.input_rows import (
    ODOMETRY,
    OWN_V2X,
    LaterFields,
    builder,
    foxglove,
    in_signals,
    is_ego_topic,
    is_gnss_topic,
    is_measured_topic,
    is_target_topic,
    is_vehicle_topic,
    quaternion,
    ros,
    v2x_builder,
    xyz,
)
from cwcli.signals.receiver_inputs import RECEIVERS
from cwcli.signals.role import Role

if TYPE_CHECKING:
    from cwcli.signals.columns import Columns


@lru_cache(maxsize=256)
def normalise(schema_name: str) -> str:
    """Return one spelling of a schema name: `sensor_msgs/msg/NavSatFix`, `sensor_msgs/NavSatFix` and the DDS form are
    the same."""
    name = schema_name.replace("::", "/").replace("/dds_/", "/").removesuffix("_")
    return re.sub(r"/msg/", "/", name)


_build_pose_truth = builder("targets.build_pose_truth")
_build_state_truth = builder("targets.build_state_truth")
_build_target_truth = builder("targets.build_target_truth")
_build_camera_info = builder("camera.build_camera_info")
_build_imu = builder("imu.build_imu")
_build_quaternion_heading = builder("motion.build_quaternion_heading")
_build_twist = builder("motion.build_twist")
_build_velocity_report = builder("motion.build_velocity_report")
_build_steering_report = builder("steer.build_steering_report")
_build_odometry_speed = builder("pose.build_odometry_speed")
_build_pose = builder("pose.build_pose")
_build_vehicle_state = builder("pose.build_vehicle_state")
_build_fix = builder("position.build_fix")

_FIX = ("latitude", "longitude", "altitude", "position_covariance", "position_covariance_type")
"""The leaf paths that both fix messages share."""
_ROS_FIX = ros("status.status", *_FIX)
"""The leaf fields of a `NavSatFix`, by encoding."""
_FOXGLOVE_FIX = foxglove(*_FIX)
"""The leaf fields of a `LocationFix`, by encoding."""
_IMU = ros(
    *xyz("linear_acceleration"),
    "linear_acceleration_covariance",
    *xyz("angular_velocity"),
    "angular_velocity_covariance",
)
"""The leaf fields of an `Imu`'s measurements, by encoding."""
_IMU_ORIENTATION = ros(*quaternion("orientation"), "orientation_covariance")
"""The leaf fields of an `Imu`'s orientation, by encoding."""
_TWIST = ros("twist.linear.x", "twist.linear.y", "twist.angular.z")
"""The leaf fields of a `TwistStamped`, by encoding."""
_TWIST_COVARIANCE = ros("twist.twist.linear.x", "twist.twist.linear.y", "twist.twist.angular.z", "twist.covariance")
"""The leaf fields of a `TwistWithCovarianceStamped`, by encoding."""
_ODOMETRY = ros(
    "child_frame_id",
    *xyz("pose.pose.position"),
    *quaternion("pose.pose.orientation"),
    "pose.covariance",
    *xyz("twist.twist.linear"),
    *xyz("twist.twist.angular"),
    "twist.covariance",
)
"""The leaf fields of an `Odometry`, by encoding."""
_POSE_COVARIANCE = ros(*xyz("pose.pose.position"), *quaternion("pose.pose.orientation"), "pose.covariance")
"""The leaf fields of a `PoseWithCovarianceStamped`, by encoding."""
_POSE_STAMPED = ros(*xyz("pose.position"), *quaternion("pose.orientation"))
"""The leaf fields of a `PoseStamped`, by encoding."""
_POSE_IN_FRAME = foxglove(*xyz("pose.position"), *quaternion("pose.orientation"))
"""The leaf fields of a `PoseInFrame`, by encoding."""
_VELOCITY_REPORT = ros("longitudinal_velocity", "lateral_velocity", "heading_rate")
"""The leaf fields of a `VelocityReport`, by encoding."""
_STEERING_REPORT: Fields = dict.fromkeys(("cdr", "json"), ("stamp.sec", "stamp.nanosec", "steering_tire_angle"))
"""The leaf fields of a `SteeringReport`, by encoding."""
_KINEMATIC_STATE = ros(
    *("state.x", "state.y", "state.heading.real", "state.heading.imag", "state.heading_rate_rps"),
    *(*xyz("state.pose.position"), *quaternion("state.pose.orientation")),
    *("state.longitudinal_velocity_mps", "state.lateral_velocity_mps"),
)
"""The leaf fields of a `VehicleKinematicState`, by encoding."""
_ACKERMANN = ros("drive.steering_angle")
"""The leaf fields of an `AckermannDriveStamped`, by encoding."""
_TIMES = ("sec", "nanosec", "secs", "nsec", "nsecs")
"""The names that the parts of a ROS time have in different encodings."""
_TRAJECTORY_TIMES = tuple(f"points.time_from_start.{name}" for name in _TIMES)
"""The leaf paths of the times of a trajectory's points."""
_TRAJECTORY = ros(*_TRAJECTORY_TIMES, *xyz("points.pose.position"), "points.longitudinal_velocity_mps")
"""The leaf fields of a `Trajectory`, by encoding."""
_PATH = ros(*(f"poses.header.stamp.{name}" for name in _TIMES), *xyz("poses.pose.position"))
"""The leaf fields of a `nav_msgs/Path`, by encoding."""
_CAMERA_INFO = ros("width", "height", "distortion_model", "d", "k", "r", "p", "D", "K", "R", "P")
"""The leaf fields of a `CameraInfo`, by encoding."""
_CALIBRATION = foxglove("width", "height", "distortion_model", "D", "K", "R", "P", "d", "k", "r", "p")
"""The leaf fields of a `CameraCalibration`, by encoding."""
_STATE: Fields = {
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
_TARGET: Fields = {
    "protobuf": ("stamp_ns", "id", "frame_id", "x_m", "y_m", "vx_mps", "vy_mps"),
}
"""The leaf fields of a `cwcli.v1.Target`, by encoding."""
_FRAMES: Fields = {}
"""The leaf fields of camera images: none, because images are streamed frame by frame."""


def _fix(fields: Fields) -> tuple[Input, ...]:
    return (
        Input(Role.EGO_POSITION, fields, _build_fix),
        Input(Role.TRUTH, fields, _build_fix, fits=is_ego_topic),
    )


def _twist(fields: Fields) -> tuple[Input, ...]:
    return (
        Input(Role.EGO_VELOCITY, fields, _build_twist, fits=is_gnss_topic),
        Input(Role.EGO_SPEED, fields, _build_twist, fits=is_vehicle_topic),
    )


def _plain_twist(base: str, *more: str) -> Input:
    leaves = (f"{base}linear.x", f"{base}angular.z", *more)
    fields = dict.fromkeys(("cdr", "json"), leaves)
    return Input(Role.EGO_SPEED, fields, builder("motion.build_plain_twist"), rank=None)


_PLAIN_SPEED = Input(
    Role.EGO_SPEED, dict.fromkeys(("cdr", "json"), ("data",)), builder("motion.build_plain_speed"), rank=None
)
"""The registry row of a speed without a header."""


def _pose(fields: Fields, after: int = 0) -> tuple[Input, ...]:
    return (
        Input(Role.TRUTH, fields, _build_pose, rank=after, fits=is_ego_topic),
        Input(Role.TARGET_TRUTH, fields, _build_pose_truth, rank=after, fits=is_target_topic),
        Input(Role.EGO_POSITION, fields, _build_pose, rank=ODOMETRY + after, fits=is_measured_topic),
    )


_OWN_MAKERS = {
    Role.EGO_POSITION: "own_position_builder",
    Role.EGO_SPEED: "own_speed_builder",
    Role.EGO_HEADING: "own_heading_builder",
}
"""The function of `builders.v2x` that makes the builder, by role of the ego."""


def _v2x(find: Callable[[], Fields], codec: str, *, says_who_is_ego: bool = False) -> tuple[Input, ...]:
    """Return the registry rows of a V2X schema: remote vehicles, and the ego's own messages where these are known."""
    fields = LaterFields(find)
    own = (
        Input(role, fields, v2x_builder(maker, codec), rank=OWN_V2X, needs_ego_station=not says_who_is_ego)
        for role, maker in _OWN_MAKERS.items()
    )
    return (Input(Role.REMOTE, fields, v2x_builder("remote_builder", codec)), *own)


def _cam_fields(paths: str) -> Callable[[], Fields]:
    """Return a function that finds the leaf fields of a CAM in a table of `etsi`."""

    def find_leaf_fields() -> Fields:
        leaves = tuple(in_signals(f"etsi.{paths}").values())
        return {"cdr": leaves, "json": leaves}

    return find_leaf_fields


def _ros_bsm_fields() -> Fields:
    from cwcli.signals import j2735
    from cwcli.signals.bsm_flags import ros_fields

    leaves = (*j2735.ROS.values(), *ros_fields())
    return {"cdr": leaves, "json": leaves}


def _carma_bsm_fields() -> Fields:
    from cwcli.signals import j2735
    from cwcli.signals.bsm_flags import ros_fields

    presence = dict.fromkeys(path for path, _ in j2735.CARMA_PRESENCE.values())
    leaves = (*j2735.ROS.values(), *presence, *ros_fields())
    return {"cdr": leaves, "json": leaves}


def _radio_fields() -> Fields:
    from cwcli.signals.radio.frames import CONTENTS

    return dict.fromkeys(("cdr", "json"), CONTENTS)


def _objects_fields(module: str) -> Callable[[], Fields]:
    """Return a function that finds the leaf fields of a message with perceived objects or events."""

    def find_leaf_fields() -> Fields:
        return dict.fromkeys(("cdr", "json"), in_signals(f"{module}.ros_fields")())

    return find_leaf_fields


def _json_bsm_fields() -> Fields:
    from cwcli.signals import j2735

    return {"json": j2735.json_fields()}


def _perceived(module: str, codec: str) -> tuple[Input, ...]:
    """Return the registry row of a schema whose messages tell of other objects or events only."""
    build = v2x_builder("remote_builder", f"{module}.{codec}")
    return (Input(Role.REMOTE, LaterFields(_objects_fields(module)), build, is_beside=True),)


_CAMERA = (Input(Role.CAMERA, _FRAMES, None),)
"""The registry row of camera images."""


RADIO_FORMATS: dict[str, str] = {
    "j2735": "cwcli_radio/J2735",
    "btp": "cwcli_radio/Btp",
    "its": "cwcli_radio/Its",
}
"""The registry entry that reads raw octets, by the format that the user names (`--topic remote=/raw:btp`)."""

_BUILTIN: dict[str, tuple[Input, ...] | str] = {
    "sensor_msgs/NavSatFix": _fix(_ROS_FIX),
    "foxglove.LocationFix": _fix(_FOXGLOVE_FIX),
    "foxglove_msgs/LocationFix": _fix(_FOXGLOVE_FIX),
    "sensor_msgs/Imu": (
        Input(Role.IMU, _IMU, _build_imu),
        Input(Role.EGO_HEADING, _IMU_ORIENTATION, _build_quaternion_heading, rank=None),
    ),
    "geometry_msgs/TwistStamped": _twist(_TWIST),
    "geometry_msgs/TwistWithCovarianceStamped": _twist(_TWIST_COVARIANCE),
    # without a header, and often what was commanded
    "geometry_msgs/Twist": (_plain_twist(""),),
    "geometry_msgs/TwistWithCovariance": (_plain_twist("twist.", "covariance"),),
    "std_msgs/Float32": (_PLAIN_SPEED,),
    "std_msgs/Float64": (_PLAIN_SPEED,),
    "geometry_msgs/QuaternionStamped": (
        Input(Role.EGO_HEADING, ros(*quaternion("quaternion")), _build_quaternion_heading),
    ),
    "geometry_msgs/PoseStamped": _pose(_POSE_STAMPED),
    # a localisation publishes it beside its odometry
    "geometry_msgs/PoseWithCovarianceStamped": _pose(_POSE_COVARIANCE, after=1),
    "nav_msgs/Odometry": (*_pose(_ODOMETRY), Input(Role.EGO_SPEED, _ODOMETRY, _build_odometry_speed, rank=ODOMETRY)),
    "foxglove.PoseInFrame": _pose(_POSE_IN_FRAME),
    "foxglove_msgs/PoseInFrame": _pose(_POSE_IN_FRAME),
    "autoware_vehicle_msgs/VelocityReport": (Input(Role.EGO_SPEED, _VELOCITY_REPORT, _build_velocity_report),),
    "autoware_auto_vehicle_msgs/VelocityReport": (Input(Role.EGO_SPEED, _VELOCITY_REPORT, _build_velocity_report),),
    "autoware_vehicle_msgs/SteeringReport": (Input(Role.EGO_STEER, _STEERING_REPORT, _build_steering_report),),
    "autoware_auto_vehicle_msgs/SteeringReport": (Input(Role.EGO_STEER, _STEERING_REPORT, _build_steering_report),),
    **{
        f"{package}/VehicleKinematicState": (
            Input(Role.EGO_POSITION, _KINEMATIC_STATE, builder("kinematic_state.build_pose"), rank=ODOMETRY),
            Input(Role.EGO_SPEED, _KINEMATIC_STATE, builder("kinematic_state.build_speed"), rank=ODOMETRY),
        )
        for package in ("autoware_auto_vehicle_msgs", "autoware_auto_msgs")
    },
    # often what was commanded, not what was measured
    "ackermann_msgs/AckermannDriveStamped": (Input(Role.EGO_STEER, _ACKERMANN, _build_steering_report, rank=None),),
    "autoware_planning_msgs/Trajectory": (Input(Role.PLANNED_PATH, _TRAJECTORY, builder("path.build_trajectory")),),
    "autoware_auto_planning_msgs/Trajectory": (
        Input(Role.PLANNED_PATH, _TRAJECTORY, builder("path.build_trajectory")),
    ),
    "nav_msgs/Path": (Input(Role.PLANNED_PATH, _PATH, builder("path.build_path")),),
    "sensor_msgs/CompressedImage": _CAMERA,
    "sensor_msgs/Image": _CAMERA,
    "foxglove.CompressedImage": _CAMERA,
    "foxglove.RawImage": _CAMERA,
    "foxglove_msgs/CompressedImage": _CAMERA,
    "foxglove_msgs/RawImage": _CAMERA,
    "foxglove.CompressedVideo": _CAMERA,
    "foxglove_msgs/CompressedVideo": _CAMERA,
    "sensor_msgs/CameraInfo": (Input(Role.CAMERA_INFO, _CAMERA_INFO, _build_camera_info),),
    "foxglove.CameraCalibration": (Input(Role.CAMERA_INFO, _CALIBRATION, _build_camera_info),),
    "foxglove_msgs/CameraCalibration": (Input(Role.CAMERA_INFO, _CALIBRATION, _build_camera_info),),
    **RECEIVERS,
    "etsi_its_cam_msgs/CAM": _v2x(_cam_fields("EN_PATHS"), "etsi.CAM"),
    "etsi_its_cam_ts_msgs/CAM": _v2x(_cam_fields("TS_PATHS"), "etsi.CAM"),
    "etsi_its_vam_ts_msgs/VAM": _v2x(_cam_fields("VAM_PATHS"), "etsi.CAM"),
    "etsi_its_denm_msgs/DENM": _perceived("denm", "ROS_DENM"),
    "etsi_its_cpm_ts_msgs/CollectivePerceptionMessage": _perceived("cpm", "ROS_CPM"),
    "j3224_v2x_msgs/SensorDataSharingMessage": _perceived("sdsm", "ROS_SDSM"),
    "carma_v2x_msgs/SensorDataSharingMessage": _perceived("sdsm", "CARMA_SDSM"),
    "j2735_v2x_msgs/BSM": _v2x(_ros_bsm_fields, "j2735.ROS_BSM"),
    "carma_v2x_msgs/BSM": _v2x(_carma_bsm_fields, "j2735.CARMA_BSM"),
    "carma_driver_msgs/ByteArray": _v2x(_radio_fields, "radio.codec.J2735"),
    "cwcli_radio/J2735": _v2x(_radio_fields, "radio.codec.J2735"),
    "cwcli_radio/Btp": _v2x(_radio_fields, "radio.codec.BTP"),
    "cwcli_radio/Its": _v2x(_radio_fields, "radio.codec.ITS"),
    "udp_msgs/UdpPacket": _v2x(_radio_fields, "radio.codec.BTP"),
    "BasicSafetyMessage": _v2x(_json_bsm_fields, "j2735.JSON_BSM"),
    "MessageFrame": _v2x(_json_bsm_fields, "j2735.JSON_BSM"),
    "OdeBsmData": _v2x(_json_bsm_fields, "j2735.JSON_BSM", says_who_is_ego=True),
    "OdeBsmJson": _v2x(_json_bsm_fields, "j2735.JSON_BSM", says_who_is_ego=True),
    "OdeMessageFrameData": _v2x(_json_bsm_fields, "j2735.JSON_BSM", says_who_is_ego=True),
    **DETECTIONS,
    "cwcli.v1.Target": (Input(Role.TARGET_TRUTH, _TARGET, _build_target_truth),),
    "cwcli.v1.VehicleState": (
        Input(Role.TRUTH, _STATE, _build_vehicle_state, fits=is_ego_topic),
        Input(Role.TARGET_TRUTH, _STATE, _build_state_truth, fits=is_target_topic),
    ),
    "cwcli.v1.LateralState": (Input(Role.LATERAL_TRUTH, {}, None),),
    "osi3.GroundTruth": "cwcli.signals.osi.leaves:GROUND_TRUTH",
    "osi3.SensorView": "cwcli.signals.osi.leaves:SENSOR_VIEW",
    "osi3.SensorData": "cwcli.signals.osi.leaves:SENSOR_DATA",
    "osi3.HostVehicleData": "cwcli.signals.osi.leaves:HOST_VEHICLE_DATA",
}
"""The registry rows of this package, by schema name."""


def _accept(entry: object, plugin: Plugin) -> tuple[Input, ...]:
    """Check a plug-in's inputs, and guard their builders."""
    inputs = entry if isinstance(entry, tuple) else (entry,)
    if any(isinstance(one, Input) and one.build is None for one in inputs):
        raise plugin.error("has no builder")
    return tuple(plugin_entry(Input, {"build": _check_built})(one, plugin) for one in inputs)


def _check_built(built: object, columns: Columns, reading: Reading) -> object:
    from cwcli.signals.contract import check_built

    return check_built(built, columns, reading)


INPUTS: Registry[tuple[Input, ...]] = Registry("input", "cwcli.inputs", _BUILTIN, _accept, spell=normalise)
"""The registry of inputs: the rows of this package and of plug-ins, by schema name."""


@lru_cache(maxsize=256)
def inputs_of(schema_name: str) -> tuple[Input, ...]:
    """Return the registry's rows for a schema name in any spelling, () for an unknown one."""
    name = normalise(schema_name)
    return INPUTS.get(name) or INPUTS.get(name.rsplit(".", 1)[-1], ())


def input_for(role: str, schema_name: str) -> Input | None:
    """Return the registry row of a schema for a role, or None."""
    return next((entry for entry in inputs_of(schema_name) if entry.role == role), None)


def is_beside(role: str, schema_name: str) -> bool:
    """Return whether such a channel is bound in addition to the one that is chosen for the role."""
    entry = input_for(role, schema_name)
    return entry is not None and entry.is_beside
