"""Doubts: reasons not to believe the results on a log, over its whole length."""

from __future__ import annotations

from collections.abc import Iterator

from cwcli.evaluation.doubts import find_doubts
from cwcli.events.base import EventKind, Moment, severity_as_ratio_to_threshold
from cwcli.events.evidence import EventEvidence


def find_doubtful_logs(evidence: EventEvidence) -> Iterator[Moment]:
    """Yield the doubts about the log, the worst first."""
    log = evidence.log
    for doubt in find_doubts(log):
        severity = (
            severity_as_ratio_to_threshold(abs(doubt.value), abs(doubt.threshold), "high") if doubt.threshold else 1.0
        )
        severity = max(severity, 1.0)
        yield Moment(log.start_ns, log.end_ns, ("ego",), doubt.value, severity, doubt.name, doubt.sentence)


EVENT = EventKind(
    summary="a reason not to believe the results on a log",
    value_name="doubt",
    threshold="",
    source="docs/digest.md",
    needs="states",
    find=find_doubtful_logs,
)
