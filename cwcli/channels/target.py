"""`cwcli.v1.Target`: writes tracks as a channel and as a scene for viewers; reads them as states of vehicles."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.channels.output import make_output_channel
from cwcli.channels.published import TARGET_SCENE, TARGETS, TARGETS_ONLINE, Channel
from cwcli.channels.vehicle_state import VehicleStates
from cwcli.errors import DataError
from cwcli.signals.columns import (
    Columns,
    Field,
    FloatArray,
    Int64Array,
    OutputChannel,
    OutputField,
    Repeated,
    Strings,
    repeat_string,
    sort_distinct_values,
)
from cwcli.signals.leaf_fields import read_integers, read_matrix, read_numbers, read_texts, unusable_field_error
from cwcli.signals.row_order import iter_rows_by_id
from cwcli.signals.vehicle_state import ACCEL, BODY_FRAME, MAP_FRAME, N_STATES, YAW_RATE
from cwcli.tracking.convert import (
    MIN_SPEED_OF_TARGET_HEADING_MPS,
    target_rows_of_result,
    vehicle_states_and_covariances_of_target,
)
from cwcli.tracking.tracker import TargetTrack, TrackResult

TARGET_LIFETIME_NS = 1_000_000_000
"""Time for which a viewer shows a target that is not updated, ns; chosen by hand."""
TARGET_BALL_DIAMETER_M = 1.5
"""Diameter of the ball that marks a target, m; chosen by eye."""
TARGET_ID_LETTER_HEIGHT_M = 1.0
"""Height of the letters of a target's id, m; chosen by eye."""
TARGET_BALL_RGBA = (1.0, 0.55, 0.0, 0.8)
"""Orange, the colour in which a viewer shows targets' balls and arrows: red, green, blue and opacity, each 0 to 1.
Chosen by eye."""
TARGET_ID_TEXT_RGBA = (1.0, 1.0, 1.0, 1.0)
"""White, the colour in which a viewer shows targets' ids: red, green, blue and opacity, each 0 to 1. Chosen by eye."""


def make_target_channels(
    result: TrackResult, *, in_map: bool, known_ns: tuple[Int64Array, Int64Array], channel: Channel = TARGETS
) -> tuple[OutputChannel, ...]:
    """Make the channel of the tracks, and a scene of them for viewers.

    Args:
        in_map: The tracks are in the map frame, not in the car's body frame.
        known_ns: Stamps of all scans, increasing, and the log times at which each was known.
        channel: The channel of smoothed or of online tracks; only smoothed tracks get a scene.
    """
    rows = target_rows_of_result(result)
    motion = _accelerations_yaw_rates_and_sigmas(result)
    stamps, logged = known_ns
    log_time_ns = logged[np.searchsorted(stamps, rows.stamp_ns)] if len(rows.stamp_ns) else rows.stamp_ns
    order = np.lexsort((rows.id, rows.stamp_ns, log_time_ns))
    n = len(order)
    names = tuple(str(track.id) for track in result.tracks)
    number_of = {track.id: k for k, track in enumerate(result.tracks)}
    codes = np.array([number_of[track] for track in rows.id[order].tolist()], np.int32)
    ids = Strings(codes, names)
    frame = repeat_string(MAP_FRAME if in_map else BODY_FRAME, n)
    state = rows.state[order]
    fields: dict[str, Field] = {
        "stamp_ns": rows.stamp_ns[order],
        "id": ids,
        "x_m": state[:, 0],
        "y_m": state[:, 1],
        "vx_mps": state[:, 2],
        "vy_mps": state[:, 3],
        "covariance": rows.covariance[order].reshape(n, 16),
        "sensor": rows.sensor.select_rows(order),
        "frame_id": frame,
        "accel_mps2": motion[order, 0],
        "yaw_rate_radps": motion[order, 1],
        "accel_sigma_mps2": motion[order, 2],
        "yaw_rate_sigma_radps": motion[order, 3],
    }
    targets = make_output_channel(channel, log_time_ns[order], fields)
    if channel != TARGETS:
        return (targets,)
    return targets, _target_scene_channel(log_time_ns[order], rows.stamp_ns[order], ids, frame, state)


