"""Makes the command of a stage from its entry in the table of stages and its configuration."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from cwcli.cli.options.configfile import RunTalkOptions
from cwcli.cli.options.expand import expand_dataclass_parameters
from cwcli.cli.options.shared import (
    CalibrationOptions,
    LogArgument,
    ReadingOptions,
    SensorOptions,
    StageOutputOptions,
    source_of_logs,
)
from cwcli.cli.options.stage import (
    StageOptions,
    command_reads_sensor_messages,
    make_stage_options_class,
    stage_call_from_options,
    uses_calibration,
)
from cwcli.cli.pipeline import Job, run_write_and_print
from cwcli.pipeline.execute import SkipRules
from cwcli.pipeline.missing import SkipStagesAlreadyRun
from cwcli.pipeline.stage import Stage
from cwcli.stages import STAGES


def make_stage_command(stage: Stage) -> tuple[Callable[..., Any], tuple[str, ...]]:
    """Make the function of a stage's command, as Typer takes it, and its examples.

    Raises:
        UsageError: The stage's module is missing.
    """

    def command(
        log: LogArgument,
        stages: dict[str, StageOptions],
        writing: StageOutputOptions,
        reading: ReadingOptions,
        sensors: SensorOptions,
        calibration: CalibrationOptions,
        talk: RunTalkOptions,
    ) -> None:
        known = calibration.load_if_named()
        first = {
            name: stage_call_from_options(make_stage_options_class(name)(), sensors, known) for name in stage.first
        }
        job = Job(
            stage.name,
            source_of_logs(log, reading.as_one),
            {**first, stage.name: stage_call_from_options(stages[stage.name], sensors, known)},
            reading,
            writing,
            talk,
            writing.metrics,
            writing.metrics_dir,
            tuple(first),
        )
        if first:
            job = replace(job, skip=SkipRules(SkipStagesAlreadyRun(stage, STAGES, sensors.ego_station)))
        run_write_and_print(job)

    command.__doc__ = re.split(r"\n\n(?:Args|Returns|Raises):\n", inspect.getdoc(stage.stage_function) or "")[0]
    without = [
        *([] if command_reads_sensor_messages(stage) else ["sensors"]),
        *([] if uses_calibration(stage) else ["calibration"]),
    ]
    return expand_dataclass_parameters(
        command, stage.name, stages=(make_stage_options_class(stage.name),), without=without
    ), stage.examples
