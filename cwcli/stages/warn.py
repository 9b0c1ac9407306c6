"""Stage `warn`: states and predicted paths in, warnings of collisions and their scores out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
import numpy.typing as npt

from cwcli.channels.binding import bind
from cwcli.channels.predicted_path import PredictedPaths, read_paths
from cwcli.channels.published import EGO_PATH, EGO_STATE, REMOTE_PATH, REMOTE_STATE, TARGETS, WARNINGS
from cwcli.channels.target import read_targets
from cwcli.channels.vehicle_state import VehicleStates, read_states, require_ego
from cwcli.channels.warning import read_warnings, write_warnings
from cwcli.errors import DataError
from cwcli.logs.read.reader import Log
from cwcli.option import Option
from cwcli.pipeline.result import Cell, InputCount, Section, StageResult, Summary
from cwcli.pipeline.run_record import run_record
from cwcli.prediction.models import MODELS
from cwcli.prediction.paths import Paths
from cwcli.prediction.rollout import rollout
from cwcli.signals.columns import FloatArray
from cwcli.signals.rows import tracks_of
from cwcli.signals.units import NS_PER_S
from cwcli.stages.predict import MAX_MESSAGE_AGE_S
from cwcli.stages.summaries.warn import RuleOutcome, numbered, tables_of
from cwcli.warning.evaluate import check_config as check_rule
from cwcli.warning.evaluate import evaluate
from cwcli.warning.rules import RULES
from cwcli.warning.types import VehicleTrack, WarningConfig, WarningResult, outline_of

EXAMPLES = (
    "cwcli warn predicted.mcap -o warned.mcap --metrics warnings.parquet",
    "cwcli warn predicted.mcap --rule song2016 --horizon 2.5 --distance 2.5",
    "cwcli warn predicted.mcap --rules cwcli,ttc -o warned.mcap",
)
ONSET = "onset"
"""The motion model that says where a manoeuvre leads that has just begun."""
OF_EGO = (EGO_STATE.role, EGO_PATH.role)
OF_OTHERS = (REMOTE_STATE.role, REMOTE_PATH.role)


def _names(text: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name.strip() for name in text.split(",")))


@dataclass(frozen=True)
class WarnConfig:
    """Settings of the stage.

    Attributes:
        rule: The rule and its thresholds.
        rules: Several rules, each with the thresholds of `rule`. Empty: that of `rule` alone.
        topics: Role -> topic, the user's choices.
        start_ns, end_ns: Only states logged in this span are used.
    """

    rule: WarningConfig = field(default_factory=WarningConfig)
    rules: Annotated[
        tuple[str, ...],
        Option(
            "--rules",
            "Several rules in one pass: names of those of --rule.",
            metavar="NAME[,NAME]",
            default="that of --rule",
            kind=str | None,
            parse=_names,
        ),
    ] = ()
    topics: Mapping[str, str] = field(default_factory=dict)
    start_ns: int | None = None
    end_ns: int | None = None

    def __post_init__(self) -> None:
        """Check what can be checked without a log.

        Raises:
            UsageError: An unknown rule, or a value out of its range.
        """
        for name in self.names:
            check_rule(replace(self.rule, rule=name))

    @property
    def names(self) -> tuple[str, ...]:
        """The rules."""
        return self.rules or (self.rule.rule,)


def warn(log: Log, config: WarnConfig) -> StageResult:
    """Warn the ego vehicle of collisions with the others.

    Needs the channels of `cwcli predict`. One conflict is one warning: raised, held, cleared. Where the log holds what
    really happened, warnings are scored as true, false, late or missed, with their lead times.

    Raises:
        MissingSignalError: The log lacks a state or path channel.
        DataError: States and paths do not belong together.
    """
    return warn_of(log, config, "warn", OF_OTHERS)


def warn_of(log: Log, config: WarnConfig, stage: str, others: tuple[str, ...]) -> StageResult:
    """Warn the ego of others, at each of its states.

    Args:
        log: The log.
        config: The rules.
        stage: Name of the stage that this is.
        others: Roles of the others: those of their states and paths, or that of targets, which are predicted here with
            the model, the step and the horizon of the ego's own paths.

    Raises:
        MissingSignalError: The log lacks a channel.
        DataError: States and paths do not belong together.
    """
    bound = bind(log.channels, config.topics, required=OF_EGO + others, where=log.name, command=stage)
    topics = {role: bindings[0].topic for role, bindings in bound.by_role.items()}
    columns = log.load(dict.fromkeys(topics.values()))
    uses_onset = any(RULES[name].uses_onset for name in config.names)
    inputs: list[InputCount] = []
    tracks: dict[str, list[VehicleTrack]] = {}
    predicted: dict[str, PredictedPaths] = {}
    for state_role, path_role in (OF_EGO, OF_OTHERS):
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
    if TARGETS.role in topics:
        everything = read_targets(columns[topics[TARGETS.role]])
        states = everything.logged_within(config.start_ns, config.end_ns)
        paths = _paths_of(states, like=predicted[EGO_PATH.role], where=topics[EGO_PATH.role])
        tracks[REMOTE_STATE.role] = vehicle_tracks(states, paths, with_onset=uses_onset)
        inputs.append(InputCount(topics[TARGETS.role], TARGETS.role, len(everything), len(states)))
    outcomes = []
    for name in config.names:
        result = evaluate(hosts[0], tracks[REMOTE_STATE.role], replace(config.rule, rule=name))
        sections = _sections(result, log.start_ns)
        outcomes.append(RuleOutcome(name, result.rows, result.tables, sections))
    return warnings_result(stage, log, config, outcomes, tuple(inputs), bound.notes)


def warnings_result(
    stage: str,
    log: Log,
    config: object,
    outcomes: Sequence[RuleOutcome],
    inputs: tuple[InputCount, ...],
    notes: tuple[str, ...],
) -> StageResult:
    """What the rules of one stage say. The warnings of an earlier stage of the same run stay in the channel."""
    is_there = any(channel.topic == WARNINGS.topic for channel in log.added_channels)
    earlier = [read_warnings(log.columns(WARNINGS.topic))] if is_there else []
    outcomes = numbered(outcomes, after=earlier)
    channels = write_warnings([*earlier, *(outcome.rows for outcome in outcomes)])
    sections = tuple(section for outcome in outcomes for section in outcome.sections)
    summary = Summary(stage, sections, inputs, notes)
    return StageResult(stage, channels, tables_of(outcomes), summary, run_record(stage, log, config, summary))


def vehicle_tracks(states: VehicleStates, predicted: PredictedPaths, *, with_onset: bool = False) -> list[VehicleTrack]:
    """One track per vehicle: its states, in stamp order, each with the path that starts from it.

    Args:
        with_onset: Add the paths of the onset hypothesis, which are never published: they are no prediction.
    """
    path_rows = dict(tracks_of(predicted.ids, predicted.stamp_ns))
    tracks = []
    for vehicle, all_rows in tracks_of(states.ids, states.stamp_ns):
        candidates = path_rows.get(vehicle)
        if candidates is None:
            continue
        _, mine, theirs = np.intersect1d(
            states.stamp_ns[all_rows], predicted.stamp_ns[candidates], assume_unique=True, return_indices=True
        )
        if not len(mine):
            continue
        rows, candidates = all_rows[mine], candidates[theirs]
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
