"""Sentence on the consistency of an estimate, with its faults and what to do about them."""

from __future__ import annotations

import math
from collections.abc import Sequence

from cwcli.estimation.contradiction import SourceQuantity
from cwcli.estimation.limit_check import doubt_sentence_on_lasting_errors
from cwcli.estimation.measurements import KINDS_THAT_IMU_MEASURES_TOO, Kind
from cwcli.estimation.result import SourceReport, TrackSummary
from cwcli.estimation.tolerances import (
    MAX_BRIDGED_STATE_SHARE,
    MAX_GATED_ROW_SHARE,
    MIN_LOG_SPAN_FOR_SLOW_ERRORS_S,
    TOLERATED_SIGMA_FACTOR,
    TOLERATED_VARIANCE_FACTOR,
)
from cwcli.lazy_dataclass import dataclass
from cwcli.text import join_names

MAX_LISTED_FAULTS = 2
"""Greatest number of faults in the sentence; chosen for a short sentence."""


@dataclass(frozen=True)
class NeesOfQuantity:
    """Errors of a quantity relative to their covariance.

    Attributes:
        name: The quantity.
        per_dof: Mean of the normalised error squared by its degrees of freedom; 1 is expected.
        bounds: 95 % bounds of it, for as many independent errors as their autocorrelation leaves.
        truth_rule: By what rule the truth differs from the track all along, in words; "": by none.
        per_dof_without_rule: What is left of `per_dof` without that difference.
    """

    name: str
    per_dof: float
    bounds: tuple[float, float]
    truth_rule: str = ""
    per_dof_without_rule: float = math.nan

    @property
    def is_within_bounds(self) -> bool | None:
        """Whether it lies within its bounds; None where it is unknown."""
        return None if math.isnan(self.per_dof) else self.bounds[0] <= self.per_dof <= self.bounds[1]

    @property
    def is_too_large(self) -> bool:
        """Whether the errors are larger than their covariance says, by more than is tolerated."""
        return self.is_within_bounds is False and self.per_dof > TOLERATED_VARIANCE_FACTOR


def consistency_verdict_sentence(track: TrackSummary, nees: Sequence[NeesOfQuantity] = ()) -> str:
    """Whether the estimate is as good as it says; what was corrected of the input comes first.

    The worst comes first: sources of which one must be wrong, states that err by more than they say, sources that
    contradict the others, states that hang in the air, sources that are noisier than taken for, and what is better than
    it says. Corrections that the user asked for are not repeated. `nees` is used where there is a truth.
    """
    corrected = [each.sentence_on_fault_and_undoing for each in track.corrections if not each.is_by_user]
    before = f"input corrected: {'; '.join(corrected)}. With that: " if corrected else ""
    return before + _verdict_on_estimate(track, nees)


def _verdict_on_estimate(track: TrackSummary, nees: Sequence[NeesOfQuantity]) -> str:
    """Return the verdict on the estimate from what was used of the input."""
    sources = track.sources
    if not track.n_states:
        return "nothing was estimated"
    surer = _texts_on_errors_beyond_sigma([each for each in nees if each.is_too_large])
    bridged_share = track.n_flagged.get("bridged", 0) / track.n_states
    bridged = [f"{100 * bridged_share:.0f} % of the states bridge gaps: leave out those flagged bridged"]
    faults = [
        *(f"{each.contradiction_sentence} ({each.votes_and_left_out_sources_text})" for each in track.contradictions),
        *surer,
        *_contradiction_texts(sources),
        *(bridged if bridged_share > MAX_BRIDGED_STATE_SHARE else ()),
        *_understated_noise_texts(sources),
    ]
    if faults:
        more = f", and {len(faults) - MAX_LISTED_FAULTS} more" if len(faults) > MAX_LISTED_FAULTS else ""
        return f"not consistent: {'; '.join(faults[:MAX_LISTED_FAULTS])}{more}"
    agreed, exception = "consistent", _text_on_drift_that_no_source_shows(track, nees)
    if all(math.isnan(each.per_dof) for each in nees) and (doubt := doubt_sentence_on_lasting_errors(sources)):
        exception = f"; but {doubt}{exception}"
    if exception:
        agreed = "no contradiction"
    unchecked = [str(SourceQuantity(s.source, s.kind)) for s in sources if s.n_used and not s.is_checked]
    if unchecked and track.span_s < MIN_LOG_SPAN_FOR_SLOW_ERRORS_S and all(math.isnan(each.per_dof) for each in nees):
        # What no other source confirms may have any unit, sign or delay.
        agreed = f"too short to check {join_names(unchecked)}; no contradiction otherwise"
    careful = [
        *(
            f"{each.name} error"
            for each in nees
            if each.is_within_bounds is False and each.per_dof < TOLERATED_SIGMA_FACTOR**-2
        ),
        *(
            _source_and_quantity_text(s)
            for s in sources
            if s.nis_inside is False and _nis_per_dof(s) < TOLERATED_SIGMA_FACTOR**-2
        ),
    ]
    if careful:
        return f"{agreed}, with a covariance larger than necessary for {join_names(careful)}{exception}"
    outside = [_source_and_quantity_text(s) for s in sources if s.nis_inside is False]
    outside += [f"NEES of the {each.name}" for each in nees if each.is_within_bounds is False]
    if outside:
        return (
            f"{agreed} within a factor of {TOLERATED_SIGMA_FACTOR:g} in sigma: "
            f"{join_names(outside)} outside the 95 % bounds{exception}"
        )
    if any(s.nis_inside is not None for s in sources):
        return f"{agreed}{exception}"
    return "too little was measured to judge whether the estimate is consistent"


