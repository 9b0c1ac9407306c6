"""`cwcli observe`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import typer

from cwcli.cli.options.expand import StageOptions
from cwcli.cli.options.shared import LogArgument, MetricsOption, ReadingOptions, TalkOptions, WritingOptions
from cwcli.cli.pipeline import Job, run_job
from cwcli.errors import UsageError
from cwcli.pipeline.call import StageCall

EXAMPLES = (
    "cwcli observe lanes.mcap -o observed.mcap --vehicle vehicle.toml",
    "cwcli observe lanes.mcap --method zhang2011 --load full",
    "cwcli lanes drive.mcap -o - | cwcli observe - -o observed.mcap",
)


@dataclass(frozen=True)
class ObserveOptions(StageOptions):
    """Options of the stage."""

    stage: ClassVar[str] = "observe"

    method: Annotated[
        Literal["cwcli", "zhang2011"],
        typer.Option(
            "--method",
            help="cwcli: one Kalman filter over frames and sensors at their own times; zhang2011: the paper's "
            "observers for multiples of 10 km/h, two of them blended.",
        ),
    ] = "cwcli"
    vehicle: Annotated[
        str | None,
        typer.Option(
            "--vehicle",
            metavar="FILE",
            show_default="the shipped example zhang2011",
            help="TOML file of the car, or the name of a shipped one.",
        ),
    ] = None
    load: Annotated[
        str | None,
        typer.Option("--load", metavar="NAME", show_default="the file's own", help="A load of the car's file."),
    ] = None
    estimate_load: Annotated[
        bool, typer.Option("--estimate-load", help="Estimate the car's mass too (cwcli); turns are needed to tell it.")
    ] = False
    gyro: Annotated[
        bool, typer.Option("--gyro/--no-gyro", help="Fuse the measured yaw rate, if there is one (cwcli).")
    ] = True
    steering: Annotated[
        bool, typer.Option("--steering/--no-steering", help="Use the measured steering angle, if there is one.")
    ] = True
    steer_rate: Annotated[
        Literal["raw", "robust"],
        typer.Option(
            "--steer-rate",
            help="How zhang2011 takes the rate of the heading deviation (eq. 10): from two frames, or as the median "
            "slope of five.",
        ),
    ] = "raw"
    coast: Annotated[
        float, typer.Option("--coast", metavar="SECONDS", help="Carry the state on for so long without boundaries.")
    ] = 2.0

    def make(self) -> StageCall:
        """The stage with these options."""
        if self.vehicle is None and self.load is None:
            chosen = None
        else:
            from cwcli.dynamics.vehicle import DEFAULT_VEHICLE, load_vehicle

            chosen = load_vehicle(self.vehicle or DEFAULT_VEHICLE, load=self.load)
        if not 0.0 < self.coast <= 60.0:
            raise UsageError(f"--coast {self.coast:g} must be above 0 and at most 60 s")
        from cwcli.dynamics.config import ObserverConfig
        from cwcli.stages.observe import ObserveConfig

        observer = ObserverConfig(
            method=self.method,
            estimate_load=self.estimate_load,
            max_coast_s=self.coast,
            steer_rate=self.steer_rate,
        )
        return StageCall(
            self.stage,
            ObserveConfig(vehicle=chosen, observer=observer, use_gyro=self.gyro, use_steer=self.steering),
        )


def command(
    log: LogArgument,
    options: ObserveOptions,
    writing: WritingOptions,
    reading: ReadingOptions,
    talk: TalkOptions,
    metrics: MetricsOption = None,
) -> None:
    """Observe the ego's lateral speed and yaw rate from its lane.

    Needs the channel of `cwcli lanes` and the ego's speed; uses a gyroscope and a measured steering angle where the log
    has them. Where the log holds the true motion, errors are shown.
    """
    run_job(Job("observe", log, {"observe": options.make()}, reading, writing, talk, metrics=metrics))
