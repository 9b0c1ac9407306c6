"""`VehicleKinematicState` of Autoware.Auto (`autoware_auto_vehicle_msgs`, `autoware_auto_msgs`): as an odometry.

Older ones have x, y and a heading whose two parts are w and z of a quaternion, half the angle; later ones a pose. In a
frame that moves with the car the position is none.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cwcli.signals.builders import pose
from cwcli.signals.builders.base import Reading
from cwcli.signals.builders.motion import BODY_FRAME_IDS
from cwcli.signals.canonical import PoseSignal, SpeedSignal
from cwcli.signals.columns import Columns, Field
from cwcli.signals.leaf_fields import find_field, read_frame_id
from cwcli.signals.quality import Quality

ODOMETRY_POSITION_PATH, ODOMETRY_ORIENTATION_PATH = "pose.pose.position", "pose.pose.orientation"
"""The paths of position and orientation in an `Odometry`."""
SOURCE_PATHS_BY_ODOMETRY_FIELD = {
    f"{ODOMETRY_POSITION_PATH}.x": ("state.x", "state.pose.position.x"),
    f"{ODOMETRY_POSITION_PATH}.y": ("state.y", "state.pose.position.y"),
    f"{ODOMETRY_ORIENTATION_PATH}.x": ("state.pose.orientation.x",),
    f"{ODOMETRY_ORIENTATION_PATH}.y": ("state.pose.orientation.y",),
    f"{ODOMETRY_ORIENTATION_PATH}.z": ("state.heading.imag", "state.pose.orientation.z"),
    f"{ODOMETRY_ORIENTATION_PATH}.w": ("state.heading.real", "state.pose.orientation.w"),
    "twist.twist.linear.x": ("state.longitudinal_velocity_mps",),
    "twist.twist.linear.y": ("state.lateral_velocity_mps",),
    "twist.twist.angular.z": ("state.heading_rate_rps",),
}
"""The fields of this message, by the `Odometry` field that each of them fills."""
VEHICLE_FIXED_FRAME_NOTE = "its frame moves with the vehicle, so it has no position"
"""The note for a channel whose frame moves with the vehicle."""


def build_pose(columns: Columns, reading: Reading) -> tuple[PoseSignal, Quality]:
    """Build poses, where the frame does not move with the vehicle."""
    signal, quality = pose.build_pose(_convert_to_odometry_columns(columns), reading)
    if _has_vehicle_fixed_frame(columns):
        quality.notes += (VEHICLE_FIXED_FRAME_NOTE,)
    return signal, quality


def build_speed(columns: Columns, reading: Reading) -> tuple[SpeedSignal, Quality]:
    """Build the speed and the yaw rate."""
    return pose.build_odometry_speed(_convert_to_odometry_columns(columns), reading)


def _convert_to_odometry_columns(columns: Columns) -> Columns:
    fields: dict[str, Field] = {name: field for name, field in columns.fields.items() if name.startswith("header.")}
    for name, paths in SOURCE_PATHS_BY_ODOMETRY_FIELD.items():
        found = find_field(columns, *paths)
        if found is not None:
            fields[name] = found
    zero = np.zeros(len(columns))
    fields = {
        f"{ODOMETRY_ORIENTATION_PATH}.x": zero,
        f"{ODOMETRY_ORIENTATION_PATH}.y": zero,
        f"{ODOMETRY_POSITION_PATH}.z": zero,
        **fields,
    }
    if _has_vehicle_fixed_frame(columns):
        fields |= {f"{ODOMETRY_POSITION_PATH}.{axis}": zero + np.nan for axis in "xy"}
    return replace(columns, fields=fields)


def _has_vehicle_fixed_frame(columns: Columns) -> bool:
    return read_frame_id(columns).lower() in BODY_FRAME_IDS
