"""What one stage made, in a sentence, from the summary in its record: the digest of a stage's own command."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping

import numpy as np

from cwcli.digest.drive_sentences import found_lanes_text, tracked_targets_text
from cwcli.metrics.table import Table
from cwcli.pipeline.records import Record, RecordedSummary, read_recorded_summary
from cwcli.pipeline.result import Cell
from cwcli.signals.units import KMH_PER_MPS
from cwcli.signals.v2x_codec import EGO_STATION_NOTE_BEGINNING
from cwcli.signals.vehicle_state import EGO_ID
from cwcli.text import join_names, shorten_and_escape

MAX_NAME_CHARACTERS = 40
"""Greatest length of a name in a sentence, in characters; chosen by hand."""
MAX_NAMES_IN_SENTENCE = 4
"""Greatest number of things that a sentence names one by one; chosen by hand."""


PHRASE_BY_BRAKING_POLICY = {
    "no-action": "nobody braking",
    "fuzzy": "the controller",
    "driver": "a driver who brakes late",
}
"""Policy of `control` -> what it is called in a sentence."""
_HORIZON_PATTERN = re.compile(r"[\d.]+ s ahead")
"""The horizon in the title of the table of prediction errors."""
Tables = Mapping[str, Table]


def stage_sentence(stage: str, records: Mapping[str, Record], tables: Tables) -> str:
    """Return what a stage made; "" where nothing says it, or where the story of the drive does.

    Args:
        tables: Name -> table, of the stages that have just run.
    """
    describe = _SENTENCE_FUNCTION_BY_STAGE.get(stage)
    return "" if describe is None else describe(read_recorded_summary(records.get(stage, {})), tables)


def _estimate_sentence(summary: RecordedSummary, tables: Tables) -> str:
    """Name the sources of the ego's states, and the V2X station that the car was taken for."""
    names = dict.fromkeys(str(source) for (source,) in summary.rows_of_table_columns_or_empty("sources", "source"))
    if not names:
        return ""
    said = next((note for note in summary.notes if EGO_STATION_NOTE_BEGINNING in note), "")
    station = said[said.find(EGO_STATION_NOTE_BEGINNING) :]
    text = f"The car's motion was estimated from {_join_first_names(list(names))}"
    return f"{text}: {shorten_and_escape(station)}." if station else f"{text}."


def _track_sentence(summary: RecordedSummary, tables: Tables) -> str:
    """Count the targets, with the longest and the fastest."""
    rows = summary.rows_of_table_columns_or_empty("targets", "duration [s]", "max speed [m/s]")
    if not rows:
        return "No target was tracked."
    spans, speeds = ([_cell_to_float_or_nan(row[k]) for row in rows] for k in (0, 1))
    text, longest, fastest = (
        tracked_targets_text(len(rows)),
        f"{max(spans):.0f} s",
        f"{KMH_PER_MPS * max(speeds):.0f} km/h",
    )
    if len(rows) == 1:
        return f"{text} for {longest}, at a speed of at most {fastest}."
    return f"{text}: the longest for {longest}, the fastest at {fastest}."


def _lanes_sentence(summary: RecordedSummary, tables: Tables) -> str:
    """Count the frames with both boundaries; the record does not say it, because that table holds run times."""
    if "lanes" not in tables:
        return ""
    left, right = (np.asarray(tables["lanes"].columns[f"{side}_found"], np.bool_) for side in ("left", "right"))
    return f"{found_lanes_text(int(np.count_nonzero(left & right)), len(left))}."


def _observe_sentence(summary: RecordedSummary, tables: Tables) -> str:
    """Say how fast the car turned and slid in its lane."""
    found = {
        str(name): value for name, value in summary.rows_of_table_columns_or_empty("observer", "quantity", "value")
    }
    turn, slide = (
        _cell_to_float_or_nan(found.get(name)) for name in ("largest yaw rate (deg/s)", "largest lateral speed (m/s)")
    )
    if not math.isfinite(turn + slide):
        return "The lateral motion in the lane was observed."
    return (
        f"The lateral motion in the lane was observed: at most {turn:.1f} deg/s of yaw rate and {slide:.2f} m/s "
        "sideways."
    )


