"""Find the hypothesis that explains why a source contradicts the others.

For each suspect every hypothesis of its kind is compared with the other sources over the whole log
(`step_evidence`). A hypothesis wins where all of the following hold:

- it predicts the steps better than the values as they are by MIN_LOG_LIKELIHOOD_GAIN_OF_HYPOTHESIS,
- it predicts them better than every hypothesis with another effect by MIN_LOG_LIKELIHOOD_MARGIN_TO_NEXT,
- with it the source contradicts no other source any more, agrees with at least one, and the ratio that is left over
  is near 1, so that a fault that is not on the list is not taken for one that is,
- no hypothesis on another source does the same; that of a position does not count, because a map shows a wrong one.
  A position is only corrected where nothing else explains the contradiction, not even in several ways.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from cwcli.estimation.check_texts import SourceComparisonCheck
from cwcli.estimation.contradiction import SourceQuantity
from cwcli.estimation.hypotheses import UNIT_AND_CONVENTION_HYPOTHESES_BY_KIND
from cwcli.estimation.hypotheses.base import Hypothesis, with_pairwise_combinations
from cwcli.estimation.measurements import Kind
from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.source_checks import (
    Judgement,
    SourceComparison,
    compare_all_source_pairs,
    reverse_fix_courses_while_reversing,
)
from cwcli.estimation.step_evidence import StepResiduals, log_likelihood_gains_of_candidates, step_residuals_of_pair
from cwcli.estimation.step_motion import StepMotion, compute_step_motion_by_source, step_edges_s
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray

MIN_LOG_LIKELIHOOD_GAIN_OF_HYPOTHESIS = 15.0
"""Least gain in log-likelihood of a hypothesis. Chosen: a fault is a thousand times less likely than none and there are
up to a hundred hypotheses (11.5), and the errors of neighbouring steps are not independent; not fitted."""
MIN_LOG_LIKELIHOOD_MARGIN_TO_NEXT = 5.0
"""Least gain over the next hypothesis with another effect: odds of 150 to 1. Chosen by hand; not fitted."""
LOG_LIKELIHOOD_COST_OF_SECOND_FAULT = 3.0
"""Log-likelihood that a second fault of a source must gain: odds of 20 to 1. Chosen by hand; not fitted."""
MAX_DISTANCE_RATIO_ERROR = 0.05
"""Greatest relative difference from 1 of the ratio of ways after a correction: worn tyres and noise; the steps from
feet/s to km/h and from knots to miles/h are twice as large. Chosen by hand; not fitted."""
MAX_TURN_OR_SPEED_CHANGE_RATIO_ERROR = 0.15
"""Greatest relative difference from 1 of the ratio of turns, or of changes of speed, after a correction. Chosen by
hand: latencies and slopes change it."""
EVIDENCE_STEP_S = 2.0
"""Length of the steps, s: longer than sensors are late and shorter than a turn. Chosen by hand."""
MAX_CHORD_SPEED_SIGMA_MPS = 0.7
"""Greatest sigma of a speed by two fixes; with noisier fixes the steps are longer. Chosen by hand; not fitted."""
MAX_EVIDENCE_STEP_S = 8.0
"""Greatest length of the steps, s. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class Finding:
    """A hypothesis that explains the contradictions of a source.

    Attributes:
        who: The source.
        hypothesis: What is wrong with it.
        gain: Log-likelihood beyond that of the values as they are.
        judges: Sources that agree with the corrected one.
    """

    who: SourceQuantity
    hypothesis: Hypothesis
    gain: float
    judges: tuple[SourceQuantity, ...]

    @property
    def evidence_text(self) -> str:
        """Text on what shows it."""
        judges = ", ".join(dict.fromkeys(each.source for each in self.judges))
        return f"log-likelihood ratio {self.gain:.0f} by {judges}"


