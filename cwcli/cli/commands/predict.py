"""`cwcli predict`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import typer

from cwcli.cli.options.expand import StageOptions
from cwcli.cli.options.shared import LogArgument, MetricsOption, ReadingOptions, TalkOptions, WritingOptions
from cwcli.cli.pipeline import Job, Selection, run_job
from cwcli.prediction.models import DEFAULT_MODEL, MODELS

if TYPE_CHECKING:
    from cwcli.logs.log import Log
    from cwcli.stages.result import StageResult

EXAMPLES = (
    "cwcli predict estimated.mcap -o predicted.mcap --horizon 3",
    "cwcli estimate drive.mcap -o - | cwcli predict - -o predicted.mcap",
)


def _models(incomplete: str) -> list[tuple[str, str]]:
    return [(name, model.summary) for name, model in MODELS.items() if name.startswith(incomplete)]


@dataclass(frozen=True)
class PredictOptions(StageOptions):
    """Options of the stage."""

    stage: ClassVar[str] = "predict"

    model: Annotated[
        str,
        typer.Option(
            "--model",
            metavar="NAME",
            autocompletion=_models,
            help="; ".join(f"{name}: {model.summary}" for name, model in MODELS.items()) + ".",
        ),
    ] = DEFAULT_MODEL
    horizon: Annotated[float, typer.Option("--horizon", metavar="SECONDS", help="How far ahead.")] = 2.5
    step: Annotated[float, typer.Option("--step", metavar="SECONDS", help="Between the points of a path.")] = 0.05
    discretisation: Annotated[
        Literal["exact", "paper"],
        typer.Option("--discretisation", help="Integrate exactly, or by the recursion of song2016 (eq. 2, 9, 10)."),
    ] = "exact"

    def make(self) -> Callable[[Log, Selection], StageResult]:
        """The stage with these options."""
        from cwcli.stages.predict import PredictConfig, predict

        def stage(log: Log, selection: Selection) -> StageResult:
            return predict(
                log,
                PredictConfig(
                    model=self.model,
                    horizon_s=self.horizon,
                    step_s=self.step,
                    discretisation=self.discretisation,
                    topics=selection.topics,
                    start_ns=selection.start_ns,
                    end_ns=selection.end_ns,
                ),
            )

        return stage


def command(
    log: LogArgument,
    options: PredictOptions,
    writing: WritingOptions,
    reading: ReadingOptions,
    talk: TalkOptions,
    metrics: MetricsOption = None,
) -> None:
    """Predict the path of every vehicle from each of its states.

    Needs the channels of `cwcli estimate`. Adds one path per state, with its covariance, and compares every motion
    model with what then happened.
    """
    run_job(Job("predict", log, {"predict": options.make()}, reading, writing, talk, metrics=metrics))
