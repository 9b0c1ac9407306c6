"""Stage `control`: states in; what a braking controller, a driver, and nobody would have made of each warning out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from cwcli.channels.binding import bind
from cwcli.channels.control_step import write_replays
from cwcli.channels.predicted_path import PredictedPaths
from cwcli.channels.published import EGO_STATE, REMOTE_STATE
from cwcli.channels.vehicle_state import VehicleStates, read_states, require_ego
from cwcli.control.encounter import RecordedTrack, Span, replay_warning
from cwcli.errors import DataError, UsageError
from cwcli.logs.log import Log
from cwcli.pipeline.result import InputCount, StageResult, Summary
from cwcli.pipeline.run_record import run_record
from cwcli.prediction.calibrate import predict_vehicles
from cwcli.prediction.models import DEFAULT_MODEL, MODELS
from cwcli.signals.columns import OutputChannel
from cwcli.stages.predict import MAX_MESSAGE_AGE_S
from cwcli.stages.records import Record, configuration_of, map_of, run_records
from cwcli.stages.summaries.control import Replayed, control_table, published_steps, sections, series_table
from cwcli.stages.warn import vehicle_tracks
from cwcli.warning.evaluate import evaluate
from cwcli.warning.rules import DEFAULT_RULE, RULES
from cwcli.warning.types import VehicleTrack, WarningConfig

PAPER_RULE = "song2016"
PATH_STEP_S = 0.05
MIN_SPAN_S = 0.1


@dataclass(frozen=True)
class ControlConfig:
    """Settings of the stage.

    Attributes:
        predictor: A key of `prediction.MODELS`; None: the default one.
        rule: The rule that finds the warning moments, and its thresholds.
        span: How much of the drive is replayed after each warning.
        topics: Role -> topic, the user's choices.
        start_ns, end_ns: Only states logged in this span are used.
    """

    predictor: str | None = None
    rule: WarningConfig = field(default_factory=WarningConfig)
    span: Span = field(default_factory=Span)
    topics: Mapping[str, str] = field(default_factory=dict)
    start_ns: int | None = None
    end_ns: int | None = None


def rule_for(predictor: str | None) -> str:
    """The rule that goes with a predictor unless the user says otherwise: the paper's with one that was chosen."""
    return DEFAULT_RULE if predictor is None else PAPER_RULE


def control(log: Log, config: ControlConfig) -> StageResult:
    """Find the warnings, and replay the drive around each of them under every policy.

    A warning that is raised while an earlier one is still being replayed is left out: the host would not have been
    there.

    Raises:
        MissingSignalError: The log lacks the states of the ego or of the other vehicles.
        UsageError: An unknown model or rule, or a setting out of range.
        DataError: The log holds the states of several egos.
    """
    check_config(config)
    model = config.predictor or DEFAULT_MODEL
    bound = bind(
        log.channels,
        config.topics,
        required=(EGO_STATE.role, REMOTE_STATE.role),
        where=log.name,
        command="control",
    )
    topics = {role: bindings[0].topic for role, bindings in bound.by_role.items()}
    columns = log.load(dict.fromkeys(topics.values()))
    inputs: list[InputCount] = []
    tracks: dict[str, list[VehicleTrack]] = {}
    for role in (EGO_STATE.role, REMOTE_STATE.role):
        everything = read_states(columns[topics[role]])
        states = everything.logged_within(config.start_ns, config.end_ns)
        inputs.append(InputCount(topics[role], role, len(everything), len(states)))
        if role == EGO_STATE.role:
            require_ego(states, log_name=log.name, topic=topics[role])
        is_other = role == REMOTE_STATE.role
        uses_onset = is_other and RULES[config.rule.rule].uses_onset
        paths = _predicted(model, states, config.rule.horizon_s + (MAX_MESSAGE_AGE_S if is_other else 0.0))
        tracks[role] = vehicle_tracks(states, paths, with_onset=uses_onset)
    if len(tracks[EGO_STATE.role]) != 1:
        raise DataError(
            f"expected the states of one ego, found {len(tracks[EGO_STATE.role])}", where=topics[EGO_STATE.role]
        )
    (host,), others = tracks[EGO_STATE.role], tracks[REMOTE_STATE.role]
    events = evaluate(host, others, config.rule).events.records()
    replayed, notes = _replays(host, others, events, config.span)
    if not events:
        notes.append(f"no warning arises (predictor {model}, rule {config.rule.rule}): nothing is braked")
    notes += _about_states(run_records(log).get("estimate", {}))
    summary = Summary(
        "control", sections(replayed, log.start_ns, model, config.rule.rule), tuple(inputs), (*bound.notes, *notes)
    )
    tables = (control_table(replayed, model, config.rule.rule), series_table(replayed))
    channels: tuple[OutputChannel, ...] = ()
    if replayed:
        local_map = map_of(run_records(log).get("estimate", {}))
        size_m = (host.length_m, host.width_m)
        channels = write_replays(published_steps(replayed), host_size_m=size_m, local_map=local_map)
    return StageResult(
        "control",
        channels,
        {table.name: table for table in tables},
        summary,
        run_record("control", log, config, summary),
    )


