"""Judge the sources before anything is estimated: correct what is wrong in a known way, leave out what is not.

First what the user says (`--as`), then what no sensor of a car can read (`odd_sensors`). Where sources still contradict
each other, the hypotheses of `hypotheses` are tried, and the one that clearly wins is applied
(`source_hypotheses`). What still contradicts the others is left out by vote (`source_vote`).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from cwcli.errors import UsageError, hint_at_closest_or_all_known_names
from cwcli.estimation.contradiction import Contradiction, SourceQuantity
from cwcli.estimation.correction import Correction, correction_of_all_rows
from cwcli.estimation.distance_ratio import correct_and_list_scaled_speeds
from cwcli.estimation.hypotheses import UNIT_AND_CONVENTION_HYPOTHESES_BY_KIND
from cwcli.estimation.hypotheses.base import compose_hypothesis_by_name
from cwcli.estimation.imu_yaw import find_imu_yaw_hypothesis_and_evidence
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.odd_sensors import find_impossible_imu_values, find_tilt_and_evidence
from cwcli.estimation.prepare import PreparedSeries, earliest_stamp_ns, seconds_since_zero_time
from cwcli.estimation.source_checks import MIN_ROWS_OF_COMPARED_SOURCE
from cwcli.estimation.source_correction import (
    CorrectionAttempt,
    Prepare,
    correct_one_contradicted_source,
    gain_and_attempt_of_imu_correction,
)
from cwcli.estimation.source_vote import (
    emptied_series,
    find_unchecked_quantities,
    leave_out_outvoted_sources,
    quantity_of_series,
)
from cwcli.estimation.standstill_heading import has_heading_jumps
from cwcli.estimation.wrong_rows import set_wrong_rows_aside_and_list_them
from cwcli.lazy_dataclass import dataclass, replace

SourceUnits = Mapping[str, str]
"""Source -> name of a hypothesis that the user says, see `UNIT_AND_CONVENTION_HYPOTHESES_BY_KIND`."""
MAX_CORRECTED_SOURCES = 6
"""Greatest number of sources that are corrected one after the other. Chosen by hand."""


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
    measurements: Sequence[Measurements], prepare: Prepare, *, trusted: Collection[str] = (), looks_ahead: bool = True
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
    current, corrections = set_wrong_rows_aside_and_list_them(measurements, trusted)
    prepared, notes = prepare(current)
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
            tried = gain_and_attempt_of_imu_correction(m, current, others, prepare)
            if tried is not None:
                apply_correction_attempt(tried[1])
    # Where the other sources cannot tell, size and direction of the values still do.
    current, impossible = correct_and_list_imu_units_and_tilt(current, trusted)
    if impossible:
        corrections += impossible
        prepared, notes = prepare(current)
    for _ in range(MAX_CORRECTED_SOURCES):
        voted = leave_out_outvoted_sources(prepared, trusted)
        if not voted.contradictions and not _does_any_heading_jump(prepared):
            break
        attempt = correct_one_contradicted_source(current, prepared, voted.comparisons, prepare, trusted)
        if attempt is None:
            break
        apply_correction_attempt(attempt)
    current, turned_imus = correct_and_list_turned_imus(current, voted.prepared, trusted)
    current, scaled = correct_and_list_scaled_speeds(current, voted.prepared, trusted)
    if turned_imus or scaled:
        corrections += [*turned_imus, *scaled]
        prepared, notes = prepare(current)
        voted = leave_out_outvoted_sources(
            [replace(p, series=emptied_series(p.series)) if quantity_of_series(p) in unused else p for p in prepared],
            trusted,
        )
    unchecked = find_unchecked_quantities(voted.prepared, voted.comparisons)
    return JudgedSources(voted.prepared, notes, tuple(corrections), voted.contradictions, unchecked)


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


def correct_and_list_turned_imus(
    measurements: Sequence[Measurements], prepared: Sequence[PreparedSeries], trusted: Collection[str] = ()
) -> tuple[list[Measurements], list[Correction]]:
    """Return the measurements with level IMUs that are turned about the vertical turned back; see `imu_yaw`.

    Args:
        measurements: Measurements.
        prepared: Their series, after what contradicts the others was left out.
        trusted: Sources that are not corrected.
    """
    fixes = [
        p.series for p in prepared if p.series.kind is Kind.POSITION and len(p.series) >= MIN_ROWS_OF_COMPARED_SOURCE
    ]
    level = {p.series.source for p in prepared if p.mounting is not None and len(p.series)}
    corrected: list[Measurements] = []
    corrections: list[Correction] = []
    for m in measurements:
        found = None
        if m.kind is Kind.IMU and fixes and m.source in level - {*trusted}:
            rows = np.flatnonzero(np.isfinite(m.values).all(axis=1))
            rows = rows[np.argsort(m.stamp_ns[rows], kind="stable")]
            time_s = seconds_since_zero_time(m.stamp_ns[rows], earliest_stamp_ns(measurements))
            helpers = [
                p.series
                for p in prepared
                if len(p.series) >= MIN_ROWS_OF_COMPARED_SOURCE
                and (p.series.kind is Kind.SPEED or (p.series.kind is Kind.YAW_RATE and p.series.source == m.source))
            ]
            found = find_imu_yaw_hypothesis_and_evidence(time_s, m.values[rows], [fixes[0], *helpers])
        if found is not None:
            corrections.append(correction_of_all_rows(m, *found))
        corrected.append(m if found is None else found[0].correct_measurements(m))
    return corrected, corrections
