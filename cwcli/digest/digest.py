"""The digest of a run on one log: what happened, how far to trust it, what was made, and what to do next.

What one stage made is said in a sentence, from the summary in its record: the digest of a stage's own command.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from cwcli.channels.binding import DESCRIPTION_BY_ROLE
from cwcli.channels.published import EGO_STATE, REMOTE_STATE
from cwcli.digest.drive_sentences import drive_length_sentence, found_lanes_text, tracked_targets_text
from cwcli.evaluation.doubts import find_doubts_in_evidence, find_remarks_in_evidence
from cwcli.evaluation.doubts.base import Doubt
from cwcli.evaluation.doubts.evidence import DoubtEvidence, read_evidence
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.metrics.table import Table
from cwcli.pipeline.records import Record, RecordedSummary, read_recorded_summary
from cwcli.pipeline.result import Cell
from cwcli.signals.units import KMH_PER_MPS
from cwcli.signals.v2x_codec import EGO_STATION_NOTE_BEGINNING
from cwcli.signals.vehicle_state import EGO_ID
from cwcli.text import format_number, join_names, shorten_and_escape

if TYPE_CHECKING:
    from cwcli.digest.drive import Drive

WARNING_STAGES = ("warn", "warn-targets", "warn-lane")
"""Stages after which the story of the drive, with its warnings, says what happened."""
NO_EGO_STATE_TEXT = f"no channel holds {DESCRIPTION_BY_ROLE[EGO_STATE.role]}"
"""The reason for leaving a stage out where the car's motion was not estimated, in the words of the channels."""
_PATTERN_OF_ALTERNATIVE_STAGES_IN_REASON = re.compile(r" \(another way: --stage ([\w,-]+)\)")
"""How a reason for leaving a stage out names other stages that do the same."""
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


@dataclass(frozen=True)
class Digest:
    """What a run on one log came to.

    Attributes:
        happened: Sentences on what happened, the most important first.
        more: Further facts, which are said behind how far to trust them.
        doubts: Reasons not to believe it, the worst first.
        confidence: What is known of its errors, in sentences; said where there is no doubt.
    """

    happened: tuple[str, ...]
    more: tuple[str, ...]
    doubts: tuple[Doubt, ...]
    confidence: tuple[str, ...]


def build_digest(
    log: Log, stages: Sequence[str], left_out: Mapping[str, str], tables: Mapping[str, Table], *, is_run: bool
) -> Digest:
    """Build the digest of stages that have just run; nothing but their results is read.

    Args:
        log: The log in memory, with what the stages made.
        left_out: Stage -> why it did not run.
        is_run: Several stages ran as one run, not a stage by itself.

    Raises:
        InputError: The log is damaged.
        DataError: A channel was written by another version.
    """
    drive = _read_warned_drive(log) if set(stages).intersection(WARNING_STAGES) else None
    evidence = read_evidence(log) if drive is None else drive.doubt_evidence
    doubts = find_doubts_in_evidence(evidence)
    sentences = tuple(filter(None, (stage_sentence(stage, evidence.records, tables) for stage in stages)))
    if drive is not None:
        happened, more = _story_sentences(drive)
        more = (*more, *sentences)
    else:
        length = drive_length_sentence(log, evidence.ego, evidence.records, n_heard=_count_heard_vehicles(log))
        reason = _reason_for_no_warnings(left_out) if is_run else ()
        is_length_first = is_run and evidence.ego is not None
        happened, more = ((length, *reason), sentences) if is_length_first else ((*sentences, *reason), (length,))
    return Digest(happened, more, doubts, confidence_sentences(evidence))


def _read_warned_drive(log: Log) -> Drive:
    """Read what the story of a drive with warnings needs."""
    from cwcli.digest.drive import read_drive

    return read_drive(log, with_figures=False)


