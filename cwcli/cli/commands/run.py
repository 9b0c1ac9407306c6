"""`cwcli run`."""

from __future__ import annotations

from dataclasses import asdict, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.configfile import RunTalkOptions
from cwcli.cli.options.shared import (
    LogsArgument,
    ReadingOptions,
    RunInputOptions,
    RunOutputOptions,
    source_of_logs,
)
from cwcli.cli.options.stage import StageOptions, make_all_stage_options_classes, stage_call_from_options
from cwcli.cli.pipeline import Job, run_write_and_print
from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.pipeline.channel_choice import ChannelChoice
from cwcli.pipeline.execute import DEFAULT_CHOICE_OF_ALL_WRITTEN_CHANNELS, SkipRules
from cwcli.stages import DEFAULT_STAGES, STAGES

if TYPE_CHECKING:
    from cwcli.fleet.plan import FleetPlan
    from cwcli.pipeline.call import StageCall

EXAMPLES = (
    "cwcli run drive.mcap -o annotated.mcap --metrics-dir metrics/",
    "cwcli run drive.mcap --warn-rule ttc --predict-horizon 3 --json",
    "cwcli run part_0.mcap part_1.mcap --as-one -o annotated.mcap",
    "cwcli run logs/*.mcap -d out/ --jobs 2",
    "cwcli run 's3://bucket/drives/*.mcap' -d out/ --ray auto",
)
"""Command lines at the end of the command's `--help`."""


def _complete_stages(incomplete: str) -> list[tuple[str, str]]:
    return [(name, stage.help) for name, stage in STAGES.items() if name.startswith(incomplete)]


@dataclass(frozen=True)
class PipelineOptions:
    """Which stages run on each log, and options of the whole pipeline."""

    heading: ClassVar[str] = "Pipeline"
    stages: Annotated[
        list[str],
        typer.Option(
            "--stage",
            metavar="NAME",
            show_default=", ".join(DEFAULT_STAGES),
            autocompletion=_complete_stages,
            help="Run this stage if the log has the signals for it; several with commas. Repeatable.",
        ),
    ] = field(default_factory=list)
    tables: Annotated[bool, typer.Option("--tables", help="With -d: also write every channel as a table.")] = False
    no_annotate: Annotated[
        bool, typer.Option("--no-annotate", help="With -d: write tables, but no annotated logs.")
    ] = False
    gates: Annotated[
        list[str],
        typer.Option(
            "--gate",
            metavar="EXPR",
            help="With -d: a gate for `cwcli evaluate`, stored in the manifest. Repeatable.",
        ),
    ] = field(default_factory=list)


@dataclass(frozen=True)
class FleetOptions:
    """Output folder and workers of a run over many logs."""

    heading: ClassVar[str] = "Many logs"
    directory: Annotated[
        str | None,
        typer.Option(
            "--directory",
            "-d",
            metavar="DIR",
            help="Write each log's results into this folder or s3:// URL; results that are up to date are not "
            "computed again.",
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
            help="With -d: run on this Ray cluster (needs the extra cwcli-drive[ray]).",
        ),
    ] = None
    shard: Annotated[
        str | None,
        typer.Option(
            "--shard",
            metavar="I/N",
            help="With -d: process part I of N of the logs; auto/N takes I from an array job. "
            "`cwcli merge` joins the parts.",
        ),
    ] = None
    rehash: Annotated[
        bool,
        typer.Option(
            "--rehash",
            help="With -d: hash every log again, even if its file has the same size and times.",
        ),
    ] = False


@dataclass(frozen=True)
class AllOptions:
    """All options of a run.

    Attributes:
        wanted_stages: Names of the stages to run, in order.
    """

    pipeline: PipelineOptions
    inputs: RunInputOptions
    options_of_stages: dict[str, StageOptions]
    wanted_stages: tuple[str, ...]

    def stage_calls(self) -> dict[str, StageCall]:
        """Configure the stages to run, by name in order.

        Raises:
            UsageError: An option's value makes no sense.
        """
        from cwcli.metrics.gate_syntax import parse_gate

        for gate in self.pipeline.gates:
            parse_gate(gate)
        known = self.inputs.load_if_named()
        return {
            name: stage_call_from_options(self.options_of_stages[name], self.inputs, known)
            for name in self.wanted_stages
        }

    def to_document(self) -> dict[str, Any]:
        """Convert all options and their values to the form of a configuration file."""
        shared = {**asdict(self.inputs), "gates": list(self.pipeline.gates)}
        run = {"stages": list(self.stage_calls()), "tables": self.pipeline.tables}
        if self.pipeline.no_annotate:
            run["no_annotate"] = True
        return {
            **shared,
            "run": run,
            **{name: options.option_values() for name, options in self.options_of_stages.items()},
        }

    def fleet_plan(self, *, replace: bool, choice: ChannelChoice = DEFAULT_CHOICE_OF_ALL_WRITTEN_CHANNELS) -> FleetPlan:
        """Make the plan of a run over many logs."""
        from cwcli.fleet.plan import FleetPlan

        inputs = self.inputs
        return FleetPlan(
            stages=tuple(self.stage_calls().values()),
            pipeline={**self.to_document(), **({"channels": list(choice.patterns)} if choice else {})},
            topic=tuple(inputs.topics_and_mappings),
            start=inputs.start,
            end=inputs.end,
            recover=inputs.recover,
            max_chunk_bytes=inputs.max_chunk_bytes,
            max_pipe_bytes=inputs.max_pipe_bytes,
            max_ratio=inputs.max_ratio,
            timeout_s=inputs.timeout,
            strict=inputs.strict,
            ego_station=inputs.ego_station,
            replace=replace,
            tables=self.pipeline.tables,
            annotate=not self.pipeline.no_annotate,
            channels=choice.patterns,
        )


