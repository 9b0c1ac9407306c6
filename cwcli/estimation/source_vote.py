"""Which source is wrong where two contradict each other: the others vote before anything is estimated.

A source that two others contradict, while fewer agree with it, is outvoted and left out. Where two contradict each other
and no third tells which of them is wrong, the positions count, since without them there is no estimate, and the other
one is left out. Two sources of which neither is a position are then both used. Every case is told first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cwcli.estimation.contradiction import GRAVITY, Contradiction, Quantity
from cwcli.estimation.measurements import RATES, Kind
from cwcli.estimation.passes import Series
from cwcli.estimation.prepare import PreparedSeries
from cwcli.estimation.source_checks import Comparison, Judgement, compare_sources
from cwcli.signals.units import STANDARD_GRAVITY_MPS2

LEAST_GRAVITY_PART = 0.5
"""Part of gravity that a mean specific force has to have so that it tells where down is; an IMU whose gravity was taken
out already has none."""
MOST_TILT_PART = 0.5
"""An IMU whose vertical axis has less than this part of gravity is tilted by more than 60 degrees."""
AXES = ("forward", "left", "vertical")


@dataclass(frozen=True)
class Vote:
    """What the sources say of each other.

    Attributes:
        prepared: The series, those that are left out without rows.
        contradictions: The one that matters most first.
    """

    prepared: list[PreparedSeries]
    contradictions: tuple[Contradiction, ...]


def vote(prepared: Sequence[PreparedSeries]) -> Vote:
    """Compare the sources and leave out those that can't be right.

    Args:
        prepared: Of one vehicle, positions first.
    """
    tilted = _tilted(prepared)
    upright = [p for p in prepared if not any(_quantity(p) == each.who for each in tilted)]
    voted = judge_comparisons(compare_sources([_levelled(p) for p in upright]))
    found = (*tilted, *voted)
    out = {each.who for each in found if each.is_left_out}
    kept = [replace(p, series=without_rows(p.series)) if _quantity(p) in out else p for p in prepared]
    return Vote(kept, _one_per_source(found))


def judge_comparisons(comparisons: Sequence[Comparison]) -> list[Contradiction]:
    """Find out who is wrong, one source after the other: the one that most others contradict comes first.

    Args:
        comparisons: Of all pairs.
    """
    left = [each for each in comparisons if each.judgement is not Judgement.UNKNOWN]
    found = []
    while contrary := [each for each in left if each.judgement is Judgement.CONTRADICT]:
        suspects = dict.fromkeys(who for each in contrary for who in (each.one, each.other))
        # Of equals a position is blamed last, since without it there is no estimate; then what comes first in the log.
        who = max(suspects, key=lambda each: (_votes_against(left, each), each.kind is not Kind.POSITION))
        against = [each for each in contrary if each.has(who)]
        against.sort(key=lambda each: each.opposite(who).kind is not Kind.POSITION)
        main = against[0]
        allies = _allies(left, who, main.opposite(who), against)
        outvoted = _votes_against(left, who) > 0 and bool(allies)
        named = replace(main.contradiction(who), allies=allies if outvoted else ())
        undecided = not outvoted and main.opposite(who).kind is Kind.POSITION
        found.append(named.left_out() if (outvoted or undecided) and who.kind is not Kind.POSITION else named)
        left = [each for each in left if not each.has(who)]
    return found


def without_rows(s: Series) -> Series:
    """The series without its rows: it stays in the tables, and takes no part."""
    return s.at(np.zeros(len(s), np.bool_))


def _votes_against(comparisons: Sequence[Comparison], who: Quantity) -> int:
    """How many other topics contradict a source, less those that agree with it."""
    contrary, agreeing = (
        {each.opposite(who).source for each in comparisons if each.has(who) and each.judgement is judgement}
        - {who.source}
        for judgement in (Judgement.CONTRADICT, Judgement.AGREE)
    )
    return len(contrary) - len(agreeing - contrary)


def _allies(
    comparisons: Sequence[Comparison], who: Quantity, against: Quantity, contrary: Sequence[Comparison]
) -> tuple[Quantity, ...]:
    """Other topics that contradict `who` and agree with the source that it contradicts."""
    accusers = dict.fromkeys(each.opposite(who) for each in contrary)
    return tuple(
        each
        for each in accusers
        if each.source not in (who.source, against.source)
        and any(c.has(each) and c.has(against) and c.judgement is Judgement.AGREE for c in comparisons)
    )


def _tilted(prepared: Sequence[PreparedSeries]) -> list[Contradiction]:
    """IMUs whose vertical axis is not vertical: neither their forward axis nor their yaw rate is what it should be."""
    found = []
    for p in prepared:
        if p.mean_force_mps2 is None or not len(p.series):
            continue
        norm = float(np.linalg.norm(p.mean_force_mps2))
        if norm < LEAST_GRAVITY_PART * STANDARD_GRAVITY_MPS2 or p.mean_force_mps2[2] > MOST_TILT_PART * norm:
            continue
        axis = int(np.argmax(np.abs(p.mean_force_mps2)))
        what = (
            f"on average it reads {p.mean_force_mps2[axis]:.1f} m/s^2 along its {AXES[axis]} axis"
            + (f" and {p.mean_force_mps2[2]:.1f} along its vertical one" if axis != 2 else ", downward")
            + ": it is not mounted with x forward and z up"
        )
        found.append(Contradiction(_quantity(p), GRAVITY, what, is_left_out=True))
    return found


def _levelled(p: PreparedSeries) -> Series:
    """The series; an accelerometer's without gravity through the pitch at which it is mounted."""
    if p.series.kind is not Kind.ACCEL or p.mounting is None or not len(p.series):
        return p.series
    values = p.series.values.copy()
    values[:, 0] -= STANDARD_GRAVITY_MPS2 * np.sin(p.mounting.nose_up_rad)
    return replace(p.series, values=values)


def _quantity(p: PreparedSeries) -> Quantity:
    return Quantity(p.series.source, p.series.kind)


def _one_per_source(found: Sequence[Contradiction]) -> tuple[Contradiction, ...]:
    """An IMU that contradicts gravity does so with both its quantities: told once."""
    first: dict[tuple[str, str], Contradiction] = {}
    for each in found:
        is_imu = each.against == GRAVITY and each.who.kind in RATES
        first.setdefault((each.who.source, GRAVITY if is_imu else str(each.who)), each)
    return tuple(first.values())