def check_config(config: ControlConfig) -> None:
    """Check what can be checked without a log.

    Raises:
        UsageError: An unknown model or rule, or a setting out of range.
    """
    model = config.predictor or DEFAULT_MODEL
    MODELS.require(model)
    RULES.require(config.rule.rule)
    if not (np.isfinite(config.rule.horizon_s) and config.rule.horizon_s > 0.0):
        raise UsageError(f"a horizon of {config.rule.horizon_s:g} is not positive")
    if not MIN_SPAN_S <= config.span.duration_s <= 600.0:
        raise UsageError(f"a duration of {config.span.duration_s:g} s is not between {MIN_SPAN_S:g} and 600")
    if not MIN_SPAN_S <= config.span.after_s <= 60.0:
        raise UsageError(f"{config.span.after_s:g} s beyond the record is not between {MIN_SPAN_S:g} and 60")


def _predicted(model: str, states: VehicleStates, horizon_s: float) -> PredictedPaths:
    paths = predict_vehicles(
        model,
        states.ids.codes,
        states.stamp_ns,
        states.state,
        states.covariance,
        horizon_s=horizon_s,
        step_s=PATH_STEP_S,
    )
    return PredictedPaths.of(states, model, paths)


def _replays(
    host: VehicleTrack, others: Sequence[VehicleTrack], events: Sequence[Mapping[str, object]], span: Span
) -> tuple[list[Replayed], list[str]]:
    """One replay per event that no earlier replay covers, and what to say of the others."""
    by_id = {other.id: other for other in others}
    replayed: list[Replayed] = []
    n_covered, busy_until_ns = 0, -1
    for event in sorted(events, key=_raised_ns):
        warning_ns = _raised_ns(event)
        if warning_ns <= busy_until_ns:
            n_covered += 1
            continue
        other = by_id[str(event["other_id"])]
        encounter = replay_warning(
            RecordedTrack(host.stamp_ns, host.state), RecordedTrack(other.stamp_ns, other.state), warning_ns, span
        )
        one = Replayed(len(replayed) + 1, warning_ns, other, host.outline_m, encounter)
        replayed.append(one)
        busy_until_ns = one.stamp_ns(float(encounter.outcome.time_s[-1]))
    notes = []
    if n_covered:
        notes.append(f"left out, because raised during the replay of an earlier warning: {n_covered}")
    notes += [
        f"event {one.event_id}: vehicle {one.other.id} is behind the host and does not react to its braking"
        for one in replayed
        if one.encounter.is_behind
    ]
    extended_s = max((one.extrapolated_s for one in replayed), default=0.0)
    if extended_s > 0.0:
        notes.append(
            f"beyond the last state of a vehicle it goes on at its last speed and yaw rate ({extended_s:.1f} s)"
        )
    return replayed, notes


def _raised_ns(event: Mapping[str, object]) -> int:
    raised = event["raised_stamp_ns"]
    assert isinstance(raised, int | np.integer)
    return int(raised)


def _about_states(record: Record) -> list[str]:
    """A note if the states know what comes, from the record of `estimate`."""
    estimator = configuration_of(record).get("estimator")
    if not isinstance(estimator, dict) or estimator.get("causal", True):
        return []
    return ["the states are smoothed: they know a little of what comes (`cwcli estimate --causal`)"]
