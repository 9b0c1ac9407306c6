"""A log without a truth: its errors are not known. It is a remark, because most drives have none."""

from __future__ import annotations

import re
from collections.abc import Iterator

from cwcli.evaluation.doubts.base import DoubtRule, Finding
from cwcli.evaluation.doubts.evidence import DoubtEvidence
from cwcli.text import shorten_and_escape

SEVERAL_TRUTHS = "hold the truth"
"""Words in the note of `estimate` that several channels could be the truth, so that none was used."""
_TRUTH_OPTION_PATTERN = re.compile(r"--topic truth=[^\s,)]+")
"""An option in that note that chooses one of them."""


def find_estimate_without_truth(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield a remark if the ego was estimated and nothing tells its errors."""
    if evidence.ego is not None and not evidence.estimate_summary.column_cells("nees", "error of"):
        choice = next((note for note in evidence.estimate_summary.notes if SEVERAL_TRUTHS in note), "")
        reason = (
            "The log has several channels of true positions"
            if choice
            else "The log has no true positions to compare with"
        )
        options = " or ".join(dict.fromkeys(_TRUTH_OPTION_PATTERN.findall(choice)))
        hint = f"; choose one with {shorten_and_escape(options)}" if options else ""
        yield Finding(0.0, f"{reason}, so the size of the errors is not known{hint}.")


RULE = DoubtRule(
    summary="no truth of the car (a remark, not counted as a doubt)",
    threshold=1,
    unit="",
    source="one truth is enough",
    advice="Name one with --topic truth=TOPIC if it has.",
    find=find_estimate_without_truth,
    is_remark=True,
)
