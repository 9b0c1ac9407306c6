"""Headline metrics of `warn`: warnings against the conflicts that really happened."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from cwcli.channels.published import EGO_STATE, REMOTE_STATE, TARGETS, WARNINGS
from cwcli.channels.target import read_targets
from cwcli.channels.vehicle_state import read_states
from cwcli.channels.warning import WITHOUT_WORDS, WarningEvent, read_warnings, warning_events
from cwcli.evaluation.records import rule_of, warn_record
from cwcli.evaluation.subject import Subject
from cwcli.logs.read.reader import Log
from cwcli.measures.pair import ActualTrack, Pair
from cwcli.metrics.headline import Headline, metric_of
from cwcli.pipeline.records import Record, configuration_of, run_records, whole
from cwcli.signals.row_order import tracks_of
from cwcli.signals.units import NS_PER_S
from cwcli.warning.conflicts import FALSE, LATE, TRUE, UNDECIDED, RealConflict, judge, real_conflicts
from cwcli.warning.lane_departure import RULE as LANE_DEPARTURE
from cwcli.warning.types import WarningConfig, outline_of

NS_PER_H = 3600 * NS_PER_S


@dataclass(frozen=True)
class WarningScores:
    """What became of the warnings and of the conflicts of a log.

    Attributes:
        n_true, n_late, n_false, n_undecided: Warnings by verdict (`cwcli.warning.conflicts.Verdict`).
        n_conflicts, n_in_time, n_warned_late: Real conflicts; those whose first warning came before they began, and
            after it.
        lead_times_s: Of the conflicts that were warned of.
        host_hours: Length of the host's track.
    """

    n_true: int
    n_late: int
    n_false: int
    n_undecided: int
    n_conflicts: int
    n_in_time: int
    n_warned_late: int
    lead_times_s: tuple[float, ...]
    host_hours: float


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
    collision_rules = [rule for rule in rules if rule != LANE_DEPARTURE]
    for k, (rule, scores) in enumerate(judge_warnings(log, events, collision_rules).items()):
        if k == 0:
            _add_scores(headline, "warnings", scores)
        if len(collision_rules) > 1 and metric_of(f"warnings.{rule}.precision") is not None:
            _add_scores(headline, f"warnings.{rule}", scores)


def _rules(records: Mapping[str, Record]) -> list[str]:
    """The rules that warned, by name."""
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


def _add_scores(headline: Headline, prefix: str, found: WarningScores) -> None:
    n_warned = found.n_in_time + found.n_warned_late
    decided = found.n_true + found.n_late + found.n_false
    if prefix == "warnings":
        headline.count("warnings.count", decided + found.n_undecided)
        headline.count("warnings.conflicts_count", found.n_conflicts)
        headline.count("warnings.missed_count", found.n_conflicts - n_warned)
        headline.count("warnings.false_count", found.n_false)
        headline.count("warnings.undecided_count", found.n_undecided)
    headline.add(f"{prefix}.precision", found.n_true + found.n_late, decided)
    headline.add(f"{prefix}.recall", n_warned, found.n_conflicts)
    headline.add(f"{prefix}.timeliness", found.n_in_time, n_warned)
    headline.add(f"{prefix}.lead_time_mean_s", math.fsum(found.lead_times_s), len(found.lead_times_s))
    if prefix == "warnings" and found.lead_times_s:
        headline.add("warnings.lead_time_min_s", min(found.lead_times_s), 1.0, n=len(found.lead_times_s))
    headline.add(f"{prefix}.false_alarms_per_hour", found.n_false, found.host_hours, n=found.n_false)


def judge_warnings(log: Log, events: Sequence[WarningEvent], rules: Sequence[str]) -> dict[str, WarningScores]:
    """Judge the warnings of an annotated log as `cwcli warn` did: rule -> scores. Empty where states are missing."""
    record, is_of_targets = warn_record(run_records(log))
    configuration = configuration_of(record)
    others_topic = TARGETS.topic if is_of_targets else REMOTE_STATE.topic
    if not rules or not {EGO_STATE.topic, others_topic} <= {channel.topic for channel in log.channels}:
        return {}
    columns = log.load(dict.fromkeys((EGO_STATE.topic, others_topic)))
    host = read_states(columns[EGO_STATE.topic])
    others = (read_targets if others_topic == TARGETS.topic else read_states)(columns[others_topic])
    start_ns, end_ns = (whole(configuration.get(name)) for name in ("start_ns", "end_ns"))
    host, others = host.logged_within(start_ns, end_ns), others.logged_within(start_ns, end_ns)
    if not len(host):
        return {}
    config = rule_of(record)
    host_size, host = outline_of(host.length_m, host.width_m), host.by_stamp()
    own = ActualTrack(host.stamp_ns, host.state)
    hours = float(own.stamp_ns[-1] - own.stamp_ns[0]) / NS_PER_H
    pairs = {
        vehicle: Pair(
            own,
            ActualTrack(others.stamp_ns[rows], others.state[rows]),
            host_size,
            outline_of(others.length_m[rows], others.width_m[rows]),
            config.max_gap_s,
        )
        for vehicle, rows in tracks_of(others.ids, others.stamp_ns)
    }
    conflicts = {vehicle: real_conflicts(pair, config) for vehicle, pair in pairs.items()}
    return {rule: _scores(_spans(events, rule), pairs, conflicts, config, hours) for rule in rules}


def _scores(
    events: Mapping[str, Sequence[tuple[int, int]]],
    pairs: Mapping[str, Pair],
    conflicts: Mapping[str, Sequence[RealConflict]],
    config: WarningConfig,
    hours: float,
) -> WarningScores:
    kinds: list[str] = []
    first: list[str] = []
    leads: list[float] = []
    for vehicle, spans in events.items():
        warned: set[int] = set()
        for raised_ns, last_ns in spans if vehicle in pairs else ():
            verdict = judge(raised_ns, last_ns, conflicts[vehicle], pairs[vehicle], config)
            kinds.append(verdict.kind)
            if verdict.conflict >= 0 and verdict.conflict not in warned:
                warned.add(verdict.conflict)
                first.append(verdict.kind)
                leads.append(verdict.lead_time_s)
    return WarningScores(
        n_true=kinds.count(TRUE),
        n_late=kinds.count(LATE),
        n_false=kinds.count(FALSE),
        n_undecided=kinds.count(UNDECIDED),
        n_conflicts=sum(map(len, conflicts.values())),
        n_in_time=first.count(TRUE),
        n_warned_late=first.count(LATE),
        lead_times_s=tuple(leads),
        host_hours=hours,
    )


def _spans(events: Sequence[WarningEvent], rule: str) -> dict[str, list[tuple[int, int]]]:
    """Vehicle -> when each warning of it by a rule was raised and last held, in order of time."""
    found: dict[str, list[tuple[int, int]]] = {}
    for event in events:
        if event.rule == rule:
            found.setdefault(event.other_id, []).append((event.raised_ns, event.last_ns))
    return found
