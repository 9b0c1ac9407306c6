"""Sources that were wrong in a known way and were corrected: the estimate is as good as that judgement."""

from __future__ import annotations

from collections.abc import Iterator

from cwcli.evaluation.doubts.base import DoubtRule, Finding
from cwcli.evaluation.doubts.evidence import DoubtEvidence
from cwcli.text import shorten_and_escape

MAX_UNDOUBTED_CORRECTIONS = 1
"""Number of corrected sources from which the estimate is doubted. Chosen by hand: the user should see every one."""
ADVICE_WITH_AN_OPTION = "Check that sensor, or mend the recording."
"""The advice where the sentence on the correction names the option for it already."""


def find_corrections(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield each source that the estimator corrected by itself."""
    found = evidence.estimate_summary.corrections
    for sentence in found:
        # a sentence that names an option says by itself how to confirm what it is about
        advice = ADVICE_WITH_AN_OPTION if "; --" in sentence else ""
        yield Finding(float(len(found)), f"{shorten_and_escape(sentence).rstrip('.')}.", advice)


RULE = DoubtRule(
    summary="sources that were corrected",
    short_name="corrected sources",
    threshold=MAX_UNDOUBTED_CORRECTIONS,
    unit="",
    source="chosen: each is shown",
    advice="Mend the recording, or confirm it with --as.",
    find=find_corrections,
)
