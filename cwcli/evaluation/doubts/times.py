"""Log times that are far from those of the states."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cwcli.evaluation.doubts.base import DoubtRule, Finding
from cwcli.evaluation.doubts.evidence import DoubtEvidence
from cwcli.signals.units import NS_PER_S
from cwcli.text import format_duration

MAX_HOLE_H = 24.0
"""Longest time in h within a log without a state of the car. Chosen by hand: a drive is shorter than a day."""


def find_holes_in_log_times(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield the longest time within the log that has no state of the ego, before, between or after its states."""
    if evidence.ego is None or not len(evidence.ego):
        return
    first_ns, last_ns = int(evidence.start_ns), int(evidence.end_ns)
    inner = evidence.ego.stamp_ns[(evidence.ego.stamp_ns >= first_ns) & (evidence.ego.stamp_ns <= last_ns)]
    stamps_s = np.concatenate([[0.0], np.sort(inner - first_ns) / NS_PER_S, [(last_ns - first_ns) / NS_PER_S]])
    hole_s = float(np.diff(stamps_s).max())
    if hole_s > MAX_HOLE_H * 3600.0:
        length = format_duration((last_ns - first_ns) / NS_PER_S)
        yield Finding(
            hole_s / 3600.0,
            f"The log is {length} long, and {format_duration(hole_s)} without interruption have no state of the car.",
        )


RULE = DoubtRule(
    summary="log times far from the states",
    short_name="log times",
    threshold=MAX_HOLE_H,
    unit="h",
    source="chosen: a drive is shorter than a day",
    advice="Look at the log times with `cwcli info --doctor`, and leave the wrong ones out with --start and --end.",
    find=find_holes_in_log_times,
)