def _accelerations_yaw_rates_and_sigmas(result: TrackResult) -> FloatArray:
    """Acceleration, yaw rate and their sigmas, shape (n, 4), in the order of `target_rows_of_result`; NaN if not
    modelled."""
    parts = [
        np.zeros((0, 4)),
        *(_accelerations_yaw_rates_and_sigmas_of_track(track, result.state_names) for track in result.tracks),
    ]
    stamp = np.concatenate([np.zeros(0, np.int64), *(track.stamp_ns for track in result.tracks)])
    ids = np.concatenate([np.zeros(0, np.int64), *(np.full(len(track), track.id) for track in result.tracks)])
    return np.concatenate(parts)[np.lexsort((ids, stamp))]


def _accelerations_yaw_rates_and_sigmas_of_track(track: TargetTrack, names: tuple[str, ...]) -> FloatArray:
    out = np.full((len(track), 4), np.nan)
    if "turn_rate_radps" in names:
        k = names.index("turn_rate_radps")
        out[:, 1], out[:, 3] = track.state[:, k], np.sqrt(track.covariance[:, k, k])
    elif "ax_mps2" in names:
        a, b = names.index("ax_mps2"), names.index("ay_mps2")
        speed = np.hypot(track.state[:, 2], track.state[:, 3])
        size = np.maximum(speed, MIN_SPEED_OF_TARGET_HEADING_MPS)
        along = track.state[:, 2:4] / size[:, None]
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        accel, noise = track.state[:, [a, b]], track.covariance[:, [[a], [b]], [a, b]]
        out[:, 0] = (along * accel).sum(axis=1)
        out[:, 1] = (across * accel).sum(axis=1) / size
        out[:, 2] = np.sqrt(np.einsum("ni,nij,nj->n", along, noise, along))
        out[:, 3] = np.sqrt(np.einsum("ni,nij,nj->n", across, noise, across)) / size
    return out


def _target_scene_channel(
    log_time_ns: Int64Array, stamp_ns: Int64Array, ids: Strings, frame: Strings, state: FloatArray
) -> OutputChannel:
    """Make one scene for each log time: a ball, an arrow of one second's motion and the id for each target."""
    n = len(log_time_ns)
    times, first = np.unique(log_time_ns, return_index=True)
    one_each = np.arange(n + 1, dtype=np.int64)
    half = 0.5 * np.arctan2(state[:, 3], state[:, 2])
    speed = np.hypot(state[:, 2], state[:, 3])

    def pose_fields(up_m: float, half_yaw: FloatArray) -> dict[str, OutputField]:
        return {
            "pose.position.x": state[:, 0],
            "pose.position.y": state[:, 1],
            "pose.position.z": np.full(n, up_m),
            "pose.orientation.z": np.sin(half_yaw),
            "pose.orientation.w": np.cos(half_yaw),
        }

    def color_fields(values: tuple[float, ...]) -> dict[str, OutputField]:
        return {f"color.{part}": np.full(n, value) for part, value in zip("rgba", values, strict=True)}

    size: dict[str, OutputField] = {f"size.{axis}": np.full(n, TARGET_BALL_DIAMETER_M) for axis in "xyz"}
    arrow: dict[str, OutputField] = {
        "shaft_length": speed,
        "shaft_diameter": np.full(n, 0.2 * TARGET_BALL_DIAMETER_M),
        "head_length": np.full(n, 0.4 * TARGET_BALL_DIAMETER_M),
        "head_diameter": np.full(n, 0.4 * TARGET_BALL_DIAMETER_M),
    }
    text: dict[str, OutputField] = {
        "billboard": np.ones(n, np.bool_),
        "font_size": np.full(n, TARGET_ID_LETTER_HEIGHT_M),
        "text": ids,
    }
    still = np.zeros(n)
    entities: dict[str, OutputField] = {
        "timestamp": stamp_ns,
        "frame_id": frame,
        "id": ids,
        "lifetime": np.full(n, TARGET_LIFETIME_NS, np.int64),
        "spheres": Repeated(
            one_each, {**pose_fields(0.5 * TARGET_BALL_DIAMETER_M, still), **size, **color_fields(TARGET_BALL_RGBA)}
        ),
        "arrows": Repeated(
            one_each, {**pose_fields(0.5 * TARGET_BALL_DIAMETER_M, half), **arrow, **color_fields(TARGET_BALL_RGBA)}
        ),
        "texts": Repeated(
            one_each, {**pose_fields(2.0 * TARGET_BALL_DIAMETER_M, still), **text, **color_fields(TARGET_ID_TEXT_RGBA)}
        ),
    }
    offsets = np.append(first, n).astype(np.int64)
    return OutputChannel(TARGET_SCENE.topic, TARGET_SCENE.schema, times, {"entities": Repeated(offsets, entities)})


