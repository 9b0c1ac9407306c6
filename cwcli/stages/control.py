"""Stage `control`: states in; what a braking controller, a driver, and nobody would have made of each warning out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import Annotated

import numpy as np

from cwcli.channels.binding import Bindings, bind_roles
from cwcli.channels.control_step import ReplayedSteps, make_replay_channels
from cwcli.channels.published import EGO_STATE, REMOTE_STATE
from cwcli.control.encounter import BRAKING_POLICY_NAMES, RecordedTrack, ReplaySpan, replay_warning
from cwcli.control.replayed import (
    PublishedReplay,
    control_series_table,
    control_table_by_warning_and_policy,
    control_table_row,
)
from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.option import Option
from cwcli.pipeline.paths import PathRequest, plan_paths_from_states
from cwcli.pipeline.records import local_map_from_estimate_record, read_run_records
from cwcli.pipeline.result import Cell, InputMessageCount, StageResult, StageSummary, SummaryTable
from cwcli.pipeline.run_record import build_run_record
from cwcli.pipeline.states import StatesSelection, bind_state_channels, read_selected_states
from cwcli.prediction.models import DEFAULT_MODEL, MODELS
from cwcli.prediction.rollout import Discretisation, check_rollout_options
from cwcli.signals.columns import OutputChannel
from cwcli.signals.row_order import iter_track_rows
from cwcli.signals.units import NS_PER_S
from cwcli.stages.inputs.sources import read_bound_columns
from cwcli.stages.inputs.vehicles import build_vehicle_tracks, require_single_ego
from cwcli.stages.summaries.warn import WARNING_NUMBER_HEADING
from cwcli.warning.evaluate import check_warning_config as check_rule
from cwcli.warning.evaluate import find_warnings
from cwcli.warning.rules import DEFAULT_RULE, RULES
from cwcli.warning.types import VehicleTrack, WarningConfig

EXAMPLES = (
    "cwcli control drive.mcap -o braked.mcap --metrics control.parquet",
    "cwcli control drive.mcap --predictor cj-cya -o braked.mcap --metrics-dir m/",
    "cwcli estimate drive.mcap -o - | cwcli control - --rule ttc --json",
)
"""Command lines that the help of `cwcli control` shows."""
PAPER_WARNING_RULE = "song2016"
"""Name of the warning rule of song2016, which is the default when a predictor is chosen."""
PREDICTED_PATH_STEP_S = 0.05
"""Time between the points of the predicted paths [s]: the default of `cwcli predict --step`."""
MIN_REPLAY_DURATION_S = 0.1
"""Shortest duration of a replay, and of its part beyond the record, that is accepted [s]; chosen by hand."""


@dataclass(frozen=True)
class ControlConfig(StatesSelection):
    """Settings of the stage.

    Attributes:
        predictor: A key of `cwcli.prediction.models.MODELS`; None: the default one.
        rule: A key of `cwcli.warning.rules.RULES`, which finds the warnings; None: the paper's with a predictor that
            was chosen, else the default one.
        horizon_s, distance_m: Settings of the rule, as in `WarningConfig`.
        discretisation: "exact", or "paper" for song2016's recursion.
        span: How much of the drive is replayed after each warning.
    """

    predictor: Annotated[
        str | None,
        Option(
            "--predictor",
            "Motion model that finds the warnings: {names} (see `cwcli predict --help`).",
            metavar="NAME",
            default=DEFAULT_MODEL,
            choices="cwcli.prediction.models:MODELS",
        ),
    ] = None
    rule: Annotated[
        str | None,
        Option(
            "--rule",
            "Warning rule: {names} (see `cwcli warn --help`).",
            metavar="NAME",
            default=f"{PAPER_WARNING_RULE} with --predictor, else {DEFAULT_RULE}",
            choices="cwcli.warning.rules:RULES",
        ),
    ] = None
    horizon_s: Annotated[float, Option("--horizon", "Warn of events at most this far ahead.", metavar="SECONDS")] = (
        WarningConfig.horizon_s
    )
    distance_m: Annotated[
        float, Option("--distance", "The rule's collision distance between centres.", metavar="METRES")
    ] = WarningConfig.distance_m
    discretisation: Annotated[
        Discretisation,
        Option(
            "--discretisation",
            "exact: integrate the model exactly; paper: use the recursion of song2016 (eq. 2, 9, 10).",
        ),
    ] = "exact"
    span: ReplaySpan = field(default_factory=ReplaySpan)

    def __post_init__(self) -> None:
        """Check what can be checked without a log.

        Raises:
            UsageError: An unknown model or rule, or a setting out of range.
        """
        MODELS.require(self.motion_model_name)
        check_rollout_options(self.motion_model_name, self.discretisation, self.horizon_s, PREDICTED_PATH_STEP_S)
        check_rule(self.warning_config)
        if not MIN_REPLAY_DURATION_S <= self.span.duration_s <= 600.0:
            raise UsageError(
                f"a duration of {self.span.duration_s:g} s is not between {MIN_REPLAY_DURATION_S:g} and 600"
            )
        if not MIN_REPLAY_DURATION_S <= self.span.after_s <= 60.0:
            raise UsageError(
                f"{self.span.after_s:g} s beyond the record is not between {MIN_REPLAY_DURATION_S:g} and 60"
            )

    @property
    def motion_model_name(self) -> str:
        """The motion model."""
        return self.predictor or DEFAULT_MODEL

    @property
    def warning_config(self) -> WarningConfig:
        """The rule that finds the warnings, and its thresholds."""
        usual = DEFAULT_RULE if self.predictor is None else PAPER_WARNING_RULE
        return WarningConfig(rule=self.rule or usual, horizon_s=self.horizon_s, distance_m=self.distance_m)


def replay_warnings_with_braking(log: Log, config: ControlConfig) -> StageResult:
    """Replay each warning with a braking controller, a driver who brakes late, and nobody.

    The host's recorded motion is replayed until the warning; then the fuzzy controller of song2016 brakes it along its
    recorded path, or a driver 1.5 s later, or nobody. The other vehicle moves as recorded. Uses the states of `cwcli
    estimate`: the online ones for the warnings, those in hindsight for what was recorded. Where the log has none, they
    are estimated first and written too. Paths and warnings are computed again. A warning that is raised while an
    earlier one is still being replayed is left out: the host would not have been there.

    Raises:
        MissingSignalError: The log lacks the states of the ego or of the other vehicles.
        DataError: The log holds the states of several egos.
    """
    model, rule = config.motion_model_name, config.warning_config
    roles = (EGO_STATE.role, REMOTE_STATE.role)
    bound = bind_state_channels(log.channels, config, required=roles, where=log.name, command="control")
    happened = bind_roles(log.channels, config.topics, required=roles, where=log.name, command="control")
    columns = read_bound_columns(log, bound)
    inputs: list[InputMessageCount] = []
    tracks: dict[str, list[VehicleTrack]] = {}
    for role in roles:
        states, count = read_selected_states(log, columns[role], role, config)
        inputs.append(count)
        is_other = role == REMOTE_STATE.role
        paths = plan_paths_from_states(
            states, role, PathRequest(model, rule.horizon_s, PREDICTED_PATH_STEP_S, config.discretisation)
        )
        tracks[role] = build_vehicle_tracks(states, paths, with_onset=is_other and RULES[rule.rule].uses_onset)
    host = require_single_ego(tracks[EGO_STATE.role], where=columns[EGO_STATE.role].topic)
    events = find_warnings(host, tracks[REMOTE_STATE.role], rule).events_table.rows_as_dicts()
    recorded = _read_recorded_tracks(log, happened, config)
    replayed, notes = _replay_warnings_and_note(host, tracks[REMOTE_STATE.role], recorded, events, config.span)
    if not events:
        notes.append(f"no warning arises (predictor {model}, rule {rule.rule}): nothing is braked")
    summary = StageSummary(
        "control",
        _summary_tables(replayed, log.start_ns, model, rule.rule),
        tuple(inputs),
        tuple(dict.fromkeys((*bound.notes, *happened.notes, *notes))),
    )
    tables = (control_table_by_warning_and_policy(replayed, model, rule.rule), control_series_table(replayed))
    channels: tuple[OutputChannel, ...] = ()
    if replayed:
        local_map = local_map_from_estimate_record(read_run_records(log).get("estimate", {}))
        size_m = (host.length_m, host.width_m)
        channels = make_replay_channels(_steps_not_published_before(replayed), host_size_m=size_m, local_map=local_map)
    return StageResult(
        "control",
        channels,
        {table.name: table for table in tables},
        summary,
        build_run_record("control", log, config, summary),
    )


control = replay_warnings_with_braking
"""The function of the stage, under the name of the stage."""


def _read_recorded_tracks(log: Log, bound: Bindings, config: ControlConfig) -> dict[str, RecordedTrack]:
    """Return each vehicle's recorded motion: its states in hindsight."""
    found: dict[str, RecordedTrack] = {}
    for role, columns in read_bound_columns(log, bound).items():
        states, _ = read_selected_states(log, columns, role, config)
        found |= {
            vehicle: RecordedTrack(states.stamp_ns[rows], states.state[rows])
            for vehicle, rows in iter_track_rows(states.ids, states.stamp_ns)
        }
    return found