def _story_sentences(drive: Drive) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return what happened in a drive, as on the page, and how long it was."""
    from cwcli.digest.encounters import find_encounters
    from cwcli.digest.story import build_story

    story = build_story(drive, find_encounters(drive), with_careful_driver=False)
    return (story.happened, *story.more), (story.length,)


def _reason_for_no_warnings(left_out: Mapping[str, str]) -> tuple[str, ...]:
    """Say why a run has no warnings; where the car's motion is missing, why it was not estimated."""
    stage = next((each for each in WARNING_STAGES if each in left_out), None)
    if stage is None:
        return ()
    what = "lane" if stage == "warn-lane" else "collision"
    reason, other = left_out[stage], _PATTERN_OF_ALTERNATIVE_STAGES_IN_REASON.search(left_out[stage])
    reason = reason if other is None else reason[: other.start()]
    if reason == NO_EGO_STATE_TEXT:
        reason = left_out.get("estimate", reason)
    text = f"No {what} warnings were computed: {_replace_channel_names_by_plain_words(reason)}"
    if other is None:
        return (f"{text}.",)
    return (f"{text}; `cwcli run` with --stage {other[1]} {_watched_by_stages_text(other[1])}.",)


def _replace_channel_names_by_plain_words(reason: str) -> str:
    """Return a reason in the words of somebody who knows no channels."""
    return reason.replace("no channel holds", "the log lacks").replace("the ego ", "the car's ")


def _watched_by_stages_text(stages: str) -> str:
    """Say what other stages than `warn` warn of."""
    return "warns of leaving the lane" if stages.endswith("warn-lane") else "gives some warnings"


def _count_heard_vehicles(log: Log) -> int:
    """Count the vehicles that were heard by radio."""
    from cwcli.signals.leaf_fields import read_texts

    if all(channel.topic != REMOTE_STATE.topic for channel in log.channels):
        return 0
    return len(read_texts(log.columns(REMOTE_STATE.topic, ["id"]), "id", required=True).values)


def confidence_sentences(evidence: DoubtEvidence) -> tuple[str, ...]:
    """Say what is known of the errors: those against the truth, or that nothing tells them."""
    errors = [
        f"{format_number(sigma, 2)} {unit} ({name})"
        for name, unit, sigma in evidence.estimate_summary.rows_of_table_columns_or_empty(
            "errors", "quantity", "unit", "RMS error of estimates"
        )
        if isinstance(sigma, float) and str(name).startswith(("position", "speed", "heading"))
    ]
    against = (f"Compared with the true motion in the log, typical errors are {join_names(errors)}.",) if errors else ()
    return (
        *against,
        *_target_error_sentences(evidence),
        *_lane_error_sentences(evidence),
        *(each.sentence for each in find_remarks_in_evidence(evidence)),
    )


def _lane_error_sentences(evidence: DoubtEvidence) -> tuple[str, ...]:
    """Say how far the observed place in the lane is from the true one; () without a truth of it."""
    rows = evidence.summary_of_stage("observe").rows_of_table_columns_or_empty("observer_errors", "state", "RMS error")
    error_m = next((value for state, value in rows if state == "lateral_deviation_m"), None)
    if not isinstance(error_m, float) or not math.isfinite(error_m):
        return ()
    return (
        f"Compared with the true lane in the log, the place in the lane is {format_number(error_m, 2)} m off (RMS).",
    )


def _target_error_sentences(evidence: DoubtEvidence) -> tuple[str, ...]:
    """Say how far the worst tracked target lies from its truth; () without a truth of targets."""
    rows = evidence.summary_of_stage("track").rows_of_table_columns_or_empty(
        "errors", "RMS error of x [m]", "RMS error of y [m]"
    )
    errors_m = [math.hypot(x, y) for x, y in rows if isinstance(x, float) and isinstance(y, float)]
    if not errors_m:
        return ()
    whose = "the target" if len(errors_m) == 1 else "the worst target"
    return (f"Compared with its true position in the log, {whose} is {format_number(max(errors_m), 2)} m off (RMS).",)


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
