"""Stage `warn`: states and predicted paths in, warnings of collisions and their scores out."""

from __future__ import annotations

import json
from dataclasses import field
from typing import Annotated

from cwcli.channels.predicted_path import AnyPaths
from cwcli.channels.published import EGO_PATH, EGO_STATE, REMOTE_EVENTS, REMOTE_PATH, REMOTE_STATE, TARGETS
from cwcli.channels.road_event import read_road_events
from cwcli.channels.target import read_targets_as_states
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.logs.read.reader import Log
from cwcli.option import Option
from cwcli.pipeline.json_names import CellWithValues
from cwcli.pipeline.paths import replanned_or_logged_paths_and_notes
from cwcli.pipeline.records import WITHHELD_WARNINGS_RECORD_KEY, read_run_records
from cwcli.pipeline.result import Cell, InputMessageCount, StageResult, SummaryTable
from cwcli.pipeline.states import (
    StatesSelection,
    bind_state_channels,
    note_if_paths_start_from_other_states,
    read_selected_states,
)
from cwcli.signals.units import NS_PER_S
from cwcli.stages.inputs.sources import read_bound_columns
from cwcli.stages.inputs.vehicles import build_vehicle_tracks, predict_paths_with_settings_of, require_single_ego
from cwcli.stages.summaries.warn import WARNING_NUMBER_HEADING, RuleOutcome, build_warnings_result
from cwcli.text import split_distinct_names
from cwcli.warning.evaluate import FoundWarnings, find_warnings
from cwcli.warning.evaluate import check_warning_config as check_rule
from cwcli.warning.rows import WarningRows
from cwcli.warning.rules import RULES
from cwcli.warning.types import VehicleTrack, WarningConfig

EXAMPLES = (
    "cwcli warn predicted.mcap -o warned.mcap --metrics warnings.parquet",
    "cwcli warn predicted.mcap --rule song2016 --horizon 2.5 --distance 2.5",
    "cwcli warn predicted.mcap --rules cwcli,ttc -o warned.mcap",
)
"""Command lines that the help of `cwcli warn` shows."""
TEXT_BY_EVALUATION_OUTCOME = {
    "evaluated": "evaluated",
    "out_of_reach": "too far away to collide within the horizon",
    "no_message_received_yet": "no message received yet",
    "stale": "newest state too old (--max-age)",
    "beyond_the_predicted_path": "beyond the end of the predicted path",
    "not_finite": "state with a value that is not a number",
    "withheld": "withheld: a state was not reliable",
}
"""Outcome of an evaluation -> what the table of the evaluations calls it."""
EGO_INPUT_ROLES = (EGO_STATE.role, EGO_PATH.role)
"""Roles of the ego's states and of its predicted paths."""
REMOTE_INPUT_ROLES = (REMOTE_STATE.role, REMOTE_PATH.role)
"""Roles of the remote vehicles' states and of their predicted paths."""


@dataclass(frozen=True)
class WarnConfig(StatesSelection):
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
            "Run several rules in one pass, by the names of --rule.",
            metavar="NAME[,NAME]",
            default="that of --rule",
            kind=str | None,
            parse=split_distinct_names,
        ),
    ] = ()

    def __post_init__(self) -> None:
        """Check what can be checked without a log.

        Raises:
            UsageError: An unknown rule, or a value out of its range.
        """
        for name in self.rule_names:
            check_rule(replace(self.rule, rule=name))

    @property
    def rule_names(self) -> tuple[str, ...]:
        """The rules."""
        return self.rules or (self.rule.rule,)


