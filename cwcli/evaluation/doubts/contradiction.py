"""Sources that contradict each other: one of them is wrong."""

from __future__ import annotations

from collections.abc import Iterator

from cwcli.evaluation.doubts.base import DoubtRule, Finding
from cwcli.evaluation.doubts.evidence import DoubtEvidence, name_sources_in_words

MAX_CONTRADICTIONS = 1
"""Number of contradictions from which the estimate is doubted. Chosen by hand: one is enough to spoil it."""


def find_contradictions(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield each contradiction that the estimator found."""
    found = evidence.estimate_summary.contradictions
    for sentence in found:
        yield Finding(float(len(found)), name_sources_in_words(sentence))


RULE = DoubtRule(
    summary="sources that contradict each other",
    short_name="contradicting sources",
    threshold=MAX_CONTRADICTIONS,
    unit="",
    source="chosen: one spoils the estimate",
    advice="Find out which of them is wrong, and leave it out or correct it with --topic or --map.",
    find=find_contradictions,
)
