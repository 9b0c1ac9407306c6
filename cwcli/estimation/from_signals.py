"""Convert canonical signals to measurements of the estimator; geodetic positions are projected to the map here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cwcli.errors import DataError, UsageError
from cwcli.estimation.config import Senders
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.signals.bsm_sender import repeated_heading_at_standstill_mask, undo_low_pass_filter_and_noise_gain
from cwcli.signals.canonical import (
    HeadingSignal,
    ImuSignal,
    PoseSignal,
    PositionSignal,
    RemoteSignal,
    Signal,
    SpeedSignal,
    VelocitySignal,
)
from cwcli.signals.columns import FloatArray, Int64Array, sort_distinct_values
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.remotes import join_remote_signals
from cwcli.signals.stitch import join_changed_station_ids
from cwcli.signals.units import NS_PER_S

MAX_LISTED_ID_CHANGES = 5
"""Greatest number of id changes that a note lists; chosen for short notes."""
MAX_EGO_STATES = 20_000_000
"""Greatest number of ego states. Chosen so that a wrong stamp ends as an error and does not exhaust the memory."""
EgoSignal = PositionSignal | PoseSignal | VelocitySignal | SpeedSignal | HeadingSignal | ImuSignal


def ego_signal_to_measurements(signal: EgoSignal, local_map: LocalMap | None) -> list[Measurements]:
    """Convert an ego signal to measurements, one per quantity that it carries.

    Args:
        local_map: The map frame; None where the first position is Cartesian.

    Raises:
        UsageError: It is a position of another kind than the first one.
    """
    stamp_ns, log_ns = signal.stamp_ns, signal.log_time_ns
    match signal:
        case PositionSignal():
            if local_map is None:
                hint = "name positions of one kind with --topic ego_position="
                raise UsageError(f"{signal.source} is in degrees, and the position before it is Cartesian", hint=hint)
            x_m, y_m, _ = local_map.map_from_wgs84(signal.latitude_deg, signal.longitude_deg, signal.altitude_m)
            covariance = _unpack_symmetric_2x2(signal.covariance_m2)
            values = np.column_stack([x_m, y_m])
            return [Measurements(signal.source, Kind.POSITION, stamp_ns, values, covariance, log_ns)]
        case PoseSignal():
            if local_map is not None:
                hint = "name positions of one kind with --topic ego_position="
                raise UsageError(f"{signal.source} is Cartesian, and the position before it is not", hint=hint)
            return _pose_to_measurements(signal)
        case VelocitySignal():
            values = np.column_stack([signal.east_mps, signal.north_mps])
            covariance = _unpack_symmetric_2x2(signal.covariance_m2ps2)
            return [Measurements(signal.source, Kind.VELOCITY, stamp_ns, values, covariance, log_ns)]
        case SpeedSignal():
            return _columns_to_measurements(
                signal,
                stamp_ns,
                log_ns,
                {
                    Kind.SPEED: (signal.speed_mps, signal.speed_variance_m2ps2),
                    Kind.YAW_RATE: (signal.yaw_rate_radps, signal.yaw_rate_variance_rad2ps2),
                },
            )
        case HeadingSignal():
            return _columns_to_measurements(
                signal, stamp_ns, log_ns, {Kind.HEADING: (signal.heading_rad, signal.variance_rad2)}
            )
        case ImuSignal():
            values = np.column_stack([signal.accel_mps2, signal.gyro_radps])
            variances = np.column_stack([signal.accel_variance, signal.gyro_variance])
            return [Measurements(signal.source, Kind.IMU, stamp_ns, values, variances, log_ns)]


def drop_stretches_without_position_and_note(
    measurements: Sequence[Measurements], max_pause_s: float
) -> tuple[list[Measurements], list[str]]:
    """Drop rows that a long pause separates from every position; returns the measurements and notes.

    In a stretch without a position between two pauses of all sources the place of the vehicle is unknown. Usually the
    time of such rows is wrong, or their channel uses another epoch.

    Args:
        max_pause_s: A longer pause of all sources together separates two stretches.
    """
    measured_ns = sort_distinct_values(np.concatenate([m.stamp_ns for m in measurements]))
    is_pause = np.diff(measured_ns) > max_pause_s * NS_PER_S
    if not is_pause.any():
        return list(measurements), []
    stretch = np.append(0, np.cumsum(is_pause))
    of_row = [stretch[np.searchsorted(measured_ns, m.stamp_ns)] for m in measurements]
    position_rows = [own for m, own in zip(measurements, of_row, strict=True) if m.kind is Kind.POSITION]
    near, notes = [], []
    for m, own in zip(measurements, of_row, strict=True):
        rows = np.isin(own, np.concatenate(position_rows))
        n_apart = int(np.count_nonzero(~rows))
        if n_apart:
            count_text = f"{n_apart} {m.kind.name.lower().replace('_', ' ')} rows lie more than {max_pause_s:g} s from"
            notes.append(f"{m.source}: {count_text} any stretch with a position, left out")
        if rows.any():
            near.append(m.select_rows(rows) if n_apart else m)
    return near, notes


def merge_remotes_placed_in_map_and_note(
    signals: Sequence[Signal], position: Signal, local_map: LocalMap | None, *, is_stitched: bool = False
) -> tuple[RemoteSignal | None, tuple[str, ...]]:
    """Merge the signals of remote vehicles that can be placed in the ego's map; returns one signal and notes.

    Args:
        position: Position signal of the ego: Cartesian remote vehicles must be in the same frame.
        local_map: The map frame; None where the ego's position is Cartesian.
        is_stitched: Join the ids of a vehicle that changed its id.
    """
    frame_id = "" if local_map is not None else position.frame_id if isinstance(position, PoseSignal) else ""
    remote_signals = [signal for signal in signals if isinstance(signal, RemoteSignal)]
    placed_remotes = [
        each for each in remote_signals if each.frame_id == frame_id and (each.x_m is not None or local_map is not None)
    ]
    notes: tuple[str, ...] = ()
    if len(placed_remotes) < len(remote_signals):
        mismatch_text = "is Cartesian" if local_map is None else "is on the globe, and theirs are Cartesian"
        notes = (f"the ego position {mismatch_text}: remote vehicles can't be placed in its map and are left out",)
    if not placed_remotes:
        return None, notes
    merged = join_remote_signals(placed_remotes)
    if not is_stitched:
        return merged, notes
    joined_remotes, id_notes = _join_changed_ids_and_note(merged, local_map)
    return joined_remotes, (*notes, *id_notes)


def remote_station_to_measurements(
    remote: RemoteSignal, rows: Int64Array, local_map: LocalMap | None, senders: Senders = "plain"
) -> list[Measurements]:
    """Convert the messages of one station to measurements of its motion.

    Args:
        rows: Indices of the station's messages, in stamp order.
        local_map: The map frame; None where the signal is Cartesian.
        senders: How senders of BSMs filtered their motion, see `EstimatorConfig`.
    """
    if local_map is None:
        assert remote.x_m is not None
        assert remote.y_m is not None
        x_m, y_m = remote.x_m[rows], remote.y_m[rows]
    else:
        x_m, y_m, _ = local_map.map_from_wgs84(
            remote.latitude_deg[rows], remote.longitude_deg[rows], remote.altitude_m[rows]
        )
    stamp_ns, log_ns = remote.stamp_ns[rows], remote.log_time_ns[rows]
    covariance = _unpack_symmetric_2x2(remote.position_covariance_m2[rows])
    heading, accel, gain = remote.heading_rad[rows], remote.accel_mps2[rows], np.ones(len(rows))
    if senders == "j2945" and np.isfinite(remote.message_count[rows]).all():  # a CAM counts no messages
        heading = np.where(repeated_heading_at_standstill_mask(heading, remote.speed_mps[rows]), np.nan, heading)
        accel, gain = undo_low_pass_filter_and_noise_gain((stamp_ns - stamp_ns[0]) / NS_PER_S, accel)
    return [
        Measurements(
            remote.source, Kind.POSITION, stamp_ns, np.column_stack([x_m, y_m]), covariance, log_ns, remote.is_exact
        ),
        *_columns_to_measurements(
            remote,
            stamp_ns,
            log_ns,
            {
                Kind.SPEED: (remote.speed_mps[rows], remote.speed_sigma_mps[rows] ** 2),
                Kind.HEADING: (heading, remote.heading_sigma_rad[rows] ** 2),
                Kind.ACCEL: (accel, (gain * remote.accel_sigma_mps2[rows]) ** 2),
                Kind.YAW_RATE: (remote.yaw_rate_radps[rows], remote.yaw_rate_sigma_radps[rows] ** 2),
            },
        ),
    ]


def _pose_to_measurements(pose: PoseSignal) -> list[Measurements]:
    """Return position and heading. The twist of an odometry has another role (ego speed), so that it counts once."""
    values = np.column_stack([pose.x_m, pose.y_m])
    variance = pose.yaw_variance_rad2
    if variance is None:
        variance = np.full(len(pose.stamp_ns), np.nan)
    return [
        Measurements(
            pose.source,
            Kind.POSITION,
            pose.stamp_ns,
            values,
            _unpack_symmetric_2x2(pose.covariance_m2),
            pose.log_time_ns,
            pose.is_exact,
        ),
        *_columns_to_measurements(pose, pose.stamp_ns, pose.log_time_ns, {Kind.HEADING: (pose.yaw_rad, variance)}),
    ]


def _columns_to_measurements(
    signal: Signal,
    stamp_ns: Int64Array,
    log_ns: Int64Array,
    values_and_variances_by_kind: Mapping[Kind, tuple[FloatArray, FloatArray]],
) -> list[Measurements]:
    """Convert columns (values, variances) by kind to measurements; rows without a finite value are left out."""
    found = []
    is_exact = isinstance(signal, PoseSignal | SpeedSignal | RemoteSignal) and signal.is_exact
    for kind, (values, variances) in values_and_variances_by_kind.items():
        is_finite = np.isfinite(values)
        if is_finite.any():
            times = stamp_ns[is_finite], log_ns[is_finite]
            found.append(
                Measurements(signal.source, kind, times[0], values[is_finite], variances[is_finite], times[1], is_exact)
            )
    return found


def _unpack_symmetric_2x2(xx_xy_yy: FloatArray) -> FloatArray:
    """Convert (n, 3) columns xx, xy, yy to (n, 2, 2) matrices."""
    return xx_xy_yy[:, [0, 1, 1, 2]].reshape(-1, 2, 2)


def ego_output_stamps_ns(measurements: Sequence[Measurements], rate_hz: float, max_bridge_s: float) -> Int64Array:
    """Return the stamps (ns) of the ego's states: from its first position to its last measurement, at the given rate.

    Where nothing is measured for longer than `max_bridge_s`, recording was interrupted and there are no states.

    Raises:
        DataError: The span is so long that a stamp must be wrong.
    """
    first_ns, last_ns = int(measurements[0].stamp_ns[0]), int(measurements[0].stamp_ns[-1])
    last_ns = max(int(m.stamp_ns[-1]) for m in measurements if len(m) and int(m.stamp_ns[0]) <= last_ns)
    step_ns = round(NS_PER_S / rate_hz)
    n = (last_ns - first_ns) // step_ns + 1
    if n > MAX_EGO_STATES:
        raise DataError(
            f"the measurements span {(last_ns - first_ns) / NS_PER_S:.0f} s, {n} states at {rate_hz:g} Hz",
            where=measurements[0].source,
            hint="check the stamps with `cwcli info`, use --clock log, or cut with --start and --end",
        )
    grid_ns = np.asarray(first_ns + step_ns * np.arange(n), dtype=np.int64)
    measured_ns = sort_distinct_values(np.concatenate([m.stamp_ns for m in measurements]))
    for k in np.flatnonzero(np.diff(measured_ns) > max_bridge_s * NS_PER_S):
        grid_ns = grid_ns[(grid_ns <= measured_ns[k]) | (grid_ns >= measured_ns[k + 1])]
    return grid_ns


def _join_changed_ids_and_note(
    signal: RemoteSignal, local_map: LocalMap | None
) -> tuple[RemoteSignal, tuple[str, ...]]:
    """Join the ids of vehicles that changed their id; returns the signal and notes."""
    found = join_changed_station_ids(signal, local_map)
    notes = []
    if found.joined:
        pairs = ", ".join(f"{one} became {other}" for one, other in found.joined[:MAX_LISTED_ID_CHANGES])
        more = ", ..." if len(found.joined) > MAX_LISTED_ID_CHANGES else ""
        notes.append(f"changed ids joined by motion: {len(found.joined)} ({pairs}{more})")
    if found.n_undecided:
        notes.append(f"changed ids not joined, because more than one new id could follow: {found.n_undecided}")
    return found.signal, tuple(notes)
