"""The stages and options that a Python program names, as configured calls of stages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path

from cwcli.errors import UsageError, hint_at_closest_or_all_known_names
from cwcli.pipeline.call import StageCall
from cwcli.pipeline.execute import RunRules, SkipRules
from cwcli.pipeline.missing import SignalCheck, SkipStagesAlreadyRun
from cwcli.pipeline.stage_options import (
    SensorReading,
    check_option_values_from_python,
    configure_stage,
    option_entries_of_stage,
)
from cwcli.stages import DEFAULT_STAGES, STAGES

OptionValue = str | float | bool | PathLike[str] | Sequence[str] | None
"""The value of a stage's option."""
StageOptions = Mapping[str, Mapping[str, OptionValue]]
"""Stage -> name of an option -> its value."""
CHOICES_OF_MEASUREMENT_TIME = ("stamp", "log")
"""Times that a measurement can have: its header stamp, or when it was logged."""


def stage_names_in_pipeline_order(names: Sequence[str]) -> tuple[str, ...]:
    """Return named stages in the order of the pipeline, the default ones where none is named.

    Raises:
        UsageError: A stage does not exist.
    """
    for name in names:
        if name not in STAGES:
            raise UsageError(
                f"there is no stage {name}", hint=hint_at_closest_or_all_known_names(name, STAGES, "known")
            )
    return tuple(name for name in STAGES if name in (names or DEFAULT_STAGES))


def sensor_reading_from_options(clock: str, ego_station: str | None, calibration: str | Path | None) -> SensorReading:
    """Return how sensor messages are read, with the calibration of a file.

    Raises:
        UsageError: The clock does not exist, or the file's content is wrong.
        InputError: The file can't be read.
    """
    if clock not in CHOICES_OF_MEASUREMENT_TIME:
        raise UsageError(
            f"there is no clock {clock!r}",
            hint=hint_at_closest_or_all_known_names(str(clock), CHOICES_OF_MEASUREMENT_TIME),
        )
    if calibration is None:
        return SensorReading(clock, ego_station)
    from cwcli.estimation.calibration import load_calibration

    return SensorReading(clock, ego_station, load_calibration(calibration))


def plan_named_stages(
    names: Sequence[str], options: StageOptions, reading: SensorReading, *, strict: bool
) -> tuple[dict[str, StageCall], RunRules]:
    """Configure the stages that a program names, and say which of them may be left out.

    A named stage must run. Stages that have to run before it (`Stage.first`) run unless the log holds their channels.
    Without names the default stages run, those without signals are left out.

    Raises:
        UsageError: A stage or an option does not exist, a value is wrong, or options are for a stage that does not run.
    """
    stage_names = stage_names_in_pipeline_order(names)
    first = [each for name in stage_names for each in STAGES[name].first if names and each not in stage_names]
    calls = {
        name: configure_named_stage(name, options.get(name, {}), reading)
        for name in STAGES
        if name in stage_names or name in first
    }
    for name in options:
        stage_names_in_pipeline_order([name])
        if name not in calls:
            raise UsageError(
                f"options are given for the stage {name}, which does not run", hint=f"run: {', '.join(calls)}"
            )
    if not names:
        rules = RunRules(SkipRules(SignalCheck(STAGES, reading.ego_station), lenient=True))
    elif first:
        own = next(STAGES[name] for name in stage_names if STAGES[name].first)
        own = replace(own, first=tuple(first))
        rules = RunRules(SkipRules(SkipStagesAlreadyRun(own, STAGES, reading.ego_station)))
    else:
        rules = RunRules()
    return calls, replace(rules, strict=strict)


def configure_named_stage(name: str, values: Mapping[str, OptionValue], reading: SensorReading) -> StageCall:
    """Configure one stage.

    Raises:
        UsageError: An option does not exist, or a value is wrong.
    """
    stage, entries = STAGES[name], option_entries_of_stage(STAGES[name])
    return configure_stage(stage, entries, check_option_values_from_python(name, entries, values), reading)
