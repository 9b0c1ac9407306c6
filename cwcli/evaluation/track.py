"""Evaluation of `track`: scores against the truth of the targets, and headline metrics from its record."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cwcli.evaluation.evaluation_context import EvaluationContext
from cwcli.evaluation.knowledge import TRUTH, comparison_label, online_or_hindsight_of_stage_output
from cwcli.evaluation.target_truth import (
    build_score_sections,
    format_score_record_json,
    score_tracks_against_truth,
    target_score_metric_rows,
)
from cwcli.logs.read.reader import Log
from cwcli.metrics.table import append_metric_rows
from cwcli.pipeline.records import parse_json_entry_or_empty, read_finite_number_or_nan, read_run_records
from cwcli.pipeline.result import StageResult
from cwcli.signals.canonical import TargetTruthSignal
from cwcli.stages.track import TrackConfig, TrackingEvidence


def add_scores_to_result(log: Log, config: TrackConfig, result: StageResult) -> StageResult:
    """Add the scores of the tracks to the result, if the log has a truth; their sums go into the record."""
    evidence: TrackingEvidence = result.evaluation_inputs
    truth = next((each for each in evidence.truths if isinstance(each, TargetTruthSignal)), None)
    if truth is None:
        return result.with_evaluation(entries={"scores": format_score_record_json(evidence.result, None)})
    errors, notes = score_tracks_against_truth(
        truth, evidence.result, evidence.moments_ns, in_map=evidence.in_map, local_map=evidence.local_map
    )
    entries = {"scores": format_score_record_json(evidence.result, errors)}
    if errors is None:
        return result.with_evaluation(notes=notes, note_index=evidence.n_notes, entries=entries)
    return result.with_evaluation(
        sections=build_score_sections(errors, len(evidence.result.tracks)),
        tables={"track": append_metric_rows(result.tables["track"], target_score_metric_rows(errors))},
        notes=notes,
        note_index=evidence.n_notes,
        entries=entries,
    )


def add_metrics(context: EvaluationContext) -> None:
    """Add the metrics of the tracks; nothing if the log has none, or if an older version wrote them."""
    headline, log = context.headline, context.log
    record = read_run_records(log).get("track", {})
    entry: Mapping[str, Any] = parse_json_entry_or_empty(record, "scores", dict)
    if not entry:
        return
    headline.add_count("tracking.targets_count", read_finite_number_or_nan(entry, "tracks"))
    inside = entry.get("nis_inside")
    if isinstance(inside, list):
        headline.add_share("tracking.nis_inside_share", [bool(each) for each in inside])
    truth = entry.get("truth")
    if not context.uses_truth or not isinstance(truth, dict):
        return
    tracked = read_finite_number_or_nan(truth, "tracked")
    with headline.label_rows_with_states(comparison_label(online_or_hindsight_of_stage_output(record), TRUTH)):
        headline.add_from_sums(
            "tracking.gospa_m",
            read_finite_number_or_nan(truth, "gospa_sum_m"),
            read_finite_number_or_nan(truth, "moments"),
        )
        headline.add_from_sums(
            "tracking.position_rmse_m", read_finite_number_or_nan(truth, "position_square_sum_m2"), tracked
        )
        headline.add_from_sums(
            "tracking.velocity_rmse_mps", read_finite_number_or_nan(truth, "velocity_square_sum_m2ps2"), tracked
        )
        headline.add_from_sums("tracking.tracked_share", tracked, read_finite_number_or_nan(truth, "present"))
        headline.add_count("tracking.switch_count", read_finite_number_or_nan(truth, "switches"))
