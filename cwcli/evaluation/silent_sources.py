"""When sources of the ego are silent while others go on."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from cwcli.estimation.measurements import Kind, Measurements
from cwcli.evaluation.doubts.silences import MAX_UNDOUBTED_SILENCE_S, SILENCES_RECORD_KEY
from cwcli.signals.clocks import find_stamp_gaps
from cwcli.signals.columns import Int64Array, median_of_values
from cwcli.signals.units import NS_PER_S

MIN_SILENCE_IN_USUAL_STEPS = 5.0
"""Least duration of a silence in usual steps of its source. Chosen: as for the gaps of `cwcli info`."""
MEASURED_QUANTITIES_BY_KIND = {
    Kind.POSITION: ("position",),
    Kind.VELOCITY: ("speed", "heading"),
    Kind.SPEED: ("speed",),
    Kind.HEADING: ("heading",),
    Kind.ACCEL: ("acceleration",),
    Kind.YAW_RATE: ("yaw rate",),
    Kind.IMU: ("acceleration", "yaw rate"),
}
"""Kind of a measurement -> the quantities that it measures; a silence matters only where no other source has them."""


def lost_quantity_spans_to_record_entry(measurements: Sequence[Measurements]) -> dict[str, str]:
    """Return the entry of the record with the spans in which nothing told a quantity that is told elsewhere in the log.

    Each span has its `source`, its lost `quantities`, `begin_ns` and `end_ns`, whether it lasts `from_the_start` or
    `to_the_end`, and the `others` that tell something there. A time in which all sources are silent is a pause of the
    recording and no silence of a source.

    Args:
        measurements: Of the ego; the first one has the positions, with which the states begin.
    """
    stamps_by_source = [(m, np.sort(m.stamp_ns[np.isfinite(m.values).all(axis=1)])) for m in measurements]
    stamps_by_source = [(m, stamp_ns) for m, stamp_ns in stamps_by_source if len(stamp_ns)]
    positions_ns = [stamp_ns for m, stamp_ns in stamps_by_source if m.kind is Kind.POSITION]
    if not positions_ns:
        return {SILENCES_RECORD_KEY: "[]"}
    first_ns = min(int(each[0]) for each in positions_ns)
    last_ns = max(int(each[-1]) for _, each in stamps_by_source)
    found: dict[tuple[str, int, int], dict[str, Any]] = {}
    for m, stamp_ns in stamps_by_source:
        usual_s = median_of_values(np.diff(stamp_ns)) / NS_PER_S if len(stamp_ns) > 1 else 0.0
        least_s = max(MAX_UNDOUBTED_SILENCE_S, MIN_SILENCE_IN_USUAL_STEPS * usual_s)
        within_ns = stamp_ns[stamp_ns >= first_ns]
        for gap in find_stamp_gaps(within_ns, start_ns=first_ns, end_ns=last_ns, min_gap_s=least_s):
            others = [
                each
                for each in stamps_by_source
                if each[0] is not m and _does_source_go_on_in_span(each[1], gap.start_ns, gap.end_ns)
            ]
            known = {name for other, _ in others for name in MEASURED_QUANTITIES_BY_KIND[other.kind]}
            lost_quantities = [name for name in MEASURED_QUANTITIES_BY_KIND[m.kind] if name not in known]
            if not lost_quantities or not others:
                continue
            silence = found.setdefault(
                (m.source, gap.start_ns, gap.end_ns),
                {
                    "source": m.source,
                    "quantities": [],
                    "begin_ns": gap.start_ns,
                    "end_ns": gap.end_ns,
                    "from_the_start": gap.start_ns <= first_ns,
                    "to_the_end": gap.end_ns >= last_ns,
                    "others": {},
                },
            )
            silence["quantities"] += [name for name in lost_quantities if name not in silence["quantities"]]
            for other, _ in others:
                of_topic = silence["others"].setdefault(other.source, [])
                of_topic += [name for name in MEASURED_QUANTITIES_BY_KIND[other.kind] if name not in of_topic]
    return {SILENCES_RECORD_KEY: json.dumps(list(found.values()))}


def _does_source_go_on_in_span(stamp_ns: Int64Array, begin_ns: int, end_ns: int) -> bool:
    """Whether a source goes on for more than half of a span: it has no gap of so long there."""
    inside = stamp_ns[(stamp_ns > begin_ns) & (stamp_ns < end_ns)]
    edges_ns = np.concatenate([[begin_ns], inside, [end_ns]])
    return len(inside) > 0 and int(np.diff(edges_ns).max()) <= (end_ns - begin_ns) // 2
