"""Columns named by the path to a field of a ROS message: `field.pose.pose.position.x`, `/imu/angular_velocity/z`.

`rostopic echo -p`, PlotJuggler and Foxglove write such tables. The units are those of REP-103, whatever the values.
"""

from __future__ import annotations

import re
from dataclasses import replace

from cwcli.importing.tables import Preset, SourceTable

HEADER_PATH_PATTERN = re.compile(r"(^|[./])header[./](stamp|seq|frame_id)\b")
"""The path to the header of a stamped message, which shows that a table holds ROS messages."""
PRESET_BY_PATH_PATTERN = (
    (r"pose[./]position[./]([xyz])", "{}", "m"),
    (r"pose[./]orientation[./]([xyzw])", "quaternion_{}", ""),
    (r"angular_velocity[./]([xyz])", "gyro_{}", "radps"),
    (r"linear_acceleration[./]([xyz])", "accel_{}", "mps2"),
    (r"twist[./]twist[./]linear[./]x()", "speed", "mps"),  # of nav_msgs/Odometry: in the axes of the car
    (r"twist[./]twist[./]angular[./]z()", "yaw_rate", "radps"),
)
"""Pattern of the end of a path, the quantity with the axis in its place, and its unit."""


def with_presets_if_ros_messages(table: SourceTable) -> SourceTable:
    """Return the table with the meaning of its columns, if they are fields of stamped ROS messages."""
    if not any(HEADER_PATH_PATTERN.search(column) for column in table.columns):
        return table
    presets = {}
    for column in table.columns:
        for pattern, quantity, unit in PRESET_BY_PATH_PATTERN:
            if found := re.search(rf"(?:^|[./]){pattern}$", column):
                presets[column] = Preset(quantity.format(found[1]), unit)
    return replace(table, kind="ros message", presets=presets) if presets else table