def _predict_sentence(summary: RecordedSummary, tables: Tables) -> str:
    """Say how far the predicted paths lie from what was driven, by the model that chooses among the others."""
    errors = [
        f"{_cell_to_float_or_nan(mean):.1f} m for {'the car' if vehicle == EGO_ID else 'the others'}"
        for vehicle, model, mean in summary.rows_of_table_columns_or_empty(
            "prediction", "vehicle", "motion model", "mean error [m]"
        )
        if model == "auto" and math.isfinite(_cell_to_float_or_nan(mean))
    ]
    title = next((section.title for section in summary.sections if section.key == "prediction"), "")
    ahead = _HORIZON_PATTERN.search(title)
    if not errors or ahead is None:
        return "Paths were predicted."
    return f"Predicted positions {ahead.group()} differ from the later track by {join_names(errors)} on average."


def _sentence_of_predict_lane_stage(summary: RecordedSummary, tables: Tables) -> str:
    return "The car's path in its lane was predicted."


def _measure_sentence(summary: RecordedSummary, tables: Tables) -> str:
    """Describe the most critical encounter, the first row of the table."""
    rows = summary.rows_of_table_columns_or_empty("encounters", "vehicle", "gap [m]", "TTC [s]")
    if not rows:
        return "No other vehicle came near enough to be measured."
    vehicle, gap_m, ttc_s = rows[0]
    if _cell_to_float_or_nan(gap_m) < 0.0:
        how_critical = ": their outlines overlap"
    else:
        facts = [f"gap {_cell_to_float_or_nan(gap_m):.1f} m"] * math.isfinite(_cell_to_float_or_nan(gap_m))
        facts += [f"time to collision {_cell_to_float_or_nan(ttc_s):.1f} s"] * math.isfinite(
            _cell_to_float_or_nan(ttc_s)
        )
        how_critical = f": least {' and least '.join(facts)}" if facts else ""
    if len(rows) == 1:
        return f"The car encountered vehicle {_cell_to_name(vehicle)}{how_critical}."
    return (
        f"Of {len(rows)} encounters the one with vehicle {_cell_to_name(vehicle)} was the most critical{how_critical}."
    )


def _crashes_by_policy_sentence(summary: RecordedSummary, tables: Tables) -> str:
    """Count, for each policy, how many of the warned encounters end in a crash."""
    rows = summary.rows_of_table_columns_or_empty("control", "braking policy", "outlines touch")
    hits: dict[str, list[bool]] = {}
    for policy, hit in rows:
        hits.setdefault(_cell_to_name(policy), []).append(hit in ("yes", True))
    texts = [
        f"{sum(each)} of {len(each)} with {PHRASE_BY_BRAKING_POLICY.get(policy, policy)}"
        for policy, each in hits.items()
    ]
    return (
        f"Warned encounters that end in a crash: {join_names(texts)}." if texts else "There was no warning to replay."
    )


_SENTENCE_FUNCTION_BY_STAGE: dict[str, Callable[[RecordedSummary, Tables], str]] = {
    "estimate": _estimate_sentence,
    "track": _track_sentence,
    "lanes": _lanes_sentence,
    "observe": _observe_sentence,
    "predict": _predict_sentence,
    "predict-lane": _sentence_of_predict_lane_stage,
    "measure": _measure_sentence,
    "control": _crashes_by_policy_sentence,
}
"""Stage -> the function that describes what it made; what the warning stages made is in the story of the drive."""


def _cell_to_float_or_nan(cell: Cell) -> float:
    """Return a cell as a number; NaN if it is none."""
    return float(cell) if isinstance(cell, int | float) and not isinstance(cell, bool) else float("nan")


def _cell_to_name(cell: Cell) -> str:
    return shorten_and_escape(str(cell), MAX_NAME_CHARACTERS)


def _join_first_names(names: list[str]) -> str:
    """Join names, at most `MAX_NAMES_IN_SENTENCE` of them."""
    shown = [_cell_to_name(name) for name in names[:MAX_NAMES_IN_SENTENCE]]
    more = [f"{len(names) - MAX_NAMES_IN_SENTENCE} more"] if len(names) > MAX_NAMES_IN_SENTENCE else []
    return join_names([*shown, *more])
