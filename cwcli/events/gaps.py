"""GNSS outages and gaps of other sensors, from the times of their messages: nothing is decoded for them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cwcli.channels.published import EGO_STATE
from cwcli.channels.vehicle_state import KINEMATIC_AND_FLAG_FIELDS, read_vehicle_states
from cwcli.events.base import EventKind, Moment, severity_as_ratio_to_threshold
from cwcli.events.evidence import NEVER_PAUSING_SENSOR_ROLES, EventEvidence
from cwcli.signals.columns import Int64Array
from cwcli.signals.role import Role
from cwcli.signals.row_order import first_and_last_rows_of_runs
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import StateFlag

MIN_POSITION_OUTAGE_S = 2.0
"""Least time without a position that is an outage, s. Chosen by hand: an estimate bridges less without notice."""
MIN_MESSAGE_GAP_S = 0.5
"""Least time without a message that is a gap, s. Chosen by hand: longer than `estimate` interpolates."""
MIN_GAP_IN_USUAL_INTERVALS = 5.0
"""A gap is at least so many usual intervals of its topic. Chosen by hand."""
MIN_MESSAGES_FOR_USUAL_INTERVAL = 20
"""Topics with fewer messages have no usual interval. Chosen by hand."""
MAX_USUAL_SENSOR_INTERVAL_S = 1.0
"""Topics with a longer usual interval are no sensors without pause, s. Chosen by hand."""


def find_outages(evidence: EventEvidence) -> Iterator[Moment]:
    """Yield the times without a position: between two messages, and where the states bridge unusable ones."""
    found = []
    topics = evidence.topics_of_roles((Role.EGO_POSITION,))
    for topic in topics[:1]:
        found += [(span, topic) for span in _gap_spans_ns(evidence.message_times_ns(topic), MIN_POSITION_OUTAGE_S)]
    for span in _bridged_spans_ns(evidence):
        if not any(span[0] <= end and span[1] >= start for (start, end), _ in found):
            found.append((span, topics[0] if topics else EGO_STATE.topic))
    for (start_ns, end_ns), topic in sorted(found):
        lasted_s = (end_ns - start_ns) / NS_PER_S
        severity = severity_as_ratio_to_threshold(lasted_s, MIN_POSITION_OUTAGE_S, "high")
        words = f"no usable position for {lasted_s:.1f} s"
        yield Moment(start_ns, end_ns, (topic,), lasted_s, severity, words=words)


def _bridged_spans_ns(evidence: EventEvidence) -> list[tuple[int, int]]:
    """Return the spans in which the ego's states bridge a gap without a usable position [ns]; [] without states."""
    log = evidence.log
    if all(channel.topic != EGO_STATE.topic for channel in log.channels):
        return []
    states = read_vehicle_states(log.columns(EGO_STATE.topic, KINEMATIC_AND_FLAG_FIELDS), with_covariance=False)
    is_bridged = states.flags & np.uint8(StateFlag.BRIDGED) != 0
    spans = [
        (int(states.stamp_ns[first]), int(states.stamp_ns[last]))
        for first, last in first_and_last_rows_of_runs(is_bridged)
    ]
    return [span for span in spans if span[1] - span[0] >= MIN_POSITION_OUTAGE_S * NS_PER_S]


def find_sensor_gaps(evidence: EventEvidence) -> Iterator[Moment]:
    """Yield the times in which a sensor without pause sends nothing."""
    positions = evidence.topics_of_roles((Role.EGO_POSITION,))
    for topic in evidence.topics_of_roles(NEVER_PAUSING_SENSOR_ROLES):
        if topic in positions:
            continue
        for start_ns, end_ns in _gap_spans_ns(evidence.message_times_ns(topic), MIN_MESSAGE_GAP_S):
            lasted_s = (end_ns - start_ns) / NS_PER_S
            severity = severity_as_ratio_to_threshold(lasted_s, MIN_MESSAGE_GAP_S, "high")
            yield Moment(start_ns, end_ns, (topic,), lasted_s, severity, words=f"no message for {lasted_s:.1f} s")


def _gap_spans_ns(times_ns: Int64Array, min_s: float) -> list[tuple[int, int]]:
    """Return the times of the messages before and after each gap [ns]."""
    if len(times_ns) < MIN_MESSAGES_FOR_USUAL_INTERVAL:
        return []
    apart_ns = np.diff(times_ns)
    usual_ns = float(np.median(apart_ns))
    if usual_ns > MAX_USUAL_SENSOR_INTERVAL_S * NS_PER_S:
        return []
    rows = np.flatnonzero(apart_ns >= max(min_s * NS_PER_S, MIN_GAP_IN_USUAL_INTERVALS * usual_ns))
    return [(int(times_ns[row]), int(times_ns[row + 1])) for row in rows.tolist()]


OUTAGE_EVENT = EventKind(
    summary="no position of the ego",
    value_name="duration_s",
    threshold=f"{MIN_POSITION_OUTAGE_S:g} s",
    source="chosen",
    needs="positions",
    find=find_outages,
)
GAP_EVENT = EventKind(
    summary="a sensor of the ego sends nothing",
    value_name="duration_s",
    threshold=f"{MIN_MESSAGE_GAP_S:g} s, and {MIN_GAP_IN_USUAL_INTERVALS:g} usual intervals",
    source="chosen",
    needs="sensors",
    find=find_sensor_gaps,
)
