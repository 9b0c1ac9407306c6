"""A vehicle's state (n, 8) in the order of `cwcli.v1.VehicleState`, its flags, and the names of ego and frames."""

from enum import IntFlag

STATE_NAMES = (
    "x_m",
    "y_m",
    "speed_mps",
    "heading_rad",
    "accel_mps2",
    "yaw_rate_radps",
    "jerk_mps3",
    "yaw_accel_radps2",
)
"""The names of a state's components, in the order of its columns."""
N_STATES = len(STATE_NAMES)
"""The number of a state's components."""
X, Y, SPEED, HEADING, ACCEL, YAW_RATE, JERK, YAW_ACCEL = range(8)
"""The column of each component in a state (n, 8)."""
STATE_COLUMNS_OF_MOTION_MODEL_RESPONSES = (
    ACCEL,
    JERK,
    YAW_RATE,
    YAW_ACCEL,
)  # in the order of a motion model's responses
"""The columns of acceleration, jerk, yaw rate and yaw acceleration, in the order of a motion model's responses."""

EGO_ID = "ego"
"""The id of the ego in published channels."""
MAP_FRAME, BODY_FRAME = "map", "base_link"
"""The names of the map frame and of the ego's body frame in published channels."""


class StateFlag(IntFlag):
    """The reasons to trust a state less; `schemas/cwcli/v1/vehicle_state.proto` defines them."""

    STARTING = 1
    AFTER_RESET = 2
    BRIDGED = 4
    REJECTING = 8
