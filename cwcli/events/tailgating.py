"""Tailgating: the ego follows another vehicle too closely for some time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cwcli.events.base import EventKind, Moment, severity_as_ratio_to_threshold
from cwcli.events.evidence import EventEvidence, lasting_row_spans
from cwcli.measures import MEASURES

MAX_HEADWAY_OF_TAILGATING_S = 0.9
"""Time headway below which following is tailgating, s (Vogel 2003: half the two seconds of driving schools)."""
MIN_SPEED_OF_TAILGATING_MPS = 8.0
"""The speed above which following counts, m/s; short headways are usual in slow traffic. Chosen by hand."""
MIN_TAILGATING_DURATION_S = 2.0
"""Shorter ones pass by themselves, after a cut-in for example, s. Chosen by hand."""
MAX_PAUSE_IN_TAILGATING_S = 0.5
"""Stretches with a shorter pause are one, s. Chosen by hand."""


def find_tailgating(evidence: EventEvidence) -> Iterator[Moment]:
    """Yield the stretches in which the ego follows another vehicle too closely."""
    for other_id, pair in evidence.iter_pairs():
        headway_s = np.asarray(pair.evaluate_measure(MEASURES["thw"]))
        is_along = np.cos(pair.other_states[:, 3] - evidence.ego_state[:, 3]) > 0.9
        holds = (np.nan_to_num(headway_s, nan=np.inf) < MAX_HEADWAY_OF_TAILGATING_S) & is_along
        holds &= evidence.ego_state[:, 2] > MIN_SPEED_OF_TAILGATING_MPS
        for first, last in lasting_row_spans(
            holds, pair.stamp_ns, min_s=MIN_TAILGATING_DURATION_S, max_pause_s=MAX_PAUSE_IN_TAILGATING_S
        ):
            least_s = float(np.nanmin(headway_s[first : last + 1]))
            severity = severity_as_ratio_to_threshold(least_s, MAX_HEADWAY_OF_TAILGATING_S, "low")
            span = int(pair.stamp_ns[first]), int(pair.stamp_ns[last])
            words = f"follows with a time headway down to {least_s:.1f} s"
            yield Moment(*span, (evidence.ego_id, other_id), least_s, severity, words=words)


EVENT = EventKind(
    summary="the ego follows another too closely",
    value_name="least_thw_s",
    threshold=f"time headway below {MAX_HEADWAY_OF_TAILGATING_S:g} s for {MIN_TAILGATING_DURATION_S:g} s, "
    f"above {MIN_SPEED_OF_TAILGATING_MPS:g} m/s",
    source="Vogel 2003",
    needs="states of others",
    find=find_tailgating,
)
