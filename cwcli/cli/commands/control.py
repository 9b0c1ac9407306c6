"""`cwcli control`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer

from cwcli.cli.commands.estimate import EstimateOptions
from cwcli.cli.options.expand import StageOptions
from cwcli.cli.options.shared import (
    LogArgument,
    MetricsDirOption,
    MetricsOption,
    ReadingOptions,
    SensorOptions,
    TalkOptions,
    WritingOptions,
)
from cwcli.cli.pipeline import Job, run_job
from cwcli.pipeline.call import Selection, StageCall
from cwcli.prediction.models import DEFAULT_MODEL, MODELS
from cwcli.warning.rules import DEFAULT_RULE, RULES

if TYPE_CHECKING:
    from cwcli.logs.log import Log
    from cwcli.pipeline.missing import Missing

EXAMPLES = (
    "cwcli control drive.mcap -o braked.mcap --metrics control.parquet",
    "cwcli control drive.mcap --predictor cj-cya -o braked.mcap --metrics-dir m/",
    "cwcli estimate drive.mcap --causal -o - | cwcli control - --rule ttc --json",
)


@dataclass(frozen=True)
class ControlOptions(StageOptions):
    """Options of the stage."""

    stage: ClassVar[str] = "control"

    predictor: Annotated[
        str | None,
        typer.Option(
            "--predictor",
            metavar="NAME",
            show_default=DEFAULT_MODEL,
            autocompletion=MODELS.complete,
            help=f"Motion model that finds the warnings: {', '.join(MODELS)} (see `cwcli predict --help`).",
        ),
    ] = None
    rule: Annotated[
        str | None,
        typer.Option(
            "--rule",
            metavar="NAME",
            show_default=f"song2016 with --predictor, else {DEFAULT_RULE}",
            autocompletion=RULES.complete,
            help=f"Warning rule: {', '.join(RULES)} (see `cwcli warn --help`).",
        ),
    ] = None
    horizon: Annotated[
        float, typer.Option("--horizon", metavar="SECONDS", help="Warn of events at most this far ahead.")
    ] = 2.5
    distance: Annotated[
        float, typer.Option("--distance", metavar="METRES", help="The rule's collision distance between centres.")
    ] = 2.5
    duration: Annotated[
        float, typer.Option("--duration", metavar="SECONDS", help="Replay at most this long after a warning.")
    ] = 15.0
    after: Annotated[
        float,
        typer.Option(
            "--after",
            metavar="SECONDS",
            help="Go on at most this far beyond the last state of a vehicle, at its last speed and yaw rate.",
        ),
    ] = 6.0

    def make(self) -> StageCall:
        """The stage with these options."""
        from cwcli.control.encounter import Span
        from cwcli.stages.control import ControlConfig, check_config, rule_for
        from cwcli.warning.types import WarningConfig

        rule = WarningConfig(
            rule=self.rule or rule_for(self.predictor), horizon_s=self.horizon, distance_m=self.distance
        )

        span = Span(duration_s=self.duration, after_s=self.after)
        config = ControlConfig(predictor=self.predictor, rule=rule, span=span)
        check_config(config)
        return StageCall(self.stage, config)


def command(
    log: LogArgument,
    options: ControlOptions,
    writing: WritingOptions,
    reading: ReadingOptions,
    sensors: SensorOptions,
    talk: TalkOptions,
    metrics: MetricsOption = None,
    metrics_dir: MetricsDirOption = None,
) -> None:
    """Replay each warning with a braking controller, a driver who brakes late, and nobody.

    The host's recorded motion is replayed until the warning; then the fuzzy controller of song2016 brakes it along its
    recorded path, or a driver 1.5 s later, or nobody. The other vehicle moves as recorded. Uses the states of `cwcli
    estimate --causal`; where the log has none, they are estimated first and written too. Paths and warnings are found
    anew.
    """
    job = Job(
        command="control",
        source=log,
        stages={"estimate": EstimateOptions(causal=True).make(sensors), "control": options.make()},
        reading=reading,
        writing=writing,
        talk=talk,
        metrics=metrics,
        metrics_dir=metrics_dir,
        missing=_Sources(sensors.ego_station),
    )
    run_job(job)


@dataclass(frozen=True)
class _Sources:
    """Leaves `estimate` out where the log holds the states already."""

    ego_station: str | None

    def __call__(self, stage: str, log: Log, selection: Selection) -> Missing | None:
        """Why a stage does not run.

        Raises:
            MissingSignalError: The log has neither both states nor the sensors from which to estimate them.
        """
        from cwcli.channels.binding import bind
        from cwcli.channels.published import EGO_STATE, REMOTE_STATE
        from cwcli.pipeline.missing import Missing
        from cwcli.signals.codec import Role

        if stage != "estimate":
            return None
        states, sources = (EGO_STATE.role, REMOTE_STATE.role), (Role.EGO_POSITION, Role.REMOTE)
        found = bind(log.channels, selection.topics, required=(), optional=states, where=log.name)
        has_states = any(role in found for role in states)
        bind(
            log.channels,
            selection.topics,
            required=states if has_states else sources,
            ego_station=self.ego_station,
            where=log.name,
            command="control",
        )
        return Missing("the log holds the states") if has_states else None