@dataclass(frozen=True)
class WarningEvidence:
    """Values that the evaluation of the stage needs.

    Attributes:
        found: The warnings of each rule.
        outcomes: Rows and tables of each rule, before event ids are made unique over the rules.
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
    return warn_ego_of_others(log, config, "warn", REMOTE_INPUT_ROLES)


def warn_ego_of_others(log: Log, config: WarnConfig, stage: str, others: tuple[str, ...]) -> StageResult:
    """Warn the ego of others, at each of its states.

    Args:
        stage: Name of the stage that this is.
        others: Roles of the others: those of their states and paths, or that of targets, which are predicted here with
            the model, the step and the horizon of the ego's own paths.

    Raises:
        MissingSignalError: The log lacks a channel.
        DataError: States and paths do not belong together.
    """
    notified = (REMOTE_EVENTS.role,) if any(RULES[name].uses_states for name in config.rule_names) else ()
    required = EGO_INPUT_ROLES + others
    bound = bind_state_channels(
        log.channels, config, required=required, optional=notified, where=log.name, command=stage
    )
    columns = read_bound_columns(log, bound, without=(EGO_PATH.role, REMOTE_PATH.role))
    uses_onset = any(RULES[name].uses_onset for name in config.rule_names)
    inputs: list[InputMessageCount] = []
    tracks: dict[str, list[VehicleTrack]] = {}
    predicted: dict[str, AnyPaths] = {}
    notes = list(bound.notes)
    events = read_road_events(columns[REMOTE_EVENTS.role]) if REMOTE_EVENTS.role in columns else None
    for state_role, path_role in (EGO_INPUT_ROLES, REMOTE_INPUT_ROLES):
        if state_role not in columns:
            continue
        states, count = read_selected_states(log, columns[state_role], state_role, config)
        path_topic = bound.first_topic_of_role(path_role)
        assert path_topic is not None  # it is required
        predicted[path_role], remarks = replanned_or_logged_paths_and_notes(log, path_topic, state_role)
        notes.extend(remarks)
        onset = uses_onset and state_role == REMOTE_STATE.role
        tracks[state_role] = build_vehicle_tracks(states, predicted[path_role], with_onset=onset, events=events)
        n_used = sum(len(track.stamp_ns) for track in tracks[state_role])
        inputs.append(replace(count, used=n_used))
        inputs.append(InputMessageCount(path_topic, path_role, len(predicted[path_role]), n_used))
    host = require_single_ego(tracks[EGO_STATE.role], where=columns[EGO_STATE.role].topic)
    if TARGETS.role in columns:
        everything = read_targets_as_states(columns[TARGETS.role])
        states = everything.select_logged_within(config.start_ns, config.end_ns)
        paths = predict_paths_with_settings_of(states, predicted[EGO_PATH.role], where=log.name)
        tracks[REMOTE_STATE.role] = build_vehicle_tracks(states, paths, with_onset=uses_onset)
        inputs.append(InputMessageCount(columns[TARGETS.role].topic, TARGETS.role, len(everything), len(states)))
    others_tracks = tracks[REMOTE_STATE.role]
    found = tuple(find_warnings(host, others_tracks, replace(config.rule, rule=name)) for name in config.rule_names)
    outcomes = tuple(
        RuleOutcome(
            each.config.rule,
            each.rows,
            (each.events_table, each.evaluations_of_pairs_table),
            _warnings_tables(each, log.start_ns, config),
        )
        for each in found
    )
    withheld = {WITHHELD_WARNINGS_RECORD_KEY: json.dumps({each.config.rule: each.n_withheld for each in found})}
    notes.extend(note_if_paths_start_from_other_states(config, read_run_records(log).get("predict", {})))
    result, earlier = build_warnings_result(stage, log, config, outcomes, tuple(inputs), tuple(notes), **withheld)
    return replace(result, evaluation_inputs=WarningEvidence(found, outcomes, earlier))


def _warnings_tables(found_warnings: FoundWarnings, start_ns: int, config: WarnConfig) -> tuple[SummaryTable, ...]:
    """Return the tables of a rule's warnings and of what became of its evaluations."""
    events: tuple[tuple[Cell, ...], ...] = tuple(
        (
            event["event_id"],
            event["other_id"],
            (event["raised_ns"] - start_ns) / NS_PER_S,
            event["time_to_event_s"],
            event["predicted_distance_m"],
        )
        for event in found_warnings.events_table.rows_as_dicts()
    )
    columns = (
        WARNING_NUMBER_HEADING,
        "vehicle warned of",
        "raised at [s]",
        "time to predicted conflict [s]",
        "predicted least distance of centres [m]",
    )
    names = ("event", "vehicle", "at [s]", "event in [s]", "predicted closest [m]")
    counts: tuple[tuple[Cell, ...], ...] = tuple(
        (CellWithValues(TEXT_BY_EVALUATION_OUTCOME[name], {"": name.replace("_", " ")}), count)
        for name, count in found_warnings.evaluation_counts_by_outcome.items()
    )
    counts += (("warnings withheld", found_warnings.n_withheld),)
    for kind, n in found_warnings.n_left_out.items():
        name = kind.name_in_tables
        counts += ((CellWithValues(f"warnings left out: {name}", {"": f"warnings {name} left out"}), n),)
    times = "when they could be known" if config.states == "online" else "stamps of states in hindsight"
    title = f"Warnings (rule {found_warnings.config.rule}; times from the log's start: {times})"
    return (
        SummaryTable("events", title, columns, events, names=names),
        SummaryTable(
            "evaluations",
            "Checks of the ego and each other vehicle for a collision",
            ("result of the check", "number of checks"),
            counts,
            names=("result", "count"),
        ),
    )
