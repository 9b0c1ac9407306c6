"""Sources that were wrong in a known way and were corrected: the estimate is as good as that judgement."""

from __future__ import annotations

from collections.abc import Iterator

from cwcli.evaluation.doubts.base import DoubtRule, Finding
from cwcli.evaluation.doubts.evidence import DoubtEvidence
from cwcli.text import shorten_and_escape

MAX_UNDOUBTED_CORRECTIONS = 1
"""Number of corrected sources from which the estimate is doubted. Chosen by hand: the user should see every one."""


def find_corrections(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield each source that the estimator corrected by itself."""
    found = evidence.estimate_summary.corrections
    for sentence in found:
        yield Finding(float(len(found)), f"{shorten_and_escape(sentence).rstrip('.')}.")


RULE = DoubtRule(
    summary="sources that were corrected",
    threshold=MAX_UNDOUBTED_CORRECTIONS,
    unit="",
    source="chosen: each is shown",
    advice="Mend the recording, or confirm it with --as.",
    find=find_corrections,
)
