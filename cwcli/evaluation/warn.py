"""Evaluation of the warnings against the real conflicts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from cwcli.channels.published import EGO_STATE, REMOTE_STATE, TARGETS, WARNINGS
from cwcli.channels.vehicle_state import driven_distance_m
from cwcli.channels.warning import (
    WARNING_FIELDS_FOR_EVENTS,
    WarningEvent,
    read_warnings,
    warning_events_with_known_start,
)
from cwcli.evaluation.actual_outcomes import ActualOutcomes, find_actual_outcomes, read_actual_tracks
from cwcli.evaluation.conflicts import judge_warning
from cwcli.evaluation.evaluation_context import EvaluationContext
from cwcli.evaluation.knowledge import (
    comparison_label,
    online_or_hindsight_of_ego_states,
    online_or_hindsight_of_stage_input,
)
from cwcli.evaluation.preventable import add_preventable_share
from cwcli.evaluation.records import find_collision_warning_record_and_is_of_targets
from cwcli.evaluation.scored_warnings import WarningScores, score_warning_verdicts, score_warnings
from cwcli.lazy_dataclass import replace
from cwcli.logs.read.reader import Log
from cwcli.measures.pair import ActualTrack
from cwcli.metrics.headline import HeadlineCollector, find_metric
from cwcli.pipeline.json_names import CellWithValues
from cwcli.pipeline.records import (
    WITHHELD_WARNINGS_RECORD_KEY,
    Record,
    parse_json_entry_or_empty,
    read_configuration,
    read_run_records,
    to_int_or_none,
)
from cwcli.pipeline.result import StageResult, SummaryTable
from cwcli.stages.summaries.warn import RuleOutcome, continue_event_numbers, tables_by_unique_name
from cwcli.stages.warn import WarnConfig, WarningEvidence
from cwcli.stages.warn_lane import WarnLaneConfig
from cwcli.stages.warn_targets import WarnTargetsConfig
from cwcli.warning.evaluate import FoundWarnings
from cwcli.warning.lane_departure import LANE_DEPARTURE_RULE_NAME as LANE_DEPARTURE
from cwcli.warning.types import WarningConfig

TERMINAL_HEADING_BY_SCORE_COLUMN = {
    "n_events": "warnings",
    "n_true": "true warnings",
    "n_late": "late warnings",
    "n_false": "false warnings",
    "n_undecided": "undecided warnings",
    "n_withheld": "warnings withheld",
    "n_conflicts": "conflicts",
    "n_conflicts_warned": "conflicts with a warning in time",
    "n_conflicts_late": "conflicts with a late warning",
    "n_conflicts_missed": "conflicts missed",
    "n_crashes": "conflicts in which the outlines touched",
    "lead_time_mean_s": "time from warning to conflict, mean [s]",
    "lead_time_min_s": "time from warning to conflict, least [s]",
    "host_hours": "length of the ego's track [h]",
}
"""Column of the table `scores` -> what the summary calls it."""
VERDICT_HEADINGS = (
    "verdict on the warning",
    "time from warning to real conflict [s]",
    "real least distance of centres [m]",
    "outlines really touched",
)
"""Headings of the verdicts, which the table of warnings gets in addition."""


def add_scores_to_result(log: Log, config: WarnConfig | WarnLaneConfig, result: StageResult) -> StageResult:
    """Add verdicts on the warnings, the real conflicts and the counts of both to the result, rule by rule.

    True departures from the lane are not known, so warnings of `warn-lane` get no verdict.
    """
    evidence: WarningEvidence | None = result.evaluation_inputs
    if evidence is None:
        return result
    others = TARGETS.role if isinstance(config, WarnTargetsConfig) else REMOTE_STATE.role
    actual = read_actual_tracks(log, config, (EGO_STATE.role, others))
    outcomes = [
        _judge_rule_outcome(found, outcome, actual)
        for found, outcome in zip(evidence.found, evidence.outcomes, strict=True)
    ]
    numbered = continue_event_numbers(outcomes, earlier=evidence.earlier)
    sections = tuple(section for outcome in numbered for section in outcome.sections)
    return replace(
        result,
        tables=tables_by_unique_name(numbered),
        summary=replace(result.summary, sections=sections),
        evaluation_inputs=None,
    )


def _judge_rule_outcome(found: FoundWarnings, outcome: RuleOutcome, actual: Mapping[str, ActualTrack]) -> RuleOutcome:
    scored = score_warnings(found, actual=actual)
    events, *others = outcome.sections
    rows = tuple(
        (
            *row,
            event["verdict"],
            event["lead_time_s"],
            event["closest_distance_m"],
            _has_outline_contact_or_none(event["least_gap_m"]),
        )
        for row, event in zip(events.rows, scored.events.rows_as_dicts(), strict=True)
    )
    ((_, *counts),) = (row.items() for row in scored.scores.rows_as_dicts())
    cells = tuple(
        (CellWithValues(TERMINAL_HEADING_BY_SCORE_COLUMN[name], {"": name.removeprefix("n_").replace("_", " ")}), value)
        for name, value in counts
    )
    sections = (
        replace(
            events,
            columns=(*events.columns, *VERDICT_HEADINGS),
            rows=rows,
            names=(*(events.names or events.columns), "verdict", "lead [s]", "closest [m]", "crash"),
        ),
        SummaryTable(
            "scores",
            "Warnings and conflicts, compared with what really happened",
            ("count or time", "value"),
            cells,
            names=("measure", "value"),
        ),
        *others,
    )
    return replace(outcome, tables=scored.tables, sections=sections)


def _has_outline_contact_or_none(least_gap_m: float) -> bool | None:
    """Return whether the outlines touched in the conflict of a warning; None without a conflict."""
    return None if math.isnan(least_gap_m) else least_gap_m <= 0.0


def add_metrics(context: EvaluationContext) -> None:
    """Add the metrics of the warnings; nothing if the log has no such channel.

    The metrics without a rule in their name are of the first collision rule; of several rules each has its own too.
    """
    headline, log = context.headline, context.log
    if all(channel.topic != WARNINGS.topic for channel in log.channels):
        return
    records = read_run_records(log)
    events = warning_events_with_known_start(read_warnings(log.columns(WARNINGS.topic, WARNING_FIELDS_FOR_EVENTS)))
    rules = _rule_names_from_records(records)
    if LANE_DEPARTURE in rules:
        headline.add_count("warnings.lane_departure_count", sum(event.rule == LANE_DEPARTURE for event in events))
    record, _ = find_collision_warning_record_and_is_of_targets(records)
    withheld = parse_json_entry_or_empty(record, WITHHELD_WARNINGS_RECORD_KEY, dict)
    collision_rules = [rule for rule in rules if rule != LANE_DEPARTURE]
    real = find_actual_outcomes(log) if collision_rules else None
    if real is None:  # the states are missing
        return
    for k, (rule, scores) in enumerate(judge_published_warnings(real, events, collision_rules).items()):
        with headline.label_rows_with_states(
            comparison_label(
                online_or_hindsight_of_stage_input(records, record), online_or_hindsight_of_ego_states(records)
            )
        ):
            if k == 0:
                add_warning_scores(headline, "warnings", scores)
                if context.ego.states is not None:
                    driven_km = driven_distance_m(context.ego.states) / 1000.0
                    headline.add_from_sums(
                        "warnings.raised_per_100km", scores.n_warnings, driven_km / 100.0, n=scores.n_warnings
                    )
            if len(collision_rules) > 1 and find_metric(f"warnings.{rule}.precision") is not None:
                add_warning_scores(headline, f"warnings.{rule}", scores)
        n_withheld = to_int_or_none(withheld.get(rule)) if k == 0 else None
        if n_withheld is not None:
            headline.add_count("warnings.withheld_count", n_withheld)
    with headline.label_rows_with_states(online_or_hindsight_of_ego_states(records)):
        add_preventable_share(headline, real)


def _rule_names_from_records(records: Mapping[str, Record]) -> list[str]:
    """Return the names of the rules that were evaluated."""
    record, _ = find_collision_warning_record_and_is_of_targets(records)
    of_lane = [LANE_DEPARTURE] if "warn-lane" in records else []
    if of_lane and not record:
        return of_lane
    configuration = read_configuration(record)
    rules, options = configuration.get("rules"), configuration.get("rule")
    if isinstance(rules, list) and rules:
        return list(dict.fromkeys([*map(str, rules), *of_lane]))
    named = options.get("rule") if isinstance(options, dict) else None
    return [WarningConfig().rule if named is None else str(named), *of_lane]


def add_warning_scores(headline: HeadlineCollector, prefix: str, scores: WarningScores) -> None:
    """Add the scores of one rule under a prefix of metrics, with counts for `warnings` and for another system."""
    n_warned = scores.n_in_time + scores.n_warned_late
    decided = scores.n_warnings - scores.n_undecided
    is_whole = find_metric(f"{prefix}.count") is not None
    if is_whole:
        headline.add_count(f"{prefix}.count", scores.n_warnings)
        headline.add_count(f"{prefix}.conflicts_count", scores.n_conflicts)
        headline.add_count(f"{prefix}.missed_count", scores.n_conflicts - n_warned)
        headline.add_count(f"{prefix}.false_count", scores.n_false)
        headline.add_count(f"{prefix}.undecided_count", scores.n_undecided)
    headline.add_from_sums(f"{prefix}.precision", scores.n_true + scores.n_late, decided)
    headline.add_from_sums(f"{prefix}.recall", n_warned, scores.n_conflicts)
    headline.add_from_sums(f"{prefix}.timeliness", scores.n_in_time, n_warned)
    headline.add_from_sums(f"{prefix}.lead_time_mean_s", math.fsum(scores.lead_times_s), len(scores.lead_times_s))
    if is_whole and scores.lead_times_s:
        headline.add_from_sums(f"{prefix}.lead_time_min_s", min(scores.lead_times_s), 1.0, n=len(scores.lead_times_s))
    headline.add_from_sums(f"{prefix}.false_alarms_per_hour", scores.n_false, scores.host_hours, n=scores.n_false)
    if is_whole:
        headline.add_from_sums(f"{prefix}.raised_per_hour", scores.n_warnings, scores.host_hours, n=scores.n_warnings)


def judge_published_warnings(
    real: ActualOutcomes, events: Sequence[WarningEvent], rules: Sequence[str]
) -> dict[str, WarningScores]:
    """Judge the warnings of an annotated log as `cwcli warn` did; returns scores by rule."""
    found = {}
    for rule in rules:
        verdicts = (
            [judge_warning(*span, real.conflicts[vehicle], real.pairs[vehicle], real.config) for span in spans]
            for vehicle, spans in _warning_spans_ns_by_vehicle(events, rule).items()
            if vehicle in real.pairs
        )
        found[rule] = score_warning_verdicts(verdicts, n_conflicts=real.n_conflicts, host_hours=real.host_hours)
    return found


def _warning_spans_ns_by_vehicle(events: Sequence[WarningEvent], rule: str) -> dict[str, list[tuple[int, int]]]:
    """Return by vehicle when each warning of a rule was raised and last held, in order of time."""
    found: dict[str, list[tuple[int, int]]] = {}
    for event in events:
        if event.rule == rule:
            found.setdefault(event.other_id, []).append((event.raised_ns, event.last_ns))
    return found
