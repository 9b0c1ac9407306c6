"""Runs stages on a log: opens it, runs the stages in memory, writes the outputs and prints the summary."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cwcli.cli.console import Console, stdout_or_file
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.shared import ReadingOptions, WritingOptions, names_of
from cwcli.cli.progress import Progress
from cwcli.cli.report import print_result, print_written
from cwcli.errors import UsageError
from cwcli.pipeline.call import Call
from cwcli.pipeline.execute import Missed, Outcome, run_stages
from cwcli.pipeline.selection import select
from cwcli.stages import STAGES

if TYPE_CHECKING:
    from cwcli.logs.read.reader import Log
    from cwcli.logs.read.source import Source
    from cwcli.metrics.table import Table
    from cwcli.output import Together


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
        missing, lenient: Which stages are left out; see `cwcli.pipeline.execute.run_stages`.
    """

    command: str
    source: Source
    stages: Mapping[str, Call]
    reading: ReadingOptions
    writing: WritingOptions
    talk: TalkOptions
    metrics: str | None = None
    metrics_dir: str | None = None
    first: Collection[str] = ()
    missing: Missed = lambda name, log, selection: None
    lenient: bool = False


def run_job(job: Job) -> Outcome:
    """Run the stages of a job, write its outputs, and print the summary.

    Raises:
        CwcliError: Known errors. Nothing is written unless every stage succeeded.
    """
    job = replace(job, writing=replace(job.writing, output=stdout_or_file(job.writing.output)))
    console = _console(job)
    outcome = execute(job)
    if job.talk.json:
        console.document(job.command, document(job, outcome))
    else:
        tell(job, console, outcome)
    return outcome


def execute(job: Job) -> Outcome:
    """Run the stages of a job and write its outputs; prints only the progress.

    Raises:
        CwcliError: Known errors. Nothing is written unless every stage succeeded.
    """
    _check_targets(job)
    from cwcli.array_memory import bound_array_memory
    from cwcli.logs.read.reader import Log

    bound_array_memory()

    with Progress(quiet=job.talk.quiet) as progress:
        progress.step(f"reading {', '.join(names_of(job.source))}")
        reading = job.reading
        with Log.open(
            job.source,
            recover=reading.recover,
            max_chunk_bytes=reading.max_chunk_bytes,
            max_pipe_bytes=reading.max_pipe_bytes,
            max_ratio=reading.max_ratio,
        ) as log:
            outcome, annotated = run_stages(
                log,
                job.stages,
                select(log, job.reading.topics, job.reading.start, job.reading.end),
                missing=job.missing,
                lenient=job.lenient,
                strict=job.reading.strict,
                choice=job.writing.choice,
                step=progress.step,
            )
            _write(job, annotated, outcome, progress)
    return outcome


def _console(job: Job) -> Console:
    to_stdout = job.writing.output == "-"
    if to_stdout and job.talk.json:
        raise UsageError("--json and -o - both want standard output", hint="write the log to a file")
    return Console(quiet=job.talk.quiet, summary_to_stderr=to_stdout)


def _check_targets(job: Job) -> None:
    """Check before the work that all outputs can be written."""
    from cwcli.metrics.table import check_table_name
    from cwcli.output import check_targets

    if job.metrics is not None:
        check_table_name(job.metrics)
    job.writing.choice.check_before(STAGES[name] for name in job.stages)
    output, parts = (None, job.writing.output) if job.writing.is_folder else (job.writing.output, None)
    if parts == "-":
        raise UsageError("--split like-input writes several files, and -o - is one", hint="name a folder with -o")
    folders = (job.metrics_dir, parts)
    check_targets((output, job.metrics), folders, force=job.writing.force, inputs=names_of(job.source))


def _write(job: Job, log: Log, outcome: Outcome, progress: Progress) -> None:
    """Write the annotated log and the tables: all of them or none."""
    from cwcli.metrics.table import write_table
    from cwcli.output import Together, check_targets, make_folder

    tables = _table_files(job, outcome)
    check_targets([path for path in tables if path.parent.is_dir()], force=job.writing.force)  # others are made below
    with Together() as together:
        written = [] if job.writing.output is None else _write_log(job, log, outcome, progress, together)
        if job.metrics_dir is not None:
            make_folder(job.metrics_dir)
        for path, table in tables.items():
            write_table(table, path, force=job.writing.force, together=together)
    outcome.written.extend(name for name in written if name != "-")
    outcome.written.extend(map(str, tables))


def _write_log(job: Job, log: Log, outcome: Outcome, progress: Progress, together: Together) -> list[str]:
    """Write the annotated log; returns the names of its files."""
    from cwcli.logs.write.annotate import annotate
    from cwcli.logs.write.annotate_parts import annotate_parts

    writing = job.writing
    output = str(writing.output)
    progress.step(f"writing {output}")
    if writing.is_folder:
        parts = annotate_parts(
            log, output, replace=writing.replace, force=writing.force, chosen=writing.choice, together=together
        )
        return list(map(str, parts))
    report = annotate(
        log, (), {}, output, replace=writing.replace, force=writing.force, chosen=writing.choice, together=together
    )
    outcome.left_profile = report.left_profile
    return [output]


def _table_files(job: Job, outcome: Outcome) -> dict[Path, Table]:
    """The requested tables, by file."""
    files: dict[Path, Table] = {}
    if job.metrics is not None:
        own = next(result for result in outcome.results if result.stage not in job.first)
        files[Path(job.metrics)] = next(iter(own.tables.values()))
    if job.metrics_dir is not None:
        files |= {Path(job.metrics_dir) / f"{name}.parquet": table for name, table in outcome.tables().items()}
    return files


def document(job: Job, outcome: Outcome) -> dict[str, Any]:
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


def tell(job: Job, console: Console, outcome: Outcome) -> None:
    """Print the summaries of the stages, notes on left-out stages and faults, and the written files."""
    for result in outcome.results:
        print_result(console, result.summary)
    for stage, reason in outcome.left_out.items():
        console.note(f"{stage} was left out: {reason}")
    for name in outcome.unmade:
        console.note(f"--channels {name}: this run made no such channel")
    for reason, count in outcome.faults.items():
        console.note(f"{outcome.name}: {reason}: {count}")
    if outcome.left_profile:
        console.note(
            f"the annotated log's profile is no longer {outcome.left_profile}: it holds more than ROS messages"
        )
    print_written(console, outcome.written)
    if not outcome.written and job.writing.output is None:
        console.note("nothing was written; -o FILE writes the annotated log")
