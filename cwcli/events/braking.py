"""Hard braking of the ego, and of another vehicle near it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cwcli.events.base import EventKind, Moment, severity_as_ratio_to_threshold
from cwcli.events.evidence import EventEvidence, lasting_row_spans
from cwcli.measures.pair import ActualTrack, accel_yaw_rate_jerk_of_track
from cwcli.signals.columns import FloatArray, Int64Array

MIN_HARD_BRAKING_MPS2 = 3.92
"""Deceleration from which on braking is hard, m/s^2: 0.4 g, the event flag eventHardBraking of SAE J2735."""
MIN_BRAKING_DURATION_S = 0.3
"""Shorter decelerations are shocks or errors of the state, s. Chosen by hand."""
MAX_PAUSE_IN_BRAKING_S = 0.5
"""Decelerations with a shorter pause are one braking, s. Chosen by hand."""
MAX_DISTANCE_OF_OTHER_BRAKING_M = 100.0
"""Another vehicle's braking counts within this distance of the ego, m. Chosen by hand."""


def find_ego_braking(evidence: EventEvidence) -> Iterator[Moment]:
    """Yield the ego's hard braking."""
    track = ActualTrack(evidence.stamp_ns, evidence.ego_state)
    accel_mps2 = accel_yaw_rate_jerk_of_track(track)[:, 0]
    yield from _find_hard_braking(evidence.stamp_ns, accel_mps2, (evidence.ego_id,))


def find_other_braking(evidence: EventEvidence) -> Iterator[Moment]:
    """Yield the hard braking of others near the ego."""
    for other_id, pair in evidence.iter_pairs():
        actors = (evidence.ego_id, other_id)
        for moment in _find_hard_braking(evidence.stamp_ns, pair.other_derivatives[:, 0], actors):
            first, last = np.searchsorted(evidence.stamp_ns, (moment.start_ns, moment.end_ns))
            if (pair.distance_m[first : last + 1] < MAX_DISTANCE_OF_OTHER_BRAKING_M).any():
                yield moment


def _find_hard_braking(stamp_ns: Int64Array, accel_mps2: FloatArray, actors: tuple[str, ...]) -> Iterator[Moment]:
    """Yield the stretches of hard braking in an acceleration (n,)."""
    holds = np.nan_to_num(accel_mps2) <= -MIN_HARD_BRAKING_MPS2
    for first, last in lasting_row_spans(
        holds, stamp_ns, min_s=MIN_BRAKING_DURATION_S, max_pause_s=MAX_PAUSE_IN_BRAKING_S
    ):
        peak_mps2 = -float(np.nanmin(accel_mps2[first : last + 1]))
        severity = severity_as_ratio_to_threshold(peak_mps2, MIN_HARD_BRAKING_MPS2, "high")
        span = int(stamp_ns[first]), int(stamp_ns[last])
        yield Moment(*span, actors, peak_mps2, severity, words=f"brakes with up to {peak_mps2:.1f} m/s^2")


EGO_EVENT = EventKind(
    summary="the ego brakes hard",
    value_name="peak_deceleration_mps2",
    threshold=f"{MIN_HARD_BRAKING_MPS2:g} m/s^2 for {MIN_BRAKING_DURATION_S:g} s",
    source="0.4 g, eventHardBraking of SAE J2735",
    needs="states",
    find=find_ego_braking,
)
OTHER_EVENT = EventKind(
    summary=f"another vehicle within {MAX_DISTANCE_OF_OTHER_BRAKING_M:g} m brakes hard",
    value_name="peak_deceleration_mps2",
    threshold=f"{MIN_HARD_BRAKING_MPS2:g} m/s^2 for {MIN_BRAKING_DURATION_S:g} s",
    source="0.4 g, eventHardBraking of SAE J2735",
    needs="states of others",
    find=find_other_braking,
)
