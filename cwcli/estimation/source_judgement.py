"""Judge the sources before anything is estimated: correct what is wrong in a known way, leave out what is not.

First what the user says (`--as`), then what changes in mid-log (`source_pieces`) and what no sensor of a car can read
(`odd_sensors`). Where sources still contradict each other, the hypotheses of `hypotheses` are tried, and the one that
clearly wins is applied (`source_hypotheses`). What still contradicts the others is left out by vote (`source_vote`).
Rows that are wrong although the rest of their source is right are set aside and counted.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from cwcli.errors import UsageError, hint_at_closest_or_all_known_names
from cwcli.estimation.contradiction import Contradiction, SourceQuantity
from cwcli.estimation.correction import Correction, correction_of_all_rows
from cwcli.estimation.distance_ratio import correct_and_list_scaled_speeds
from cwcli.estimation.fix_scatter import scatter_about_neighbours
from cwcli.estimation.frozen_rows import FixMotion, frozen_row_mask
from cwcli.estimation.hypotheses import UNIT_AND_CONVENTION_HYPOTHESES_BY_KIND
from cwcli.estimation.hypotheses.base import compose_hypothesis_by_name
from cwcli.estimation.imu_against_motion import correct_imus_and_find_contradictions_of_motion
from cwcli.estimation.jumping_fixes import fixes_jumped_away_mask
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.odd_sensors import find_impossible_imu_values, find_tilt_and_evidence
from cwcli.estimation.prepare import (
    PreparedSeries,
    earliest_stamp_ns,
    finite_rows_by_stamp,
    seconds_since_zero_time,
)
from cwcli.estimation.source_checks import MIN_ROWS_OF_COMPARED_SOURCE
from cwcli.estimation.source_correction import (
    CorrectionAttempt,
    Prepare,
    attempt_imu_correction,
    correct_one_contradicted_source,
)
from cwcli.estimation.source_pieces import correct_and_list_sources_that_change, find_contradicting_pieces
from cwcli.estimation.source_vote import (
    emptied_series,
    find_unchecked_quantities,
    leave_out_outvoted_sources,
    quantity_of_series,
)
from cwcli.estimation.speed_in_bends import set_speeds_aside_in_bends
from cwcli.estimation.standstill_heading import has_heading_jumps, heading_flipped_at_standstill_mask
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.columns import FloatArray

SourceUnits = Mapping[str, str]
"""Source -> name of a hypothesis that the user says, see `UNIT_AND_CONVENTION_HYPOTHESES_BY_KIND`."""
MAX_CORRECTED_SOURCES = 6
"""Greatest number of sources that are corrected one after the other. Chosen by hand."""
STANDSTILL_CHECK_WINDOW_S = 2.0
"""Time in s over which the fixes show whether the car stands. Chosen by hand."""


@dataclass(frozen=True)
class JudgedSources:
    """Sources after they were judged.

    Attributes:
        prepared: Series of the estimate; those that are left out have no rows.
        notes: Notes on the cleaning.
        corrections: What was corrected, in this order.
        contradictions: Sources that contradict each other all the same.
        unchecked: Quantities with which no other source clearly agrees.
    """

    prepared: list[PreparedSeries]
    notes: list[str]
    corrections: tuple[Correction, ...]
    contradictions: tuple[Contradiction, ...]
    unchecked: frozenset[SourceQuantity] = frozenset()


def judge_sources(
    measurements: Sequence[Measurements],
    prepare: Prepare,
    *,
    trusted: Collection[str] = (),
    looks_ahead: bool = True,
) -> JudgedSources:
    """Correct and leave out sources; see the module.

    Args:
        measurements: Positions first; what the user says of them is corrected already.
        prepare: Cleans them.
        trusted: Sources that are neither corrected nor left out.
        looks_ahead: Whether the whole log may be used; else contradictions are reported, and nothing is changed.
    """
    if not looks_ahead:
        prepared, notes = prepare(measurements)
        found = leave_out_outvoted_sources(prepared, trusted).contradictions
        return JudgedSources(prepared, notes, (), tuple(each.with_left_out() for each in found))
    zero_ns = earliest_stamp_ns(measurements)
    current, corrections = set_wrong_rows_aside_and_list_them(measurements, trusted)
    prepared, notes = prepare(current)
    has_pieces = bool(find_contradicting_pieces(prepared, current))
    if has_pieces:
        current, in_part = correct_and_list_sources_that_change(current, prepared, prepare, trusted)
        corrections, (prepared, notes) = corrections + in_part, prepare(current)
    unused: set[SourceQuantity] = set()

    def apply_correction_attempt(attempt: CorrectionAttempt) -> None:
        nonlocal current, prepared, notes
        corrections.append(attempt.correction)
        unused.update(attempt.unused)
        current, notes = attempt.measurements, attempt.notes
        prepared = [
            replace(p, series=emptied_series(p.series)) if quantity_of_series(p) in unused else p
            for p in attempt.prepared
        ]

    for m in current:
        if m.kind is Kind.IMU and m.source not in trusted and find_impossible_imu_values(m.values):
            others = [
                p.series
                for p in prepared
                if p.series.source != m.source and len(p.series) >= MIN_ROWS_OF_COMPARED_SOURCE
            ]
            tried = attempt_imu_correction(m, current, others, prepare, zero_ns)
            if tried is not None:
                apply_correction_attempt(tried)
    # Where the other sources cannot tell, size and direction of the values still do.
    current, impossible = correct_and_list_imu_units_and_tilt(current, trusted)
    if impossible:
        corrections += impossible
        prepared, notes = prepare(current)
    for _ in range(MAX_CORRECTED_SOURCES):
        voted = leave_out_outvoted_sources(prepared, trusted)
        if not voted.contradictions and not _does_any_heading_jump(prepared):
            break
        attempt = correct_one_contradicted_source(current, prepared, voted.comparisons, prepare, trusted, zero_ns)
        if attempt is None:
            break
        apply_correction_attempt(attempt)

    def apply_and_vote_again(found: Sequence[Correction], left_out: Collection[SourceQuantity] = ()) -> None:
        nonlocal prepared, notes, voted
        if not found and not left_out:
            return
        corrections.extend(found)
        unused.update(left_out)
        prepared, notes = prepare(current)
        voted = leave_out_outvoted_sources(
            [replace(p, series=emptied_series(p.series)) if quantity_of_series(p) in unused else p for p in prepared],
            trusted,
        )

    if has_pieces:
        current, in_part = correct_and_list_sources_that_change(
            current, voted.prepared, prepare, trusted, sets_aside=True
        )
        apply_and_vote_again(in_part)
    current, turned_imus, wrong_maps = correct_imus_and_find_contradictions_of_motion(current, voted.prepared, trusted)
    apply_and_vote_again(turned_imus, [who for each in wrong_maps for who in each.left_out])
    current, wrong_speeds = _correct_and_list_speeds(current, voted.prepared, trusted)
    apply_and_vote_again(wrong_speeds)
    return JudgedSources(
        voted.prepared,
        notes,
        tuple(corrections),
        (*wrong_maps, *voted.contradictions),
        find_unchecked_quantities(voted.prepared, voted.comparisons),
    )


def _correct_and_list_speeds(
    measurements: Sequence[Measurements], prepared: Sequence[PreparedSeries], trusted: Collection[str]
) -> tuple[list[Measurements], list[Correction]]:
    """Return the measurements with rows of speeds in bends set aside, and speeds scaled as on straight roads."""
    corrected, slipping, without_slip = set_speeds_aside_in_bends(measurements, prepared, trusted)
    corrected, scaled = correct_and_list_scaled_speeds(corrected, without_slip, trusted)
    return corrected, [*slipping, *scaled]


def _does_any_heading_jump(prepared: Sequence[PreparedSeries]) -> bool:
    return any(
        p.series.kind is Kind.HEADING and has_heading_jumps(p.series.time_s, p.series.values[:, 0]) for p in prepared
    )


def correct_and_list_user_faults(
    measurements: Sequence[Measurements], units: SourceUnits
) -> tuple[list[Measurements], list[Correction]]:
    """Return the measurements with what the user says of them corrected.

    Raises:
        UsageError: A source has no values for which this is a unit or convention.
    """
    corrected: list[Measurements] = []
    corrections: list[Correction] = []
    used = set()
    for m in measurements:
        name = units.get(m.source)
        hypothesis = (
            None
            if name is None
            else compose_hypothesis_by_name(m.kind, UNIT_AND_CONVENTION_HYPOTHESES_BY_KIND.get(m.kind, ()), name)
        )
        if hypothesis is not None:
            used.add(m.source)
            corrections.append(correction_of_all_rows(m, hypothesis, ""))
        corrected.append(m if hypothesis is None else hypothesis.correct_measurements(m))
    for source, name in units.items():
        kinds = [m.kind for m in measurements if m.source == source]
        if source not in used and kinds:
            names = [each.name for kind in kinds for each in UNIT_AND_CONVENTION_HYPOTHESES_BY_KIND.get(kind, ())]
            is_twice = "+" in name and all(part in names for part in name.split("+"))
            hint = (
                "name only one unit, one sign and one choice of axes"
                if is_twice
                else hint_at_closest_or_all_known_names(name, names)
            )
            raise UsageError(f"--as {source}={name}: there is no such fault of {source}", hint=hint)
    return corrected, corrections


def correct_and_list_imu_units_and_tilt(
    measurements: Sequence[Measurements], trusted: Collection[str] = ()
) -> tuple[list[Measurements], list[Correction]]:
    """Return the measurements with IMUs in SI units and level where their values show it by themselves."""
    corrected: list[Measurements] = []
    corrections: list[Correction] = []
    for m in measurements:
        own = m
        if m.kind is Kind.IMU and m.source not in trusted:
            for hypothesis, evidence in find_impossible_imu_values(m.values):
                own = hypothesis.correct_measurements(own)
                corrections.append(correction_of_all_rows(m, hypothesis, evidence))
            tilt = find_tilt_and_evidence(own.values)
            if tilt is not None:
                own = tilt[0].correct_measurements(own)
                corrections.append(correction_of_all_rows(m, *tilt))
        corrected.append(own)
    return corrected, corrections


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
            rows = finite_rows_by_stamp(m)
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
    rows = finite_rows_by_stamp(m)
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
