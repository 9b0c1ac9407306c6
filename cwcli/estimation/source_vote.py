"""Find the wrong one of two contradicting sources by the votes of the others, before anything is estimated.

A source that two others contradict, while fewer agree with it, is outvoted and left out. Where two contradict each
other and no third tells which of them is wrong, the positions count, since without them there is no estimate, and the
other one is left out. Of two sources of which neither is a position both are left out. Every case is reported first.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from cwcli.estimation.check_texts import SourceComparisonCheck
from cwcli.estimation.contradiction import CAR_MOTION_TEXT, GRAVITY_TEXT, Contradiction, SourceQuantity
from cwcli.estimation.measurements import KINDS_THAT_IMU_MEASURES_TOO, Kind
from cwcli.estimation.median import median_of_finite_values
from cwcli.estimation.odd_sensors import MAX_GRAVITY_IN_ANY_UNIT
from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.prepare import PreparedSeries
from cwcli.estimation.source_checks import (
    MIN_ROWS_OF_COMPARED_SOURCE,
    Judgement,
    SourceComparison,
    compare_all_source_pairs,
)
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.units import STANDARD_GRAVITY_MPS2

MIN_MEAN_SPECIFIC_FORCE_OVER_GRAVITY = 0.5
"""Least mean specific force relative to gravity that shows the vertical. Chosen by hand; not fitted.

