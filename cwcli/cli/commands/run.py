"""`cwcli run`."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import typer

from cwcli.cli.commands.estimate import EstimateOptions
from cwcli.cli.commands.predict import PredictOptions
from cwcli.cli.commands.warn import WarnOptions
from cwcli.cli.options.shared import LogArgument, ReadingOptions, SensorOptions, TalkOptions, WritingOptions
from cwcli.cli.pipeline import Job, Selection, run_job

if TYPE_CHECKING:
    from cwcli.logs.log import Log
    from cwcli.signals.roles import Bindings
    from cwcli.stages.result import StageResult

EXAMPLES = (
    "cwcli run drive.mcap -o annotated.mcap --metrics-dir metrics/",
    "cwcli run drive.mcap --warn-rule ttc --predict-horizon 3 --json",
)

MetricsDirOption = Annotated[
    str | None,
    typer.Option(
        "--metrics-dir",
        metavar="DIR",
        show_default=False,
        help="Write every table of every stage into this folder, as Parquet.",
    ),
]


def command(
    log: LogArgument,
    writing: WritingOptions,
    reading: ReadingOptions,
    sensors: SensorOptions,
    talk: TalkOptions,
    estimate: EstimateOptions,
    predict: PredictOptions,
    warn: WarnOptions,
    metrics_dir: MetricsDirOption = None,
) -> None:
    """Estimate, predict and warn in one pass.

    The same as `cwcli estimate | cwcli predict | cwcli warn`, without the copies in between. Needs the ego's position;
    without the V2X messages of another vehicle there is nobody to warn of, and the last stage is left out.
    """
    job = Job("run", log, {}, reading, writing, talk, metrics_dir=metrics_dir)
    run_job(with_all_stages(job, sensors, estimate, predict, warn))


def with_all_stages(
    job: Job, sensors: SensorOptions, estimate: EstimateOptions, predict: PredictOptions, warn: WarnOptions
) -> Job:
    """The job with the three stages; it fails at once if the log has nothing for the first."""

    def preflight(log: Log, selection: Selection) -> dict[str, str]:
        from cwcli.signals.roles import Role, bind

        def find(role: Role, *, is_required: bool) -> Bindings:
            return bind(
                log.channels,
                selection.topics,
                required=(role,) if is_required else (),
                optional=() if is_required else (role,),
                ego_station=sensors.ego_station,
                where=log.name,
                command="run",
            )

        find(Role.EGO_POSITION, is_required=True)
        others = find(Role.REMOTE, is_required=False)
        if Role.REMOTE in others:
            return {}
        return {"warn": others.notes[0] if others.notes else "no channel holds remote vehicles (BSM or CAM messages)"}

    def follow_up(result: StageResult) -> dict[str, str]:
        from cwcli.stages.channels import REMOTE_STATE_TOPIC

        is_alone = result.stage == "estimate" and REMOTE_STATE_TOPIC not in {each.topic for each in result.channels}
        return {"warn": "no message of another vehicle could be used"} if is_alone else {}

    stages = {"estimate": estimate.make(sensors), "predict": predict.make(), "warn": warn.make()}
    return replace(job, stages=stages, preflight=preflight, follow_up=follow_up)
