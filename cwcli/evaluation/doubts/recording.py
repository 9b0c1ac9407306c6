"""Doubts about the recording: its log times, late, rejected and lost messages."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from cwcli.channels.published import EGO_ONLINE, OWN_TOPIC_PREFIX
from cwcli.estimation.tolerances import MAX_UNREPORTED_STATE_DELAY_S
from cwcli.evaluation.doubts.base import DoubtRule, Finding
from cwcli.evaluation.doubts.evidence import MAX_TOPIC_CHARACTERS, DoubtEvidence
from cwcli.pipeline.records import read_finite_number_or_nan, read_input_counts, to_float_or_nan
from cwcli.signals.units import NS_PER_S
from cwcli.text import format_duration, shorten_and_escape

MAX_UNDOUBTED_TIME_WITHOUT_CAR_STATE_H = 24.0
"""Longest time in h within a log without a state of the car. Chosen by hand: a drive is shorter than a day."""


def find_holes_in_log_times(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield the longest time within the log that has no state of the ego, before, between or after its states."""
    if evidence.ego is None or not len(evidence.ego):
        return
    first_ns, last_ns = int(evidence.start_ns), int(evidence.end_ns)
    inner = evidence.ego.stamp_ns[(evidence.ego.stamp_ns >= first_ns) & (evidence.ego.stamp_ns <= last_ns)]
    stamps_s = np.concatenate([[0.0], np.sort(inner - first_ns) / NS_PER_S, [(last_ns - first_ns) / NS_PER_S]])
    hole_s = float(np.diff(stamps_s).max())
    if hole_s > MAX_UNDOUBTED_TIME_WITHOUT_CAR_STATE_H * 3600.0:
        length = format_duration((last_ns - first_ns) / NS_PER_S)
        yield Finding(
            hole_s / 3600.0,
            f"The log is {length} long, and {format_duration(hole_s)} without interruption have no state of the car.",
        )


LOG_TIME_HOLES_RULE = DoubtRule(
    summary="log times far from the states",
    short_name="log times",
    threshold=MAX_UNDOUBTED_TIME_WITHOUT_CAR_STATE_H,
    unit="h",
    source="chosen: a drive is shorter than a day",
    advice="Look at the log times with `cwcli info --doctor`, and leave the wrong ones out with --start and --end.",
    find=find_holes_in_log_times,
)


def find_late_states(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield the delay of the ego's online states that 95 % of them keep."""
    for topic, delay in evidence.estimate_summary.rows_of_table_columns_or_empty(
        "online", "channel", "95 % of delays below [s]"
    ):
        delay_s = to_float_or_nan(delay) if isinstance(delay, int | float) else 0.0
        if topic == EGO_ONLINE.topic and delay_s > MAX_UNREPORTED_STATE_DELAY_S:
            yield Finding(
                delay_s,
                f"A car could have known these states only {delay_s:.1f} s late, so warnings come as late.",
            )


LATE_STATES_RULE = DoubtRule(
    summary="online states that could be known only late (95 % of them within this time)",
    short_name="late states",
    threshold=MAX_UNREPORTED_STATE_DELAY_S,
    unit="s",
    source="chosen: a second is what a driver needs to react",
    advice="Check the stamps against the log times; --clock log uses the log times.",
    find=find_late_states,
    is_of_whole_log=True,
)


MAX_UNDOUBTED_REJECTED_SHARE = 0.05
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
    if n > 0 and n_rejected > MAX_UNDOUBTED_REJECTED_SHARE * n:
        share, most = n_rejected / n, max(counts, key=lambda reason: counts[reason])
        name, why = (shorten_and_escape(text, MAX_TOPIC_CHARACTERS) for text in (topic, most))
        yield Finding(share, f"{100 * share:.0f} % of the messages of {name} could not be used (most: {why}).")


REJECTED_MESSAGES_RULE = DoubtRule(
    summary="messages of an input that were rejected",
    short_name="rejected messages",
    threshold=MAX_UNDOUBTED_REJECTED_SHARE,
    unit="share",
    source="chosen: as for gated measurements",
    advice="Look at the sensor, or at --map; --details lists the reasons.",
    find=find_rejected_inputs,
    is_of_whole_log=True,
)


MIN_FAULTS_FOR_DOUBT = 1
"""Number of faults of the file from which its results are doubted. Chosen by hand: nobody knows what one has lost."""


def find_file_faults(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield what is wrong with the file."""
    faults = {reason: n for reason, n in evidence.faults.items() if n > 0}
    if faults:
        most = max(faults, key=lambda reason: faults[reason])
        count = f": {faults[most]}" if faults[most] > 1 else ""
        more = f", and {len(faults) - 1} more" if len(faults) > 1 else ""
        yield Finding(float(sum(faults.values())), f"The file is damaged ({shorten_and_escape(most)}{count}{more}).")


DAMAGED_FILE_RULE = DoubtRule(
    summary="a damaged file",
    short_name="damaged file",
    threshold=MIN_FAULTS_FOR_DOUBT,
    unit="",
    source="chosen: the lost part is not known",
    advice="Copy or record it again; the intact parts were used.",
    find=find_file_faults,
)
