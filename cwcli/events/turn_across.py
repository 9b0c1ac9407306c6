"""Turns across: another vehicle turns and crosses the way that the ego drives."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cwcli.events.base import EventKind, Moment, severity_as_ratio_to_threshold
from cwcli.events.evidence import EventEvidence
from cwcli.events.own_path import HALF_LANE_WIDTH_M, project_on_own_path
from cwcli.signals.units import NS_PER_S

MAX_TIME_UNTIL_EGO_AT_CROSSING_S = 6.0
"""The ego comes to the place within this time, s. Chosen by hand: nobody waits for a longer one."""
TIME_GAP_OF_SEVERITY_1_S = 3.0
"""A turn across has severity 1 at this time between both at the place, s. Chosen by hand."""
MIN_TURN_OF_OTHER_RAD = np.radians(35.0)
"""The other turns by at least this while it crosses and shortly before and after, rad. Chosen by hand."""
MIN_CROSSING_ANGLE_RAD = np.radians(20.0)
"""Smallest angle between both ways, rad; smaller ones are lane changes. Chosen by hand."""
TURN_COUNTED_AROUND_CROSSING_S = 3.0
"""How long before and after the crossing the turn counts, s. Chosen by hand."""
MIN_CROSSING_SPEED_MPS = 1.0
"""Slower vehicles do not cross, m/s. Chosen by hand."""


def find_turns_across(evidence: EventEvidence) -> Iterator[Moment]:
    """Yield the moments in which another vehicle turns across the ego's way, from its first to its last touch of it."""
    for other_id, _ in evidence.iter_pairs():
        projected = project_on_own_path(evidence, other_id)
        turn_rad = np.unwrap(np.where(np.isnan(projected.turn_rad), 0.0, projected.turn_rad))
        known = np.isfinite(projected.left_m)
        both = known[:-1] & known[1:]
        sign = np.sign(projected.left_m)
        angle_rad = np.abs(np.sin(projected.turn_rad))
        crossed = both & (sign[:-1] != sign[1:]) & (angle_rad[:-1] > np.sin(MIN_CROSSING_ANGLE_RAD))
        for row in np.flatnonzero(crossed).tolist():
            gap_s = float(projected.passed_ns[row] - projected.stamp_ns[row]) / NS_PER_S
            around = known & (
                np.abs(projected.stamp_ns - projected.stamp_ns[row]) <= TURN_COUNTED_AROUND_CROSSING_S * NS_PER_S
            )
            turned_rad = float(np.ptp(turn_rad[around]))
            if (
                abs(gap_s) > MAX_TIME_UNTIL_EGO_AT_CROSSING_S
                or turned_rad < MIN_TURN_OF_OTHER_RAD
                or projected.speed_mps[row] < MIN_CROSSING_SPEED_MPS
            ):
                continue
            inside = known & (np.abs(projected.left_m) < HALF_LANE_WIDTH_M + projected.half_width_m)
            outside = np.flatnonzero(~inside)
            first = int(outside[outside < row][-1]) + 1 if (outside < row).any() else 0
            last = int(outside[outside > row][0]) - 1 if (outside > row).any() else len(inside) - 1
            span = int(projected.stamp_ns[first]), int(projected.stamp_ns[last])
            severity = severity_as_ratio_to_threshold(abs(gap_s), TIME_GAP_OF_SEVERITY_1_S, "low")
            words = f"turns across the ego's way; {abs(gap_s):.1f} s between both at that place"
            yield Moment(*span, (evidence.ego_id, other_id), abs(gap_s), severity, words=words)


EVENT = EventKind(
    summary="another turns across the ego's way",
    value_name="time_gap_s",
    threshold=f"the ego is there within {MAX_TIME_UNTIL_EGO_AT_CROSSING_S:g} s",
    source="chosen",
    needs="states of others",
    find=find_turns_across,
)
