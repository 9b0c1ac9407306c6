"""Convert radar tracks in Cartesian form to radar values, and tracked targets to rows and vehicle states."""

from __future__ import annotations

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, Int64Array, Strings
from cwcli.tracking.tracker import TrackResult

MIN_SPEED_OF_TARGET_HEADING_MPS = 0.5
"""Speed in m/s below which a target keeps its last heading: its direction of motion is mostly noise. Chosen by hand;
not fitted."""
_UNKNOWN_HEADING_VARIANCE_RAD2 = np.pi**2 / 3.0
"""Variance of a heading that is uniform over all directions, rad^2."""


def radar_values_and_covariances_from_cartesian(
    position_m: FloatArray,
    velocity_mps: FloatArray,
    position_covariance: FloatArray | None = None,
    velocity_covariance: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Convert tracks that a radar reports in Cartesian form (`radar_msgs/RadarTracks`) to radar values.

    Only the radial part of the velocity is used: the rest is estimated by the radar's own filter, not measured.

    Args:
        position_m, velocity_mps: Shape (n, 2), in the sensor's axes, velocity relative to the sensor.
        position_covariance, velocity_covariance: Shape (n, 2, 2), NaN = not given, or None.

    Returns:
        Values (n, 3): range, azimuth, range rate, and their covariance (n, 3, 3), NaN where not given.
    """
    r = np.hypot(position_m[:, 0], position_m[:, 1])
    with np.errstate(invalid="ignore", divide="ignore"):
        line = position_m / r[:, None]
    rate = (line * velocity_mps).sum(axis=1)
    values = np.stack([r, np.arctan2(position_m[:, 1], position_m[:, 0]), rate], axis=1)
    n = len(r)
    covariance = np.full((n, 3, 3), np.nan)
    if position_covariance is None:
        return values, covariance
    speed = velocity_covariance if velocity_covariance is not None else np.full((n, 2, 2), np.nan)
    across = np.stack([-line[:, 1], line[:, 0]], axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        jacobian = np.zeros((n, 3, 4))
        jacobian[:, 0, :2] = line
        jacobian[:, 1, :2] = across / r[:, None]
        jacobian[:, 2, :2] = (velocity_mps - rate[:, None] * line) / r[:, None]
        jacobian[:, 2, 2:] = line
        both = np.zeros((n, 4, 4))
        both[:, :2, :2], both[:, 2:, 2:] = position_covariance, speed
        covariance = jacobian @ both @ jacobian.transpose(0, 2, 1)
    covariance[~np.isfinite(covariance).all(axis=(1, 2))] = np.nan
    return values, covariance


@dataclass(frozen=True)
class TargetRows:
    """All tracks as rows in the order of time (`/cwcli/targets`).

    Attributes:
        stamp_ns, id: Shape (n,).
        state: Shape (n, 4): x_m, y_m, vx_mps, vy_mps.
        covariance: Shape (n, 4, 4).
        sensor: Source that updated the row; absent where the track coasted.
    """

    stamp_ns: Int64Array
    id: Int64Array
    state: FloatArray
    covariance: FloatArray
    sensor: Strings


def target_rows_of_result(result: TrackResult) -> TargetRows:
    """Convert all tracks of a result to rows, by time, then id."""
    tracks = result.tracks
    none = np.zeros(0, np.int64)
    stamp = np.concatenate([none, *(t.stamp_ns for t in tracks)])
    ids = np.concatenate([none, *(np.full(len(t), t.id) for t in tracks)])
    state = np.concatenate([np.zeros((0, 4)), *(t.state[:, :4] for t in tracks)])
    covariance = np.concatenate([np.zeros((0, 4, 4)), *(t.covariance[:, :4, :4] for t in tracks)])
    source = np.concatenate([none, *(t.source for t in tracks)])
    order = np.lexsort((ids, stamp))
    sensor = Strings(source[order].astype(np.int32), result.sources)
    return TargetRows(stamp[order], ids[order], state[order], covariance[order], sensor)


def vehicle_states_and_covariances_of_target(
    state: FloatArray,
    covariance: FloatArray,
    *,
    min_speed_mps: float = MIN_SPEED_OF_TARGET_HEADING_MPS,
    looks_ahead: bool = True,
) -> tuple[FloatArray, FloatArray]:
    """Convert one target's rows to vehicle states, as prediction and warning use them for V2X vehicles.

    Args:
        state: Shape (n, 4): x, y, vx, vy, in the order of time.
        covariance: Shape (n, 4, 4).
        min_speed_mps: A slower target keeps the last heading that it had at a higher speed.
        looks_ahead: Before the first such heading the target has that one; else the direction of its velocity.

    Returns:
        States (n, 8): x, y, speed, heading, acceleration, yaw rate, jerk, yaw acceleration, the last four 0, and their
        covariance (n, 8, 8), zero for those four.
    """
    n = len(state)
    speed = np.hypot(state[:, 2], state[:, 3])
    heading = np.unwrap(np.arctan2(state[:, 3], state[:, 2]))
    moves = speed >= min_speed_mps
    if moves.any():
        last = np.maximum.accumulate(np.where(moves, np.arange(n), -1))
        before = np.argmax(moves) if looks_ahead else np.arange(n)
        heading = heading[np.where(last >= 0, last, before)]
    out = np.zeros((n, 8))
    out[:, :2], out[:, 2] = state[:, :2], speed
    out[:, 3] = heading - 2.0 * np.pi * np.floor((heading + np.pi) / (2.0 * np.pi))
    c, s, size = np.cos(heading), np.sin(heading), np.maximum(speed, min_speed_mps)
    jacobian = np.zeros((n, 4, 4))
    jacobian[:, 0, 0] = jacobian[:, 1, 1] = 1.0
    jacobian[:, 2, 2], jacobian[:, 2, 3] = c, s
    jacobian[:, 3, 2], jacobian[:, 3, 3] = -s / size, c / size
    small = jacobian @ covariance @ jacobian.transpose(0, 2, 1)
    wide = small[:, 3, 3] > _UNKNOWN_HEADING_VARIANCE_RAD2
    small[wide, 3, :] = 0.0
    small[wide, :, 3] = 0.0
    small[wide, 3, 3] = _UNKNOWN_HEADING_VARIANCE_RAD2
    full = np.zeros((n, 8, 8))
    full[:, :4, :4] = small
    return out, full
