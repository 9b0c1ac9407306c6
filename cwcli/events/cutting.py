"""Cut-ins and cut-outs: another vehicle enters the way that the ego drives, or leaves it, ahead of the ego."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from cwcli.events.base import EventKind, Moment, severity_as_ratio_to_threshold
from cwcli.events.evidence import EventEvidence
from cwcli.events.lane_change import find_lane_changes
from cwcli.events.own_path import HALF_LANE_WIDTH_M, OnOwnPath, project_on_own_path
from cwcli.signals.units import NS_PER_S

MAX_DURATION_OF_LANE_ENTRY_OR_EXIT_S = 10.0
"""Entering or leaving the lane takes at most this long, s. Chosen by hand: lane changes take 2 s to 8 s."""
MAX_HEADWAY_OF_CUT_IN_S = 4.0
"""Farther ahead nobody cuts in, s of the ego's way. Chosen by hand: twice the recommended headway."""
MIN_SPEED_OF_BOTH_VEHICLES_MPS = 3.0
"""Below this speed of either it is a manoeuvre in a car park, m/s. Chosen by hand."""
HEADWAY_OF_SEVERITY_1_S = 2.0
"""A cut-in has severity 1 at this time headway, s: the recommended headway."""
MIN_TIME_IN_OTHER_LANE_BEFORE_S = 0.3
"""The other must have been in the other lane for so long, s. Chosen by hand."""


def find_cut_ins(evidence: EventEvidence) -> Iterator[Moment]:
    """Yield the moments in which another vehicle enters the ego's lane ahead of it."""
    return _find_cut_ins_or_cut_outs(evidence, is_in=True)


def find_cut_outs(evidence: EventEvidence) -> Iterator[Moment]:
    """Yield the moments in which another vehicle leaves the ego's lane ahead of it."""
    return _find_cut_ins_or_cut_outs(evidence, is_in=False)


def _find_cut_ins_or_cut_outs(evidence: EventEvidence, *, is_in: bool) -> Iterator[Moment]:
    """Yield cut-ins or cut-outs: from a side on the line to wholly inside the lane, or back."""
    other_ids = [other_id for other_id, _ in evidence.iter_pairs()]
    own_changes = [(each.start_ns, each.end_ns) for each in find_lane_changes(evidence)]
    for other_id in other_ids:
        projected = project_on_own_path(evidence, other_id)
        for first, last in _iter_first_and_last_crossing_row(projected, is_in=is_in):
            place_ns = projected.passed_ns[first], projected.passed_ns[last]
            if any(place_ns[0] <= end and place_ns[1] >= start for start, end in own_changes):
                continue  # the ego left the lane there, not the other
            gap_m = float(projected.ahead_m[last if is_in else first] - projected.half_length_m)
            headway_s = gap_m / float(projected.ego_speed_mps[last if is_in else first])
            is_near = 0.0 <= headway_s <= MAX_HEADWAY_OF_CUT_IN_S
            slowest_mps = min(
                projected.ego_speed_mps[first : last + 1].min(), projected.speed_mps[first : last + 1].min()
            )
            if is_near and slowest_mps > MIN_SPEED_OF_BOTH_VEHICLES_MPS:
                span = int(projected.stamp_ns[first]), int(projected.stamp_ns[last])
                severity = severity_as_ratio_to_threshold(headway_s, HEADWAY_OF_SEVERITY_1_S, "low")
                words = f"{'enters' if is_in else 'leaves'} the ego's lane {gap_m:.0f} m, {headway_s:.1f} s ahead of it"
                yield Moment(*span, (evidence.ego_id, other_id), headway_s, severity, words=words)


def _iter_first_and_last_crossing_row(projected: OnOwnPath, *, is_in: bool) -> Iterator[tuple[int, int]]:
    """Yield first and last row of each crossing of the lane's edge.

    It begins when the side nearest to the lane crosses the line, and ends when the far side does.
    """
    off_m = np.abs(projected.left_m)
    touches_m, inside_m = (
        HALF_LANE_WIDTH_M + projected.half_width_m,
        max(HALF_LANE_WIDTH_M - projected.half_width_m, 0.3),
    )
    is_ahead = (projected.ahead_m > 0.0) & projected.is_same_direction
    zone = np.where(~is_ahead | np.isnan(off_m), -1, np.where(off_m > touches_m, 2, np.where(off_m < inside_m, 0, 1)))
    changes = np.concatenate([[0], np.flatnonzero(np.diff(zone)) + 1, [len(zone)]])
    runs = [(int(zone[a]), int(a), int(b)) for a, b in itertools.pairwise(changes) if b > a]
    outer, inner = (2, 0) if is_in else (0, 2)
    for before, between, after in zip(runs, runs[1:], runs[2:], strict=False):
        if (before[0], between[0], after[0]) != (outer, 1, inner):
            continue
        lasted_s = (projected.stamp_ns[before[2] - 1] - projected.stamp_ns[before[1]]) / NS_PER_S
        took_s = (projected.stamp_ns[after[1]] - projected.stamp_ns[between[1]]) / NS_PER_S
        is_one_side = np.sign(projected.left_m[between[1]]) == np.sign(projected.left_m[between[2] - 1])
        if (
            lasted_s >= MIN_TIME_IN_OTHER_LANE_BEFORE_S
            and took_s <= MAX_DURATION_OF_LANE_ENTRY_OR_EXIT_S
            and is_one_side
        ):
            yield between[1], after[1]


CUT_IN_EVENT = EventKind(
    summary="another enters the ego's lane ahead of it",
    value_name="headway_s",
    threshold=f"within {MAX_HEADWAY_OF_CUT_IN_S:g} s of the ego's way",
    source="chosen; lanes of 3.5 m around the way that the ego drove",
    needs="states of others",
    find=find_cut_ins,
)
CUT_OUT_EVENT = EventKind(
    summary="another leaves the ego's lane ahead of it",
    value_name="headway_s",
    threshold=f"within {MAX_HEADWAY_OF_CUT_IN_S:g} s of the ego's way",
    source="chosen; lanes of 3.5 m around the way that the ego drove",
    needs="states of others",
    find=find_cut_outs,
)
