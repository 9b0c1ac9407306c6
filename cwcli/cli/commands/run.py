"""`cwcli run`."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from cwcli.cli.commands.control import ControlOptions
from cwcli.cli.commands.estimate import EstimateOptions
from cwcli.cli.commands.lanes import LanesOptions
from cwcli.cli.commands.observe import ObserveOptions
from cwcli.cli.commands.predict import PredictOptions
from cwcli.cli.commands.track import TrackOptions
from cwcli.cli.commands.warn import WarnOptions
from cwcli.cli.options.shared import (
    LogsArgument,
    MetricsDirOption,
    ReadingOptions,
    SensorOptions,
    TalkOptions,
    WritingOptions,
)
from cwcli.cli.pipeline import Job, run_job
from cwcli.errors import UsageError

if TYPE_CHECKING:
    from cwcli.fleet.plan import Plan
    from cwcli.pipeline.call import StageCall

EXAMPLES = (
    "cwcli run drive.mcap -o annotated.mcap --metrics-dir metrics/",
    "cwcli run drive.mcap --warn-rule ttc --predict-horizon 3 --json",
    "cwcli run logs/*.mcap -d out/ --jobs 2",
    "cwcli run 's3://bucket/drives/*.mcap' -d out/ --ray auto",
)


@dataclass(frozen=True)
class PipelineOptions:
    """What is done with each log, beside the options of the stages."""

    heading: ClassVar[str] = "Pipeline"
    stages: Annotated[
        list[str],
        typer.Option(
            "--stage",
            metavar="NAME",
            show_default="all but control",
            help="Run this stage if the log has the signals for it. Repeatable.",
        ),
    ] = field(default_factory=list)
    tables: Annotated[bool, typer.Option("--tables", help="With -d: write the channels' columns too.")] = False
    gates: Annotated[
        list[str],
        typer.Option(
            "--gate",
            metavar="EXPR",
            show_default=False,
            help="With -d: a condition for `cwcli evaluate`, kept in the manifest. Repeatable.",
        ),
    ] = field(default_factory=list)


@dataclass(frozen=True)
class FleetOptions:
    """Where the results of many logs go, and who makes them."""

    heading: ClassVar[str] = "Many logs"
    directory: Annotated[
        str | None,
        typer.Option(
            "--directory",
            "-d",
            metavar="DIR",
            show_default=False,
            help="Write each log's results into this folder; what is there unchanged is not done again.",
        ),
    ] = None
    jobs: Annotated[
        int | None,
        typer.Option("--jobs", "-j", metavar="N", show_default="all processors", help="With -d: worker processes."),
    ] = None
    ray: Annotated[
        str | None,
        typer.Option(
            "--ray",
            metavar="auto|local|ADDRESS",
            show_default=False,
            help="With -d: run on this Ray cluster (needs the extra cwcli[ray]).",
        ),
    ] = None


@dataclass(frozen=True)
class AllOptions:
    """The options of every stage.

    Attributes:
        pipeline, reading, sensors: Those that the stages share.
        of_stages: Stage -> its own.
    """

    pipeline: PipelineOptions
    reading: ReadingOptions
    sensors: SensorOptions
    of_stages: dict[str, Any]

    def calls(self) -> dict[str, StageCall]:
        """The stages that are to run, in order.

        Raises:
            UsageError: There is no such stage, or an option's value makes no sense.
        """
        from cwcli.cli.console import closest
        from cwcli.metrics.gate_syntax import parse
        from cwcli.pipeline.missing import DEFAULT_STAGES

        for gate in self.pipeline.gates:
            parse(gate)
        for name in self.pipeline.stages:
            if name not in self.of_stages:
                raise UsageError(f"there is no stage {name}", hint=closest(name, list(self.of_stages)))
        wanted = self.pipeline.stages or DEFAULT_STAGES
        return {name: self._call(name, options) for name, options in self.of_stages.items() if name in wanted}

    def document(self) -> dict[str, Any]:
        """Every option and its value, as a configuration file has them."""
        shared = {**asdict(self.reading), **asdict(self.sensors)}
        shared["gates"] = list(self.pipeline.gates)
        run = {"stages": list(self.calls()), "tables": self.pipeline.tables}
        return {**shared, "run": run, **{name: asdict(options) for name, options in self.of_stages.items()}}

    def plan(self, *, replace: bool) -> Plan:
        """What is done with each log."""
        from cwcli.fleet.plan import Plan

        reading = self.reading
        return Plan(
            stages=tuple(self.calls().values()),
            pipeline=self.document(),
            topic=tuple(reading.topic),
            start=reading.start,
            end=reading.end,
            recover=reading.recover,
            strict=reading.strict,
            ego_station=self.sensors.ego_station,
            replace=replace,
            tables=self.pipeline.tables,
        )

    def _call(self, name: str, options: Any) -> StageCall:
        call: StageCall = options.make(self.sensors) if name in ("estimate", "track") else options.make()
        return call


def all_options(
    pipeline: PipelineOptions,
    reading: ReadingOptions,
    sensors: SensorOptions,
    estimate: EstimateOptions,
    track: TrackOptions,
    lanes: LanesOptions,
    observe: ObserveOptions,
    predict: PredictOptions,
    warn: WarnOptions,
    control: ControlOptions,
) -> AllOptions:
    """The options of every stage, in the order in which the stages run."""
    of_stages = {each.stage: each for each in (estimate, track, lanes, observe, predict, warn, control)}
    return AllOptions(pipeline, reading, sensors, of_stages)


def default_options() -> AllOptions:
    """Every option as it is when nobody says otherwise."""
    kinds = (EstimateOptions, TrackOptions, LanesOptions, ObserveOptions, PredictOptions, WarnOptions, ControlOptions)
    return AllOptions(PipelineOptions(), ReadingOptions(), SensorOptions(), {kind.stage: kind() for kind in kinds})


def command(
    logs: LogsArgument,
    pipeline: PipelineOptions,
    fleet: FleetOptions,
    writing: WritingOptions,
    reading: ReadingOptions,
    sensors: SensorOptions,
    talk: TalkOptions,
    estimate: EstimateOptions,
    track: TrackOptions,
    lanes: LanesOptions,
    observe: ObserveOptions,
    predict: PredictOptions,
    warn: WarnOptions,
    control: ControlOptions,
    metrics_dir: MetricsDirOption = None,
) -> int:
    """Run every stage that a log has the signals for, on one log or many.

    One log gives an annotated log (-o) and tables (--metrics-dir), without the copies in between that separate commands
    would make. Stages without their signals are left out, and it is said why.

    With -d, every log is done by itself, on several processes or a Ray cluster, and one that fails stops no other. The
    folder gets each log's annotated log, tables and metrics, and manifest.json: what was done, what failed and why. A
    second run does what is missing or has changed. The exit code is 0 if every log is done, else the highest of those
    that failed.
    """
    options = all_options(pipeline, reading, sensors, estimate, track, lanes, observe, predict, warn, control)
    if fleet.directory is not None:
        from cwcli.cli.fleet import run_many

        _refuse_with_directory(writing, metrics_dir, fleet)
        return run_many(
            logs, options.plan(replace=writing.replace), fleet.directory, fleet.jobs, fleet.ray, writing.force, talk
        )
    _refuse_without_directory(logs, pipeline, fleet)
    run_job(with_all_stages(Job("run", logs[0], {}, reading, writing, talk, metrics_dir=metrics_dir), options))
    return 0


def with_all_stages(job: Job, options: AllOptions) -> Job:
    """The job with every stage that is to run and for which its log turns out to have the signals."""
    from cwcli.pipeline.missing import signals_for

    calls = options.calls()
    return replace(job, stages=calls, missing=signals_for(calls, options.sensors.ego_station), lenient=True)


def _refuse_with_directory(writing: WritingOptions, metrics_dir: str | None, fleet: FleetOptions) -> None:
    for option, value in (("-o", writing.output), ("--metrics-dir", metrics_dir)):
        if value is not None:
            raise UsageError(f"{option} and -d exclude each other", hint="-d holds the annotated logs and the tables")
    if fleet.jobs is not None and fleet.jobs < 1:
        raise UsageError(f"--jobs {fleet.jobs} must be at least 1")


def _refuse_without_directory(logs: list[str], pipeline: PipelineOptions, fleet: FleetOptions) -> None:
    for option, value in (("--jobs", fleet.jobs), ("--ray", fleet.ray), ("--tables", pipeline.tables or None)):
        if value is not None:
            raise UsageError(f"{option} needs an output folder", hint="name it with -d")
    if len(logs) > 1:
        raise UsageError(f"{len(logs)} logs need an output folder", hint="name it with -d")
    if Path(logs[0]).is_dir():
        raise UsageError("a folder of logs needs an output folder", where=logs[0], hint="name it with -d")
