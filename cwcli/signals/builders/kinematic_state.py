"""`VehicleKinematicState` of Autoware.Auto (`autoware_auto_vehicle_msgs`, `autoware_auto_msgs`): as an odometry.

Older ones have x, y and a heading whose two parts are w and z of a quaternion, half the angle; later ones a pose. In a
frame that moves with the car the position is none.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cwcli.signals.builders import pose
from cwcli.signals.builders.base import Reading
from cwcli.signals.builders.motion import BODY_FRAMES
from cwcli.signals.canonical import PoseSignal, SpeedSignal
from cwcli.signals.columns import Columns, Field
from cwcli.signals.leaf_fields import find, frame_id
from cwcli.signals.quality import Quality

POSITION, ORIENTATION = "pose.pose.position", "pose.pose.orientation"
"""The paths of position and orientation in an `Odometry`."""
NAMES = {
    f"{POSITION}.x": ("state.x", "state.pose.position.x"),
    f"{POSITION}.y": ("state.y", "state.pose.position.y"),
    f"{ORIENTATION}.x": ("state.pose.orientation.x",),
    f"{ORIENTATION}.y": ("state.pose.orientation.y",),
    f"{ORIENTATION}.z": ("state.heading.imag", "state.pose.orientation.z"),
    f"{ORIENTATION}.w": ("state.heading.real", "state.pose.orientation.w"),
    "twist.twist.linear.x": ("state.longitudinal_velocity_mps",),
    "twist.twist.linear.y": ("state.lateral_velocity_mps",),
    "twist.twist.angular.z": ("state.heading_rate_rps",),
}
"""The fields of this message, by the `Odometry` field that each of them fills."""
IN_CAR = "its frame moves with the vehicle, so it has no position"
"""The note for a channel whose frame moves with the vehicle."""


def build_pose(columns: Columns, reading: Reading) -> tuple[PoseSignal, Quality]:
    """Build poses, where the frame does not move with the vehicle."""
    signal, quality = pose.build_pose(_as_odometry(columns), reading)
    if _is_in_car(columns):
        quality.notes += (IN_CAR,)
    return signal, quality


def build_speed(columns: Columns, reading: Reading) -> tuple[SpeedSignal, Quality]:
    """Build the speed and the yaw rate."""
    return pose.build_odometry_speed(_as_odometry(columns), reading)


def _as_odometry(columns: Columns) -> Columns:
    fields: dict[str, Field] = {name: field for name, field in columns.fields.items() if name.startswith("header.")}
    for name, paths in NAMES.items():
        found = find(columns, *paths)
        if found is not None:
            fields[name] = found
    zero = np.zeros(len(columns))
    fields = {f"{ORIENTATION}.x": zero, f"{ORIENTATION}.y": zero, f"{POSITION}.z": zero, **fields}
    if _is_in_car(columns):
        fields |= {f"{POSITION}.{axis}": zero + np.nan for axis in "xy"}
    return replace(columns, fields=fields)


def _is_in_car(columns: Columns) -> bool:
    return frame_id(columns).lower() in BODY_FRAMES
