"""Values of a signal at other times; times in a gap get NaN."""

from __future__ import annotations

from bisect import bisect_left
from typing import Literal

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.angles import wrap_angle
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.units import NS_PER_S

Method = Literal["linear", "previous", "nearest"]
MAX_INTERPOLATED_STATE_GAP_S = 0.5
"""Longest gap between two states of a vehicle, in seconds, over which it is interpolated. Chosen by hand."""
MAX_TIME_TO_INTERPOLATED_NEIGHBOUR_S = 0.5
"""The largest distance in time to either neighbour, in seconds, across which a value is interpolated. Chosen by hand;
not fitted."""


def interpolate_signal_at_times(
    stamp_ns: Int64Array,
    values: FloatArray,
    at_ns: Int64Array,
    *,
    max_gap_s: float,
    method: Method = "linear",
    is_angle: bool = False,
) -> FloatArray:
    """Interpolate a signal at the times `at_ns`.

    A sample that holds NaN is no sample: it neither counts as a neighbour nor bridges a gap. A time that a sample has
    exactly takes that sample, however wide the gaps beside it.

    Args:
        stamp_ns: Shape (n,), non-decreasing; of samples with one stamp the last one counts.
        values: Shape (n,) or (n, k).
        at_ns: Shape (m,), in any order.
        max_gap_s: `linear`: largest distance between the two neighbours. `previous`: greatest age of the sample.
            `nearest`: largest distance to the sample.
        method: See above. Beyond the first and last sample `linear` is NaN.
        is_angle: Values are radians: interpolate along the shortest arc, result in (-pi, pi].

    Returns:
        Shape (m,) or (m, k); NaN where the signal does not cover the time.
    """
    samples = np.asarray(values, dtype=np.float64)
    if samples.ndim == 2 and not (method == "linear" and len(samples) and np.isfinite(samples).all()):
        columns = [
            interpolate_signal_at_times(
                stamp_ns, samples[:, i], at_ns, max_gap_s=max_gap_s, method=method, is_angle=is_angle
            )
            for i in range(samples.shape[1])
        ]
        return np.stack(columns, axis=1) if columns else np.zeros((len(at_ns), 0))
    is_sample = np.isfinite(samples) if samples.ndim == 1 else slice(None)  # columns that lack nothing share their rows
    stamps, samples = np.asarray(stamp_ns, dtype=np.int64)[is_sample], samples[is_sample]
    if not len(stamps):
        return np.full(len(at_ns), np.nan)
    max_gap_ns = float(np.rint(max_gap_s * NS_PER_S))
    after = np.searchsorted(stamps, at_ns, side="right")
    before = after - 1
    if method == "previous":
        index, distance_ns = (
            _clip_to_neighbour_indices(before, stamps),
            at_ns - stamps[_clip_to_neighbour_indices(before, stamps)],
        )
        result = np.where((before >= 0) & (distance_ns <= max_gap_ns), samples[index], np.nan)
    elif method == "nearest":
        index = _nearest_sample_indices(stamps, at_ns, before)
        result = np.where(np.abs(at_ns - stamps[index]) <= max_gap_ns, samples[index], np.nan)
    else:
        result = _interpolate_linearly(stamps, samples, at_ns, before, max_gap_ns, is_angle=is_angle)
    return wrap_angle(result) if is_angle else result


def _interpolate_linearly(
    stamps: Int64Array,
    samples: FloatArray,
    at_ns: Int64Array,
    index_before: npt.NDArray[np.intp],
    max_gap_ns: float,
    *,
    is_angle: bool,
) -> FloatArray:
    left, right = _clip_to_neighbour_indices(index_before, stamps), _clip_to_neighbour_indices(index_before + 1, stamps)
    gap_ns = stamps[right] - stamps[left]
    since_ns = at_ns - stamps[left]
    is_exact = (index_before >= 0) & (since_ns == 0)
    is_between = (index_before >= 0) & (index_before + 1 < len(stamps)) & (gap_ns <= max_gap_ns)
    change = samples[right] - samples[left]
    if is_angle:
        change = wrap_angle(change)
    fraction = since_ns / np.where(gap_ns == 0, 1, gap_ns)
    if samples.ndim == 2:
        fraction, is_exact, is_between = fraction[:, None], is_exact[:, None], is_between[:, None]
    between = samples[left] + fraction * change
    return np.where(is_exact, samples[left], np.where(is_between, between, np.nan))


def _nearest_sample_indices(
    stamps: Int64Array, at_ns: Int64Array, index_before: npt.NDArray[np.intp]
) -> npt.NDArray[np.intp]:
    left, right = _clip_to_neighbour_indices(index_before, stamps), _clip_to_neighbour_indices(index_before + 1, stamps)
    return np.where(np.abs(stamps[right] - at_ns) < np.abs(at_ns - stamps[left]), right, left)


def _clip_to_neighbour_indices(index: npt.NDArray[np.intp], stamps: Int64Array) -> npt.NDArray[np.intp]:
    return np.clip(index, 0, len(stamps) - 1)


@dataclass(frozen=True)
class Series:
    """Values at increasing stamps; empty where the log has none."""

    stamp_ns: Int64Array
    values: FloatArray

    def linear_value_at_time_or_nan(self, stamp_ns: int) -> float:
        """Return the value at a time, linear between two samples that are both near; NaN elsewhere."""
        if not len(self.stamp_ns):
            return float("nan")
        i = bisect_left(self.stamp_ns, stamp_ns)  # not NumPy's, which waits for the decoding threads each time
        if i < len(self.stamp_ns) and self.stamp_ns[i] == stamp_ns:
            return float(self.values[i])
        if i == 0 or i == len(self.stamp_ns):
            return float("nan")
        before, after = int(self.stamp_ns[i - 1]), int(self.stamp_ns[i])
        if max(stamp_ns - before, after - stamp_ns) > MAX_TIME_TO_INTERPOLATED_NEIGHBOUR_S * NS_PER_S:
            return float("nan")
        part = (stamp_ns - before) / (after - before)
        return float((1.0 - part) * self.values[i - 1] + part * self.values[i])
