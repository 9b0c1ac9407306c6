"""Kinds of warnings of collisions that the host cannot avoid, or of vehicles that keep their lanes.

A warning is for the one who can act on it. Who is followed cannot avoid the collision by braking; the follower can, as
in the first rule of RSS, "do not hit someone from behind" (Shalev-Shwartz, Shammah and Shashua 2017). Nor can a host
that stands: it has already done what a warning asks for. And two that drive parallel, each in its own lane, pass each
other: what their predicted paths say of contact comes from the noise of their yaw rates.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
import numpy.typing as npt

from cwcli.measures.outlines import LengthAndWidthM
from cwcli.signals.angles import wrap_angle
from cwcli.signals.columns import FloatArray
from cwcli.signals.vehicle_state import ACCEL, HEADING, SPEED, YAW_RATE, X, Y
from cwcli.warning.measures import PairStates

MAX_FOLLOWING_ANGLE_RAD = np.radians(30.0)
"""Greatest angle between the headings of a vehicle and one that follows it, rad. Chosen by hand; not fitted."""
MIN_HOST_SPEED_TO_AVOID_FOLLOWER_MPS = -0.5
"""Speed in m/s, negative in reverse, below which the host can avoid who is behind it. Chosen by hand; not fitted."""
MAX_LATERAL_GAP_OF_FOLLOWING_VEHICLE_M = 0.5
"""Lateral distance in m from the host's line, beyond half of both widths, up to which a vehicle counts as following.
Chosen by hand."""
MAX_PARALLEL_ANGLE_RAD = np.radians(10.0)
"""Greatest angle between parallel lines of travel, rad: twice that of a usual change of lanes. Chosen by hand."""
MIN_OUTLINE_GAP_OF_SEPARATE_LANES_M = 1.0
"""Least lateral distance of the outlines of vehicles in lanes of their own, m: lanes are 3 m wide or more, cars 2 m.
Chosen by hand; not fitted."""
MAX_LATERAL_SPEED_IN_LANE_MPS = 1.0
"""Greatest speed towards the other's line in a lane, m/s: a change of lanes (3.5 m in 4 to 6 s) has 0.9 on average."""
MAX_STANDSTILL_SPEED_MPS = 0.5
"""Speed in m/s up to which a host stands that does not drive off. Chosen by hand; not fitted."""
MAX_STANDING_ACCEL_MPS2 = 0.5
"""Acceleration in m/s^2 above which a host that stands drives off: cars start with 1 m/s^2 and more. Chosen by hand."""
MAX_LATERAL_ACCEL_IN_LANE_MPS2 = 1.0
"""Greatest lateral acceleration of a vehicle that keeps a straight lane, m/s^2. Chosen by hand; not fitted."""


class WarningKind(IntEnum):
    """What a warning is about."""

    COLLISION = 0
    FROM_BEHIND = 1
    BESIDE_LANE = 2
    HOST_STANDS = 3

    @property
    def name_in_tables(self) -> str:
        """The kind's name in tables."""
        return self.name.lower().replace("_", " ")


def kind_of_each_warning(states: PairStates) -> npt.NDArray[np.int8]:
    """Return the `WarningKind` of a warning at each of m moments, (m,), from the states of both."""
    host, other = states.host, states.other
    cos, sin = np.cos(host[:, HEADING]), np.sin(host[:, HEADING])
    dx, dy = other[:, X] - host[:, X], other[:, Y] - host[:, Y]
    ahead_m, left_m = dx * cos + dy * sin, dy * cos - dx * sin
    angle_rad = wrap_angle(other[:, HEADING] - host[:, HEADING])
    kinds = np.full(len(host), WarningKind.COLLISION, np.int8)
    kinds[_drives_parallel_at_distance_mask(host, other, left_m, angle_rad, states.sizes)] = WarningKind.BESIDE_LANE
    is_standing = (np.abs(host[:, SPEED]) < MAX_STANDSTILL_SPEED_MPS) & (host[:, ACCEL] < MAX_STANDING_ACCEL_MPS2)
    kinds[is_standing] = WarningKind.HOST_STANDS
    kinds[_follower_mask(host, ahead_m, left_m, angle_rad, states.sizes)] = WarningKind.FROM_BEHIND
    return kinds


def _follower_mask(
    host_states: FloatArray,
    ahead_m: FloatArray,
    left_m: FloatArray,
    angle_rad: FloatArray,
    sizes: tuple[LengthAndWidthM, LengthAndWidthM],
) -> npt.NDArray[np.bool_]:
    """Whether the other follows the host in its lane, (m,)."""
    (length_m, width_m), (other_length_m, other_width_m) = sizes
    overlap_m = 0.5 * (width_m + other_width_m) - np.abs(left_m)
    # In one line who is nearer to the front is ahead; partly beside the host the follower must be behind its rear.
    is_behind = ahead_m < np.where(overlap_m > 0.0, 0.0, -0.5 * (length_m + other_length_m))
    is_in_line = overlap_m > -MAX_LATERAL_GAP_OF_FOLLOWING_VEHICLE_M
    is_in_line &= np.abs(angle_rad) < MAX_FOLLOWING_ANGLE_RAD
    return np.asarray(is_behind & is_in_line & (host_states[:, SPEED] > MIN_HOST_SPEED_TO_AVOID_FOLLOWER_MPS))


def _drives_parallel_at_distance_mask(
    host_states: FloatArray,
    other_states: FloatArray,
    left_m: FloatArray,
    angle_rad: FloatArray,
    host_and_other_size: tuple[LengthAndWidthM, LengthAndWidthM],
) -> npt.NDArray[np.bool_]:
    """Whether both drive straight and parallel, the same way or opposite, at a clear lateral distance, (m,)."""
    skew_rad = np.abs(np.where(np.abs(angle_rad) > 0.5 * np.pi, np.pi - np.abs(angle_rad), angle_rad))
    clearance_m = np.abs(left_m) - 0.5 * (host_and_other_size[0][1] + host_and_other_size[1][1])
    sideways_mps = np.abs(other_states[:, SPEED] * np.sin(angle_rad))
    is_straight = np.abs(host_states[:, SPEED] * host_states[:, YAW_RATE]) < MAX_LATERAL_ACCEL_IN_LANE_MPS2
    is_straight &= np.abs(other_states[:, SPEED] * other_states[:, YAW_RATE]) < MAX_LATERAL_ACCEL_IN_LANE_MPS2
    is_parallel = (skew_rad < MAX_PARALLEL_ANGLE_RAD) & (sideways_mps < MAX_LATERAL_SPEED_IN_LANE_MPS)
    return np.asarray(is_parallel & is_straight & (clearance_m > MIN_OUTLINE_GAP_OF_SEPARATE_LANES_M))
