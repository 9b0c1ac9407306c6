"""`cwcli track`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

import typer

from cwcli.cli.options.expand import StageOptions
from cwcli.cli.options.sensor import parse_sensors
from cwcli.cli.options.shared import (
    LogArgument,
    MetricsOption,
    ReadingOptions,
    SensorOptions,
    TalkOptions,
    WritingOptions,
)
from cwcli.cli.pipeline import Job, run_job
from cwcli.errors import UsageError
from cwcli.pipeline.call import StageCall

EXAMPLES = (
    "cwcli track drive.mcap -o tracked.mcap --filter ukf --metrics tracks.parquet",
    "cwcli track drive.mcap --filter ekf --causal",
    "cwcli track drive.mcap --sensor /radar/scan:x=3.6,y=-0.4,yaw_deg=-30",
)


@dataclass(frozen=True)
class TrackOptions(StageOptions):
    """Options of the stage."""

    stage: ClassVar[str] = "track"

    filter: Annotated[
        Literal["ukf", "ekf"], typer.Option("--filter", help="Unscented or extended Kalman filter (xiang2019).")
    ] = "ukf"
    model: Annotated[
        Literal["ctrv", "ca", "cv"],
        typer.Option(
            "--model",
            help="Motion of a target: constant turn rate and velocity, constant acceleration, or constant velocity "
            "(the paper's).",
        ),
    ] = "ctrv"
    causal: Annotated[
        bool, typer.Option("--causal", help="The filter alone: no state uses what was detected later.")
    ] = False
    tune: Annotated[
        bool,
        typer.Option(
            "--tune/--no-tune",
            help="Find process and measurement noise from the detections by maximum likelihood; no truth is seen.",
        ),
    ] = True
    targets: Annotated[
        Literal["auto", "one", "many"],
        typer.Option(
            "--targets",
            help="auto: one target where no scan holds two detections and one track takes nine in ten, else many.",
        ),
    ] = "auto"
    sensor: Annotated[
        list[str],
        typer.Option(
            "--sensor",
            metavar="TOPIC:KEY=VALUE,..",
            show_default=False,
            help="Mounting and noise of a sensor: x, y (m), yaw_deg, axes (body, paper), carrier (body, map), frame, "
            "sigma (one value, or one per measured value with / between), range_m, fov_deg, detection (probability), "
            "rate (away, toward, off). Repeatable.",
        ),
    ] = field(default_factory=list)
    noise: Annotated[
        float | None,
        typer.Option(
            "--noise",
            metavar="DENSITY",
            show_default="the model's own",
            help="Process noise: acceleration in m/s^1.5, or jerk in m/s^2.5 for ca. --tune starts from it.",
        ),
    ] = None
    gate: Annotated[
        float,
        typer.Option("--gate", metavar="P", help="Probability that the gate keeps a good detection; 1 is off."),
    ] = 0.9999

    def make(self, sensors: SensorOptions) -> StageCall:
        """The stage with these options."""
        if not 0 < self.gate <= 1:
            raise UsageError(f"--gate {self.gate:g} must be a probability above 0")
        if self.noise is not None and not 0 < self.noise <= 1000:
            raise UsageError(f"--noise {self.noise:g} must be above 0 and at most 1000")
        settings = parse_sensors(self.sensor)
        from cwcli.stages.inputs.sources import SourceConfig
        from cwcli.stages.track import TrackConfig
        from cwcli.tracking.config import FilterConfig, TrackerConfig

        single = FilterConfig(
            filter=self.filter,
            model=self.model,
            noise=self.noise,
            gate_probability=self.gate,
            smooth=not self.causal,
            tune=self.tune,
        )

        sources = SourceConfig(clock=sensors.clock)
        return StageCall(self.stage, TrackConfig(sources, TrackerConfig(single), self.targets, settings))


def command(
    log: LogArgument,
    options: TrackOptions,
    writing: WritingOptions,
    reading: ReadingOptions,
    sensors: SensorOptions,
    talk: TalkOptions,
    metrics: MetricsOption = None,
) -> None:
    """Track other road users from the detections of lidars and radars.

    Needs a channel of detections; every such channel is a sensor. With the states of `cwcli estimate` in the log,
    targets are in the map and the car's own motion is taken out. Where the log has their truth, errors are shown.
    """
    run_job(Job("track", log, {"track": options.make(sensors)}, reading, writing, talk, metrics=metrics))
