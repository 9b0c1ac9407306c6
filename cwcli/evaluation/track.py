"""Evaluation of `track`: scores against the truth of the targets, and headline metrics from its record."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cwcli.evaluation.knowledge import TRUTH, against, knowledge_of
from cwcli.evaluation.subject import Subject
from cwcli.evaluation.target_truth import score_record, score_rows, score_sections, scores_of
from cwcli.logs.read.reader import Log
from cwcli.metrics.table import with_rows
from cwcli.pipeline.records import json_entry, number, run_records
from cwcli.pipeline.result import StageResult
from cwcli.signals.canonical import TargetTruthSignal
from cwcli.stages.track import Made, TrackConfig


def judge_result(log: Log, config: TrackConfig, result: StageResult) -> StageResult:
    """Add the scores of the tracks to the result, if the log has a truth; their sums go into the record."""
    made: Made = result.made
    truth = next((each for each in made.truths if isinstance(each, TargetTruthSignal)), None)
    if truth is None:
        return result.judged(entries={"scores": score_record(made.result, None)})
    errors, notes = scores_of(truth, made.result, made.moments_ns, in_map=made.in_map, local_map=made.local_map)
    entries = {"scores": score_record(made.result, errors)}
    if errors is None:
        return result.judged(notes=notes, at=made.n_notes, entries=entries)
    return result.judged(
        sections=score_sections(errors, len(made.result.tracks)),
        tables={"track": with_rows(result.tables["track"], score_rows(errors))},
        notes=notes,
        at=made.n_notes,
        entries=entries,
    )


def add_metrics(subject: Subject) -> None:
    """Add the metrics of the tracks; nothing if the log has none, or if an older version wrote them."""
    headline, log = subject.headline, subject.log
    record = run_records(log).get("track", {})
    entry: Mapping[str, Any] = json_entry(record, "scores", dict)
    if not entry:
        return
    headline.count("tracking.targets_count", number(entry, "tracks"))
    inside = entry.get("nis_inside")
    if isinstance(inside, list):
        headline.share("tracking.nis_inside_share", [bool(each) for each in inside])
    truth = entry.get("truth")
    if not subject.with_truth or not isinstance(truth, dict):
        return
    tracked = number(truth, "tracked")
    with headline.of(against(knowledge_of(record), TRUTH)):
        headline.add("tracking.gospa_m", number(truth, "gospa_sum_m"), number(truth, "moments"))
        headline.add("tracking.position_rmse_m", number(truth, "position_square_sum_m2"), tracked)
        headline.add("tracking.velocity_rmse_mps", number(truth, "velocity_square_sum_m2ps2"), tracked)
        headline.add("tracking.tracked_share", tracked, number(truth, "present"))
        headline.count("tracking.switch_count", number(truth, "switches"))
