"""Columns named by the path to a field of a ROS message: `field.pose.pose.position.x`, `/imu/angular_velocity/z`.

`rostopic echo -p`, PlotJuggler and Foxglove write such tables. The units are those of REP-103, whatever the values.
"""

from __future__ import annotations

import re
from dataclasses import replace

from cwcli.importing.names import split_name
from cwcli.importing.tables import Preset, SourceTable

HEADER_PATH_PATTERN = re.compile(r"(^|[./])header[./](stamp|seq|frame_id)\b")
"""The path to the header of a stamped message, which shows that a table holds ROS messages."""
PRESET_BY_PATH_PATTERN = (
    (r"pose[./]position[./]([xyz])", "{}", "m"),
    (r"pose[./]orientation[./]([xyzw])", "quaternion_{}", ""),
    (r"angular_velocity[./]([xyz])", "gyro_{}", "radps"),
    (r"linear_acceleration[./]([xyz])", "accel_{}", "mps2"),
    (r"twist[./]twist[./]linear[./]x()", "speed", "mps"),
    (r"twist[./]twist[./]angular[./]z()", "yaw_rate", "radps"),
)
"""Pattern of the end of a path, the quantity with the axis in its place, and its unit."""
OTHER_ROAD_USER_WORDS = frozenset({"lead", "leading", "target", "object", "objects", "obstacle", "other", "tracked"})
"""Words of a topic whose messages are about another vehicle."""


def with_presets_if_ros_messages(table: SourceTable) -> SourceTable:
    """Return the table with the meaning of its columns, if they are fields of stamped ROS messages."""
    if not any(HEADER_PATH_PATTERN.search(column) for column in table.columns):
        return table
    presets, notes = {}, []
    for column in table.columns:
        if OTHER_ROAD_USER_WORDS & set(split_name(column).words):
            continue
        for pattern, quantity, unit in PRESET_BY_PATH_PATTERN:
            if found := re.search(rf"(?:^|[./]){pattern}$", column):
                presets[column] = Preset(quantity.format(found[1]), unit)
        if column in presets and not _has_axes_of_the_car(table, column):
            presets[column] = Preset("ignored")
            notes.append(f"{column!r} is left out: without a position in its message, its axes may be east and north")
    return replace(table, kind="ros message", presets=presets, notes=[*table.notes, *notes]) if presets else table


def _has_axes_of_the_car(table: SourceTable, column: str) -> bool:
    """Tell whether a column is no velocity, or one of nav_msgs/Odometry: others can be in any axes."""
    position_in_same_message = re.sub(r"twist([./])twist[./](linear|angular)[./].$", r"pose\1pose\1position\1x", column)
    return position_in_same_message in table.columns