def _replay_warnings_and_note(
    host: VehicleTrack,
    others: Sequence[VehicleTrack],
    recorded: Mapping[str, RecordedTrack],
    events: Sequence[Mapping[str, object]],
    span: ReplaySpan,
) -> tuple[list[PublishedReplay], list[str]]:
    """Replay each event that no earlier replay covers; return the replays, and notes on the others."""
    by_id = {other.id: other for other in others}
    replayed: list[PublishedReplay] = []
    n_covered, busy_until_ns = 0, -1
    for event in sorted(events, key=_warning_raised_ns):
        warning_ns = _warning_raised_ns(event)
        if warning_ns <= busy_until_ns:
            n_covered += 1
            continue
        other = by_id[str(event["other_id"])]
        encounter = replay_warning(recorded[host.id], recorded[other.id], warning_ns, span)
        one = PublishedReplay(
            len(replayed) + 1, warning_ns, other.id, host.length_and_width_m, other.length_and_width_m, encounter
        )
        replayed.append(one)
        busy_until_ns = one.stamp_ns(float(encounter.outcome.time_s[-1]))
    notes = []
    if n_covered:
        notes.append(f"warnings raised during the replay of an earlier one, left out: {n_covered}")
    notes += [
        f"warning {one.event_id}: vehicle {one.other_id} is behind the host and does not react to its braking"
        for one in replayed
        if one.encounter.is_behind
    ]
    extended_s = max((one.extrapolated_s for one in replayed), default=0.0)
    if extended_s > 0.0:
        notes.append(f"after its last state a vehicle continues at its last speed and yaw rate ({extended_s:.1f} s)")
    return replayed, notes


