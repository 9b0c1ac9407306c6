"""Which source is wrong where two contradict each other: the others vote before anything is estimated.

A source that two others contradict, while fewer agree with it, is outvoted and left out. Where two contradict each
other and no third tells which of them is wrong, the positions count, since without them there is no estimate, and the
other one is left out. Of two sources of which neither is a position both are left out then. Every case is told first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cwcli.estimation.check_words import Check
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
    out = {Quantity(each.who.source, kind) for each in tilted for kind in RATES}
    upright = [p for p in prepared if _quantity(p) not in out]
    compared = compare_sources([p.series for p in upright])
    # Where gravity shows how the IMU is mounted, a bias is mostly gravity, and no fault.
    level = {_quantity(p) for p in prepared if p.mounting is not None}
    compared = [c for c in compared if not (c.check is Check.ACCEL_BIAS and {c.one, c.other} & level)]
    voted = judge_comparisons(compared)
    out |= {quantity for each in voted for quantity in each.left_out}
    kept = [replace(p, series=without_rows(p.series)) if _quantity(p) in out else p for p in prepared]
    return Vote(kept, (*tilted, *voted))


def judge_comparisons(comparisons: Sequence[Comparison]) -> list[Contradiction]:
    """Find out who is wrong, one source after the other: the one that most others contradict comes first.

    Args:
        comparisons: Of all pairs.
    """
    left = [each for each in comparisons if each.judgement is not Judgement.UNKNOWN]
    found = []
    while contrary := [each for each in left if each.judgement is Judgement.CONTRADICT]:
        suspects = dict.fromkeys(who for each in contrary for who in (each.one, each.other))
        accused = [_accusation(left, who) for who in suspects]
        # A position is blamed only where it is outvoted, since without it there is no estimate.
        worst = max(accused, key=lambda each: (bool(each[0].allies), each[0].who.kind is not Kind.POSITION, each[1]))[0]
        by_position = isinstance(worst.against, Quantity) and worst.against.kind is Kind.POSITION
        out: tuple[Quantity, ...] = (worst.who,)
        if worst.who.kind is Kind.POSITION:
            out = ()
        elif not worst.allies and not by_position and isinstance(worst.against, Quantity):
            out = (worst.who, worst.against)  # either may be wrong, and the positions are left
        found.append(worst.without(*out))
        left = [each for each in left if not any(each.has(quantity) for quantity in (worst.who, *out))]
    return found


def _accusation(comparisons: Sequence[Comparison], who: Quantity) -> tuple[Contradiction, int]:
    """What contradicts a source, with the allies where it is outvoted, and how many more do than agree with it."""
    contrary = [each for each in comparisons if each.judgement is Judgement.CONTRADICT and each.has(who)]
    main = min(contrary, key=lambda each: each.opposite(who).kind is not Kind.POSITION)
    votes = _votes_against(comparisons, who)
    allies = _allies(comparisons, who, main.opposite(who), contrary) if votes > 0 else ()
    return replace(main.contradiction(who), allies=allies), votes


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
        if p.mean_force_mps2 is None or p.series.kind is not Kind.ACCEL or not len(p.series):
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
        imu = Quantity(p.series.source, Kind.IMU)
        found.append(Contradiction(imu, GRAVITY, what).without(imu))
    return found


def _quantity(p: PreparedSeries) -> Quantity:
    return Quantity(p.series.source, p.series.kind)
