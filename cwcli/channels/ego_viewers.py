"""The ego as the standard messages that viewers draw: fix, pose and transform."""

from __future__ import annotations

import numpy as np

from cwcli.channels.output import first_rows_of_each_vehicle_and_period, make_output_channel
from cwcli.channels.published import EGO_FIX, EGO_POSE, EGO_STATE, TRANSFORMS, Channel
from cwcli.channels.vehicle_state import VehicleStates, make_vehicle_state_channel
from cwcli.signals.columns import Field, FloatArray, Int64Array, OutputChannel, repeat_string
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.precision import round_plane_covariance, round_to_binary_step
from cwcli.signals.vehicle_state import BODY_FRAME, HEADING, MAP_FRAME, STATE_NAMES, X, Y

COVARIANCE_TYPE_KNOWN = 3
"""The value of `foxglove.LocationFix.PositionCovarianceType.KNOWN`."""
MAX_FIX_AND_POSE_RATE_HZ, MAX_TRANSFORM_RATE_HZ = 5.0, 10.0
"""Highest rates of fixes and poses, and of transforms; chosen for smooth drawing and small logs."""
FIX_VARIANCE_BINARY_DIGITS = 8
"""Binary digits of the variances of a fix; chosen: viewers only draw an ellipse."""
ORIENTATION_FRACTION_BITS = 20
"""Number of binary digits after the point of the components of the orientation quaternion. Chosen by hand."""


def make_ego_channels(states: VehicleStates, local_map: LocalMap | None) -> tuple[OutputChannel, ...]:
    """Make the channel of the ego's states, and fixes, poses and transforms of some of them for viewers.

    Args:
        states: In the order of their log times, which are their stamps.
        local_map: Where the map lies on the earth; None leaves the fixes unknown.
    """
    published = make_vehicle_state_channel(EGO_STATE, states, local_map)
    first_rows = first_rows_of_each_vehicle_and_period(states.ids.codes, states.stamp_ns, MAX_TRANSFORM_RATE_HZ)
    shown = first_rows_of_each_vehicle_and_period(states.ids.codes, states.stamp_ns, MAX_FIX_AND_POSE_RATE_HZ)
    state = np.column_stack([np.asarray(published.fields[name]) for name in STATE_NAMES])
    transform: dict[str, Field] = {
        "timestamp": states.stamp_ns[first_rows],
        "parent_frame_id": repeat_string(MAP_FRAME, len(first_rows)),
        "child_frame_id": repeat_string(BODY_FRAME, len(first_rows)),
        **_map_position_and_quaternion_fields("translation", "rotation", state[first_rows]),
    }
    transforms = make_output_channel(TRANSFORMS, states.log_time_ns[first_rows], transform)
    states, state, n = states.select_rows(shown), state[shown], len(shown)
    position_covariance = np.zeros((n, 9))
    position_covariance[:, [0, 1, 4]] = round_plane_covariance(
        np.stack([states.covariance[:, a, b] for a, b in ((0, 0), (0, 1), (1, 1))], axis=1), FIX_VARIANCE_BINARY_DIGITS
    )
    position_covariance[:, 3] = position_covariance[:, 1]
    fix: dict[str, Field] = {
        "timestamp": states.stamp_ns,
        "frame_id": repeat_string(BODY_FRAME, n),
        "latitude": np.asarray(published.fields["latitude_deg"])[shown],
        "longitude": np.asarray(published.fields["longitude_deg"])[shown],
        "altitude": np.full(n, local_map.origin_alt_m if local_map else 0.0),
        "position_covariance": position_covariance,
        "position_covariance_type": np.full(n, COVARIANCE_TYPE_KNOWN, np.int32),
    }
    return (
        published,
        make_output_channel(EGO_FIX, states.log_time_ns, fix),
        make_pose_channel(EGO_POSE, states.stamp_ns, state),
        transforms,
    )


def make_pose_channel(channel: Channel, stamp_ns: Int64Array, state: FloatArray) -> OutputChannel:
    """Make a channel of `foxglove.PoseInFrame` in the map frame from states (n, 8); log times are the stamps."""
    fields: dict[str, Field] = {
        "timestamp": stamp_ns,
        "frame_id": repeat_string(MAP_FRAME, len(stamp_ns)),
        **_map_position_and_quaternion_fields("pose.position", "pose.orientation", state),
    }
    return make_output_channel(channel, stamp_ns, fields)


def _map_position_and_quaternion_fields(
    position_path: str, quaternion_path: str, state: FloatArray
) -> dict[str, Field]:
    """Fields of position and orientation on the map plane, from states (n, 8)."""
    zeros, half = np.zeros(len(state)), 0.5 * state[:, HEADING]
    return {
        f"{position_path}.x": state[:, X],
        f"{position_path}.y": state[:, Y],
        f"{position_path}.z": zeros,
        f"{quaternion_path}.x": zeros,
        f"{quaternion_path}.y": zeros,
        f"{quaternion_path}.z": round_to_binary_step(np.sin(half), ORIENTATION_FRACTION_BITS),
        f"{quaternion_path}.w": round_to_binary_step(np.cos(half), ORIENTATION_FRACTION_BITS),
    }
