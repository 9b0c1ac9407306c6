"""Evaluation of the warnings against the real conflicts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from cwcli.channels.published import EGO_STATE, REMOTE_STATE, TARGETS, WARNINGS
from cwcli.channels.warning import WITHOUT_WORDS, WarningEvent, read_warnings, warning_events
from cwcli.evaluation.conflicts import judge
from cwcli.evaluation.estimate import driven_m
from cwcli.evaluation.happened import Happened, recorded_tracks, what_happened
from cwcli.evaluation.knowledge import against, estimated, read_by
from cwcli.evaluation.preventable import add_preventable
from cwcli.evaluation.records import warn_record
from cwcli.evaluation.scored_warnings import WarningScores, count_verdicts, score
from cwcli.evaluation.subject import Subject
from cwcli.logs.read.reader import Log
from cwcli.measures.pair import ActualTrack
from cwcli.metrics.headline import Headline, metric_of
from cwcli.pipeline.records import WITHHELD, Record, configuration_of, json_entry, run_records, whole
from cwcli.pipeline.result import Section, StageResult
from cwcli.stages.summaries.warn import RuleOutcome, number_outcomes, tables_of
from cwcli.stages.warn import Made, WarnConfig
from cwcli.stages.warn_lane import WarnLaneConfig
from cwcli.stages.warn_targets import WarnTargetsConfig
from cwcli.warning.evaluate import FoundWarnings
from cwcli.warning.lane_departure import RULE as LANE_DEPARTURE
from cwcli.warning.types import WarningConfig


def judge_result(log: Log, config: WarnConfig | WarnLaneConfig, result: StageResult) -> StageResult:
    """Add verdicts on the warnings, the real conflicts and the counts of both to the result, rule by rule.

    True departures from the lane are not known, so warnings of `warn-lane` get no verdict.
    """
    made: Made | None = result.made
    if made is None:
        return result
    others = TARGETS.role if isinstance(config, WarnTargetsConfig) else REMOTE_STATE.role
    actual = recorded_tracks(log, config, (EGO_STATE.role, others))
    outcomes = [_judged(found, outcome, actual) for found, outcome in zip(made.found, made.outcomes, strict=True)]
    numbered = number_outcomes(outcomes, after=made.earlier)
    sections = tuple(section for outcome in numbered for section in outcome.sections)
    return replace(result, tables=tables_of(numbered), summary=replace(result.summary, sections=sections), made=None)


def _judged(found: FoundWarnings, outcome: RuleOutcome, actual: Mapping[str, ActualTrack]) -> RuleOutcome:
    scored = score(found, actual=actual)
    events, *others = outcome.sections
    rows = tuple(
        (*row, event["verdict"], event["lead_time_s"], event["closest_distance_m"])
        for row, event in zip(events.rows, scored.events.records(), strict=True)
    )
    ((_, *counts),) = (row.items() for row in scored.scores.records())
    cells = tuple((name.removeprefix("n_").replace("_", " "), value) for name, value in counts)
    sections = (
        replace(events, columns=(*events.columns, "verdict", "lead [s]", "closest [m]"), rows=rows),
        Section("scores", "Against what really happened", ("measure", "value"), cells),
        *others,
    )
    return replace(outcome, tables=scored.tables, sections=sections)


def add_metrics(subject: Subject) -> None:
    """Add the metrics of the warnings; nothing if the log has no such channel.

    The metrics without a rule in their name are of the first collision rule; of several rules each has its own too.
    """
    headline, log = subject.headline, subject.log
    if all(channel.topic != WARNINGS.topic for channel in log.channels):
        return
    records = run_records(log)
    events = warning_events(read_warnings(log.columns(WARNINGS.topic, WITHOUT_WORDS)))
    rules = _rules(records)
    if LANE_DEPARTURE in rules:
        headline.count("warnings.lane_departure_count", sum(event.rule == LANE_DEPARTURE for event in events))
    record, _ = warn_record(records)
    withheld = json_entry(record, WITHHELD, dict)
    collision_rules = [rule for rule in rules if rule != LANE_DEPARTURE]
    real = what_happened(log) if collision_rules else None
    if real is None:  # the states are missing
        return
    for k, (rule, scores) in enumerate(judge_warnings(real, events, collision_rules).items()):
        with headline.of(against(read_by(records, record), estimated(records))):
            if k == 0:
                add_scores(headline, "warnings", scores)
                if subject.ego.states is not None:
                    driven_km = driven_m(subject.ego.states) / 1000.0
                    headline.add("warnings.raised_per_100km", scores.n_events, driven_km / 100.0, n=scores.n_events)
            if len(collision_rules) > 1 and metric_of(f"warnings.{rule}.precision") is not None:
                add_scores(headline, f"warnings.{rule}", scores)
        n_withheld = whole(withheld.get(rule)) if k == 0 else None
        if n_withheld is not None:
            headline.count("warnings.withheld_count", n_withheld)
    with headline.of(estimated(records)):
        add_preventable(headline, real)


def _rules(records: Mapping[str, Record]) -> list[str]:
    """Return the names of the rules that were evaluated."""
    record, _ = warn_record(records)
    of_lane = [LANE_DEPARTURE] if "warn-lane" in records else []
    if of_lane and not record:
        return of_lane
    configuration = configuration_of(record)
    rules, options = configuration.get("rules"), configuration.get("rule")
    if isinstance(rules, list) and rules:
        return list(dict.fromkeys([*map(str, rules), *of_lane]))
    named = options.get("rule") if isinstance(options, dict) else None
    return [WarningConfig().rule if named is None else str(named), *of_lane]


def add_scores(headline: Headline, prefix: str, found: WarningScores) -> None:
    """Add the scores of one rule under a prefix of metrics, with counts for `warnings` and for another system."""
    n_warned = found.n_in_time + found.n_warned_late
    decided = found.n_events - found.n_undecided
    is_whole = metric_of(f"{prefix}.count") is not None
    if is_whole:
        headline.count(f"{prefix}.count", found.n_events)
        headline.count(f"{prefix}.conflicts_count", found.n_conflicts)
        headline.count(f"{prefix}.missed_count", found.n_conflicts - n_warned)
        headline.count(f"{prefix}.false_count", found.n_false)
        headline.count(f"{prefix}.undecided_count", found.n_undecided)
    headline.add(f"{prefix}.precision", found.n_true + found.n_late, decided)
    headline.add(f"{prefix}.recall", n_warned, found.n_conflicts)
    headline.add(f"{prefix}.timeliness", found.n_in_time, n_warned)
    headline.add(f"{prefix}.lead_time_mean_s", math.fsum(found.lead_times_s), len(found.lead_times_s))
    if is_whole and found.lead_times_s:
        headline.add(f"{prefix}.lead_time_min_s", min(found.lead_times_s), 1.0, n=len(found.lead_times_s))
    headline.add(f"{prefix}.false_alarms_per_hour", found.n_false, found.host_hours, n=found.n_false)
    if is_whole:
        headline.add(f"{prefix}.raised_per_hour", found.n_events, found.host_hours, n=found.n_events)


def judge_warnings(real: Happened, events: Sequence[WarningEvent], rules: Sequence[str]) -> dict[str, WarningScores]:
    """Judge the warnings of an annotated log as `cwcli warn` did; returns scores by rule."""
    found = {}
    for rule in rules:
        verdicts = (
            [judge(*span, real.conflicts[vehicle], real.pairs[vehicle], real.config) for span in spans]
            for vehicle, spans in _spans(events, rule).items()
            if vehicle in real.pairs
        )
        found[rule] = count_verdicts(verdicts, n_conflicts=real.n_conflicts, host_hours=real.host_hours)
    return found


def _spans(events: Sequence[WarningEvent], rule: str) -> dict[str, list[tuple[int, int]]]:
    """Return by vehicle when each warning of a rule was raised and last held, in order of time."""
    found: dict[str, list[tuple[int, int]]] = {}
    for event in events:
        if event.rule == rule:
            found.setdefault(event.other_id, []).append((event.raised_ns, event.last_ns))
    return found
