"""The true motion of targets: one target's poses, or the states of many by their ids."""

from __future__ import annotations

import numpy as np

from cwcli.signals.builders.base import Reading
from cwcli.signals.builders.pose import build_pose
from cwcli.signals.canonical import TargetTruthSignal
from cwcli.signals.clocks import repair_and_order_times
from cwcli.signals.columns import Columns, FloatArray, repeat_string
from cwcli.signals.leaf_fields import find_field, read_frame_id, read_integers, read_numbers, read_texts
from cwcli.signals.limits import MAX_COORDINATE_M, reject_rows_beyond_limit
from cwcli.signals.quality import Quality, RowLedger
from cwcli.signals.vehicle_state import MAP_FRAME

ID_OF_TARGET_WHOSE_MESSAGES_GIVE_NO_ID = "1"
"""The id of a target whose messages give none."""


def build_pose_truth(columns: Columns, reading: Reading) -> tuple[TargetTruthSignal, Quality]:
    """Build the truth of one target from poses, with the velocity of their twist; NaN where that is not known."""
    pose, quality = build_pose(columns, reading)
    n = len(pose.stamp_ns)
    assert pose.velocity_mps is not None
    velocity_mps = np.where(np.isfinite(pose.speed_mps)[:, None], pose.velocity_mps, np.nan)
    signal = TargetTruthSignal(
        source=pose.source,
        frame_id=pose.frame_id,
        id=repeat_string(ID_OF_TARGET_WHOSE_MESSAGES_GIVE_NO_ID, n),
        stamp_ns=pose.stamp_ns,
        log_time_ns=pose.log_time_ns,
        x_m=pose.x_m,
        y_m=pose.y_m,
        vx_mps=velocity_mps[:, 0],
        vy_mps=velocity_mps[:, 1],
    )
    return signal, quality


def build_target_truth(columns: Columns, reading: Reading) -> tuple[TargetTruthSignal, Quality]:
    """Build the truth of any number of targets from `cwcli.v1.Target`."""
    return _make_target_truth_signal(
        columns, reading, read_numbers(columns, "vx_mps"), read_numbers(columns, "vy_mps"), read_frame_id(columns)
    )


def build_state_truth(columns: Columns, reading: Reading) -> tuple[TargetTruthSignal, Quality]:
    """Build the truth of any number of targets from `cwcli.v1.VehicleState` (frame `map`)."""
    speed_mps, heading_rad = read_numbers(columns, "speed_mps"), read_numbers(columns, "heading_rad")
    vx_mps, vy_mps = speed_mps * np.cos(heading_rad), speed_mps * np.sin(heading_rad)
    return _make_target_truth_signal(columns, reading, vx_mps, vy_mps, MAP_FRAME)


def _make_target_truth_signal(
    columns: Columns, reading: Reading, vx_mps: FloatArray, vy_mps: FloatArray, frame: str
) -> tuple[TargetTruthSignal, Quality]:
    ledger = RowLedger(columns, reading.role)
    x_m, y_m = read_numbers(columns, "x_m"), read_numbers(columns, "y_m")
    reject_rows_beyond_limit(ledger, np.stack([x_m, y_m], axis=1), MAX_COORDINATE_M)
    ids = read_texts(columns, "id") or repeat_string(ID_OF_TARGET_WHOSE_MESSAGES_GIVE_NO_ID, len(columns))
    stamp_ns, has_stamp = read_integers(columns, "stamp_ns")
    has_stamp &= stamp_ns > 0
    timeline = repair_and_order_times(ledger, stamp_ns, has_stamp, reading.clock, [x_m, y_m], sender=ids.codes)
    rows = timeline.rows
    has_place = find_field(columns, "latitude_deg") is not None
    signal = TargetTruthSignal(
        source=columns.topic,
        frame_id=frame,
        id=ids.select_rows(rows),
        stamp_ns=timeline.stamp_ns,
        log_time_ns=columns.log_time_ns[rows],
        x_m=x_m[rows],
        y_m=y_m[rows],
        vx_mps=vx_mps[rows],
        vy_mps=vy_mps[rows],
        latitude_deg=read_numbers(columns, "latitude_deg")[rows] if has_place else None,
        longitude_deg=read_numbers(columns, "longitude_deg")[rows] if has_place else None,
    )
    return signal, ledger.quality