def step_motions_and_edges_for_evidence(series: Sequence[SensorSeries]) -> tuple[list[StepMotion], FloatArray]:
    """Return the motions of the series in steps for the likelihood, and the edges (n + 1,) of the steps, s.

    Args:
        series: Series with rows, at least one a position.
    """
    step_s = EVIDENCE_STEP_S
    while True:
        edges_s = step_edges_s(series, step_s)
        if len(edges_s) < 2:
            return [], edges_s
        motions = [compute_step_motion_by_source(s, edges_s) for s in series]
        best = min(m.speed_sigma_mps for m in motions if m.kind is Kind.POSITION)
        if best <= MAX_CHORD_SPEED_SIGMA_MPS or step_s >= MAX_EVIDENCE_STEP_S:
            return reverse_fix_courses_while_reversing(motions), edges_s
        step_s *= 2.0


def find_fault(series: Sequence[SensorSeries], suspect_index: int, *, may_be_ambiguous: bool = False) -> Finding | None:
    """Return the hypothesis that clearly wins for one series, or None.

    Args:
        series: Series with rows, positions first; none of an IMU that is suspected.
        suspect_index: Index of the suspect.
        may_be_ambiguous: Whether another hypothesis on the same source may explain it as well: on a straight road a
            heading may count from south, or clockwise from north.
    """
    own = series[suspect_index]
    who = SourceQuantity(own.source, own.kind)
    hypotheses = with_pairwise_combinations(UNIT_AND_CONVENTION_HYPOTHESES_BY_KIND.get(own.kind, ()))
    if not hypotheses:
        return None
    motions, edges_s = step_motions_and_edges_for_evidence(series)
    if not motions:
        return None
    others = [m for i, m in enumerate(motions) if i != suspect_index]

    def step_residuals_against_others(s: SensorSeries) -> list[StepResiduals]:
        motion = compute_step_motion_by_source(s, edges_s)
        return [each for other in others for each in step_residuals_of_pair(motion, other)]

    gains = log_likelihood_gains_of_candidates(
        step_residuals_against_others(own), [step_residuals_against_others(h.correct_series(own)) for h in hypotheses]
    )
    ranked = sorted(
        zip(hypotheses, gains, strict=True),
        key=lambda each: each[1] - LOG_LIKELIHOOD_COST_OF_SECOND_FAULT * ("+" in each[0].name),
        reverse=True,
    )
    best, gain = ranked[0]
    is_ambiguous = len(ranked) > 1 and gain - ranked[1][1] < MIN_LOG_LIKELIHOOD_MARGIN_TO_NEXT
    if gain < MIN_LOG_LIKELIHOOD_GAIN_OF_HYPOTHESIS or (is_ambiguous and not may_be_ambiguous):
        return None
    corrected = [*series[:suspect_index], best.correct_series(own), *series[suspect_index + 1 :]]
    judges = sources_agreeing_after_correction(compare_all_source_pairs(corrected), who)
    return Finding(who, best, gain, judges) if judges else None


def sources_agreeing_after_correction(
    comparisons: Sequence[SourceComparison],
    who: SourceQuantity,
    max_rate_error: float = MAX_TURN_OR_SPEED_CHANGE_RATIO_ERROR,
) -> tuple[SourceQuantity, ...]:
    """Return the sources that agree with a corrected source; () if one still contradicts it or its ratio is off.

    Args:
        comparisons: Comparisons of all pairs.
        who: The corrected source.
        max_rate_error: Greatest relative difference from 1 of the ratio of turns and of changes of speed.
    """
    own = [each for each in comparisons if each.involves_source(who)]
    if any(each.judgement is Judgement.CONTRADICT for each in own):
        return ()
    agreeing = [
        each for each in own if each.judgement is Judgement.AGREE and each.other_source(who).source != who.source
    ]
    for each in agreeing:
        limit = {
            SourceComparisonCheck.WAY: MAX_DISTANCE_RATIO_ERROR,
            SourceComparisonCheck.TURN: max_rate_error,
            SourceComparisonCheck.SPEED_CHANGE: max_rate_error,
        }.get(each.check, math.inf)
        if abs(each.number - 1.0) > limit:
            return ()
    return tuple(dict.fromkeys(each.other_source(who) for each in agreeing))
