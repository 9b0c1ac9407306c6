"""A trial's warnings: the scenario as a log in memory, and the stages on it, as they would run on line."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from cwcli.channels.published import EGO_PATH, EGO_STATE, REMOTE_STATE, TARGETS, WARNINGS
from cwcli.conformance.encounter import TRIAL_TRUTH_STEP_S, Encounter
from cwcli.conformance.grades import RADAR_OF_EVERY_GRADE, SCENARIO_OVERRIDES_BY_GRADE
from cwcli.conformance.scenes import BuiltScene
from cwcli.conformance.verdict import RaisedWarning
from cwcli.errors import MissingSignalError, UsageError
from cwcli.evaluation.records import find_collision_warning_record_and_is_of_targets, warning_config_from_record
from cwcli.input import InputFile
from cwcli.logs.read.reader import Log
from cwcli.output_stream import OutputStream
from cwcli.pipeline.execute import DEFAULT_CHOICE_OF_ALL_WRITTEN_CHANNELS
from cwcli.pipeline.records import read_configuration, read_run_records
from cwcli.pipeline.result import StageResult
from cwcli.signals.columns import FloatArray
from cwcli.signals.units import NS_PER_S
from cwcli.simulate.sensor_log import write_simulated_log
from cwcli.simulation.drive import SimulatedDrive
from cwcli.simulation.scenario import EGO_VEHICLE_KEY, Scenario, parse_scenario
from cwcli.stages import STAGES

TRUTH_AFTER_TRIAL_S = 8.0
"""Time for which the truth goes on after a trial, s, so that a braking host comes to rest in it. Chosen by hand."""


WARNING_PIPELINE_STAGES = ("estimate", "predict", "warn")
"""The stages that warn of vehicles which send messages, in their order."""
RADAR_PIPELINE_STAGES = ("estimate", "track", "predict", "warn-targets")
"""The stages that warn of what a radar detects, in their order."""


def build_trial_scenario(built: BuiltScene, grade: str, *, name: str) -> Scenario:
    """Return a scene with the sensors of a grade as a checked scenario.

    Raises:
        UsageError: No vehicle can drive it.
    """
    settings = SCENARIO_OVERRIDES_BY_GRADE[grade]
    sensors = {sensor: dict(table) for sensor, table in settings.items() if sensor != "v2x"}
    if built.has_radar:
        sensors["radar"] = dict(RADAR_OF_EVERY_GRADE)
    document: dict[str, Any] = {**built.document, "sensors": sensors, "v2x": dict(settings["v2x"])}
    return parse_scenario(document, name=name)


def true_encounter(scenario: Scenario, built: BuiltScene) -> Encounter:
    """Return the true motion of the host and the principal other vehicle."""
    host, other = scenario.vehicles[EGO_VEHICLE_KEY], scenario.vehicles[built.other]
    n = int((scenario.duration_s + TRUTH_AFTER_TRIAL_S) / TRIAL_TRUTH_STEP_S) + 1
    time_s: FloatArray = np.arange(n, dtype=np.float64) * TRIAL_TRUTH_STEP_S
    return Encounter(
        time_s=time_s,
        host=host.motion.states_at(time_s),
        other=other.motion.states_at(time_s),
        host_size=(host.length_m, host.width_m),
        other_size=(other.length_m, other.width_m),
        other_id=other.station_id,
        event_s=built.event_s,
    )


@contextmanager
def open_in_memory(drive: SimulatedDrive) -> Iterator[Log]:
    """Open a simulated drive as a log that has no file name."""
    with (
        tempfile.TemporaryFile()
        if not hasattr(os, "memfd_create")
        else os.fdopen(os.memfd_create(drive.scenario.name), "w+b") as file
    ):
        descriptor = os.dup(file.fileno())
        output = OutputStream(descriptor, drive.scenario.name)
        try:
            write_simulated_log(drive, output)
            output.flush()
        finally:
            os.close(descriptor)
        with Log.open(InputFile(os.dup(file.fileno()), drive.scenario.name)) as log:
            yield log


def warn_with_pipeline(
    drive: SimulatedDrive, rules: Sequence[str], horizon_s: float | None = None
) -> dict[str, tuple[RaisedWarning, ...]]:
    """Run the stages on a drive with online states; return the warnings of each rule.

    A host with a radar is warned of the radar's targets, which have no names, else of the vehicles that send messages.

    Args:
        rules: Keys of `warning.rules.RULES`.
        horizon_s: How far the paths and the rules look ahead; None: the defaults.
    """
    with open_in_memory(drive) as log:
        has_radar = "radar" in drive.scenario.sensors
        _, result = _run_stages(log, rules, RADAR_PIPELINE_STAGES if has_radar else WARNING_PIPELINE_STAGES, horizon_s)
    found = {}
    for of_rule in result.evaluation_inputs.found:
        rows = sorted((int(row["raised_ns"]), str(row["other_id"])) for row in of_rule.events_table.rows_as_dicts())
        found[of_rule.config.rule] = tuple(
            RaisedWarning((raised - drive.scenario.start_ns) / NS_PER_S, "" if has_radar else other)
            for raised, other in rows
        )
    return found


def run_missing_stages(log: Log, rule: str, *, horizon_s: float | None = None, with_warnings: bool) -> Log:
    """Return a log with the channels of the stages that have not run on it yet.

    Args:
        rule, horizon_s: Rule of the warnings, if they are computed, and how far it looks ahead.
        with_warnings: Whether the warnings are needed, or the states alone.

    Raises:
        MissingSignalError: It lacks a signal that a stage needs.
        UsageError: It holds warnings of another rule or horizon.
    """
    topics = {channel.topic for channel in log.channels}
    if EGO_STATE.topic not in topics:
        log = _run_stages(log, (rule,), WARNING_PIPELINE_STAGES[:1])[0]
        topics = {channel.topic for channel in log.channels}
    if topics.isdisjoint((REMOTE_STATE.topic, TARGETS.topic)):
        raise MissingSignalError(
            "it holds no other vehicle than the ego, so there is no trial to judge",
            where=log.name,
            hint="the log needs the other vehicle's V2X messages, or tracks (`cwcli track`)",
        )
    if with_warnings and WARNINGS.topic not in topics:
        missing = WARNING_PIPELINE_STAGES[1:] if EGO_PATH.topic not in topics else WARNING_PIPELINE_STAGES[2:]
        return _run_stages(log, (rule,), missing, horizon_s)[0]
    if with_warnings:
        _refuse_warnings_of_other_settings(log, rule, horizon_s)
    return log


def _refuse_warnings_of_other_settings(log: Log, rule: str, horizon_s: float | None) -> None:
    """Refuse a log whose warnings another rule has raised, or one that looked ahead to another horizon."""
    record, _ = find_collision_warning_record_and_is_of_targets(read_run_records(log))
    configuration = read_configuration(record)
    recorded = warning_config_from_record(record)
    others = configuration.get("rules")
    rules = (recorded.rule, *(others if isinstance(others, list) else ()))
    if not record or (rule in rules and horizon_s in (None, recorded.horizon_s)):
        return
    raise UsageError(
        f"its warnings are those of the rule {rules[0]} with a horizon of {recorded.horizon_s:g} s",
        where=log.name,
        hint=f"judge the log without warnings, or run `cwcli warn --replace --rule {rule}` on it first",
    )


def _run_stages(
    log: Log, rules: Sequence[str], names: Sequence[str], horizon_s: float | None = None
) -> tuple[Log, StageResult]:
    """Run stages on a log in memory, without their evaluation; return the log with their channels, and the last."""
    current = log
    for name in names:
        config = STAGES[name].configuration_class()
        if name == "predict" and horizon_s is not None:
            config = replace(config, horizon_s=horizon_s)
        if name in ("warn", "warn-targets"):
            changed = {"rule": rules[0]} | ({} if horizon_s is None else {"horizon_s": horizon_s})
            config = replace(config, rule=replace(config.rule, **changed), rules=tuple(rules))
        result: StageResult = STAGES[name].stage_function(current, config)
        record = {f"cwcli.run.{name}": DEFAULT_CHOICE_OF_ALL_WRITTEN_CHANNELS.record_with_written_topics(result)}
        current = current.with_channels(result.channels, record)
    return current, result
