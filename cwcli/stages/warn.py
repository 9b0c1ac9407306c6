"""Stage `warn`: states and predicted paths in, warnings and their scores out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from cwcli.channels.binding import bind
from cwcli.channels.predicted_path import PredictedPaths, read_paths
from cwcli.channels.published import EGO_PATH, EGO_STATE, REMOTE_PATH, REMOTE_STATE, TARGETS
from cwcli.channels.target import read_targets
from cwcli.channels.vehicle_state import VehicleStates, read_states, require_ego
from cwcli.channels.warning import write_warnings
from cwcli.errors import DataError, MissingSignalError, UsageError
from cwcli.logs.log import Log
from cwcli.pipeline.result import Cell, InputCount, Section, StageResult, Summary
from cwcli.pipeline.run_record import run_record
from cwcli.prediction.models import MODELS
from cwcli.prediction.paths import Paths
from cwcli.prediction.rollout import rollout
from cwcli.signals.columns import FloatArray
from cwcli.signals.rows import rows_by_id, rows_by_stamp
from cwcli.signals.units import NS_PER_S
from cwcli.stages.predict import MAX_MESSAGE_AGE_S
from cwcli.stages.summaries.warn import RuleOutcome, numbered, tables_of
from cwcli.warning.evaluate import check_config as check_rule
from cwcli.warning.evaluate import evaluate
from cwcli.warning.lane_departure import RULE as LANE_DEPARTURE
from cwcli.warning.lane_departure import LaneDepartureConfig
from cwcli.warning.rules import RULES
from cwcli.warning.types import VehicleTrack, WarningConfig, WarningResult, outline_of

ALL_RULES = (*RULES, LANE_DEPARTURE)
ONSET = "onset"
"""The motion model that says where a manoeuvre leads that has just begun."""
OF_EGO = (EGO_STATE.role, EGO_PATH.role)
OF_OTHERS = (REMOTE_STATE.role, REMOTE_PATH.role)

Source = Literal["v2x", "targets"]


@dataclass(frozen=True)
class WarnConfig:
    """Settings of the stage.

    Attributes:
        rule: The collision rule and its thresholds.
        rules: Several rules: names of collision rules, each with the thresholds of `rule`, and `lane-departure`.
            Empty: the collision rule of `rule` alone.
        lane_departure: Options of that rule.
        source: Whom to warn of: the vehicles that speak over V2X, or the targets of `cwcli track`.
        topics: Role -> topic, the user's choices.
        start_ns, end_ns: Only states logged in this span are used.
    """

    rule: WarningConfig = field(default_factory=WarningConfig)
    rules: tuple[str, ...] = ()
    lane_departure: LaneDepartureConfig = field(default_factory=LaneDepartureConfig)
    source: Source = "v2x"
    topics: Mapping[str, str] = field(default_factory=dict)
    start_ns: int | None = None
    end_ns: int | None = None


def warn(log: Log, config: WarnConfig) -> StageResult:
    """Warn the ego of the other vehicles, at each of its states, and of leaving its lane, at each frame.

    Of several rules those for which the log lacks a channel are left out, with a note.

    Raises:
        MissingSignalError: The log lacks a state or path channel, for each of the rules.
        UsageError: An unknown rule, or a threshold out of range.
        DataError: States and paths do not belong together.
    """
    names = _checked_rules(config)
    outcomes: list[RuleOutcome] = []
    missing: list[tuple[str, MissingSignalError]] = []
    for group in _groups(names):
        try:
            outcomes += _lane_departure(log, config) if LANE_DEPARTURE in group else _collisions(log, config, group)
        except MissingSignalError as error:
            missing.append((", ".join(group), error))
    if not outcomes:
        raise missing[0][1]
    outcomes = numbered(sorted(outcomes, key=lambda outcome: names.index(outcome.rule)))
    summary = Summary(
        title="warn",
        sections=tuple(section for outcome in outcomes for section in outcome.sections),
        inputs=_distinct_inputs(outcomes),
        notes=(
            *dict.fromkeys(note for outcome in outcomes for note in outcome.notes),
            *(f"{group} is left out: {error.what}" for group, error in missing),
        ),
    )
    channels = write_warnings([outcome.rows for outcome in outcomes])
    return StageResult("warn", channels, tables_of(outcomes), summary, run_record("warn", log, config, summary))


def _distinct_inputs(outcomes: list[RuleOutcome]) -> tuple[InputCount, ...]:
    """Each channel in each role once."""
    return tuple({(count.topic, count.role): count for outcome in outcomes for count in outcome.inputs}.values())


def check_config(config: WarnConfig) -> None:
    """Check what can be checked without a log.

    Raises:
        UsageError: An unknown rule, or a value out of its range.
    """
    for name in _checked_rules(config):
        if name != LANE_DEPARTURE:
            check_rule(replace(config.rule, rule=name))


def _checked_rules(config: WarnConfig) -> tuple[str, ...]:
    names = tuple(dict.fromkeys(config.rules or (config.rule.rule,)))
    for name in names:
        if name not in ALL_RULES:
            raise UsageError(f"there is no warning rule '{name}'", hint=f"one of: {', '.join(ALL_RULES)}")
    return names


def _groups(names: tuple[str, ...]) -> list[tuple[str, ...]]:
    """The collision rules, which need the same channels, and lane departure; what was named first comes first."""
    collisions = tuple(name for name in names if name != LANE_DEPARTURE)
    groups = [group for group in (collisions, (LANE_DEPARTURE,)) if group and group[0] in names]
    return sorted(groups, key=lambda group: names.index(group[0]))


def _lane_departure(log: Log, config: WarnConfig) -> list[RuleOutcome]:
    from cwcli.stages.warn_lanes import NEEDED, warn_of_lane_departure

    bound = bind(log.channels, config.topics, required=NEEDED, where=log.name, command=f"warn --rules {LANE_DEPARTURE}")
    found = warn_of_lane_departure(log, bound, config.lane_departure, start_ns=config.start_ns, end_ns=config.end_ns)
    tables = (found.result.events, found.result.series)
    return [
        RuleOutcome(
            LANE_DEPARTURE,
            found.result.rows,
            tables,
            found.sections,
            found.inputs,
            (*bound.notes, *found.notes),
        )
    ]


def _collisions(log: Log, config: WarnConfig, names: tuple[str, ...]) -> list[RuleOutcome]:
    """The collision rules, on the same tracks.

    Targets are predicted here, with the model, the step and the horizon of the ego's own paths.
    """
    bound = bind(
        log.channels,
        config.topics,
        required=OF_EGO + (OF_OTHERS if config.source == "v2x" else (TARGETS.role,)),
        where=log.name,
        command="warn",
    )
    topics = {role: bindings[0].topic for role, bindings in bound.by_role.items()}
    columns = log.load(dict.fromkeys(topics.values()))
    uses_onset = any(RULES[name].uses_onset for name in names)
    inputs: list[InputCount] = []
    tracks: dict[str, list[VehicleTrack]] = {}
    predicted: dict[str, PredictedPaths] = {}
    for state_role, path_role in ((EGO_STATE.role, EGO_PATH.role), (REMOTE_STATE.role, REMOTE_PATH.role)):
        if state_role not in topics:
            continue
        everything = read_states(columns[topics[state_role]])
        states = everything.logged_within(config.start_ns, config.end_ns)
        if state_role == EGO_STATE.role:
            require_ego(states, log_name=log.name, topic=topics[state_role])
        predicted[path_role] = read_paths(columns[topics[path_role]])
        is_other = state_role == REMOTE_STATE.role
        tracks[state_role] = vehicle_tracks(states, predicted[path_role], with_onset=is_other and uses_onset)
        n_used = sum(len(track.stamp_ns) for track in tracks[state_role])
        inputs.append(InputCount(topics[state_role], state_role, len(everything), n_used))
        inputs.append(InputCount(topics[path_role], path_role, len(predicted[path_role]), n_used))
    hosts = tracks[EGO_STATE.role]
    if len(hosts) != 1:
        raise DataError(f"expected the states of one ego, found {len(hosts)}", where=topics[EGO_STATE.role])
    if config.source == "targets":
        everything = read_targets(columns[topics[TARGETS.role]])
        states = everything.logged_within(config.start_ns, config.end_ns)
        paths = _paths_of(states, like=predicted[EGO_PATH.role], where=topics[EGO_PATH.role])
        tracks[REMOTE_STATE.role] = vehicle_tracks(states, paths, with_onset=uses_onset)
        inputs.append(InputCount(topics[TARGETS.role], TARGETS.role, len(everything), len(states)))
    outcomes = []
    for name in names:
        result = evaluate(hosts[0], tracks[REMOTE_STATE.role], replace(config.rule, rule=name))
        sections = _sections(result, log.start_ns)
        outcomes.append(RuleOutcome(name, result.rows, result.tables, sections, tuple(inputs), bound.notes))
    return outcomes


def vehicle_tracks(states: VehicleStates, predicted: PredictedPaths, *, with_onset: bool = False) -> list[VehicleTrack]:
    """One track per vehicle: its states, in stamp order, each with the path that starts from it.

    Args:
        with_onset: Add the paths of the onset hypothesis, which are never published: they are no prediction.
    """
    path_rows = dict(rows_by_id(predicted.ids))
    tracks = []
    for vehicle, unordered in rows_by_id(states.ids):
        candidates = path_rows.get(vehicle)
        if candidates is None:
            continue
        rows = rows_by_stamp(states.stamp_ns, unordered)
        candidates = rows_by_stamp(predicted.stamp_ns, candidates)
        _, mine, theirs = np.intersect1d(
            states.stamp_ns[rows], predicted.stamp_ns[candidates], assume_unique=True, return_indices=True
        )
        if not len(mine):
            continue
        rows, candidates = rows[mine], candidates[theirs]
        length_m, width_m = outline_of(states.length_m[rows], states.width_m[rows])
        tracks.append(
            VehicleTrack(
                id=vehicle,
                stamp_ns=states.stamp_ns[rows],
                log_time_ns=states.log_time_ns[rows],
                state=states.state[rows],
                paths=predicted.paths.take(candidates),
                length_m=length_m,
                width_m=width_m,
                onset_paths=_onset(states, rows, predicted.paths.time_s) if with_onset else None,
            )
        )
    return tracks


def _paths_of(states: VehicleStates, *, like: PredictedPaths, where: str) -> PredictedPaths:
    """Paths that start from the states, predicted like others.

    Raises:
        DataError: The others were predicted with a model that is not known here, or there are none.
    """
    if like.model not in MODELS:
        raise DataError(f"the paths' motion model {like.model!r} is not known", where=where, hint="predict again")
    time_s = like.paths.time_s
    step_s = float(time_s[1] - time_s[0])
    horizon_s = float(time_s[-1]) + MAX_MESSAGE_AGE_S
    paths = rollout(like.model, states.state, states.covariance, horizon_s=horizon_s, step_s=step_s)
    return PredictedPaths.of(states, like.model, paths)


def _onset(states: VehicleStates, rows: npt.NDArray[np.intp], time_s: FloatArray) -> Paths:
    """Paths of the onset hypothesis from some states, over the same times as the predicted ones."""
    step_s = float(time_s[1] - time_s[0])
    return rollout(ONSET, states.state[rows], states.covariance[rows], horizon_s=float(time_s[-1]), step_s=step_s)


def _sections(result: WarningResult, start_ns: int) -> tuple[Section, ...]:
    events: tuple[tuple[Cell, ...], ...] = tuple(
        (
            event["event_id"],
            event["other_id"],
            (event["raised_stamp_ns"] - start_ns) / NS_PER_S,
            event["time_to_event_s"],
            event["predicted_distance_m"],
            event["verdict"],
            event["lead_time_s"],
            event["closest_distance_m"],
        )
        for event in result.events.records()
    )
    columns = ("event", "vehicle", "at [s]", "event in [s]", "pred. [m]", "verdict", "lead [s]", "closest [m]")
    (scores,) = result.scores.records()
    rule = scores.pop("rule")
    score_rows = tuple((name.removeprefix("n_").replace("_", " "), value) for name, value in scores.items())
    counts = tuple((name.replace("_", " "), count) for name, count in result.counts.items())
    return (
        Section("events", f"Warnings (rule {rule}; times from the log's start)", columns, events),
        Section("scores", "Against what really happened", ("measure", "value"), score_rows),
        Section("evaluations", "Evaluations of a pair of vehicles", ("what became of them", "count"), counts),
    )
