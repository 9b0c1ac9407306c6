"""A sensor that begins late, ends early or is silent for long while the car drives on."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from cwcli.evaluation.doubts.base import DoubtRule, Finding
from cwcli.evaluation.doubts.evidence import MAX_TOPIC_CHARACTERS, DoubtEvidence
from cwcli.pipeline.records import Record, parse_json_entry_or_empty, read_finite_number_or_nan
from cwcli.signals.columns import BoolArray, Int64Array
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import SPEED
from cwcli.text import format_duration, join_names, shorten_and_escape

MAX_UNDOUBTED_SILENCE_S = 10.0
"""Longest silence of a sensor, s, in which the car drives, that is not doubted. Chosen by hand: a restart of a driver
or a short tunnel takes less."""
MIN_SILENT_SHARE = 0.1
"""Least share of the track in which a sensor is silent. Chosen by hand. Behind the last position any share counts,
because nothing corrects the states there any more."""
MIN_DRIVING_SPEED_MPS = 1.0
"""Speed in m/s above which a car drives. Chosen: receivers that tell no course at standstill fall silent below it."""
MAX_STATE_STEP_COUNTED_AS_DRIVEN_S = 1.0
"""Longest step between two states, s, that counts as driven. Chosen by hand: states are 20 a second."""
SILENCES_RECORD_KEY = "silences"
"""Entry of the record of `estimate` that holds the silences as JSON (`cwcli.evaluation.estimate`)."""


def find_silences(evidence: DoubtEvidence) -> list[Finding]:
    """Return each silence of a source of the ego in which the car drives and nothing else measures the same."""
    found = [_finding_of_silence(evidence, silence, silent_s) for silence, silent_s in _doubtful_silences(evidence)]
    return sorted(found, key=lambda each: -each.value)


def bridged_by_silent_positions_mask(evidence: DoubtEvidence, stamp_ns: Int64Array) -> BoolArray:
    """Return which stamps (n,), ns, lie in a doubtful silence of the positions, (n,)."""
    inside = np.zeros(len(stamp_ns), np.bool_)
    for silence, _ in _doubtful_silences(evidence):
        if "position" in silence["quantities"]:
            inside |= (stamp_ns >= silence["begin_ns"]) & (stamp_ns <= silence["end_ns"])
    return inside


def _doubtful_silences(evidence: DoubtEvidence) -> Iterator[tuple[dict[str, Any], float]]:
    """Yield the recorded silences that matter, with the time in s for which the car drives in them."""
    record: Record = evidence.records.get("estimate", {})
    recorded = parse_json_entry_or_empty(record, SILENCES_RECORD_KEY, list)
    if evidence.ego is None or not len(evidence.ego) or not recorded:
        return
    ego = evidence.ego.sort_by_stamp_without_repeats()
    step_s = np.diff(ego.stamp_ns) / NS_PER_S
    step_s[step_s > MAX_STATE_STEP_COUNTED_AS_DRIVEN_S] = 0.0
    driven_s = np.where(np.abs(ego.state[:-1, SPEED]) > MIN_DRIVING_SPEED_MPS, step_s, 0.0)
    for each in recorded:
        if not isinstance(each, dict):
            continue
        begin_ns, end_ns = (read_finite_number_or_nan(each, key) for key in ("begin_ns", "end_ns"))
        quantities, others = each.get("quantities"), each.get("others")
        if not (begin_ns < end_ns and isinstance(quantities, list) and isinstance(others, dict)):
            continue
        silent_s = float(driven_s[(ego.stamp_ns[:-1] >= begin_ns) & (ego.stamp_ns[:-1] < end_ns)].sum())
        is_last_position = each.get("to_the_end") is True and "position" in quantities
        least_s = 0.0 if is_last_position else MIN_SILENT_SHARE * float(step_s.sum())
        if silent_s > MAX_UNDOUBTED_SILENCE_S and silent_s >= least_s:
            yield each, silent_s


def _finding_of_silence(evidence: DoubtEvidence, silence: dict[str, Any], silent_s: float) -> Finding:
    begin_s, end_s = (max(evidence.seconds_since_start(silence[key]), 0.0) for key in ("begin_ns", "end_ns"))
    lasting = format_duration(end_s - begin_s)
    if silence.get("to_the_end") is True:
        when, advice = f"from {begin_s:.0f} s on ({lasting}, to the end)", f"--end {begin_s:.0f}"
    elif silence.get("from_the_start") is True:
        when, advice = f"before {end_s:.0f} s ({lasting})", f"--start {end_s:.0f}"
    else:
        when, advice = f"between {begin_s:.0f} and {end_s:.0f} s ({lasting})", "--start or --end"
    others = [_topic_and_quantities_text(topic, quantities) for topic, quantities in silence["others"].items()]
    lost_quantities = join_names([_escaped_short_text(each) for each in silence["quantities"]])
    return Finding(
        silent_s,
        f"{_escaped_short_text(silence.get('source'))} reports no {lost_quantities} {when}; there the states rest on "
        f"{join_names(others)}.",
        f"Find out why that sensor was silent; leave that part out with {advice}, or use it as of a car without it.",
    )


def _topic_and_quantities_text(topic: str, quantities: Any) -> str:
    return (
        f"{_escaped_short_text(topic)} ({', '.join(_escaped_short_text(each) for each in quantities)})"
        if isinstance(quantities, list)
        else _escaped_short_text(topic)
    )


def _escaped_short_text(text: Any) -> str:
    return shorten_and_escape(str(text), MAX_TOPIC_CHARACTERS)


SILENCE_RULE = DoubtRule(
    summary=(
        "a sensor that is silent while the car drives and nothing else measures the same, in a tenth of the track or "
        "behind the last position"
    ),
    short_name="silent sensor",
    threshold=MAX_UNDOUBTED_SILENCE_S,
    unit="s",
    source="chosen: restarts and short tunnels are shorter",
    advice="Find out why it was silent.",
    find=find_silences,
)
