"""A log without a truth: its errors are not known. It is a remark, because most drives have none."""

from __future__ import annotations

from collections.abc import Iterator

from cwcli.evaluation.doubts.base import DoubtRule, Finding
from cwcli.evaluation.doubts.evidence import DoubtEvidence


def find_missing_truth(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield a remark if the ego was estimated and nothing tells its errors."""
    if evidence.ego is not None and not evidence.estimate_summary.column_cells("nees", "error of"):
        yield Finding(0.0, "No truth of the car was used: how far the estimate errs is not known.")


RULE = DoubtRule(
    summary="no truth of the car (a remark, not counted as a doubt)",
    threshold=1,
    unit="",
    source="one truth is enough",
    advice="Name one with --topic truth=TOPIC if it has.",
    find=find_missing_truth,
    is_remark=True,
)
