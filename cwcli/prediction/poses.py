"""Positions and yaw angles of the car, at which paths of its body frame are placed, and its track."""

from __future__ import annotations

import numpy as np

from cwcli.dynamics.samples import LateralTrack
from cwcli.lazy_dataclass import dataclass
from cwcli.prediction.lateral import dead_reckon_x_y_m_and_heading_rad
from cwcli.signals.columns import FloatArray, Int64Array, StateRows
from cwcli.signals.resample import interpolate_signal_at_times
from cwcli.signals.vehicle_state import HEADING, MAP_FRAME, X, Y

ODOM_FRAME = "odom"
"""Frame id of dead-reckoned poses (REP-105)."""
MAX_INTERPOLATED_EGO_GAP_S = 0.5
"""Longest gap in s across which the ego's states are interpolated. Chosen by hand; not fitted."""
MIN_SPEED_OF_SIDE_SLIP_MPS = 1.0
"""Speed in m/s below which the side slip counts as 0, because lateral speeds are mostly noise there. Chosen by hand;
not fitted."""


@dataclass(frozen=True)
class VehiclePoses:
    """Positions of the car and directions of its axis.

    Attributes:
        source: Where the poses come from, in words for the user.
        frame_id: Frame of the poses.
        stamp_ns, xy_m: Shape (m,) and (m, 2): the track.
        at_xy_m, at_yaw_rad: Shape (n, 2) and (n,): position and yaw at the observed frames; NaN where not known.
    """

    source: str
    frame_id: str
    stamp_ns: Int64Array
    xy_m: FloatArray
    at_xy_m: FloatArray
    at_yaw_rad: FloatArray


def dead_reckoned_poses(track: LateralTrack) -> VehiclePoses:
    """Integrate the observed motion from the car's first state, which is the origin; NaN at frames without a state."""
    x_m, y_m, yaw_rad = dead_reckon_x_y_m_and_heading_rad(track)
    has_state = np.isfinite(track.state[:, 0])
    first = int(np.argmax(has_state))
    dx, dy = x_m - x_m[first], y_m - y_m[first]
    cos, sin = np.cos(yaw_rad[first]), np.sin(yaw_rad[first])
    xy_m = np.where(has_state[:, None], np.column_stack([cos * dx + sin * dy, -sin * dx + cos * dy]), np.nan)
    return VehiclePoses("the observed motion", ODOM_FRAME, track.stamp_ns, xy_m, xy_m, yaw_rad - yaw_rad[first])


def body_poses_from_states(stamp_ns: Int64Array, state: StateRows, track: LateralTrack) -> VehiclePoses:
    """Build the poses from the ego's estimated track; the yaw is the course less the observed side slip.

    Args:
        stamp_ns, state: The ego's states (m,) and (m, 8), in the order of their stamps.
    """
    x_m, y_m, course_rad = interpolate_signal_at_times(
        stamp_ns, state[:, [X, Y, HEADING]], track.stamp_ns, max_gap_s=MAX_INTERPOLATED_EGO_GAP_S
    ).T
    yaw_rad = course_rad - side_slip_rad(track.state[:, 0], track.speed_mps)
    return VehiclePoses("the ego state", MAP_FRAME, stamp_ns, state[:, :2], np.column_stack([x_m, y_m]), yaw_rad)


def side_slip_rad(lateral_mps: FloatArray, forward_mps: FloatArray) -> FloatArray:
    """Angle from the car's axis to its direction of motion; 0 at walking pace."""
    moves = np.abs(forward_mps) >= MIN_SPEED_OF_SIDE_SLIP_MPS
    return np.where(moves, np.arctan2(lateral_mps, np.where(moves, forward_mps, 1.0)), 0.0)
