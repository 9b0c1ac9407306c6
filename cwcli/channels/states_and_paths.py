"""Arrays of the domain rooms as the channels that cwcli publishes (see `schemas/` and docs/channels.md)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.channels.published import EGO_FIX, EGO_POSE, TRANSFORMS
from cwcli.prediction.rollout import Paths
from cwcli.signals.columns import Field, FloatArray, Int64Array, OutputChannel, OutputField, Strings

MAP_FRAME = "map"
BODY_FRAME = "base_link"
EGO_ID = "ego"

COVARIANCE_TYPE_KNOWN = 3  # foxglove.LocationFix: KNOWN


def constant_strings(value: str, n: int) -> Strings:
    """`n` rows of one string."""
    return Strings(np.zeros(n, np.int32), (value,))


def vehicle_states(
    topic: str,
    *,
    ids: Strings,
    stamp_ns: Int64Array,
    log_time_ns: Int64Array,
    state: FloatArray,
    covariance: FloatArray,
    latitude_deg: FloatArray,
    longitude_deg: FloatArray,
    length_m: FloatArray,
    width_m: FloatArray,
) -> OutputChannel:
    """`cwcli.v1.VehicleState` rows.

    Args:
        topic: Where to publish.
        ids: Vehicle id, n rows.
        stamp_ns, log_time_ns: Shape (n,): time of the state; time at which it was known (reception for V2X).
        state: Shape (n, 8): x_m, y_m, speed_mps, heading_rad, accel_mps2, yaw_rate_radps, jerk_mps3, yaw_accel_radps2.
        covariance: Shape (n, 8, 8), the same order.
        latitude_deg, longitude_deg: Shape (n,).
        length_m, width_m: Shape (n,), NaN where unknown.
    """
    n = len(stamp_ns)
    fields: dict[str, Field] = {
        "stamp_ns": stamp_ns,
        "id": ids,
        "x_m": state[:, 0],
        "y_m": state[:, 1],
        "speed_mps": state[:, 2],
        "heading_rad": state[:, 3],
        "accel_mps2": state[:, 4],
        "yaw_rate_radps": state[:, 5],
        "jerk_mps3": state[:, 6],
        "yaw_accel_radps2": state[:, 7],
        "latitude_deg": latitude_deg,
        "longitude_deg": longitude_deg,
        "covariance": covariance.reshape(n, 64),
        "length_m": length_m,
        "width_m": width_m,
    }
    return in_log_order(OutputChannel(topic, "cwcli.v1.VehicleState", log_time_ns, fields))


def predicted_paths(
    topic: str,
    *,
    ids: Strings,
    stamp_ns: Int64Array,
    log_time_ns: Int64Array,
    model: str,
    paths: Paths,
    frame_id: str = "",
) -> OutputChannel:
    """`cwcli.v1.PredictedPath` rows, one per start of `paths`; an empty frame is `map`."""
    n = len(stamp_ns)
    step_s = float(paths.time_s[1] - paths.time_s[0]) if len(paths.time_s) > 1 else 0.0
    fields: dict[str, Field] = {
        "stamp_ns": stamp_ns,
        "id": ids,
        "model": constant_strings(model, n),
        "horizon_s": np.full(n, float(paths.time_s[-1])),
        "step_s": np.full(n, step_s),
        "x_m": paths.x_m,
        "y_m": paths.y_m,
        "heading_rad": paths.heading_rad,
        "speed_mps": paths.speed_mps,
        "position_covariance": paths.position_covariance_m2.reshape(n, 3 * len(paths.time_s)),
    }
    if frame_id:
        fields["frame_id"] = constant_strings(frame_id, n)
    return in_log_order(OutputChannel(topic, "cwcli.v1.PredictedPath", log_time_ns, fields))


def viewer_channels(
    *,
    stamp_ns: Int64Array,
    state: FloatArray,
    covariance: FloatArray,
    latitude_deg: FloatArray,
    longitude_deg: FloatArray,
    altitude_m: float,
) -> tuple[OutputChannel, ...]:
    """The ego's fix, pose and transform as the standard `foxglove.*` messages that viewers draw.

    Args:
        stamp_ns: Shape (n,).
        state, covariance: Shapes (n, 8) and (n, 8, 8), as in `vehicle_states`.
        latitude_deg, longitude_deg: Shape (n,).
        altitude_m: Height of the map's origin.
    """
    n = len(stamp_ns)
    zeros = np.zeros(n)
    half = state[:, 3] / 2.0
    position_covariance = np.zeros((n, 9))
    position_covariance[:, [0, 1, 3, 4]] = covariance[:, :2, :2].reshape(n, 4)
    fix: dict[str, Field] = {
        "timestamp": stamp_ns,
        "frame_id": constant_strings(BODY_FRAME, n),
        "latitude": latitude_deg,
        "longitude": longitude_deg,
        "altitude": np.full(n, altitude_m),
        "position_covariance": position_covariance,
        "position_covariance_type": np.full(n, COVARIANCE_TYPE_KNOWN, np.int32),
    }
    transform: dict[str, Field] = {
        "timestamp": stamp_ns,
        "parent_frame_id": constant_strings(MAP_FRAME, n),
        "child_frame_id": constant_strings(BODY_FRAME, n),
        "translation.x": state[:, 0],
        "translation.y": state[:, 1],
        "translation.z": zeros,
        "rotation.x": zeros,
        "rotation.y": zeros,
        "rotation.z": np.sin(half),
        "rotation.w": np.cos(half),
    }
    return (
        OutputChannel(EGO_FIX.topic, "foxglove.LocationFix", stamp_ns, fix),
        pose_channel(EGO_POSE.topic, stamp_ns, state),
        OutputChannel(TRANSFORMS.topic, "foxglove.FrameTransform", stamp_ns, transform),
    )


def pose_channel(topic: str, stamp_ns: Int64Array, state: FloatArray) -> OutputChannel:
    """States (n, 8) as `foxglove.PoseInFrame` in the map frame."""
    n = len(stamp_ns)
    zeros, half = np.zeros(n), 0.5 * state[:, 3]
    fields: dict[str, Field] = {
        "timestamp": stamp_ns,
        "frame_id": constant_strings(MAP_FRAME, n),
        "pose.position.x": state[:, 0],
        "pose.position.y": state[:, 1],
        "pose.position.z": zeros,
        "pose.orientation.x": zeros,
        "pose.orientation.y": zeros,
        "pose.orientation.z": np.sin(half),
        "pose.orientation.w": np.cos(half),
    }
    return OutputChannel(topic, "foxglove.PoseInFrame", stamp_ns, fields)


def in_log_order(channel: OutputChannel) -> OutputChannel:
    """The channel with its rows in log-time order (stable)."""
    order = np.argsort(channel.log_time_ns, kind="stable")
    if np.array_equal(order, np.arange(len(order))):
        return channel
    return OutputChannel(
        channel.topic,
        channel.schema_name,
        channel.log_time_ns[order],
        {name: take(values, order) for name, values in channel.fields.items()},
    )


def take(values: OutputField, rows: npt.NDArray[np.intp]) -> OutputField:
    """The given rows of a column.

    Raises:
        TypeError: The column is ragged; the channels here hold none.
    """
    if isinstance(values, Strings):
        return Strings(values.codes[rows], values.values)
    if isinstance(values, np.ndarray):
        return values[rows]
    raise TypeError("a ragged column can't be reordered here")
