"""Runs stages on a log: opens it, runs the stages in memory, writes the outputs and prints the summary."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cwcli.cli.console import Console, normalise_stdout_name
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.shared import ReadingOptions, WritingOptions, source_names
from cwcli.cli.progress import Progress
from cwcli.cli.report import print_stage_summary, print_written_files
from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.pipeline.call import Call
from cwcli.pipeline.execute import RUN_EVERY_STAGE, RunOutcome, SkipRules, run_stages
from cwcli.pipeline.selection import resolve_selection
from cwcli.stages import STAGES

if TYPE_CHECKING:
    from cwcli.input import InputFile
    from cwcli.logs.read.reader import Log
    from cwcli.logs.read.source import Source
    from cwcli.metrics.table import Table
    from cwcli.output import AtomicGroup


N_HEAD_BYTES = 16
"""Bytes by which a log is told from a file that may be imported."""


@dataclass(frozen=True)
class Job:
    """One run of stages over one log.

    Attributes:
        command: Name of the command.
        source: Name of the log, names of its parts, or "-".
        stages: Stage calls by name, in order.
        metrics: File of the stage's main table, or None.
        metrics_dir: Folder for all tables of all stages, or None.
        first: Names of the stages that only prepare inputs of the command's own stage.
        skip: Which stages are left out.
    """

    command: str
    source: Source
    stages: Mapping[str, Call]
    reading: ReadingOptions
    writing: WritingOptions
    talk: TalkOptions
    metrics: str | None = None
    metrics_dir: str | None = None
    preceding_stages: Collection[str] = ()
    skip: SkipRules = RUN_EVERY_STAGE


def run_write_and_print(job: Job) -> RunOutcome:
    """Run the stages of a job, write its outputs, and print the summary.

    Raises:
        CwcliError: Known errors. Nothing is written unless every stage succeeded.
    """
    job = replace(job, writing=replace(job.writing, output=normalise_stdout_name(job.writing.output)))
    console = _console_for_job(job)
    outcome = run_and_write(job)
    if job.talk.json:
        console.print_document(job.command, job_document(job, outcome))
    else:
        print_outcome(job, console, outcome)
    return outcome


def run_and_write(job: Job) -> RunOutcome:
    """Run the stages of a job and write its outputs; prints only the progress.

    Raises:
        CwcliError: Known errors. Nothing is written unless every stage succeeded.
    """
    _check_output_targets(job)
    from cwcli.array_memory import bound_array_memory
    from cwcli.logs.read.reader import Log

    bound_array_memory()

    with Progress(quiet=job.talk.quiet) as progress:
        progress.begin_step(f"reading {', '.join(source_names(job.source))}")
        reading = job.reading
        with Log.open(
            job.source if job.command != "run" else _imported_source(job.source),
            recover=reading.recover,
            max_chunk_bytes=reading.max_chunk_bytes,
            max_pipe_bytes=reading.max_pipe_bytes,
            max_ratio=reading.max_ratio,
        ) as log:
            outcome, annotated = run_stages(
                log,
                job.stages,
                resolve_selection(log, job.reading.topics_and_mappings, job.reading.start, job.reading.end),
                skip=job.skip,
                strict=job.reading.strict,
                choice=job.writing.channel_choice,
                step=progress.begin_step,
            )
            _write_outputs(job, annotated, outcome, progress)
    return outcome


def _imported_source(source: Source) -> Source | InputFile:
    """The source; a file that is no log is imported, if nothing about it is ambiguous."""
    if not isinstance(source, str) or source == "-" or "://" in source:
        return source
    from cwcli.logs.format.faults import is_importable_head

    try:
        if not Path(source).is_file():
            return source
        with Path(source).open("rb") as file:
            head = file.read(N_HEAD_BYTES)
    except (OSError, ValueError):
        return source
    if not is_importable_head(head):
        return source
    from cwcli.importing.temporary_log import import_if_no_log

    return import_if_no_log(source) or source


def _console_for_job(job: Job) -> Console:
    to_stdout = job.writing.output == "-"
    if to_stdout and job.talk.json:
        raise UsageError("--json and -o - both want standard output", hint="write the log to a file")
    return Console(quiet=job.talk.quiet, summary_to_stderr=to_stdout)


def _check_output_targets(job: Job) -> None:
    """Check before the work that all outputs can be written."""
    from cwcli.metrics.table import check_table_file_name
    from cwcli.output import check_targets

    if job.metrics is not None:
        check_table_file_name(job.metrics)
    job.writing.channel_choice.check_patterns_before_run(STAGES[name] for name in job.stages)
    output, parts = (None, job.writing.output) if job.writing.is_folder_of_parts else (job.writing.output, None)
    if parts == "-":
        raise UsageError("--split like-input writes several files, and -o - is one", hint="name a folder with -o")
    folders = (job.metrics_dir, parts)
    check_targets((output, job.metrics), folders, force=job.writing.force, inputs=source_names(job.source))


def _write_outputs(job: Job, log: Log, outcome: RunOutcome, progress: Progress) -> None:
    """Write the annotated log and the tables: all of them or none."""
    from cwcli.metrics.table import write_table
    from cwcli.output import AtomicGroup, check_targets, make_folder

    tables = _tables_by_file(job, outcome)
    check_targets([path for path in tables if path.parent.is_dir()], force=job.writing.force)  # others are made below
    with AtomicGroup() as together:
        written = [] if job.writing.output is None else _write_annotated_log(job, log, outcome, progress, together)
        if job.metrics_dir is not None:
            make_folder(job.metrics_dir)
        for path, table in tables.items():
            write_table(table, path, force=job.writing.force, together=together)
    outcome.written.extend(name for name in written if name != "-")
    outcome.written.extend(map(str, tables))


def _write_annotated_log(
    job: Job, log: Log, outcome: RunOutcome, progress: Progress, together: AtomicGroup
) -> list[str]:
    """Write the annotated log; returns the names of its files."""
    from cwcli.logs.write.annotate import CopyOptions, annotate_log
    from cwcli.logs.write.annotate_parts import annotate_parts

    writing = job.writing
    output = str(writing.output)
    progress.begin_step(f"writing {output}")
    if writing.is_folder_of_parts:
        parts = annotate_parts(
            log,
            output,
            replace=writing.replace,
            force=writing.force,
            chosen_topics=writing.channel_choice,
            together=together,
        )
        return list(map(str, parts))
    report = annotate_log(
        log,
        (),
        {},
        output,
        replace=writing.replace,
        force=writing.force,
        options=CopyOptions(chosen_topics=writing.channel_choice, together=together),
    )
    outcome.left_profile = report.dropped_profile
    return [output]


def _tables_by_file(job: Job, outcome: RunOutcome) -> dict[Path, Table]:
    """The requested tables, by file."""
    files: dict[Path, Table] = {}
    if job.metrics is not None:
        own = next(result for result in outcome.results if result.stage not in job.preceding_stages)
        files[Path(job.metrics)] = next(iter(own.tables.values()))
    if job.metrics_dir is not None:
        files |= {Path(job.metrics_dir) / f"{name}.parquet": table for name, table in outcome.tables_by_name().items()}
    return files


def job_document(job: Job, outcome: RunOutcome) -> dict[str, Any]:
    """Make the content of `--json`."""
    return {
        "input": outcome.name,
        "output": job.writing.output,
        "written": outcome.written,
        "faults": outcome.faults,
        "left_out": dict(outcome.left_out),
        **({"channels_not_made": list(outcome.unmade)} if outcome.unmade else {}),
        "stages": {result.stage: result.summary.to_json() for result in outcome.results},
    }


def print_outcome(job: Job, console: Console, outcome: RunOutcome) -> None:
    """Print the summaries of the stages, notes on left-out stages and faults, and the written files."""
    for result in outcome.results:
        print_stage_summary(console, result.summary)
    for stage, reason in outcome.left_out.items():
        console.print_note(f"{stage} was left out: {reason}")
    for name in outcome.unmade:
        console.print_note(f"--channels {name}: this run made no such channel")
    for reason, count in outcome.faults.items():
        console.print_note(f"{outcome.name}: {reason}: {count}")
    if outcome.left_profile:
        console.print_note(
            f"the annotated log's profile is no longer {outcome.left_profile}: it holds more than ROS messages"
        )
    print_written_files(console, outcome.written)
    if not outcome.written and job.writing.output is None:
        console.print_note("nothing was written; -o FILE writes the annotated log")
