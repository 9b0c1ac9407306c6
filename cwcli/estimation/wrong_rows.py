"""Set rows aside that are wrong although the rest of their source is right, and count them."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
import numpy.typing as npt

from cwcli.estimation.contradiction import SourceQuantity
from cwcli.estimation.correction import Correction
from cwcli.estimation.fix_scatter import scatter_about_neighbours
from cwcli.estimation.frozen_rows import FixMotion, frozen_row_mask
from cwcli.estimation.jumping_fixes import fixes_jumped_away_mask
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.prepare import earliest_stamp_ns, seconds_since_zero_time
from cwcli.estimation.source_checks import MIN_ROWS_OF_COMPARED_SOURCE
from cwcli.estimation.standstill_heading import has_heading_jumps, heading_flipped_at_standstill_mask
from cwcli.lazy_dataclass import replace
from cwcli.signals.columns import FloatArray

STANDSTILL_CHECK_WINDOW_S = 2.0
"""Time in s over which the fixes show whether the car stands. Chosen by hand."""


def set_wrong_rows_aside_and_list_them(
    measurements: Sequence[Measurements], trusted: Collection[str]
) -> tuple[list[Measurements], list[Correction]]:
    """Return the measurements without rows that are wrong, and what was set aside.

    These are rows that are stuck, fixes that jump away and back, and headings that are turned round at standstill.
    """
    zero_ns = earliest_stamp_ns(measurements)
    fixes = _motion_of_first_position_source(measurements, zero_ns)
    corrected: list[Measurements] = []
    corrections: list[Correction] = []
    for m in measurements:
        remaining = m
        if m.source not in trusted and len(m) >= MIN_ROWS_OF_COMPARED_SOURCE and not m.is_exact:
            rows = np.flatnonzero(np.isfinite(m.values).all(axis=1))
            rows = rows[np.argsort(m.stamp_ns[rows], kind="stable")]
            time_s, values = seconds_since_zero_time(m.stamp_ns[rows], zero_ns), m.values[rows]
            frozen = frozen_row_mask(m.kind, time_s, values, fixes)
            if frozen.any():
                remaining = _mark_rows_not_measured(remaining, rows[frozen])
                what = "repeats one value for long, as a sensor that is stuck or saturated"
                corrections.append(_correction_of_rows_set_aside(m, "stuck", what, frozen, time_s))
            if m.kind is Kind.POSITION:
                jumped = np.zeros(len(rows), np.bool_)
                moving_s, moving = time_s[~frozen], values[~frozen]
                jumped[~frozen] = fixes_jumped_away_mask(
                    moving_s, moving, max(scatter_about_neighbours(moving[:, k : k + 1]) for k in (0, 1))
                )
                if jumped.any():
                    remaining = _mark_rows_not_measured(remaining, rows[jumped])
                    what = "jumps away and back, as no car does"
                    corrections.append(_correction_of_rows_set_aside(m, "jump", what, jumped, time_s))
            if m.kind is Kind.HEADING and has_heading_jumps(time_s, values[:, 0]):
                flipped = heading_flipped_at_standstill_mask(
                    time_s, values[:, 0], _absolute_speed_at_mps(time_s, measurements, fixes, zero_ns)
                )
                flipped &= ~frozen  # no row is set aside twice
                rest = ~(flipped | frozen)
                if flipped.any() and not has_heading_jumps(time_s[rest], values[rest, 0]):
                    remaining = _mark_rows_not_measured(remaining, rows[flipped])
                    what = "is reversed while the car stands"
                    corrections.append(_correction_of_rows_set_aside(m, "standstill", what, flipped, time_s))
        corrected.append(remaining)
    return corrected, corrections


def _mark_rows_not_measured(m: Measurements, rows: npt.NDArray[np.intp]) -> Measurements:
    """Return the measurements with rows that count as not measured."""
    values = m.values.copy()
    values[rows] = np.nan
    return replace(m, values=values)


def _correction_of_rows_set_aside(
    m: Measurements, name: str, fault: str, mask: npt.NDArray[np.bool_], time_s: FloatArray
) -> Correction:
    n, first_s = int(mask.sum()), float(time_s[int(np.argmax(mask))])
    return Correction(
        SourceQuantity(m.source, m.kind),
        name,
        fault,
        f"{n} rows set aside",
        f"the first at {first_s:.1f} s",
        n_set_aside=n,
    )


def _motion_of_first_position_source(measurements: Sequence[Measurements], zero_ns: int) -> FixMotion:
    m = next(m for m in measurements if m.kind is Kind.POSITION)
    rows = np.flatnonzero(np.isfinite(m.values).all(axis=1))
    rows = rows[np.argsort(m.stamp_ns[rows], kind="stable")]
    return FixMotion(seconds_since_zero_time(m.stamp_ns[rows], zero_ns), m.values[rows])


def _absolute_speed_at_mps(
    time_s: FloatArray, measurements: Sequence[Measurements], fixes: FixMotion, zero_ns: int
) -> FloatArray:
    """Return the absolute speed (n,) at times by a wheel speed, else by the fixes smoothed over
    STANDSTILL_CHECK_WINDOW_S."""
    for m in measurements:
        rows = np.flatnonzero(np.isfinite(m.values).all(axis=1))
        if m.kind is Kind.SPEED and len(rows) >= MIN_ROWS_OF_COMPARED_SOURCE:
            rows = rows[np.argsort(m.stamp_ns[rows], kind="stable")]
            return np.asarray(
                np.abs(np.interp(time_s, seconds_since_zero_time(m.stamp_ns[rows], zero_ns), m.values[rows, 0]))
            )
    if len(fixes.time_s) < MIN_ROWS_OF_COMPARED_SOURCE:
        return np.full(len(time_s), np.nan)
    edges_s = np.arange(fixes.time_s[0], fixes.time_s[-1] + STANDSTILL_CHECK_WINDOW_S, STANDSTILL_CHECK_WINDOW_S)
    row = np.minimum(np.searchsorted(edges_s, fixes.time_s, side="right") - 1, len(edges_s) - 1)
    count = np.bincount(row, minlength=len(edges_s))
    used = np.flatnonzero(count)
    if len(used) < 3:
        return np.full(len(time_s), np.nan)
    mean = np.column_stack([np.bincount(row, column, len(edges_s))[used] / count[used] for column in fixes.values.T])
    middle_s = np.bincount(row, fixes.time_s, len(edges_s))[used] / count[used]
    speed = np.hypot(*np.diff(mean, axis=0).T) / np.diff(middle_s)
    return np.asarray(np.interp(time_s, 0.5 * (middle_s[1:] + middle_s[:-1]), speed))
