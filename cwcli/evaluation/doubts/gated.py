"""A source of which the estimator had to reject many measurements."""

from __future__ import annotations

from collections.abc import Iterator

from cwcli.estimation.tolerances import MAX_GATED_SHARE
from cwcli.evaluation.doubts.base import DoubtRule, Finding
from cwcli.evaluation.doubts.evidence import DoubtEvidence, source_name
from cwcli.pipeline.records import read_finite_number_or_nan


def find_gated_sources(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield each source of the ego that contradicts the others too often."""
    for source in evidence.ego_sources:
        gated, n = (
            read_finite_number_or_nan(source, "gated"),
            read_finite_number_or_nan(source, "gated") + read_finite_number_or_nan(source, "used"),
        )
        if n > 0 and gated > MAX_GATED_SHARE * n:
            share = gated / n
            yield Finding(
                share, f"{100 * share:.0f} % of the measurements of {source_name(source)} contradict the other sources."
            )


RULE = DoubtRule(
    summary="a source whose measurements the gate rejects",
    short_name="rejected measurements",
    threshold=MAX_GATED_SHARE,
    unit="share",
    source="chosen: as in the verdict of `estimate`",
    advice="Check its stamps and its mounting.",
    find=find_gated_sources,
)
