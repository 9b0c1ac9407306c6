"""Lane departures: a side of the ego crosses a boundary of its lane in the camera's frames."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cwcli.events.base import EventKind, Moment, severity_as_ratio_to_threshold
from cwcli.events.evidence import EventEvidence, lasting_row_spans

HALF_CAR_WIDTH_M = 0.9
"""Half the width of the car that is assumed, m: cars are 1.7 m to 1.9 m wide."""
MIN_DEPARTURE_DURATION_S = 0.2
"""Shorter ones are errors of single frames, s. Chosen by hand."""
MAX_PAUSE_IN_DEPARTURE_S = 0.5
"""Departures with a shorter pause are one, s. Chosen by hand."""
DEPARTURE_OF_SEVERITY_2_M = 0.3
"""A departure by this has severity 2, m: the zone of ISO 17361 in which a warning must come."""


def find_lane_departures(evidence: EventEvidence) -> Iterator[Moment]:
    """Yield the stretches in which a side of the car is beyond a boundary."""
    lanes = evidence.lanes
    beyond_m = HALF_CAR_WIDTH_M - np.stack([lanes.left_m, -lanes.right_m])
    for side, out_m in zip(("left", "right"), beyond_m, strict=True):
        holds = np.nan_to_num(out_m, nan=-1.0) > 0.0
        for first, last in lasting_row_spans(
            holds, lanes.stamp_ns, min_s=MIN_DEPARTURE_DURATION_S, max_pause_s=MAX_PAUSE_IN_DEPARTURE_S
        ):
            most_m = float(np.nanmax(out_m[first : last + 1]))
            span = int(lanes.stamp_ns[first]), int(lanes.stamp_ns[last])
            severity = severity_as_ratio_to_threshold(
                most_m + DEPARTURE_OF_SEVERITY_2_M, DEPARTURE_OF_SEVERITY_2_M, "high"
            )
            words = f"up to {most_m:.2f} m beyond the {side} lane boundary"
            yield Moment(*span, ("ego",), most_m, severity, f"{side} boundary", words)


EVENT = EventKind(
    summary="a side of the ego crosses a lane boundary",
    value_name="beyond_m",
    threshold=f"the boundary is nearer than {HALF_CAR_WIDTH_M:g} m for {MIN_DEPARTURE_DURATION_S:g} s",
    source="half the width of a car; ISO 17361",
    needs="lanes",
    find=find_lane_departures,
)