def _texts_on_errors_beyond_sigma(nees: Sequence[NeesOfQuantity]) -> list[str]:
    """Return what is wrong and what to do; quantities in which the truth differs by the same rule are told together."""
    by_rule: dict[str, list[NeesOfQuantity]] = {}
    for each in nees:
        by_rule.setdefault(each.truth_rule, []).append(each)
    return [
        f"the truth ({join_names([each.name for each in of_rule])}) {rule}: check that first (without "
        f"it the error is {math.sqrt(max(each.per_dof_without_rule for each in of_rule)):.1f} times its sigma)"
        for rule, of_rule in by_rule.items()
        if rule
    ] + [
        f"the {each.name} error is {math.sqrt(each.per_dof):.1f} times its sigma: multiply its covariance by "
        f"{each.per_dof:.2g}"
        for each in by_rule.get("", [])
    ]


def _text_on_drift_that_no_source_shows(track: TrackSummary, nees: Sequence[NeesOfQuantity]) -> str:
    """Return what the verdict does not cover: a drift, scale or jump of the only position, unless others show it.

    A truth shows a drift, and so does the way by a speed and a heading or turn rate (docs/estimation.md). The
    acceleration of an IMU does not, as the grade of the road changes it by more than a drift of minutes; nor does the
    velocity of a receiver, which is smoothed. In short logs slow errors are not searched.
    """
    used = [s for s in track.sources if s.n_used]
    positions = {s.source for s in used if s.kind is Kind.POSITION}
    if len(positions) != 1 or any(each.is_within_bounds is not None for each in nees):
        return ""
    gap_s, jump_m = next(s.gap_s_and_hidden_jump_m for s in used if s.kind is Kind.POSITION)
    fixes = next(iter(positions))
    jump = (
        ""
        if math.isnan(jump_m)
        else f"; {fixes} may lie up to {jump_m:.0f} m elsewhere since it paused for {gap_s:.0f} s"
    )
    kinds = {s.kind for s in used}
    missing = [
        name
        for name, measuring_kinds in (
            ("wheel speed", {Kind.SPEED}),
            ("heading or turn rate", {Kind.HEADING, Kind.YAW_RATE}),
        )
        if not kinds & measuring_kinds
    ]
    if track.span_s < MIN_LOG_SPAN_FOR_SLOW_ERRORS_S:
        unseen = f"a slow drift, another scale or wrong axes of {fixes}"
        return f"; in {track.span_s:.0f} s {unseen} may not show{jump}"
    if not missing:
        return jump
    unseen = f"a slow drift or another scale of {fixes}"
    return f"; {unseen} would not show, because no {' and no '.join(missing)} is measured{jump}"


def _contradiction_texts(sources: Sequence[SourceReport]) -> list[str]:
    found = []
    for s in sources:
        n = s.n_used + s.n_gated
        if n and s.n_gated > MAX_GATED_ROW_SHARE * n:
            found.append(
                f"{100 * s.n_gated / n:.0f} % of {_source_and_quantity_text(s)} contradict the rest: check its stamps "
                "and its mounting"
            )
        elif s.n_resets and s.kind not in KINDS_THAT_IMU_MEASURES_TOO:
            found.append(
                f"{_source_and_quantity_text(s)} jumped {s.n_resets} x: leave out the states flagged after_reset"
            )
    return found


def _understated_noise_texts(sources: Sequence[SourceReport]) -> list[str]:
    return [
        f"{_source_and_quantity_text(s)} scatters by {math.sqrt(_nis_per_dof(s)):.1f} times its sigma: "
        f"{'its messages understate its noise' if s.noise_origin.startswith('message') else 'its errors last'}, "
        "so trust the states less than their covariance"
        for s in sources
        if s.nis_inside is False and _nis_per_dof(s) > TOLERATED_VARIANCE_FACTOR
    ]


def _nis_per_dof(s: SourceReport) -> float:
    return s.nis_mean / s.nis_dof


def _source_and_quantity_text(s: SourceReport) -> str:
    return f"{s.source} {s.kind.name.lower().replace('_', ' ')}"