def _warning_raised_ns(event: Mapping[str, object]) -> int:
    """Return when the warning of an event was raised [ns since the epoch]."""
    raised = event["raised_ns"]
    assert isinstance(raised, int | np.integer)
    return int(raised)


def _steps_not_published_before(replayed: Sequence[PublishedReplay]) -> list[ReplayedSteps]:
    """Return for each replay the published steps that are later than all of the replay before.

    Replays overlap in time only in the seconds before a warning, which the first one then publishes.
    """
    last_ns, steps = -1, []
    for one in replayed:
        rows = one.published_step_indices
        rows = rows[one.step_stamps_ns[rows] > last_ns]
        last_ns = int(one.step_stamps_ns[rows[-1]])
        policies = range(len(BRAKING_POLICY_NAMES))
        steps.append(
            ReplayedSteps(
                one.event_id,
                one.other_id,
                one.step_stamps_ns[rows],
                tuple(one.host_states(policy)[rows] for policy in policies),
                tuple(one.time_series_columns(policy, rows) for policy in policies),
            )
        )
    return steps


def _summary_tables(
    replayed: Sequence[PublishedReplay], start_ns: int, predictor: str, rule: str
) -> tuple[SummaryTable, ...]:
    """Return the tables of the warnings and of the outcomes of each policy."""
    warnings: list[tuple[Cell, ...]] = []
    outcomes: list[tuple[Cell, ...]] = []
    for one in replayed:
        encounter = one.encounter
        for policy, name in enumerate(BRAKING_POLICY_NAMES):
            record = control_table_row(one, policy, predictor, rule)
            if policy == 0:
                at_s = (one.warning_ns - start_ns) / NS_PER_S
                warnings.append(
                    (one.event_id, one.other_id, at_s, record["warning_distance_m"], record["warning_speed_mps"])
                )
            stopped_s = float(encounter.stopped_time_s[policy])
            outcomes.append(
                (
                    one.event_id,
                    name,
                    bool(record["collided"]),
                    record["impact_speed_mps"] if record["collided"] else None,
                    record["min_distance_m"],
                    record["min_gap_m"],
                    record["peak_deceleration_mps2"],
                    record["peak_jerk_mps3"],
                    None if math.isnan(stopped_s) else stopped_s,
                )
            )
    columns = (
        WARNING_NUMBER_HEADING,
        "braking policy",
        "outlines touch",
        "relative speed at contact [m/s]",
        "least distance of centres [m]",
        "least gap of outlines [m]",
        "peak deceleration [m/s^2]",
        "peak jerk [m/s^3]",
        "time to standstill [s]",
    )
    names = ("event", "policy", "hit", "at [m/s]", "least [m]", "gap [m]", "decel [m/s^2]", "jerk [m/s^3]", "stop [s]")
    return (
        SummaryTable(
            "warnings",
            f"Warnings (predictor {predictor}, rule {rule}; times from the log's start)",
            (
                WARNING_NUMBER_HEADING,
                "vehicle warned of",
                "raised at [s]",
                "distance of centres [m]",
                "speed of the ego [m/s]",
            ),
            tuple(warnings),
            names=("event", "vehicle", "at [s]", "distance [m]", "speed [m/s]"),
        ),
        SummaryTable(
            "control",
            "What would have happened with each braking policy (times from the warning)",
            columns,
            tuple(outcomes),
            names=names,
        ),
    )
