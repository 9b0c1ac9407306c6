"""The registry rows of messages with detections, and of drawn cubes: a part of the table in `inputs`."""

from __future__ import annotations

from cwcli.signals.builders.base import Fields, Input
from cwcli.signals.input_rows import inputs_of_message, ros_leaf_fields
from cwcli.signals.stamp_fields import CDR_FOXGLOVE_STAMP_FIELDS, JSON_STAMP_FIELDS, PROTOBUF_STAMP_FIELDS

_AUTOWARE_OBJECT_FIELDS = ros_leaf_fields(
    *(
        f"objects.kinematics.{pose}.{leaf}"
        for pose in ("pose_with_covariance", "initial_pose_with_covariance")
        for leaf in ("pose.position.x", "pose.position.y", "covariance")
    ),
    "objects.kinematics.has_position_covariance",
)
"""The leaf fields of Autoware's objects, by encoding."""
_CUBE_CENTRE_PATHS = ("entities.cubes.pose.position.x", "entities.cubes.pose.position.y")
"""The leaf paths of the centres of drawn cubes."""
_CUBE_FIELDS: Fields = {
    "protobuf": (*(f"entities.{leaf}" for leaf in PROTOBUF_STAMP_FIELDS), *_CUBE_CENTRE_PATHS),
    "json": ("entities.timestamp.sec", "entities.timestamp.nsec", "entities.timestamp.nanosec", *_CUBE_CENTRE_PATHS),
    "cdr": (*(f"entities.{leaf}" for leaf in CDR_FOXGLOVE_STAMP_FIELDS), *_CUBE_CENTRE_PATHS),
}
"""The leaf fields of a `SceneUpdate` with cubes, by encoding."""
_JSON_DETECTION_FIELDS: Fields = {
    "json": (
        *JSON_STAMP_FIELDS,
        "frame_id",
        *(
            f"detections.{name}"
            for name in (
                *("x_m", "y_m", "covariance_xx_m2", "covariance_xy_m2", "covariance_yy_m2"),
                *("range_m", "azimuth_rad", "range_rate_mps"),
                *("range_sigma_m", "azimuth_sigma_rad", "range_rate_sigma_mps"),
            )
        ),
    ),
}
"""The leaf fields of JSON detections, by encoding."""


DETECTION_INPUTS: dict[str, tuple[Input, ...]] = {
    "radar_msgs/RadarScan": inputs_of_message(
        ros_leaf_fields("returns.range", "returns.azimuth", "returns.elevation", "returns.doppler_velocity"),
        detections="detections.build_radar_scan",
    ),
    "radar_msgs/RadarTracks": inputs_of_message(
        ros_leaf_fields(
            *(f"tracks.{part}.{axis}" for part in ("position", "velocity") for axis in "xy"),
            *("tracks.position_covariance", "tracks.velocity_covariance"),
        ),
        detections="detections.build_radar_tracks",
    ),
    "vision_msgs/Detection3DArray": inputs_of_message(
        ros_leaf_fields(
            *(f"detections.bbox.center.position.{axis}" for axis in "xy"),
            *(f"detections.results.pose.pose.position.{axis}" for axis in "xy"),
            "detections.results.pose.covariance",
        ),
        detections="detections.build_vision_boxes",
    ),
    **{
        f"{package}/{name}": inputs_of_message(_AUTOWARE_OBJECT_FIELDS, rank, detections="detections.build_autoware")
        for package in ("autoware_perception_msgs", "autoware_auto_perception_msgs")
        # the later ones are made from the first
        for rank, name in enumerate(("DetectedObjects", "TrackedObjects", "PredictedObjects"))
    },
    # what is drawn for viewers counts only where no sensor reports for itself
    **dict.fromkeys(
        ("foxglove.SceneUpdate", "foxglove_msgs/SceneUpdate"),
        inputs_of_message(_CUBE_FIELDS, 3, detections="detections.build_scene_cubes"),
    ),
    "cwcli.Detections": inputs_of_message(_JSON_DETECTION_FIELDS, detections="detections.build_json_detections"),
}
"""The registry rows of messages with detections, by schema name."""
