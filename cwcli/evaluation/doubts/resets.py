"""An estimate that had to begin anew, because a source jumped and stayed there."""

from __future__ import annotations

from collections.abc import Iterator

from cwcli.evaluation.doubts.base import DoubtRule, Finding
from cwcli.evaluation.doubts.evidence import DoubtEvidence, source_name
from cwcli.pipeline.records import read_finite_number_or_nan
from cwcli.text import format_count

MAX_RESETS = 1
"""Number of resets from which the estimate is doubted. Chosen by hand: a jump is never the car's motion."""


def find_resets(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield each source that was believed again only after repeated rejections."""
    for source in evidence.ego_sources:
        n = read_finite_number_or_nan(source, "resets")
        if n >= MAX_RESETS:
            yield Finding(n, f"{source_name(source)} jumped {format_count(int(n), 'time')}, and the track with it.")


RULE = DoubtRule(
    summary="a track that jumps because a source jumped",
    short_name="jumps",
    threshold=MAX_RESETS,
    unit="",
    source="chosen: no car jumps",
    advice="Do not use the states flagged after_reset.",
    find=find_resets,
)