An IMU whose gravity was removed has none."""
MIN_VERTICAL_GRAVITY_SHARE = 0.5
"""Least share of gravity along the vertical axis of an IMU that is not tilted: cos 60 degrees."""
MAX_CAR_SPEED_MPS = 150.0
"""Median speed between fixes that no road vehicle has, m/s (540 km/h)."""
MIN_FIX_INTERVAL_FOR_SPEED_S = 1.0
"""Least time between the fixes whose distance gives that speed, s: their noise is at most 30 m. Chosen by hand."""
IMU_AXIS_NAMES = ("forward", "left", "vertical")
"""Names of the axes of an IMU in texts."""


@dataclass(frozen=True)
class SourceVoteResult:
    """Result of the vote of the sources.

    Attributes:
        prepared: The series; those that are left out have no rows.
        contradictions: Contradictions, the most important first.
        comparisons: Comparisons of all pairs, from which the contradictions follow.
    """

    prepared: list[PreparedSeries]
    contradictions: tuple[Contradiction, ...]
    comparisons: tuple[SourceComparison, ...] = ()


def leave_out_outvoted_sources(prepared: Sequence[PreparedSeries], trusted: Collection[str] = ()) -> SourceVoteResult:
    """Compare the sources and leave out those that cannot be right.

    Args:
        prepared: Series of one vehicle, positions first.
        trusted: Sources that are never left out.
    """
    tilted = [each.with_left_out() if each.who.source in trusted else each for each in find_tilted_imus(prepared)]
    compared = compare_prepared_sources(prepared, trusted)
    voted = find_contradicting_sources(compared, trusted)
    out = {
        SourceQuantity(each.who.source, kind)
        for each in tilted
        if each.left_out
        for kind in KINDS_THAT_IMU_MEASURES_TOO
    }
    out |= {quantity for each in voted for quantity in each.left_out}
    remaining = [replace(p, series=emptied_series(p.series)) if quantity_of_series(p) in out else p for p in prepared]
    return SourceVoteResult(remaining, (*find_impossible_fixes(prepared), *tilted, *voted), tuple(compared))


def compare_prepared_sources(
    prepared: Sequence[PreparedSeries], trusted: Collection[str] = ()
) -> list[SourceComparison]:
    """Compare all pairs of sources but those of IMUs that are not level; for the arguments see above."""
    tilted = [each for each in find_tilted_imus(prepared) if each.who.source not in trusted]
    out = {SourceQuantity(each.who.source, kind) for each in tilted for kind in KINDS_THAT_IMU_MEASURES_TOO}
    upright = [p for p in prepared if quantity_of_series(p) not in out]
    compared = compare_all_source_pairs([p.series for p in upright])
    # Where gravity shows how the IMU is mounted, a bias is mostly gravity, and no fault.
    level = {quantity_of_series(p) for p in prepared if p.mounting is not None}
    return [c for c in compared if not (c.check is SourceComparisonCheck.ACCEL_BIAS and {c.one, c.other} & level)]


def find_unchecked_quantities(
    prepared: Sequence[PreparedSeries], comparisons: Sequence[SourceComparison]
) -> frozenset[SourceQuantity]:
    """Return the used quantities with which no other source clearly agrees; none where there is one source alone."""
    used = [quantity_of_series(p) for p in prepared if len(p.series) and not p.series.is_exact]
    if len({each.source for each in used}) < 2:
        return frozenset()
    agreeing = {
        quantity
        for each in comparisons
        if each.judgement is Judgement.AGREE and each.one.source != each.other.source
        for quantity in (each.one, each.other)
    }
    return frozenset(used) - agreeing


def find_contradicting_sources(
    comparisons: Sequence[SourceComparison], trusted: Collection[str] = ()
) -> list[Contradiction]:
    """Find the wrong sources one after the other: the one that most others contradict comes first.

    Args:
        comparisons: Comparisons of all pairs.
        trusted: Sources that are blamed only where the other one is trusted, too, and never left out.
    """
    left = [each for each in comparisons if each.judgement is not Judgement.UNKNOWN]
    found = []
    while contrary := [each for each in left if each.judgement is Judgement.CONTRADICT]:
        suspects = dict.fromkeys(who for each in contrary for who in (each.one, each.other))
        accused = [_contradiction_and_votes_against(left, who) for who in suspects]
        # A position is blamed only where it is outvoted, since without it there is no estimate.
        worst = max(
            accused,
            key=lambda each: (
                each[0].who.source not in trusted,
                bool(each[0].allies),
                each[0].who.kind is not Kind.POSITION,
                each[1],
            ),
        )[0]
        by_position = isinstance(worst.against, SourceQuantity) and worst.against.kind is Kind.POSITION
        out: tuple[SourceQuantity, ...] = (worst.who,)
        if worst.who.kind is Kind.POSITION:
            out = ()
        elif not worst.allies and not by_position and isinstance(worst.against, SourceQuantity):
            out = (worst.who, worst.against)  # either may be wrong, and the positions are left
        out = tuple(quantity for quantity in out if quantity.source not in trusted)
        found.append(worst.with_left_out(*out))
        left = [each for each in left if not any(each.involves_source(quantity) for quantity in (worst.who, *out))]
    return found


def _contradiction_and_votes_against(
    comparisons: Sequence[SourceComparison], who: SourceQuantity
) -> tuple[Contradiction, int]:
    """Return the main contradiction of a source, with allies if it is outvoted, and the votes against it."""
    contrary = [each for each in comparisons if each.judgement is Judgement.CONTRADICT and each.involves_source(who)]
    main = min(contrary, key=lambda each: each.other_source(who).kind is not Kind.POSITION)
    votes = _votes_against_minus_votes_for(comparisons, who)
    allies = _sources_agreeing_against(comparisons, who, main.other_source(who), contrary) if votes > 0 else ()
    return replace(main.to_contradiction(who), allies=allies), votes


def emptied_series(s: SensorSeries) -> SensorSeries:
    """Return the series without its rows: it stays in the tables but is not used."""
    return s.select_rows(np.zeros(len(s), np.bool_))


def _votes_against_minus_votes_for(comparisons: Sequence[SourceComparison], who: SourceQuantity) -> int:
    """Return the number of other topics that contradict a source minus the number that agree with it."""
    contrary, agreeing = (
        {
            each.other_source(who).source
            for each in comparisons
            if each.involves_source(who) and each.judgement is judgement
        }
        - {who.source}
        for judgement in (Judgement.CONTRADICT, Judgement.AGREE)
    )
    return len(contrary) - len(agreeing - contrary)


def _sources_agreeing_against(
    comparisons: Sequence[SourceComparison],
    who: SourceQuantity,
    contradicted: SourceQuantity,
    contrary: Sequence[SourceComparison],
) -> tuple[SourceQuantity, ...]:
    """Return sources of other topics that contradict `who` and agree with the source that it contradicts."""
    accusers = dict.fromkeys(each.other_source(who) for each in contrary)
    return tuple(
        each
        for each in accusers
        if each.source not in (who.source, contradicted.source)
        and any(
            c.involves_source(each) and c.involves_source(contradicted) and c.judgement is Judgement.AGREE
            for c in comparisons
        )
    )


def find_impossible_fixes(prepared: Sequence[PreparedSeries]) -> list[Contradiction]:
    """Return contradictions for positions that move faster than any car, such as metres that were taken for degrees."""
    found = []
    for p in prepared:
        s = p.series
        if s.kind is not Kind.POSITION or len(s) < MIN_ROWS_OF_COMPARED_SOURCE:
            continue
        step = max(
            1, int(np.ceil(MIN_FIX_INTERVAL_FOR_SPEED_S / max(median_of_finite_values(np.diff(s.time_s)), 1e-3)))
        )
        way_m, duration_s = np.hypot(*(s.values[step:] - s.values[:-step]).T), s.time_s[step:] - s.time_s[:-step]
        speed_mps = median_of_finite_values(way_m / np.maximum(duration_s, 1e-3)) if len(way_m) else 0.0
        if speed_mps > MAX_CAR_SPEED_MPS:
            what = f"its fixes move at {speed_mps:.3g} m/s: check its unit and its map"
            found.append(Contradiction(quantity_of_series(p), CAR_MOTION_TEXT, what))
    return found


def find_tilted_imus(prepared: Sequence[PreparedSeries]) -> list[Contradiction]:
    """Return contradictions for IMUs that do not show gravity along the vertical axis, in m/s^2 or another unit."""
    found = []
    for p in prepared:
        if p.mean_force_mps2 is None or p.series.kind is not Kind.ACCEL or not len(p.series):
            continue
        norm = float(np.linalg.norm(p.mean_force_mps2))
        if norm > MAX_GRAVITY_IN_ANY_UNIT:
            what = f"gravity reads {norm:.0f}, more than in any unit: it seems to send raw counts, not m/s^2"
            found.append(_contradiction_to_gravity(p, what))
            continue
        if (
            norm < MIN_MEAN_SPECIFIC_FORCE_OVER_GRAVITY * STANDARD_GRAVITY_MPS2
            or p.mean_force_mps2[2] > MIN_VERTICAL_GRAVITY_SHARE * norm
        ):
            continue
        axis = int(np.argmax(np.abs(p.mean_force_mps2)))
        what = (
            f"on average it reads {p.mean_force_mps2[axis]:.1f} m/s^2 along its {IMU_AXIS_NAMES[axis]} axis"
            + (f" and {p.mean_force_mps2[2]:.1f} along its vertical one" if axis != 2 else ", downward")
            + ": it is not mounted with x forward and z up"
        )
        found.append(_contradiction_to_gravity(p, what))
    return found


def _contradiction_to_gravity(p: PreparedSeries, what: str) -> Contradiction:
    imu = SourceQuantity(p.series.source, Kind.IMU)
    return Contradiction(imu, GRAVITY_TEXT, what).with_left_out(imu)


def quantity_of_series(p: PreparedSeries) -> SourceQuantity:
    """Return source and kind of a series."""
    return SourceQuantity(p.series.source, p.series.kind)
