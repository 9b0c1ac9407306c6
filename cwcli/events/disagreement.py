"""Disagreements: one of two systems warns, and the other one does not."""

from __future__ import annotations

from collections.abc import Iterator

from cwcli.events.base import EventKind, Moment, severity_as_ratio_to_threshold
from cwcli.events.evidence import EventEvidence
from cwcli.signals.units import NS_PER_S

MAX_OFFSET_OF_AGREEING_WARNINGS_S = 1.0
"""Warnings of both that are at most this far apart agree, s. Chosen by hand: a driver's reaction time."""
DURATION_OF_SEVERITY_1_S = 1.0
"""A disagreement over this time has severity 1, s. Chosen by hand."""


def find_disagreements(evidence: EventEvidence) -> Iterator[Moment]:
    """Yield the warnings of either system that the other one does not give."""
    own = [(each.raised_ns, each.last_ns) for each in evidence.warnings]
    others = evidence.other_warning_spans_ns
    assert evidence.other_system is not None  # reading its warnings requires it
    for spans, against, kind in ((own, others, "only cwcli warns"), (others, own, "only the other warns")):
        for start_ns, end_ns in spans:
            margin_ns = MAX_OFFSET_OF_AGREEING_WARNINGS_S * NS_PER_S
            if any(start_ns - margin_ns <= last and end_ns + margin_ns >= first for first, last in against):
                continue
            lasted_s = (end_ns - start_ns) / NS_PER_S
            severity = max(severity_as_ratio_to_threshold(lasted_s, DURATION_OF_SEVERITY_1_S, "high"), 1.0)
            actors = ("ego", evidence.other_system.warning)
            yield Moment(start_ns, end_ns, actors, lasted_s, severity, kind, f"{kind}, for {lasted_s:.1f} s")


EVENT = EventKind(
    summary="one of two systems warns, the other does not",
    value_name="duration_s",
    threshold=f"no warning of the other within {MAX_OFFSET_OF_AGREEING_WARNINGS_S:g} s",
    source="chosen: a driver's reaction time",
    needs="warnings, --topic warning=",
    find=find_disagreements,
)
