"""Overtaking: the ego passes a moving vehicle of its direction."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cwcli.events.base import EventKind, Moment, severity_as_ratio_to_threshold
from cwcli.events.evidence import EventEvidence, lasting_row_spans
from cwcli.events.own_path import PROJECTION_TIME_STEP_S, project_on_own_path

MIN_OVERTAKEN_SPEED_MPS = 2.0
"""Slower vehicles are parked, or stand in a queue, m/s. Chosen by hand."""
MAX_LATERAL_OFFSET_OF_SAME_ROAD_M = 7.0
"""Farther to the side is another road, m: two lanes of 3.5 m."""
SIDE_GAP_AT_SEVERITY_1_M = 1.5
"""Overtaking has severity 1 at this distance of the sides, m: the least one beside cyclists (StVO, section 5)."""


def find_overtaking(evidence: EventEvidence) -> Iterator[Moment]:
    """Yield the moments in which the ego is beside a vehicle that it passes, from its rear to its front."""
    for other_id, pair in evidence.iter_pairs():
        projected = project_on_own_path(evidence, other_id)
        is_beside = (np.abs(projected.ahead_m) < projected.half_length_m) & projected.is_same_direction
        is_beside &= (np.abs(projected.left_m) < MAX_LATERAL_OFFSET_OF_SAME_ROAD_M) & (
            projected.speed_mps > MIN_OVERTAKEN_SPEED_MPS
        )
        for first, last in lasting_row_spans(is_beside, projected.stamp_ns, max_pause_s=2 * PROJECTION_TIME_STEP_S):
            before, after = (
                projected.ahead_m[max(first - 1, 0)],
                projected.ahead_m[min(last + 1, len(projected.ahead_m) - 1)],
            )
            if not (before >= projected.half_length_m and after <= -projected.half_length_m):
                continue
            widths_m = 0.5 * pair.host_size[1] + projected.half_width_m
            side_m = float(np.abs(projected.left_m[first : last + 1]).min() - widths_m)
            if side_m <= 0.0:
                continue  # the outlines overlap: the states say that the ego drove through it
            span = int(projected.stamp_ns[first]), int(projected.stamp_ns[last])
            severity = severity_as_ratio_to_threshold(side_m, SIDE_GAP_AT_SEVERITY_1_M, "low")
            words = f"the ego passes it with {side_m:.1f} m between the sides"
            yield Moment(*span, (evidence.ego_id, other_id), side_m, severity, words=words)


EVENT = EventKind(
    summary="the ego passes a moving vehicle of its direction",
    value_name="side_distance_m",
    threshold=f"within {MAX_LATERAL_OFFSET_OF_SAME_ROAD_M:g} m to the side",
    source="chosen",
    needs="states of others",
    find=find_overtaking,
)