def read_targets_as_states(columns: Columns) -> VehicleStates:
    """Read a channel of targets as vehicle states, which prediction and warning use like those of V2X vehicles.

    Acceleration and yaw rate that a track does not model are 0.

    Raises:
        DataError: Another version wrote the channel, or the targets are not in the map.
    """
    n = len(columns)
    ids, frames = read_texts(columns, "id", required=True), read_texts(columns, "frame_id", required=True)
    covariance = read_matrix(columns, "covariance", 16, required=True).reshape(n, 4, 4)
    if not np.isfinite(covariance).all():
        raise unusable_field_error(columns, "covariance")
    if {frames.values[code] if code >= 0 else "" for code in sort_distinct_values(frames.codes)} - {MAP_FRAME}:
        raise DataError(
            "the targets are in the car's own frame, and can't be compared with its path on the map",
            where=columns.topic,
            hint="run `cwcli estimate` first, then `cwcli track --replace` on its output",
        )
    stamp_ns, _ = read_integers(columns, "stamp_ns", required=True)
    states_by_row = np.stack(
        [read_numbers(columns, name, required=True) for name in ("x_m", "y_m", "vx_mps", "vy_mps")], axis=1
    )
    state, full = np.zeros((n, N_STATES)), np.zeros((n, N_STATES, N_STATES))
    for _, unordered in iter_rows_by_id(ids):
        rows = unordered[np.argsort(stamp_ns[unordered], kind="stable")]
        state[rows], full[rows] = vehicle_states_and_covariances_of_target(
            states_by_row[rows], covariance[rows], looks_ahead=columns.topic != TARGETS_ONLINE.topic
        )
    for at, name, sigma_name in (
        (ACCEL, "accel_mps2", "accel_sigma_mps2"),
        (YAW_RATE, "yaw_rate_radps", "yaw_rate_sigma_radps"),
    ):
        value, sigma = read_numbers(columns, name), read_numbers(columns, sigma_name)
        state[:, at] = np.where(np.isfinite(value), value, 0.0)
        full[:, at, at] = np.where(np.isfinite(sigma), sigma, 0.0) ** 2
    unknown = np.full(n, np.nan)
    everything = VehicleStates(
        ids, stamp_ns, columns.log_time_ns, state, full, unknown, unknown, np.zeros(len(stamp_ns), np.uint8)
    )
    return everything.select_rows(_last_row_of_each_id_and_stamp(ids.codes, stamp_ns))


def _last_row_of_each_id_and_stamp(codes: npt.NDArray[np.int32], stamp_ns: Int64Array) -> npt.NDArray[np.intp]:
    """Select the last row of each id and stamp, in file order; two sensors may see a target at the same time."""
    order = np.lexsort((np.arange(len(codes)), stamp_ns, codes))
    is_last = np.append((np.diff(codes[order]) != 0) | (np.diff(stamp_ns[order]) != 0), len(order) > 0)
    return np.sort(order[is_last[: len(order)]])
