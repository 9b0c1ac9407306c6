"""Inputs of which many messages could not be used."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from cwcli.channels.published import OWN_TOPIC_PREFIX
from cwcli.evaluation.doubts.base import DoubtRule, Finding
from cwcli.evaluation.doubts.evidence import MAX_NAME_CHARACTERS, DoubtEvidence
from cwcli.pipeline.records import read_finite_number_or_nan, read_input_counts
from cwcli.text import shorten_and_escape

MAX_REJECTED_SHARE = 0.05
"""Share of rejected messages of a topic above which it is doubted. Chosen: as for gated measurements."""


def find_rejected_inputs(evidence: DoubtEvidence) -> list[Finding]:
    """Return each topic of which too many messages were rejected, once."""
    found: dict[str, Finding] = {}
    for record in evidence.records.values():
        for entry in read_input_counts(record):
            topic = str(entry.get("topic"))
            if topic not in found and not topic.startswith(OWN_TOPIC_PREFIX):
                found.update((topic, each) for each in _iter_finding_if_too_many_rejected(topic, entry))
    return sorted(found.values(), key=lambda each: -each.value)


def _iter_finding_if_too_many_rejected(topic: str, entry: Mapping[str, Any]) -> Iterator[Finding]:
    reasons = entry.get("rejected")
    if not isinstance(reasons, dict) or not reasons:
        return
    counts = {str(reason): read_finite_number_or_nan(reasons, reason) for reason in reasons}
    n, n_rejected = read_finite_number_or_nan(entry, "read"), sum(counts.values())
    if n > 0 and n_rejected > MAX_REJECTED_SHARE * n:
        share, most = n_rejected / n, max(counts, key=lambda reason: counts[reason])
        name, why = (shorten_and_escape(text, MAX_NAME_CHARACTERS) for text in (topic, most))
        yield Finding(share, f"{100 * share:.0f} % of the messages of {name} could not be used (most: {why}).")


RULE = DoubtRule(
    summary="messages of an input that were rejected",
    short_name="rejected messages",
    threshold=MAX_REJECTED_SHARE,
    unit="share",
    source="chosen: as for gated measurements",
    advice="Look at the sensor, or at --map; --details lists the reasons.",
    find=find_rejected_inputs,
)
