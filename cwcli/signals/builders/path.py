"""Paths that another system plans or predicts for the ego: `Trajectory` and `Path`."""

from __future__ import annotations

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.builders.base import Reading
from cwcli.signals.canonical import TimedRows
from cwcli.signals.clocks import repair_and_order_times
from cwcli.signals.columns import Columns, FloatArray, Int64Array
from cwcli.signals.elements import Elements, offsets_and_indices_of_selected_sequences
from cwcli.signals.leaf_fields import read_frame_id, read_stamps
from cwcli.signals.limits import MAX_COORDINATE_M, MAX_SPEED_MPS, NOT_FINITE_REASON, OUT_OF_RANGE_REASON
from cwcli.signals.quality import Quality, RowLedger
from cwcli.signals.units import NS_PER_S, S_PER_NS


@dataclass(frozen=True)
class PathSignal(TimedRows):
    """Paths of the ego, one a message.

    Attributes:
        frame_id: The frame that the messages name.
        offsets: Shape (n + 1,): path k has the points `offsets[k]:offsets[k + 1]`, two at least.
        time_s: One value a point: from the stamp of its path; NaN in all points of a path whose times do not increase.
        x_m, y_m: One value a point, in `frame_id`.
        speed_mps: One value a point; NaN where not given.
    """

    frame_id: str
    offsets: Int64Array
    time_s: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    speed_mps: FloatArray


def build_trajectory(columns: Columns, reading: Reading) -> tuple[PathSignal, Quality]:
    """Build paths from Autoware's `Trajectory`. Its planners may leave all times 0: then speeds alone are known."""
    ledger = RowLedger(columns, reading.role)
    points = Elements(columns, ledger, "points.pose.position.x", "points.pose.position.y")
    start = "points.time_from_start"
    time_s = points.read_numbers(f"{start}.sec") + S_PER_NS * points.read_numbers(f"{start}.nanosec", f"{start}.nsec")
    speed_mps = points.read_numbers("points.longitudinal_velocity_mps")
    return _make_path_signal(columns, reading, ledger, points, "points.pose.position", time_s, speed_mps)


def build_path(columns: Columns, reading: Reading) -> tuple[PathSignal, Quality]:
    """Build paths from `nav_msgs/Path`, whose poses may have stamps."""
    ledger = RowLedger(columns, reading.role)
    points = Elements(columns, ledger, "poses.pose.position.x", "poses.pose.position.y")
    stamp = "poses.header.stamp"
    seconds = points.read_numbers(f"{stamp}.sec", f"{stamp}.secs")
    nanoseconds = points.read_numbers(f"{stamp}.nanosec", f"{stamp}.nsec", f"{stamp}.nsecs")
    begin_ns, has_stamp = read_stamps(columns)
    whole_s, rest_ns = np.divmod(np.where(has_stamp, begin_ns, 0), NS_PER_S)
    begin_s, begin_rest_ns = (np.repeat(each.astype(np.float64), points.counts) for each in (whole_s, rest_ns))
    time_s = (seconds - begin_s) + S_PER_NS * (nanoseconds - begin_rest_ns)
    time_s[~np.repeat(has_stamp, points.counts)] = np.nan
    nothing = np.full(len(points), np.nan)
    return _make_path_signal(columns, reading, ledger, points, "poses.pose.position", time_s, nothing)


def _make_path_signal(
    columns: Columns,
    reading: Reading,
    ledger: RowLedger,
    points: Elements,
    position: str,
    time_s: FloatArray,
    speed_mps: FloatArray,
) -> tuple[PathSignal, Quality]:
    x_m, y_m = points.read_numbers(f"{position}.x"), points.read_numbers(f"{position}.y")
    ledger.reject(points.counts < 2, "fewer than two points")
    with np.errstate(invalid="ignore"):
        ledger.reject(points.sum_per_message((~np.isfinite(x_m + y_m)).astype(np.float64)) > 0, NOT_FINITE_REASON)
        is_far = (np.abs(x_m) > MAX_COORDINATE_M) | (np.abs(y_m) > MAX_COORDINATE_M)
        ledger.reject(points.sum_per_message(is_far.astype(np.float64)) > 0, OUT_OF_RANGE_REASON)
        speed_mps = np.where(np.abs(speed_mps) <= MAX_SPEED_MPS, speed_mps, np.nan)
    marks = [
        points.counts.astype(np.float64),
        points.sum_per_message(np.nan_to_num(x_m)),
        points.sum_per_message(np.nan_to_num(y_m)),
    ]
    timeline = repair_and_order_times(ledger, *read_stamps(columns), reading.clock, marks)
    offsets, index = offsets_and_indices_of_selected_sequences(points.offsets, timeline.rows)
    signal = PathSignal(
        source=columns.topic,
        frame_id=read_frame_id(columns),
        stamp_ns=timeline.stamp_ns,
        log_time_ns=columns.log_time_ns[timeline.rows],
        offsets=offsets,
        time_s=_nan_unless_times_increase(offsets, time_s[index]),
        x_m=x_m[index],
        y_m=y_m[index],
        speed_mps=speed_mps[index],
    )
    return signal, ledger.quality


def _nan_unless_times_increase(offsets: Int64Array, time_s: FloatArray) -> FloatArray:
    """Return the times of the points, NaN in paths in which they do not increase."""
    owner = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
    with np.errstate(invalid="ignore"):
        is_back = (np.diff(owner) == 0) & ~(np.diff(time_s) > 0.0)
    bad = np.zeros(len(offsets) - 1, np.bool_)
    bad[owner[1:][is_back]] = True
    return np.where(bad[owner] | ~np.isfinite(time_s), np.nan, time_s)
