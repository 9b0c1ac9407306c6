"""`cwcli.v1.LateralState`: the observed lateral motion of the ego, and the truth of it."""

from __future__ import annotations

import numpy as np

from cwcli.channels.output import make_output_channel
from cwcli.channels.published import OBSERVER
from cwcli.dynamics.samples import (
    DEFAULT_PREVIEW_POINT_DISTANCE_M,
    STATE_NAMES,
    FrameStatus,
    LateralTrack,
    count_frame_statuses,
)
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import Columns, Field, FloatArray, Int64Array, OutputChannel
from cwcli.signals.leaf_fields import read_integers, read_matrix, read_numbers, unusable_field_error
from cwcli.signals.resample import interpolate_signal_at_times
from cwcli.signals.row_order import rows_by_stamp_without_repeats

N_LATERAL_STATES = len(STATE_NAMES)
"""Number of states of the lateral observer."""
TRUE_LANE_AHEAD_FIELDS = ("ahead_lateral_deviation_m", "ahead_heading_deviation_rad")
"""Fields of the true lane at several distances ahead."""
LATERAL_TRUTH_FIELDS = ("stamp_ns", *STATE_NAMES, "preview_distance_m", "ahead_m", *TRUE_LANE_AHEAD_FIELDS)
"""Fields that are read from a channel of the lateral truth."""
PREVIEW_MATCH_TOLERANCE_M = 1e-6
"""Greatest difference of two preview distances that count as equal, m. Chosen: rounding errors only."""
PUBLISHED_STATUS_MINUS_FRAME_STATUS = 1
"""Offset from `FrameStatus` to the enum of `cwcli.v1.LateralState`, where 0 means unspecified."""


@dataclass(frozen=True)
class ObservedDrive:
    """An observed drive, in the order of its stamps.

    Attributes:
        log_time_ns: Shape (n,).
        track: n frames.
    """

    log_time_ns: Int64Array
    track: LateralTrack

    def __len__(self) -> int:
        return len(self.track)


def make_observer_channel(observed: ObservedDrive) -> OutputChannel:
    """Make the channel of the observer, one message a frame."""
    track, n = observed.track, len(observed)
    fields: dict[str, Field] = {
        "stamp_ns": track.stamp_ns,
        **{name: track.state[:, k] for k, name in enumerate(STATE_NAMES)},
        "steer_rad": track.steer_rad,
        "speed_mps": track.speed_mps,
        "curvature_1pm": track.curvature_1pm,
        "status": track.status.astype(np.int32) + PUBLISHED_STATUS_MINUS_FRAME_STATUS,
        "covariance": track.covariance.reshape(n, N_LATERAL_STATES**2),
        "mass_kg": track.mass_kg,
        "mass_sigma_kg": track.mass_sigma_kg,
        "preview_distance_m": track.preview_m,
    }
    return make_output_channel(OBSERVER, observed.log_time_ns, fields)


def read_observed_drive(columns: Columns) -> ObservedDrive:
    """Read the channel of the observer. A preview distance of 0 means none was written; then zhang2011's is used.

    Raises:
        DataError: A field is missing, or a status is unknown: another version wrote it.
    """
    stamp_ns, _ = read_integers(columns, "stamp_ns", required=True)
    order = np.argsort(stamp_ns, kind="stable")
    n = len(order)

    def read_numbers_in_order(name: str, *, required: bool = True) -> FloatArray:
        return read_numbers(columns, name, required=required)[order]

    number = read_numbers_in_order("status").astype(np.int64) - PUBLISHED_STATUS_MINUS_FRAME_STATUS
    if n and not np.isin(number, [status.value for status in FrameStatus]).all():
        raise unusable_field_error(columns, "status")
    status = number.astype(np.int8)
    preview_m = read_numbers_in_order("preview_distance_m", required=False)
    track = LateralTrack(
        stamp_ns=stamp_ns[order],
        state=np.column_stack([read_numbers_in_order(name) for name in STATE_NAMES]),
        preview_m=np.where(np.isfinite(preview_m) & (preview_m > 0.0), preview_m, DEFAULT_PREVIEW_POINT_DISTANCE_M),
        covariance=read_matrix(columns, "covariance", N_LATERAL_STATES**2).reshape(
            n, N_LATERAL_STATES, N_LATERAL_STATES
        )[order],
        speed_mps=read_numbers_in_order("speed_mps"),
        steer_rad=read_numbers_in_order("steer_rad"),
        curvature_1pm=read_numbers_in_order("curvature_1pm"),
        mass_kg=read_numbers_in_order("mass_kg"),
        mass_sigma_kg=read_numbers_in_order("mass_sigma_kg", required=False),
        status=status,
        counts=count_frame_statuses(status),
    )
    return ObservedDrive(columns.log_time_ns[order], track)


def read_lateral_truth_stamps_and_states(columns: Columns) -> tuple[Int64Array, FloatArray]:
    """Read stamps (n,), increasing, and states (n, 4) from a channel of the truth; unknown values are NaN.

    Args:
        columns: The channel; its fields `LATERAL_TRUTH_FIELDS` are enough.
    """
    stamp_ns, _ = read_integers(columns, "stamp_ns")
    rows = rows_by_stamp_without_repeats(stamp_ns)
    return stamp_ns[rows], np.column_stack([read_numbers(columns, name)[rows] for name in STATE_NAMES])


def true_lateral_and_heading_deviations_at_preview(
    columns: Columns, at_ns: Int64Array, preview_m: FloatArray, max_gap_s: float
) -> FloatArray:
    """True lateral and heading deviation at an observer's preview points, shape (n, 2) in m and rad; NaN if unknown.

    A channel with the lane ahead is read at every preview distance, another one only at its own.

    Args:
        columns: A channel of the truth.
        at_ns, preview_m: Shape (n,).
        max_gap_s: Longest gap between messages that is interpolated.
    """
    stamp_ns, _ = read_integers(columns, "stamp_ns")
    rows = rows_by_stamp_without_repeats(stamp_ns)
    told_m = read_numbers(columns, "preview_distance_m")
    known_m = told_m[told_m > 0.0]
    own_m = float(known_m[0]) if len(known_m) else DEFAULT_PREVIEW_POINT_DISTANCE_M
    is_own = np.abs(preview_m - own_m) <= PREVIEW_MATCH_TOLERANCE_M
    deviations = np.full((len(at_ns), len(TRUE_LANE_AHEAD_FIELDS)), np.nan)
    ahead_m = read_matrix(columns, "ahead_m")
    has_ahead = ahead_m.shape[1] > 1 and bool((ahead_m == ahead_m[:1]).all() and (np.diff(ahead_m[0]) > 0.0).all())
    for k, name in enumerate(TRUE_LANE_AHEAD_FIELDS):
        own = interpolate_signal_at_times(
            stamp_ns[rows], read_numbers(columns, STATE_NAMES[-2:][k])[rows], at_ns, max_gap_s=max_gap_s
        )
        deviations[is_own, k] = own[is_own]
        if has_ahead:
            lane = read_matrix(columns, name, ahead_m.shape[1])[rows]
            lane = interpolate_signal_at_times(stamp_ns[rows], lane, at_ns, max_gap_s=max_gap_s)
            for row in np.flatnonzero(~is_own):
                deviations[row, k] = np.interp(preview_m[row], ahead_m[0], lane[row], left=np.nan, right=np.nan)
    return deviations
