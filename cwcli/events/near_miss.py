"""Near misses: a time to collision or a post-encroachment time below a threshold."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cwcli.events.base import EventKind, Moment, severity_as_ratio_to_threshold
from cwcli.events.evidence import EventEvidence, lasting_row_spans
from cwcli.events.own_path import project_on_own_path
from cwcli.measures import MEASURES
from cwcli.signals.units import NS_PER_S

MAX_TTC_OF_NEAR_MISS_S = 1.5
"""Time to collision below which two nearly missed each other, s (van der Horst 1990: urban conflicts)."""
MAX_PET_OF_NEAR_MISS_S = 1.5
"""Post-encroachment time below which two nearly missed each other, s (Allen, Shin and Cooper 1978; FHWA SSAM: 5 s is
the upper end of conflicts, 1 s to 1.5 s are serious)."""
MIN_SPEED_IN_NEAR_MISS_MPS = 2.0
"""Slower meetings of both vehicles are manoeuvres in a car park, m/s. Chosen by hand."""
MAX_PAUSE_IN_NEAR_MISS_S = 1.0
"""Moments with a shorter pause are one near miss, s. Chosen by hand."""
MIN_NEAR_MISS_DURATION_S = 0.1
"""Shorter ones are noise of the states, s. Chosen by hand."""
PET_SEARCH_HALF_WINDOW_S = 10.0
"""A post-encroachment time is looked for so far around the moment at which the two were closest, s. Chosen by hand."""


def find_near_misses(evidence: EventEvidence) -> Iterator[Moment]:
    """Yield the near misses with each other vehicle, by the time to collision, else by the post-encroachment time."""
    for other_id, pair in evidence.iter_pairs():
        actors = (evidence.ego_id, other_id)
        speed_mps = np.fmax(evidence.ego_state[:, 2], pair.other_states[:, 2])
        ttc_s = np.asarray(pair.evaluate_measure(MEASURES["ttc"]))
        holds = (np.nan_to_num(ttc_s, nan=np.inf) < MAX_TTC_OF_NEAR_MISS_S) & (speed_mps > MIN_SPEED_IN_NEAR_MISS_MPS)
        spans = lasting_row_spans(
            holds, pair.stamp_ns, min_s=MIN_NEAR_MISS_DURATION_S, max_pause_s=MAX_PAUSE_IN_NEAR_MISS_S
        )
        for first, last in spans:
            least_s = float(np.nanmin(ttc_s[first : last + 1]))
            severity = severity_as_ratio_to_threshold(least_s, MAX_TTC_OF_NEAR_MISS_S, "low")
            start_ns, end_ns = int(pair.stamp_ns[first]), int(pair.stamp_ns[last])
            words = f"time to collision down to {least_s:.1f} s" if least_s > 0.0 else "the outlines touch"
            yield Moment(start_ns, end_ns, actors, least_s, severity, "time to collision", words)
        if not spans:
            yield from _find_small_post_encroachment(evidence, other_id, actors)


def _find_small_post_encroachment(evidence: EventEvidence, other_id: str, actors: tuple[str, ...]) -> Iterator[Moment]:
    """Yield the crossing of two ways with a small post-encroachment time."""
    pair = evidence.pair_with_ego(other_id)
    closest = int(np.nanargmin(pair.distance_m))
    around = np.abs(pair.stamp_ns - pair.stamp_ns[closest]) < PET_SEARCH_HALF_WINDOW_S * NS_PER_S
    rows = np.flatnonzero(around)
    stretch = pair.slice_rows(int(rows[0]), int(rows[-1]) + 1)
    pet_s = float(stretch.evaluate_measure(MEASURES["pet"]))
    if not pet_s < MAX_PET_OF_NEAR_MISS_S or pair.host.state[closest, 2] < MIN_SPEED_IN_NEAR_MISS_MPS:
        return
    projected = project_on_own_path(evidence, other_id)
    is_crossing = (np.abs(np.sin(projected.turn_rad)) > np.sin(np.radians(20.0))) & (
        np.abs(projected.left_m) < projected.half_length_m + projected.half_width_m
    )
    at = np.flatnonzero(
        is_crossing & (np.abs(projected.passed_ns - projected.stamp_ns) < 2 * MAX_PET_OF_NEAR_MISS_S * NS_PER_S)
    )
    if not len(at):
        return
    times = np.concatenate([projected.stamp_ns[at], projected.passed_ns[at]])
    severity = severity_as_ratio_to_threshold(pet_s, MAX_PET_OF_NEAR_MISS_S, "low")
    words = f"one crosses the other's way {pet_s:.1f} s after it (post-encroachment time)"
    yield Moment(int(times.min()), int(times.max()), actors, pet_s, severity, "post-encroachment", words)


EVENT = EventKind(
    summary="the ego and another nearly touch",
    value_name="least_ttc_or_pet_s",
    threshold=f"TTC below {MAX_TTC_OF_NEAR_MISS_S:g} s, or PET of crossing ways below {MAX_PET_OF_NEAR_MISS_S:g} s",
    source="van der Horst 1990; Allen, Shin and Cooper 1978",
    needs="states of others",
    find=find_near_misses,
)