def gather_all_options(
    pipeline: PipelineOptions, inputs: RunInputOptions, stages: dict[str, StageOptions]
) -> AllOptions:
    """Collect all options of a run.

    Raises:
        UsageError: There is no stage of a name.
    """
    from cwcli.cli.console import closest_names_hint

    stage_names = [name.strip() for names in pipeline.stages for name in names.split(",")]
    for name in stage_names:
        if name not in STAGES:
            raise UsageError(f"there is no stage {name}", hint=closest_names_hint(name, list(STAGES)))
    chosen_stages = tuple(name for name in STAGES if name in (stage_names or DEFAULT_STAGES))
    return AllOptions(pipeline, inputs, stages, chosen_stages)


def gather_default_options() -> AllOptions:
    """Collect the default values of all options."""
    stages = {kind.stage: kind() for kind in make_all_stage_options_classes()}
    return gather_all_options(PipelineOptions(), RunInputOptions(), stages)


def command(
    logs: LogsArgument,
    pipeline: PipelineOptions,
    fleet: FleetOptions,
    writing: RunOutputOptions,
    inputs: RunInputOptions,
    talk: RunTalkOptions,
    stages: dict[str, StageOptions],
) -> int:
    """Run every stage that a log has the signals for, on one log or many.

    With one log it writes an annotated log (-o) and tables (--metrics-dir). Stages without their signals are left out,
    with the reason.

    With -d it processes many logs, each by itself, on several processes or a Ray cluster; a log that fails stops no
    other. The folder gets each log's annotated log, tables and metrics, and manifest.json, which says what was done and
    what failed. A second run processes only what is missing or has changed. The exit code is 0 if every log is done,
    else the highest exit code of the failed logs.
    """
    options = gather_all_options(pipeline, inputs, stages)
    if fleet.directory is not None:
        from cwcli.cli.fleet import run_on_many_logs
        from cwcli.fleet.shard import parse_shard

        _refuse_with_directory(writing, inputs, fleet)
        writing.channel_choice.check_patterns_before_run(STAGES[name] for name in options.wanted_stages)
        plan = options.fleet_plan(replace=writing.replace, choice=writing.channel_choice)
        plan = replace(plan, rehash=fleet.rehash, shard=None if fleet.shard is None else parse_shard(fleet.shard))
        return run_on_many_logs(logs, plan, fleet.directory, fleet.jobs, fleet.ray, writing.force, talk)
    _refuse_without_directory(logs, pipeline, inputs, fleet)
    job = add_all_stages(
        Job("run", source_of_logs(logs, inputs.as_one), {}, inputs, writing, talk, metrics_dir=writing.metrics_dir),
        options,
    )
    run_write_and_print(job)
    return 0


def add_all_stages(job: Job, options: AllOptions) -> Job:
    """Add to a job all stages of the options; those without signals in its log are left out later."""
    from cwcli.pipeline.missing import SignalCheck

    missing = SignalCheck(STAGES, options.inputs.ego_station)
    return replace(job, stages=options.stage_calls(), skip=SkipRules(missing, lenient=True))


def _refuse_with_directory(writing: RunOutputOptions, reading: ReadingOptions, fleet: FleetOptions) -> None:
    for option, value in (("-o", writing.output), ("--metrics-dir", writing.metrics_dir)):
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
    for option, value in (
        ("--jobs", fleet.jobs),
        ("--ray", fleet.ray),
        ("--rehash", fleet.rehash or None),
        ("--shard", fleet.shard),
        ("--tables", pipeline.tables or None),
        ("--no-annotate", pipeline.no_annotate or None),
    ):
        if value is not None:
            raise UsageError(f"{option} needs an output folder", hint="name it with -d")
    hint = "name it with -d; or --as-one takes them as the parts of one log"
    if len(logs) > 1 and not reading.as_one:
        raise UsageError(f"{len(logs)} logs need an output folder", hint=hint)
    if not reading.as_one and _is_folder_of_logs(Path(logs[0])):
        raise UsageError("a folder of logs needs an output folder", where=logs[0], hint=hint)


def _is_folder_of_logs(path: Path) -> bool:
    from cwcli.logs.read.recording import is_recording_folder, log_names_in_folder

    return path.is_dir() and not is_recording_folder(path) and len(log_names_in_folder(path)) != 1
