"""Stop-and-go: the ego stops again and again with slow driving between."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cwcli.events.base import EventKind, Moment, severity_as_ratio_to_threshold
from cwcli.events.evidence import EventEvidence, lasting_row_spans
from cwcli.signals.units import NS_PER_S

MAX_STOPPED_SPEED_MPS = 0.5
"""Below this speed a car stands, m/s. Chosen by hand: above the noise of estimated speeds."""
MIN_STOP_DURATION_S = 1.0
"""Shorter stops do not count, s. Chosen by hand."""
MAX_TIME_BETWEEN_STOPS_S = 60.0
"""Stops that are farther apart do not belong together, s. Chosen by hand."""
MAX_SPEED_BETWEEN_STOPS_MPS = 12.0
"""Faster driving between two stops is a road with traffic lights, m/s. Chosen by hand: about 43 km/h."""
MIN_SPEED_BETWEEN_STOPS_MPS = 1.5
"""Slower motion between two stops is a standing car's noise, or its creeping, m/s. Chosen by hand: walking pace."""
MIN_STOPS_OF_STOP_AND_GO = 2
"""Least number of stops."""


def find_stop_and_go(evidence: EventEvidence) -> Iterator[Moment]:
    """Yield the stretches of stop-and-go, from the beginning of the first stop to the end of the last one."""
    stamp_ns, speed_mps = evidence.stamp_ns, evidence.ego_state[:, 2]
    stops = lasting_row_spans(
        np.abs(speed_mps) < MAX_STOPPED_SPEED_MPS, stamp_ns, min_s=MIN_STOP_DURATION_S, max_pause_s=0.3
    )
    group: list[tuple[int, int]] = []
    groups = [group]
    for stop in stops:
        if group:
            top_mps = speed_mps[group[-1][1] : stop[0] + 1].max()
            if top_mps < MIN_SPEED_BETWEEN_STOPS_MPS:  # it is one stop
                group[-1] = group[-1][0], stop[1]
                continue
            apart_s = (stamp_ns[stop[0]] - stamp_ns[group[-1][1]]) / NS_PER_S
            if apart_s > MAX_TIME_BETWEEN_STOPS_S or top_mps > MAX_SPEED_BETWEEN_STOPS_MPS:
                group = []
                groups.append(group)
        group.append(stop)
    for each in groups:
        if len(each) >= MIN_STOPS_OF_STOP_AND_GO:
            span = int(stamp_ns[each[0][0]]), int(stamp_ns[each[-1][1]])
            severity = severity_as_ratio_to_threshold(len(each), MIN_STOPS_OF_STOP_AND_GO, "high")
            yield Moment(*span, (evidence.ego_id,), float(len(each)), severity, words=f"{len(each)} stops")


EVENT = EventKind(
    summary="the ego stops again and again",
    value_name="stops",
    threshold=(
        f"{MIN_STOPS_OF_STOP_AND_GO} stops within {MAX_TIME_BETWEEN_STOPS_S:g} s, "
        f"a peak of {MIN_SPEED_BETWEEN_STOPS_MPS:g} to {MAX_SPEED_BETWEEN_STOPS_MPS:g} m/s between"
    ),
    source="chosen",
    needs="states",
    find=find_stop_and_go,
)
