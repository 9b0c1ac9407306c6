"""`cwcli predict`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import typer

from cwcli.cli.options.expand import StageOptions
from cwcli.cli.options.shared import LogArgument, MetricsOption, ReadingOptions, TalkOptions, WritingOptions
from cwcli.cli.pipeline import Job, run_job
from cwcli.pipeline.call import StageCall
from cwcli.prediction.models import DEFAULT_MODEL, MODELS

EXAMPLES = (
    "cwcli predict estimated.mcap -o predicted.mcap --horizon 3",
    "cwcli estimate drive.mcap -o - | cwcli predict - -o predicted.mcap",
    "cwcli predict observed.mcap --from observer -o p.mcap --render /camera/drawn",
)


@dataclass(frozen=True)
class PredictOptions(StageOptions):
    """Options of the stage."""

    stage: ClassVar[str] = "predict"

    model: Annotated[
        str,
        typer.Option(
            "--model",
            metavar="NAME",
            autocompletion=MODELS.complete,
            help=MODELS.help()
            + " From the observer: lateral (auto): the yaw rate goes over to the road's; lateral-zhang2011: speed, "
            "lateral speed and yaw rate stay.",
        ),
    ] = DEFAULT_MODEL
    origin: Annotated[
        Literal["states", "observer"],
        typer.Option(
            "--from",
            help="Start from the states of `cwcli estimate`, or, for the ego alone, from the lateral motion and the "
            "road's curvature of `cwcli observe`.",
        ),
    ] = "states"
    horizon: Annotated[float, typer.Option("--horizon", metavar="SECONDS", help="How far ahead.")] = 2.5
    step: Annotated[float, typer.Option("--step", metavar="SECONDS", help="Between the points of a path.")] = 0.05
    discretisation: Annotated[
        Literal["exact", "paper"],
        typer.Option("--discretisation", help="Integrate exactly, or by the recursion of song2016 (eq. 2, 9, 10)."),
    ] = "exact"
    calibrate: Annotated[
        bool,
        typer.Option(
            "--calibrate/--no-calibrate",
            help="From the observer: scale the uncertainty by how far this record's car went from its paths; looks at "
            "the whole record.",
        ),
    ] = True
    render: Annotated[
        str | None,
        typer.Option(
            "--render",
            metavar="/TOPIC",
            show_default=False,
            help="From the observer: publish the camera's frames with the path and the lane drawn on them here, as "
            "JPEG.",
        ),
    ] = None

    def make(self) -> StageCall:
        """The stage with these options."""
        from cwcli.stages.predict import PredictConfig, check_config

        config = PredictConfig(
            model=self.model,
            horizon_s=self.horizon,
            step_s=self.step,
            discretisation=self.discretisation,
            origin=self.origin,
            calibrate=self.calibrate,
            render=self.render,
        )
        check_config(config)
        return StageCall(self.stage, config)


def command(
    log: LogArgument,
    options: PredictOptions,
    writing: WritingOptions,
    reading: ReadingOptions,
    talk: TalkOptions,
    metrics: MetricsOption = None,
) -> None:
    """Predict the path of every vehicle from each of its states.

    Needs the channels of `cwcli estimate`, or with `--from observer` that of `cwcli observe`. Adds one path per state,
    with its covariance, and compares every motion model with what then happened.
    """
    run_job(Job("predict", log, {"predict": options.make()}, reading, writing, talk, metrics=metrics))
