"""Makes the command of a stage from its entry in the table of stages and its configuration."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.expand import expand
from cwcli.cli.options.respelled import resolved, say_notes
from cwcli.cli.options.shared import (
    CalibrationOptions,
    LogArgument,
    MetricsDirOption,
    MetricsOption,
    ReadingOptions,
    SensorOptions,
    WritingOptions,
    one_log,
)
from cwcli.cli.options.stage import StageOptions, call_of, reads_sensors, stage_options, uses_calibration
from cwcli.cli.pipeline import Job, run_job
from cwcli.pipeline.missing import FirstStages
from cwcli.pipeline.stage import Stage
from cwcli.stages import STAGES


def stage_command(stage: Stage) -> tuple[Callable[..., Any], tuple[str, ...]]:
    """Make the function of a stage's command, as Typer takes it, and its examples.

    Raises:
        UsageError: The stage's module is missing.
    """

    def command(
        log: LogArgument,
        stages: dict[str, StageOptions],
        writing: WritingOptions,
        reading: ReadingOptions,
        sensors: SensorOptions,
        calibration: CalibrationOptions,
        talk: TalkOptions,
        metrics: MetricsOption = None,
        metrics_dir: MetricsDirOption = None,
    ) -> None:
        options, wanted, notes = resolved(stages, (stage.name,))
        known = calibration.load()
        first = {name: call_of(stage_options(name)(**values), sensors, known) for name, values in stage.first.items()}
        calls = {name: call_of(options[name], sensors, known) for name in wanted}
        say_notes(talk, notes)
        job = Job(
            stage.name,
            one_log(log, reading.as_one),
            {**first, **calls},
            reading,
            writing,
            talk,
            metrics,
            metrics_dir,
            tuple(first),
        )
        if first:
            job = replace(job, missing=FirstStages(stage, STAGES, sensors.ego_station))
        run_job(replace(job, lenient=len(calls) > 1))

    command.__doc__ = re.split(r"\n\n(?:Args|Returns|Raises):\n", inspect.getdoc(stage.function) or "")[0]
    without = [
        *([] if reads_sensors(stage) else ["sensors"]),
        *([] if uses_calibration(stage) else ["calibration"]),
    ]
    return expand(command, stage.name, stages=(stage_options(stage.name),), without=without), stage.examples
