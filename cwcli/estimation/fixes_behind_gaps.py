"""Fixes that come back beside the place to which the other sources led: a receiver with another datum since then.

The gate believes any fix after a long silence, because dead reckoning may be wrong in ways that its covariance does not
hold. Mostly it does hold them, and then a fix many sigmas away shows that one side errs. A smaller jump stays hidden:
the verdict excepts it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cwcli.estimation.contradiction import Contradiction, SourceQuantity
from cwcli.estimation.limit_check import reference_quantity_of_comparison
from cwcli.estimation.measurements import Kind
from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.result import SourceReport
from cwcli.kernels.ekf import UpdateStatus
from cwcli.lazy_dataclass import replace
from cwcli.signals.columns import FloatArray

MIN_TIME_WITHOUT_FIX_S = 5.0
"""Least time without a fix, s. Chosen by hand: behind shorter ones the gate still tells a jump by itself."""
MIN_NIS_OF_FIX_BEHIND_GAP = 25.0
"""Least normalised innovation squared of the fix that ends a gap. Chosen: 5 sigmas, as two in 10^6 by chance; behind 20
s without fixes it is at most 7.2 (the scenarios `city`, `city-coarse` and `phone`, and KITTI)."""
MIN_DISTANCE_FROM_PREDICTION_OF_FIX_BEHIND_GAP_M = 3.3
"""Least distance, m: one sigma of the GPS Standard Positioning Service (2020; 8 m in 95 %), as for jumping fixes."""


def find_contradictions_of_fixes_behind_gaps(
    series: Sequence[SensorSeries],
    nis: Sequence[FloatArray],
    status: Sequence[npt.NDArray[np.int8]],
    reports: Sequence[SourceReport],
) -> list[Contradiction]:
    """Return a contradiction for the only source of fixes, if one that ends a gap is far from the place expected.

    Args:
        series: The series.
        nis, status: Of the filter's rows, see `passes.PassResult`.
        reports: Of the series.
    """
    behind = _fixes_behind_gaps(series, nis, status)
    if behind is None:
        return []
    i, gap_s, time_s, found_nis, distance_m = behind
    is_far = (found_nis > MIN_NIS_OF_FIX_BEHIND_GAP) & (distance_m > MIN_DISTANCE_FROM_PREDICTION_OF_FIX_BEHIND_GAP_M)
    if not is_far.any():
        return []
    k = int(np.argmax(np.where(is_far, found_nis, 0.0)))
    what = (
        f"after {gap_s[k]:.0f} s without fixes they are {distance_m[k]:.1f} m from where the other sources led, "
        f"{found_nis[k] ** 0.5:.0f} sigmas (at {time_s[k]:.1f} s)"
    )
    who = SourceQuantity(reports[i].source, reports[i].kind)
    return [Contradiction(who, reference_quantity_of_comparison(reports[i], reports), what, explains_misfits=True)]


def add_jumps_hidden_by_gaps(
    series: Sequence[SensorSeries],
    nis: Sequence[FloatArray],
    status: Sequence[npt.NDArray[np.int8]],
    reports: Sequence[SourceReport],
) -> tuple[SourceReport, ...]:
    """Return the reports, that of the only fixes with the jump behind a gap that would not show; arguments as above."""
    behind = _fixes_behind_gaps(series, nis, status)
    if behind is None:
        return tuple(reports)
    i, gap_s, _, found_nis, distance_m = behind
    sigma_m = distance_m / np.sqrt(np.maximum(found_nis, 1e-9))
    hidden_m = np.maximum(MIN_NIS_OF_FIX_BEHIND_GAP**0.5 * sigma_m, MIN_DISTANCE_FROM_PREDICTION_OF_FIX_BEHIND_GAP_M)
    k = int(np.argmax(hidden_m))
    jump = float(gap_s[k]), float(hidden_m[k])
    return tuple(replace(r, gap_s_and_hidden_jump_m=jump) if j == i else r for j, r in enumerate(reports))


def _fixes_behind_gaps(
    series: Sequence[SensorSeries], nis: Sequence[FloatArray], status: Sequence[npt.NDArray[np.int8]]
) -> tuple[int, FloatArray, FloatArray, FloatArray, FloatArray] | None:
    """Return the index of the only fixes, and of each that ends a gap: the gap, its time (s), NIS and distance (m)."""
    fixes = [i for i, s in enumerate(series) if s.kind is Kind.POSITION and (status[i] >= UpdateStatus.USED).any()]
    if len(fixes) != 1:
        return None
    s, found = series[fixes[0]], nis[fixes[0]]
    rows = np.flatnonzero(np.diff(s.time_s) > MIN_TIME_WITHOUT_FIX_S) + 1
    rows = rows[status[fixes[0]][rows] >= UpdateStatus.USED]  # where fixes are rejected instead, the gate tells it
    if not len(rows):
        return None
    gap_s = s.time_s[rows] - s.time_s[rows - 1]
    return fixes[0], gap_s, s.time_s[rows], found[rows, 0], np.sqrt(s.n_values_per_row * found[rows, 1])
