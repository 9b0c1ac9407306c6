"""Stage `warn`: states and predicted paths in, warnings of collisions and their scores out."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from typing import Annotated

from cwcli.channels.predicted_path import AnyPaths
from cwcli.channels.published import EGO_PATH, EGO_STATE, REMOTE_EVENTS, REMOTE_PATH, REMOTE_STATE, TARGETS
from cwcli.channels.road_event import read_road_events
from cwcli.channels.target import read_targets
from cwcli.logs.read.reader import Log
from cwcli.option import Option
from cwcli.pipeline.paths import all_paths
from cwcli.pipeline.records import WITHHELD, run_records
from cwcli.pipeline.result import Cell, InputCount, Section, StageResult
from cwcli.pipeline.states import OfStates, bind_states, chosen_states, paths_note
from cwcli.signals.units import NS_PER_S
from cwcli.stages.inputs.sources import read_bound
from cwcli.stages.inputs.vehicles import only_ego, paths_like, vehicle_tracks
from cwcli.stages.summaries.warn import RuleOutcome, warnings_result
from cwcli.warning.evaluate import FoundWarnings, find_warnings
from cwcli.warning.evaluate import check_config as check_rule
from cwcli.warning.rows import WarningRows
from cwcli.warning.rules import RULES
from cwcli.warning.types import VehicleTrack, WarningConfig

EXAMPLES = (
    "cwcli warn predicted.mcap -o warned.mcap --metrics warnings.parquet",
    "cwcli warn predicted.mcap --rule song2016 --horizon 2.5 --distance 2.5",
    "cwcli warn predicted.mcap --rules cwcli,ttc -o warned.mcap",
)
OF_EGO = (EGO_STATE.role, EGO_PATH.role)
OF_OTHERS = (REMOTE_STATE.role, REMOTE_PATH.role)


def _names(text: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name.strip() for name in text.split(",")))


@dataclass(frozen=True)
class WarnConfig(OfStates):
    """Settings of the stage.

    Attributes:
        rule: The rule and its thresholds.
        rules: Several rules, each with the thresholds of `rule`. Empty: that of `rule` alone.
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


@dataclass(frozen=True)
class Made:
    """What is held against what really happened.

    Attributes:
        found: The warnings, rule by rule.
        outcomes: What is said of them, likewise, before their events are numbered on.
        earlier: Warnings that were in the channel before.
    """

    found: tuple[FoundWarnings, ...]
    outcomes: tuple[RuleOutcome, ...]
    earlier: tuple[WarningRows, ...]


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
    notified = (REMOTE_EVENTS.role,) if any(RULES[name].uses_states for name in config.names) else ()
    required = OF_EGO + others
    bound = bind_states(log.channels, config, required=required, optional=notified, where=log.name, command=stage)
    columns = read_bound(log, bound, without=(EGO_PATH.role, REMOTE_PATH.role))
    uses_onset = any(RULES[name].uses_onset for name in config.names)
    inputs: list[InputCount] = []
    tracks: dict[str, list[VehicleTrack]] = {}
    predicted: dict[str, AnyPaths] = {}
    notes = list(bound.notes)
    events = read_road_events(columns[REMOTE_EVENTS.role]) if REMOTE_EVENTS.role in columns else None
    for state_role, path_role in (OF_EGO, OF_OTHERS):
        if state_role not in columns:
            continue
        states, count = chosen_states(log, columns[state_role], state_role, config)
        path_topic = bound.topic(path_role)
        assert path_topic is not None  # it is required
        predicted[path_role], remarks = all_paths(log, path_topic, state_role)
        notes.extend(remarks)
        onset = uses_onset and state_role == REMOTE_STATE.role
        tracks[state_role] = vehicle_tracks(states, predicted[path_role], with_onset=onset, events=events)
        n_used = sum(len(track.stamp_ns) for track in tracks[state_role])
        inputs.append(replace(count, used=n_used))
        inputs.append(InputCount(path_topic, path_role, len(predicted[path_role]), n_used))
    host = only_ego(tracks[EGO_STATE.role], where=columns[EGO_STATE.role].topic)
    if TARGETS.role in columns:
        everything = read_targets(columns[TARGETS.role])
        states = everything.logged_within(config.start_ns, config.end_ns)
        paths = paths_like(states, predicted[EGO_PATH.role], where=log.name)
        tracks[REMOTE_STATE.role] = vehicle_tracks(states, paths, with_onset=uses_onset)
        inputs.append(InputCount(columns[TARGETS.role].topic, TARGETS.role, len(everything), len(states)))
    others_tracks = tracks[REMOTE_STATE.role]
    found = tuple(find_warnings(host, others_tracks, replace(config.rule, rule=name)) for name in config.names)
    outcomes = tuple(
        RuleOutcome(each.config.rule, each.rows, (each.events, each.series), _sections(each, log.start_ns, config))
        for each in found
    )
    withheld = {WITHHELD: json.dumps({each.config.rule: each.n_withheld for each in found})}
    notes.extend(paths_note(config, run_records(log).get("predict", {})))
    result, earlier = warnings_result(stage, log, config, outcomes, tuple(inputs), tuple(notes), **withheld)
    return replace(result, made=Made(found, outcomes, earlier))


def _sections(found: FoundWarnings, start_ns: int, config: WarnConfig) -> tuple[Section, ...]:
    events: tuple[tuple[Cell, ...], ...] = tuple(
        (
            event["event_id"],
            event["other_id"],
            (event["raised_ns"] - start_ns) / NS_PER_S,
            event["time_to_event_s"],
            event["predicted_distance_m"],
        )
        for event in found.events.records()
    )
    columns = ("event", "vehicle", "at [s]", "event in [s]", "pred. [m]")
    counts = tuple((name.replace("_", " "), count) for name, count in found.counts.items())
    counts += (("warnings withheld", found.n_withheld),)
    times = "when they could be known" if config.states == "online" else "stamps of states in hindsight"
    title = f"Warnings (rule {found.config.rule}; times from the log's start: {times})"
    return (
        Section("events", title, columns, events),
        Section("evaluations", "Evaluations of a pair of vehicles", ("what became of them", "count"), counts),
    )
