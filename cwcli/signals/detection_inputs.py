"""The registry rows of messages with detections, and of drawn cubes: a part of the table in `inputs`."""

from __future__ import annotations

from cwcli.signals.builders.base import Build, Fields, Input
from cwcli.signals.input_rows import lazy_builder, ros_leaf_fields
from cwcli.signals.role import Role
from cwcli.signals.stamp_fields import CDR_FOXGLOVE_STAMP_FIELDS, JSON_STAMP_FIELDS, PROTOBUF_STAMP_FIELDS

_build_boxes = lazy_builder("detections.build_boxes")
_build_cubes = lazy_builder("detections.build_cubes")
_build_json_detections = lazy_builder("detections.build_json")
_build_radar_scan = lazy_builder("detections.build_radar_scan")
_build_radar_tracks = lazy_builder("detections.build_radar_tracks")

_AUTOWARE_OBJECT_FIELDS = ros_leaf_fields(
    *(
        f"objects.kinematics.{pose}.{leaf}"
        for pose in ("pose_with_covariance", "initial_pose_with_covariance")
        for leaf in ("pose.position.x", "pose.position.y", "covariance")
    ),
    "objects.kinematics.has_position_covariance",
)
"""The leaf fields of Autoware's objects, by encoding."""
_RADAR_SCAN_FIELDS = ros_leaf_fields(
    "returns.range", "returns.azimuth", "returns.elevation", "returns.doppler_velocity"
)
"""The leaf fields of a `RadarScan`, by encoding."""
_RADAR_TRACK_FIELDS = ros_leaf_fields(
    *(f"tracks.{part}.{axis}" for part in ("position", "velocity") for axis in "xy"),
    "tracks.position_covariance",
    "tracks.velocity_covariance",
)
"""The leaf fields of `RadarTracks`, by encoding."""
_BOX_FIELDS = ros_leaf_fields(
    *(f"detections.bbox.center.position.{axis}" for axis in "xy"),
    *(f"detections.results.pose.pose.position.{axis}" for axis in "xy"),
    "detections.results.pose.covariance",
)
"""The leaf fields of a `Detection3DArray`, by encoding."""
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


def _detection_inputs(fields: Fields, build: Build, rank: int = 0) -> tuple[Input, ...]:
    return (Input(Role.DETECTIONS, fields, build, rank=rank),)


# what is drawn for viewers counts only where no sensor reports for itself
_SCENE_UPDATE_INPUTS = _detection_inputs(_CUBE_FIELDS, _build_cubes, rank=3)
"""The registry rows of drawn cubes; they are used only where no sensor reports for itself."""

DETECTION_INPUTS: dict[str, tuple[Input, ...]] = {
    "radar_msgs/RadarScan": _detection_inputs(_RADAR_SCAN_FIELDS, _build_radar_scan),
    "radar_msgs/RadarTracks": _detection_inputs(_RADAR_TRACK_FIELDS, _build_radar_tracks),
    "vision_msgs/Detection3DArray": _detection_inputs(_BOX_FIELDS, _build_boxes),
    **{
        f"{package}/{name}": _detection_inputs(
            _AUTOWARE_OBJECT_FIELDS, lazy_builder("autoware.build_objects"), rank=rank
        )
        for package in ("autoware_perception_msgs", "autoware_auto_perception_msgs")
        # the later ones are made from the first
        for rank, name in enumerate(("DetectedObjects", "TrackedObjects", "PredictedObjects"))
    },
    "foxglove.SceneUpdate": _SCENE_UPDATE_INPUTS,
    "foxglove_msgs/SceneUpdate": _SCENE_UPDATE_INPUTS,
    "cwcli.Detections": _detection_inputs(_JSON_DETECTION_FIELDS, _build_json_detections),
}
"""The registry rows of messages with detections, by schema name."""
