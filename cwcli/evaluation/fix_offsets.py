"""How far an estimated track lies beside the fixes that it was made from."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np

from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.result import SourceReport, Track
from cwcli.evaluation.doubts.fixes import (
    FIX_OFFSETS_RECORD_KEY,
    MAX_UNDOUBTED_OFFSET_SIGMAS,
    MIN_DOUBTED_OFFSET_M,
    MIN_LASTING_OFFSET_S,
)
from cwcli.signals.columns import FloatArray, median_of_values
from cwcli.signals.resample import MAX_INTERPOLATED_STATE_GAP_S, interpolate_signal_at_times
from cwcli.signals.units import NS_PER_S

MAD_TO_SIGMA = 1.0 / 0.6745
"""Standard deviation per median absolute deviation of a normal distribution."""
SECOND_DIFFERENCE_SIGMA_RATIO = 6.0**0.5
"""Standard deviation of the second difference of white noise (1, -2, 1) per its own."""


def fix_offsets_to_record_entry(measurements: Sequence[Measurements], ego: Track) -> dict[str, str]:
    """Return the entry of the record with the largest lasting offset of the track from each source of positions."""
    found = []
    for each in measurements:
        report = next((s for s in ego.sources if s.source == each.source and s.kind is Kind.POSITION), None)
        if each.kind is Kind.POSITION and report is not None:
            found += _largest_lasting_offset_as_document(each, report, ego)
    return {FIX_OFFSETS_RECORD_KEY: json.dumps(found)}


def _largest_lasting_offset_as_document(
    fixes: Measurements, report: SourceReport, ego: Track
) -> list[dict[str, object]]:
    """Return the offset with its sigma; [] with fewer than three fixes beside states.

    The sigma is that of the track and of the fixes' scatter around it, not the one that the fixes state: fixes that
    all lie beside the track are no better explained by a large stated sigma if they hardly scatter.
    """
    latency_s = report.latency.applied_s
    stamp_ns = fixes.stamp_ns - round((latency_s if np.isfinite(latency_s) else 0.0) * NS_PER_S)
    order = np.argsort(stamp_ns, kind="stable")
    stamp_ns = stamp_ns[order]
    variance = 0.5 * (ego.covariance[:, 0, 0] + ego.covariance[:, 1, 1])
    track_at_fixes = interpolate_signal_at_times(
        ego.stamp_ns, np.column_stack([ego.state[:, :2], variance]), stamp_ns, max_gap_s=MAX_INTERPOLATED_STATE_GAP_S
    )
    offset = fixes.values[order] - track_at_fixes[:, :2]
    known = np.isfinite(offset).all(axis=1)
    stamp_ns, offset, variance = stamp_ns[known], offset[known], track_at_fixes[known, 2]
    if len(stamp_ns) < 3:
        return []
    distance_m = least_value_in_window_from_each_row(
        stamp_ns / NS_PER_S - stamp_ns[0] / NS_PER_S, np.hypot(*offset.T), MIN_LASTING_OFFSET_S
    )
    scatter_m = MAD_TO_SIGMA * median_of_values(np.abs(np.diff(offset, 2, axis=0))) / SECOND_DIFFERENCE_SIGMA_RATIO
    sigma_m = np.sqrt(np.maximum(variance, 0.0) + scatter_m**2)
    doubted = (distance_m > MIN_DOUBTED_OFFSET_M) & (distance_m > MAX_UNDOUBTED_OFFSET_SIGMAS * sigma_m)
    at = int(np.where(doubted, distance_m, -1.0).argmax() if doubted.any() else distance_m.argmax())
    return [
        {
            "source": fixes.source,
            "quantity": "position",
            "offset_m": float(distance_m[at]),
            "sigma_m": float(sigma_m[at]),
            "stamp_ns": int(stamp_ns[at]),
        }
    ]


def least_value_in_window_from_each_row(time_s: FloatArray, values: FloatArray, window_s: float) -> FloatArray:
    """Return, for each window that begins at a row and is whole, the least value in it, (n,); 0 where it is not whole.

    Args:
        time_s: Shape (n,), increasing.
        values: Shape (n,).
        window_s: Length of the window. One that holds fewer than two rows is not whole.
    """
    n = len(time_s)
    stop = np.searchsorted(time_s, time_s + window_s)  # the first row behind the window
    out = np.zeros(n)
    whole = np.flatnonzero((stop < n) & (stop - np.arange(n) >= 2))
    if len(whole):
        edges = np.column_stack([whole, stop[whole]]).ravel()
        out[whole] = np.minimum.reduceat(values, edges)[::2]
    return out
