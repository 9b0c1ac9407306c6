"""The digest of a run on one log: what happened, how far to trust it, what was made, and what to do next."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from cwcli.channels.binding import DESCRIPTION_BY_ROLE
from cwcli.channels.published import EGO_STATE, REMOTE_STATE
from cwcli.digest.drive_sentences import drive_length_sentence
from cwcli.digest.stage_sentences import stage_sentence
from cwcli.evaluation.doubts import find_doubts_in_evidence, find_remarks_in_evidence
from cwcli.evaluation.doubts.base import Doubt
from cwcli.evaluation.doubts.evidence import DoubtEvidence, read_evidence
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.metrics.table import Table
from cwcli.text import format_number, join_names

if TYPE_CHECKING:
    from cwcli.digest.drive import Drive

WARNING_STAGES = ("warn", "warn-targets", "warn-lane")
"""Stages after which the story of the drive, with its warnings, says what happened."""
NO_EGO_STATE_TEXT = f"no channel holds {DESCRIPTION_BY_ROLE[EGO_STATE.role]}"
"""The reason for leaving a stage out where the car's motion was not estimated, in the words of the channels."""

_PATTERN_OF_ALTERNATIVE_STAGES_IN_REASON = re.compile(r" \(another way: --stage ([\w,-]+)\)")
"""How a reason for leaving a stage out names other stages that do the same."""


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
