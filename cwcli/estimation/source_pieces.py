"""Find a source whose unit, sign, axes or convention changes in mid-log, as when its driver is started anew.

Comparisons over the whole log take medians, to which a source that is wrong in a part of it seems right, noisy or of
another fault. So for each pair of sources the steps with clear motion are judged one by one. The stretch in which the
steps that contradict outnumber most those that agree is judged as a log of its own: the hypothesis that clearly wins
there is applied to the rows of the stretch, and what is outvoted there is set aside there.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from itertools import combinations, product

import numpy as np

from cwcli.estimation.check_texts import SourceComparisonCheck
from cwcli.estimation.contradiction import SourceQuantity
from cwcli.estimation.correction import Correction
from cwcli.estimation.hypotheses.base import Hypothesis
from cwcli.estimation.measurements import KINDS_THAT_IMU_MEASURES_TOO, Kind, Measurements
from cwcli.estimation.median import median_of_finite_values
from cwcli.estimation.prepare import PreparedSeries, earliest_stamp_ns, seconds_since_zero_time
from cwcli.estimation.source_checks import (
    AGREEING_HEADING_DIFFERENCE_RANGE_RAD,
    MAX_COMPARED_HEADING_CHANGE_RAD,
    MIN_HEADING_CHANGE_OF_TURN_RAD,
    MIN_MOTION_CHANGE_SIGMAS,
    MIN_ROWS_OF_COMPARED_SOURCE,
    MIN_SPEED_CHANGE_MPS,
    Judgement,
    SourceComparison,
)
from cwcli.estimation.source_correction import Prepare, correct_one_contradicted_source
from cwcli.estimation.source_hypotheses import step_motions_and_edges_for_evidence
from cwcli.estimation.source_vote import (
    MIN_MEAN_SPECIFIC_FORCE_OVER_GRAVITY,
    MIN_VERTICAL_GRAVITY_SHARE,
    leave_out_outvoted_sources,
)
from cwcli.estimation.step_evidence import FIX_KINDS, MIN_COURSE_SPEED_MPS
from cwcli.estimation.step_motion import (
    MIN_FIX_DISTANCE_FOR_COURSE_M,
    StepMotion,
    covered_step_mask,
    means_between_edges,
)
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.angles import wrap_angle
from cwcli.signals.columns import AccelGyroRows, BoolArray, FloatArray, Int64Array
from cwcli.signals.units import STANDARD_GRAVITY_MPS2

MIN_STEPS_OF_PIECE = 2
"""Least number by which the steps of a piece that contradict outnumber those that agree, and by which those outside of
it that agree outnumber the others. Chosen small: the likelihood decides."""
MAX_AGREEING_DIFFERENCE, MIN_CONTRADICTING_DIFFERENCE = 0.35, 0.5
"""Greatest difference of two ways, turns or changes of speed that agree, and the least one of two that contradict, as a
share of the larger one. Chosen by hand: latencies and bends change short steps; half or twice is no such change."""
MIN_LOG_LIKELIHOOD_GAIN_OF_PIECE = 30.0
"""Least gain in log-likelihood of a hypothesis on a piece. Chosen: twice that on a whole log, because begin and end are
searched, too; not fitted."""
NAMES_OF_FAULTS_LIKE_REVERSING = frozenset({"reversed", "backward", "west-south"})
"""Names of hypotheses that a car which drives backwards explains as well: they hold for whole logs only."""
MAX_CHANGED_PIECES = 4
"""Greatest number of pieces that are corrected one after the other. Chosen by hand."""
MIN_RATIO_OF_JUMP_TO_USUAL = 12.0
"""Least jump of the values at a change, relative to the median of their changes from row to row: eight sigmas of white
noise. Chosen far above noise."""
MIN_RATIO_OF_SCATTERS = 3.0
"""Least ratio of the changes from row to row on both sides of a change of unit. Chosen below that of km/h to m/s."""
MIN_ROWS_BESIDE_CHANGE = 5
"""Least number of rows on each side of a change of the scatter. Chosen by hand."""
SMALLEST_JUMP = 1e-9
"""Added to each change from row to row, in SI units: nothing is divided by zero where values repeat."""


@dataclass(frozen=True)
class Piece:
    """A part of a log in which two sources contradict each other.

    Attributes:
        begins_within_s, ends_within_s: Between which times, s, it begins and ends: from a step in which they agree to
            one in which they contradict each other; infinite where the piece begins or ends with the log.
        pair: The two sources.
    """

    begins_within_s: tuple[float, float]
    ends_within_s: tuple[float, float]
    pair: tuple[SourceQuantity, SourceQuantity]


@dataclass(frozen=True)
class ComparedSteps:
    """The steps in which two sources clearly agree and contradict each other.

    Attributes:
        agrees, contradicts: Masks (n,) of the steps.
        edges_s: Edges of the steps; n is one less, or two less where a change from step to step is judged.
        pair: The two sources; an IMU twice where gravity judges it.
    """

    agrees: BoolArray
    contradicts: BoolArray
    edges_s: FloatArray
    pair: tuple[SourceQuantity, SourceQuantity]


def correct_and_list_sources_that_change(
    measurements: Sequence[Measurements],
    prepared: Sequence[PreparedSeries],
    prepare: Prepare,
    trusted: Collection[str] = (),
    *,
    sets_aside: bool = False,
) -> tuple[list[Measurements], list[Correction]]:
    """Return the measurements with what is wrong in a part of the log corrected there.

    Args:
        measurements: Measurements.
        prepared: Their series.
        prepare: Cleans measurements.
        trusted: Sources that are neither corrected nor set aside.
        sets_aside: Whether what is outvoted in a part of the log is set aside there, too.
    """
    current, corrections = list(measurements), list[Correction]()
    for _ in range(MAX_CHANGED_PIECES):
        found = None
        for piece, who in product(find_contradicting_pieces(prepared, current), (0, 1)):
            own = _measurements_of_quantity(current, piece.pair[who])
            if own.kind is not Kind.POSITION and own.source not in trusted:
                found = _correct_piece(current, own, piece, prepare, sets_aside=sets_aside)
            if found is not None:
                break
        if found is None:
            break
        current, correction = found
        corrections.append(correction)
        prepared, _ = prepare(current)
    return current, corrections


def _measurements_of_quantity(measurements: Sequence[Measurements], who: SourceQuantity) -> Measurements:
    kinds = (who.kind, Kind.IMU) if who.kind in KINDS_THAT_IMU_MEASURES_TOO else (who.kind,)
    return next(m for kind in kinds for m in measurements if (m.source, m.kind) == (who.source, kind))


def find_contradicting_pieces(prepared: Sequence[PreparedSeries], measurements: Sequence[Measurements]) -> list[Piece]:
    """Return the pieces in which two sources contradict each other although they agree in the rest, the longest first.

    Gravity is a source, too: an IMU may be upright in a part of the log and lie on its side in another.

    Args:
        prepared: Series, positions first.
        measurements: What they were prepared from.
    """
    series = [p.series for p in prepared if len(p.series) >= MIN_ROWS_OF_COMPARED_SOURCE and not p.series.is_exact]
    if len(series) < 2 or not any(s.kind is Kind.POSITION for s in series):
        return []
    motions, edges_s = step_motions_and_edges_for_evidence(series)
    if len(edges_s) < 2:
        return []
    found = [
        scored
        for steps in _compare_steps_of_pairs(motions, edges_s, measurements)
        if (scored := _number_of_steps_and_piece(steps)) is not None
    ]
    return [piece for _, piece in sorted(found, key=lambda each: -each[0])]


def _compare_steps_of_pairs(
    motions: Sequence[StepMotion], edges_s: FloatArray, measurements: Sequence[Measurements]
) -> Iterator[ComparedSteps]:
    """Yield the steps of each pair of sources for each quantity that both have, and of each IMU beside gravity."""
    for one, other in combinations(motions, 2):
        if one.source != other.source:
            for agrees, contradicts in _iter_agreeing_and_contradicting_steps(one, other):
                yield ComparedSteps(agrees, contradicts, edges_s, (_quantity(one), _quantity(other)))
    zero_ns = earliest_stamp_ns(measurements)
    for m in measurements:
        who = SourceQuantity(m.source, Kind.ACCEL)
        if m.kind is Kind.IMU and who in map(_quantity, motions):
            time_s = seconds_since_zero_time(m.stamp_ns, zero_ns)
            yield ComparedSteps(*_upright_and_lying_steps(time_s, m.values, edges_s), edges_s, (who, who))


def _does_correction_contradict_outside(
    own: Measurements,
    hypothesis: Hypothesis,
    within_s: tuple[float, float],
    measurements: Sequence[Measurements],
    prepare: Prepare,
) -> bool:
    """Return whether a source that is corrected everywhere contradicts another one outside of a time, s.

    If not, it is wrong in the whole log.
    """
    everywhere = [hypothesis.correct_measurements(m) if m is own else m for m in measurements]
    prepared, _ = prepare(everywhere)
    series = [p.series for p in prepared if len(p.series) >= MIN_ROWS_OF_COMPARED_SOURCE and not p.series.is_exact]
    motions, edges_s = step_motions_and_edges_for_evidence(series)
    for steps in _compare_steps_of_pairs(motions, edges_s, everywhere):
        if own.source in {who.source for who in steps.pair}:
            score = steps.contradicts.astype(np.int64) - steps.agrees
            width = len(edges_s) - len(score)
            is_outside = (edges_s[width:] <= within_s[0]) | (edges_s[: len(score)] >= within_s[1])
            if int(score[is_outside].sum()) >= MIN_STEPS_OF_PIECE:
                return True
    return False


def _quantity(motion: StepMotion) -> SourceQuantity:
    return SourceQuantity(motion.source, motion.kind)


def _number_of_steps_and_piece(steps: ComparedSteps) -> tuple[int, Piece] | None:
    """Return by how many the steps that contradict outnumber the others in a piece, and the piece; None without one."""
    agrees, edges_s = steps.agrees, steps.edges_s
    score = steps.contradicts.astype(np.int64) - agrees
    begin, end = _begin_and_end_of_greatest_sum(score)
    n_more = int(score[begin:end].sum())
    if n_more < MIN_STEPS_OF_PIECE or n_more - int(score.sum()) < MIN_STEPS_OF_PIECE:
        return None
    width = len(edges_s) - len(score)
    before, after = np.flatnonzero(agrees[:begin]), end + np.flatnonzero(agrees[end:])
    return n_more, Piece(
        (float(edges_s[before[-1]]), float(edges_s[begin + width])) if len(before) else (-np.inf, -np.inf),
        (float(edges_s[end - 1]), float(edges_s[after[0] + width])) if len(after) else (np.inf, np.inf),
        steps.pair,
    )


def _upright_and_lying_steps(
    time_s: FloatArray, values: AccelGyroRows, edges_s: FloatArray
) -> tuple[BoolArray, BoolArray]:
    """Return masks of the steps in which the mean specific force of an IMU points along its vertical axis, or not."""
    rows = np.flatnonzero(np.isfinite(values).all(axis=1))
    if (np.diff(time_s[rows]) < 0.0).any():
        rows = rows[np.argsort(time_s[rows], kind="stable")]
    force = np.column_stack([means_between_edges(time_s[rows], column, edges_s) for column in values[rows, :3].T])
    norm = np.linalg.norm(force, axis=1)
    is_known = (norm > MIN_MEAN_SPECIFIC_FORCE_OVER_GRAVITY * STANDARD_GRAVITY_MPS2) & covered_step_mask(
        time_s[rows], edges_s
    )
    is_upright = force[:, 2] > MIN_VERTICAL_GRAVITY_SHARE * norm
    return np.asarray(is_known & is_upright), np.asarray(is_known & ~is_upright)


def _iter_agreeing_and_contradicting_steps(one: StepMotion, other: StepMotion) -> Iterator[tuple[BoolArray, BoolArray]]:
    """Yield masks of the steps in which two sources clearly agree and contradict, for each quantity that both have.

    A car that drives backwards turns no source wrong: signs of ways, and opposite directions, contradict nothing.
    """
    kinds = {one.kind, other.kind}
    with np.errstate(invalid="ignore"):
        if kinds <= {*FIX_KINDS, Kind.SPEED} and kinds != {Kind.POSITION}:
            ways_m = np.abs(one.distance_m), np.abs(other.distance_m)
            yield _agreeing_and_contradicting_values(*ways_m, MIN_FIX_DISTANCE_FOR_COURSE_M)
        if Kind.SPEED not in kinds and Kind.ACCEL not in kinds:
            sigma_rad = np.fmax(one.turn_sigma_rad, other.turn_sigma_rad)
            least = np.fmax(MIN_HEADING_CHANGE_OF_TURN_RAD, MIN_MOTION_CHANGE_SIGMAS * sigma_rad)
            turns = one.turn_rad, other.turn_rad
            is_known = np.fmin(*np.abs(turns)) < MAX_COMPARED_HEADING_CHANGE_RAD  # else they may go round the other way
            agrees, contradicts = _agreeing_and_contradicting_values(*turns, least)
            yield agrees & is_known, contradicts & is_known
        fixes = [m for m in (one, other) if m.kind in FIX_KINDS]
        if fixes and one.has_zero_angle and other.has_zero_angle:
            difference = np.abs(wrap_angle(one.angle_rad - other.angle_rad))
            is_fast = np.abs(fixes[0].speed_mps) > MIN_COURSE_SPEED_MPS
            limit = AGREEING_HEADING_DIFFERENCE_RANGE_RAD.high
            is_opposite = difference > math.pi - limit
            yield is_fast & (difference < limit), is_fast & (difference > 1.5 * limit) & ~is_opposite
        if Kind.ACCEL in kinds and len(kinds) == 2:
            changes = one.speed_change_to_next_step_mps, other.speed_change_to_next_step_mps
            difference = changes[0] - changes[1]
            known = difference[np.isfinite(difference)]
            middle = median_of_finite_values(known) if len(known) else 0.0
            shift = middle if one.kind is Kind.ACCEL else -middle
            accel, judge = changes if one.kind is Kind.ACCEL else changes[::-1]
            least_mps = max(
                MIN_SPEED_CHANGE_MPS, *(MIN_MOTION_CHANGE_SIGMAS * m.speed_change_sigma_mps for m in (one, other))
            )
            yield _agreeing_and_contradicting_values(accel - shift, judge, least_mps)


def _agreeing_and_contradicting_values(
    one: FloatArray, other: FloatArray, least: FloatArray | float
) -> tuple[BoolArray, BoolArray]:
    """Return masks of the values that agree and contradict, of those of which one is larger than the least."""
    larger = np.fmax(np.abs(one), np.abs(other))
    difference = np.abs(one - other)
    is_clear = larger > least
    return (
        np.asarray(is_clear & (difference < MAX_AGREEING_DIFFERENCE * larger)),
        np.asarray(is_clear & (difference > np.fmax(MIN_CONTRADICTING_DIFFERENCE * larger, least))),
    )


def _begin_and_end_of_greatest_sum(score: Int64Array) -> tuple[int, int]:
    """Return begin and end of the slice of a column (n,) that has the greatest sum (Kadane's algorithm)."""
    total = np.concatenate([[0], np.cumsum(score)])
    lowest = np.minimum.accumulate(total)
    end = int(np.argmax(total - lowest))
    begin = int(np.flatnonzero(total[: end + 1] == lowest[end])[-1])
    return begin, end


def _correct_piece(
    measurements: Sequence[Measurements], own: Measurements, piece: Piece, prepare: Prepare, *, sets_aside: bool
) -> tuple[list[Measurements], Correction] | None:
    """Return the measurements with one source corrected or set aside in a piece; None where nothing is clear there."""
    zero_ns = earliest_stamp_ns(measurements)
    time_s = seconds_since_zero_time(own.stamp_ns, zero_ns)
    begin_s, begin_text = _time_of_change_and_text(own, time_s, piece.begins_within_s, "from")
    end_s, end_text = _time_of_change_and_text(own, time_s, piece.ends_within_s, "until")
    parts = [
        m.select_rows((seconds >= begin_s) & (seconds < end_s))
        for m in measurements
        for seconds in [seconds_since_zero_time(m.stamp_ns, zero_ns)]
    ]
    parts = [part for part in parts if len(part) >= MIN_ROWS_OF_COMPARED_SOURCE]
    if not any(part.kind is Kind.POSITION for part in parts):
        return None
    prepared, _ = prepare(parts)
    voted = leave_out_outvoted_sources(prepared)
    step_by_step = SourceComparison(SourceComparisonCheck.TURN, *piece.pair, Judgement.CONTRADICT, math.nan)
    others = {m.source for m in measurements} - {own.source}
    compared = [*voted.comparisons, step_by_step]
    attempt = correct_one_contradicted_source(parts, prepared, compared, prepare, others, zero_ns)
    rows = (time_s >= begin_s) & (time_s < end_s)
    n, when = int(rows.sum()), " ".join(each for each in (begin_text, end_text) if each)
    if attempt is not None and attempt.gain >= MIN_LOG_LIKELIHOOD_GAIN_OF_PIECE:
        hypothesis, correction = attempt.hypothesis, attempt.correction
        if (
            correction.who != SourceQuantity(own.source, own.kind)
            or _may_be_reversing(own.kind, hypothesis)
            or not _does_correction_contradict_outside(own, hypothesis, (begin_s, end_s), measurements, prepare)
        ):
            return None
        # Where the forward axis is not clear, a turned accelerometer cannot be used.
        if not attempt.unused or np.array_equal(np.array(hypothesis.matrix)[:3, :3], np.eye(3)):
            correction = replace(
                correction, fault=f"{correction.fault}, {when}", action=f"{correction.action} there", n_rows=n
            )
            corrected = _correct_rows(own, rows, hypothesis)
            return [corrected if m is own else m for m in measurements], correction
        fault, evidence = correction.fault, correction.evidence
    elif sets_aside:
        outvoted = next(
            (c for c in voted.contradictions if c.allies and c.who in piece.pair and c.who.source == own.source), None
        )
        if outvoted is None or not outvoted.left_out:
            return None
        fault = f"contradicts {outvoted.against}: {outvoted.what}"
        evidence = f"by {', '.join(dict.fromkeys(each.source for each in outvoted.allies))}"
    else:
        return None
    who = SourceQuantity(own.source, own.kind)
    correction = Correction(who, "piece", f"{fault}, {when}", f"{n} rows set aside", evidence, n_set_aside=n)
    aside = replace(own, values=np.where(rows[:, None], np.nan, own.values))
    return [aside if m is own else m for m in measurements], correction


def _may_be_reversing(kind: Kind, hypothesis: Hypothesis) -> bool:
    """Return whether a car that drives backwards explains what a hypothesis explains."""
    return kind is not Kind.IMU and not NAMES_OF_FAULTS_LIKE_REVERSING.isdisjoint(hypothesis.name.split("+"))


def _correct_rows(m: Measurements, rows: BoolArray, hypothesis: Hypothesis) -> Measurements:
    """Return the measurements with a hypothesis applied to some rows, given as a mask (n,)."""
    corrected = hypothesis.correct_measurements(m)
    covariance = m.covariance
    if covariance is not None and corrected.covariance is not None:
        covariance = np.where(rows[:, None, None], corrected.covariance, covariance)
    return replace(m, values=np.where(rows[:, None], corrected.values, m.values), covariance=covariance)


def _time_of_change_and_text(
    m: Measurements, time_s: FloatArray, within_s: tuple[float, float], word: str
) -> tuple[float, str]:
    """Return when the values of a source change between two times, s: where they jump, or their scatter changes.

    Where neither shows, nothing in the values tells the pieces apart, and the time is the middle. The text is "" where
    the times are infinite.
    """
    if math.isinf(within_s[0]):
        return within_s[0], ""
    rows = np.flatnonzero((time_s >= within_s[0]) & (time_s <= within_s[1]) & np.isfinite(m.values).all(axis=1))
    middle_s = 0.5 * (within_s[0] + within_s[1])
    rows = rows[np.argsort(time_s[rows], kind="stable")]
    if len(rows) <= 2 * MIN_ROWS_BESIDE_CHANGE:
        return middle_s, f"{word} about {middle_s:.0f} s"
    jumps = np.abs(np.diff(m.values[rows], axis=0)) + SMALLEST_JUMP
    n, count = len(jumps), np.arange(1.0, len(jumps))[:, None]
    power = np.cumsum(np.square(jumps), axis=0)
    rest = np.maximum(power[-1] - power[:-1], SMALLEST_JUMP**2)
    cost = count * np.log(power[:-1] / count) + (n - count) * np.log(rest / (n - count))
    inner = slice(MIN_ROWS_BESIDE_CHANGE - 1, n - MIN_ROWS_BESIDE_CHANGE)
    k = MIN_ROWS_BESIDE_CHANGE - 1 + int(cost.sum(axis=1)[inner].argmin())
    before, after, usual = (
        np.array([median_of_finite_values(column) for column in part.T])
        for part in (jumps[: k + 1], jumps[k + 1 :], jumps)
    )
    ratio = after / before
    if ratio.max() > MIN_RATIO_OF_SCATTERS:
        k += 1  # the jump itself belongs to the larger scatter
    elif ratio.min() > 1.0 / MIN_RATIO_OF_SCATTERS:
        in_usual = (jumps / usual).max(axis=1)
        k = int(in_usual.argmax())
        if in_usual[k] < MIN_RATIO_OF_JUMP_TO_USUAL:
            return middle_s, f"{word} about {middle_s:.0f} s"
    change_s = float(0.5 * (time_s[rows[k]] + time_s[rows[k + 1]]))
    return change_s, f"{word} {change_s:.1f} s"
