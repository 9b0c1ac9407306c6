"""`cwcli run`."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.respelled import resolved, say_notes
from cwcli.cli.options.shared import (
    CalibrationOptions,
    LogsArgument,
    MetricsDirOption,
    ReadingOptions,
    SensorOptions,
    WritingOptions,
    one_log,
)
from cwcli.cli.options.stage import StageOptions, call_of, every_stage
from cwcli.cli.pipeline import Job, run_job
from cwcli.errors import UsageError
from cwcli.pipeline.channel_choice import ChannelChoice
from cwcli.pipeline.execute import ALL_CHANNELS
from cwcli.stages import DEFAULT_STAGES, STAGES

if TYPE_CHECKING:
    from cwcli.fleet.plan import Plan
    from cwcli.pipeline.call import StageCall

EXAMPLES = (
    "cwcli run drive.mcap -o annotated.mcap --metrics-dir metrics/",
    "cwcli run drive.mcap --warn-rule ttc --predict-horizon 3 --json",
    "cwcli run part_0.mcap part_1.mcap --as-one -o annotated.mcap",
    "cwcli run logs/*.mcap -d out/ --jobs 2",
    "cwcli run 's3://bucket/drives/*.mcap' -d out/ --ray auto",
)


def _stages(incomplete: str) -> list[tuple[str, str]]:
    return [(name, stage.help) for name, stage in STAGES.items() if name.startswith(incomplete)]


@dataclass(frozen=True)
class PipelineOptions:
    """What is done with each log, beside the options of the stages."""

    heading: ClassVar[str] = "Pipeline"
    stages: Annotated[
        list[str],
        typer.Option(
            "--stage",
            metavar="NAME",
            show_default=", ".join(DEFAULT_STAGES),
            autocompletion=_stages,
            help="Run this stage if the log has the signals for it; several with commas. Repeatable.",
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
            help="With -d: run on this Ray cluster (needs the extra cwcli-drive[ray]).",
        ),
    ] = None


@dataclass(frozen=True)
class AllOptions:
    """The options of every stage.

    Attributes:
        pipeline, reading, sensors, calibration: Those that the stages share.
        of_stages: Stage -> its own.
        wanted: The stages that are to run, in order.
        notes: What replaces old spellings that were given.
    """

    pipeline: PipelineOptions
    reading: ReadingOptions
    sensors: SensorOptions
    calibration: CalibrationOptions
    of_stages: dict[str, StageOptions]
    wanted: tuple[str, ...]
    notes: tuple[str, ...]

    def calls(self) -> dict[str, StageCall]:
        """The stages that are to run, in order.

        Raises:
            UsageError: An option's value makes no sense.
        """
        from cwcli.metrics.gate_syntax import parse

        for gate in self.pipeline.gates:
            parse(gate)
        known = self.calibration.load()
        return {name: call_of(self.of_stages[name], self.sensors, known) for name in self.wanted}

    def document(self) -> dict[str, Any]:
        """Every option and its value, as a configuration file has them."""
        shared = {**asdict(self.reading), **asdict(self.sensors), **asdict(self.calibration)}
        shared["gates"] = list(self.pipeline.gates)
        run = {"stages": list(self.calls()), "tables": self.pipeline.tables}
        return {**shared, "run": run, **{name: options.values() for name, options in self.of_stages.items()}}

    def plan(self, *, replace: bool, choice: ChannelChoice = ALL_CHANNELS) -> Plan:
        """What is done with each log."""
        from cwcli.fleet.plan import Plan

        reading = self.reading
        return Plan(
            stages=tuple(self.calls().values()),
            pipeline={**self.document(), **({"channels": list(choice.patterns)} if choice else {})},
            topic=tuple(reading.topics),
            start=reading.start,
            end=reading.end,
            recover=reading.recover,
            max_chunk_bytes=reading.max_chunk_bytes,
            max_pipe_bytes=reading.max_pipe_bytes,
            max_ratio=reading.max_ratio,
            strict=reading.strict,
            ego_station=self.sensors.ego_station,
            replace=replace,
            tables=self.pipeline.tables,
            channels=choice.patterns,
        )


def all_options(
    pipeline: PipelineOptions,
    reading: ReadingOptions,
    sensors: SensorOptions,
    calibration: CalibrationOptions,
    stages: dict[str, StageOptions],
) -> AllOptions:
    """The options of every stage, old spellings replaced.

    Raises:
        UsageError: There is no stage of a name.
    """
    from cwcli.cli.console import closest

    asked = [name.strip() for names in pipeline.stages for name in names.split(",")]
    for name in asked:
        if name not in STAGES:
            raise UsageError(f"there is no stage {name}", hint=closest(name, list(STAGES)))
    wanted = [name for name in STAGES if name in (asked or DEFAULT_STAGES)]
    return AllOptions(pipeline, reading, sensors, calibration, *resolved(stages, wanted))


def default_options() -> AllOptions:
    """Every option as it is when nobody says otherwise."""
    stages = {kind.stage: kind() for kind in every_stage()}
    return all_options(PipelineOptions(), ReadingOptions(), SensorOptions(), CalibrationOptions(), stages)


def command(
    logs: LogsArgument,
    pipeline: PipelineOptions,
    fleet: FleetOptions,
    writing: WritingOptions,
    reading: ReadingOptions,
    sensors: SensorOptions,
    calibration: CalibrationOptions,
    talk: TalkOptions,
    stages: dict[str, StageOptions],
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
    options = all_options(pipeline, reading, sensors, calibration, stages)
    if fleet.directory is not None:
        from cwcli.cli.fleet import run_many

        _refuse_with_directory(writing, reading, metrics_dir, fleet)
        writing.choice.check_before(STAGES[name] for name in options.wanted)
        plan = options.plan(replace=writing.replace, choice=writing.choice)
        say_notes(talk, options.notes)
        return run_many(logs, plan, fleet.directory, fleet.jobs, fleet.ray, writing.force, talk)
    _refuse_without_directory(logs, pipeline, reading, fleet)
    job = with_all_stages(
        Job("run", one_log(logs, reading.as_one), {}, reading, writing, talk, metrics_dir=metrics_dir), options
    )
    say_notes(talk, options.notes)
    run_job(job)
    return 0


def with_all_stages(job: Job, options: AllOptions) -> Job:
    """The job with every stage that is to run and for which its log turns out to have the signals."""
    from cwcli.pipeline.missing import SignalsFor

    missing = SignalsFor(STAGES, options.sensors.ego_station)
    return replace(job, stages=options.calls(), missing=missing, lenient=True)


def _refuse_with_directory(
    writing: WritingOptions, reading: ReadingOptions, metrics_dir: str | None, fleet: FleetOptions
) -> None:
    for option, value in (("-o", writing.output), ("--metrics-dir", metrics_dir)):
        if value is not None:
            raise UsageError(f"{option} and -d exclude each other", hint="-d holds the annotated logs and the tables")
    if writing.split != "one":
        raise UsageError("--split and -d exclude each other", hint="-d writes one annotated log each")
    if reading.as_one:
        raise UsageError("--as-one and -d exclude each other", hint="-d takes a folder with a metadata.yaml as one log")
    if fleet.jobs is not None and fleet.jobs < 1:
        raise UsageError(f"--jobs {fleet.jobs} must be at least 1")


def _refuse_without_directory(
    logs: list[str], pipeline: PipelineOptions, reading: ReadingOptions, fleet: FleetOptions
) -> None:
    for option, value in (("--jobs", fleet.jobs), ("--ray", fleet.ray), ("--tables", pipeline.tables or None)):
        if value is not None:
            raise UsageError(f"{option} needs an output folder", hint="name it with -d")
    hint = "name it with -d; or --as-one takes them as the parts of one log"
    if len(logs) > 1 and not reading.as_one:
        raise UsageError(f"{len(logs)} logs need an output folder", hint=hint)
    if not reading.as_one and _is_folder_of_logs(Path(logs[0])):
        raise UsageError("a folder of logs needs an output folder", where=logs[0], hint=hint)


def _is_folder_of_logs(path: Path) -> bool:
    from cwcli.logs.read.recording import is_recording, logs_in

    return path.is_dir() and not is_recording(path) and len(logs_in(path)) != 1
