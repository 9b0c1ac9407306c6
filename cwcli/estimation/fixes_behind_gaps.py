"""Fixes that come back beside the place to which the other sources led: a receiver with another datum since then.

The gate believes any fix after a long silence, because dead reckoning may be wrong in ways that its covariance does not
hold. Mostly it does hold them, and then a fix many sigmas away shows that one side errs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cwcli.estimation.contradiction import Contradiction, SourceQuantity
from cwcli.estimation.limit_check import quantity_compared_with
from cwcli.estimation.measurements import Kind
from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.result import SourceReport
from cwcli.kernels.ekf import UpdateStatus
from cwcli.signals.columns import FloatArray

MIN_TIME_WITHOUT_FIX_S = 5.0
"""Least time without a fix, s. Chosen by hand: behind shorter ones the gate still tells a jump by itself."""
MIN_NIS_OF_FIX_BEHIND_GAP = 25.0
"""Least normalised innovation squared of the fix that ends a gap. Chosen: 5 sigmas, as two in 10^6 by chance; behind 20
s without fixes it is at most 7.2 (the scenarios `city`, `city-coarse` and `phone`, and KITTI)."""
MIN_DISTANCE_OF_FIX_BEHIND_GAP_M = 3.3
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
    fixes = [i for i, s in enumerate(series) if s.kind is Kind.POSITION and (status[i] >= UpdateStatus.USED).any()]
    if len(fixes) != 1:
        return []
    s, found = series[fixes[0]], nis[fixes[0]]
    back = np.flatnonzero(status[fixes[0]] >= UpdateStatus.USED)
    back = back[back > 0]
    gap_s = s.time_s[back] - s.time_s[back - 1]  # where fixes are rejected instead, the gate tells it
    distance_m = np.sqrt(s.n_values_per_row * found[back, 1])
    is_far = (
        (gap_s > MIN_TIME_WITHOUT_FIX_S)
        & (found[back, 0] > MIN_NIS_OF_FIX_BEHIND_GAP)
        & (distance_m > MIN_DISTANCE_OF_FIX_BEHIND_GAP_M)
    )
    if not is_far.any():
        return []
    k = int(np.argmax(np.where(is_far, found[back, 0], 0.0)))
    what = (
        f"after {gap_s[k]:.0f} s without fixes they are {distance_m[k]:.1f} m from where the other sources led, "
        f"{found[back[k], 0] ** 0.5:.0f} sigmas (at {s.time_s[back[k]]:.1f} s)"
    )
    against = quantity_compared_with(reports[fixes[0]], reports)
    return [Contradiction(SourceQuantity(s.source, s.kind), against, what, explains_misfits=True)]
