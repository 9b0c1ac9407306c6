"""Runs stages on a log: opens it, runs the stages in memory, writes the outputs and prints the summary."""

from __future__ import annotations

import shlex
from collections.abc import Collection, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cwcli.cli.console import Console, replace_stdout_path_by_dash
from cwcli.cli.digest import SUGGESTED_STAGE_AFTER_STAGE, print_digest, suggest_next_step
from cwcli.cli.options.configfile import RunTalkOptions
from cwcli.cli.options.shared import ReadingOptions, WritingOptions, source_names
from cwcli.cli.progress import Progress
from cwcli.cli.report import print_stage_summary, print_written_files
from cwcli.errors import CwcliError, UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.pipeline.call import Call
from cwcli.pipeline.execute import SKIP_RULES_THAT_SKIP_NO_STAGE, RunOutcome, RunRules, SkipRules
from cwcli.stages import STAGES
from cwcli.work_share import part_of_work, report_work_share_to

if TYPE_CHECKING:
    from cwcli.digest.digest import Digest
    from cwcli.input import InputFile
    from cwcli.library.writing import OutputFiles
    from cwcli.logs.read.reader import Log
    from cwcli.logs.read.source import Source
    from cwcli.metrics.table import Table


N_BYTES_TO_RECOGNISE_LOG = 16
"""Bytes by which a log is told from a file that may be imported."""


@dataclass(frozen=True)
class Job:
    """One run of stages over one log.

    Attributes:
        source: Name of the log, names of its parts, or "-".
        metrics: File of the stage's main table, or None.
        metrics_dir: Folder for all tables of all stages, or None.
        preceding_stages: Names of the stages that only prepare inputs of the command's own stage.
    """

    command: str
    source: Source
    stages: Mapping[str, Call]
    reading: ReadingOptions
    writing: WritingOptions
    talk: RunTalkOptions
    metrics: str | None = None
    metrics_dir: str | None = None
    preceding_stages: Collection[str] = ()
    skip: SkipRules = SKIP_RULES_THAT_SKIP_NO_STAGE


@dataclass(frozen=True)
class JobOutcome:
    """What came of a job.

    Attributes:
        digest: Their digest, None where none is printed.
        following_stage: The stage that is suggested next and has its signals, "" for none.
        notes: What the user should know of the input, beside the notes of the stages.
    """

    run: RunOutcome
    digest: Digest | None
    following_stage: str = ""
    notes: tuple[str, ...] = ()


def run_write_and_print(job: Job) -> None:
    """Run the stages of a job, write its outputs, and print the summary.

    Raises:
        CwcliError: Known errors. Nothing is written unless every stage succeeded.
    """
    job = replace(job, writing=replace(job.writing, output=replace_stdout_path_by_dash(job.writing.output)))
    console = _console_for_job(job)
    outcome = run_and_write(job)
    if job.talk.json:
        console.print_document(job.command, job_document(job, outcome))
    elif outcome.digest is not None:
        next_step = suggest_next_step(job.command, job.writing.output, following=outcome.following_stage)
        print_outcome(job, console, outcome, next_step)


def run_and_write(job: Job) -> JobOutcome:
    """Run the stages of a job and write its outputs; prints only the progress.

    Raises:
        CwcliError: Known errors. Nothing is written unless every stage succeeded.
    """
    _check_output_targets(job)
    from cwcli.library.log import open_log_with_choices_and_span
    from cwcli.library.writing import write_outputs

    reading = job.reading
    with Progress(quiet=job.talk.quiet) as progress, report_work_share_to(progress.show_share):
        progress.begin_step(f"reading {', '.join(source_names(job.source))}")
        span = (reading.start, reading.end)
        source = _source_or_imported_log(job.source) if job.command == "run" else job.source
        with open_log_with_choices_and_span(
            source, reading.topics_and_mappings, span, recover=reading.recover, limits=reading.resource_limits
        ) as log:
            rules = RunRules(job.skip, reading.strict, job.writing.channel_choice)
            share = 0.9 if job.writing.output is not None else 0.98
            with part_of_work(0.0, share):
                result = log.run_calls(job.stages, rules, progress.begin_step)
            outcome = result.outcome
            is_silent = job.talk.quiet or job.talk.json
            # Before the writing, which ends with a last look at whether the input is as it was.
            digest = None if job.talk.quiet and not job.talk.json else _build_digest(job, result.annotated, outcome)
            following = "" if is_silent else _following_stage_or_empty(job.command, result.annotated)
            with part_of_work(share, 1.0, "items"):
                file_names = write_outputs(result, _output_files(job, outcome), progress.begin_step)
    outcome.written.extend(file_names.names)
    outcome.left_profile = file_names.dropped_profile
    is_imported = source is not job.source
    preview = shlex.join(("cwcli", "import", str(job.source), "--preview"))
    notes = (f"imported; how: {preview}",) if is_imported else ()
    return JobOutcome(outcome, digest, following, notes)


def _following_stage_or_empty(command: str, annotated: Log) -> str:
    """Return the stage after a stage's own command, if it finds its signals in the annotated log without an option."""
    from cwcli.pipeline.call import Selection
    from cwcli.pipeline.missing import SignalCheck

    following = SUGGESTED_STAGE_AFTER_STAGE.get(command, "")
    if not following:
        return ""
    try:
        return "" if SignalCheck(STAGES)(following, annotated, Selection()) else following
    except CwcliError:
        return ""


def _build_digest(job: Job, log: Log, outcome: RunOutcome) -> Digest:
    """Build the digest of a job from its results in memory."""
    from cwcli.digest.digest import build_digest

    stages = [result.stage for result in outcome.results]
    return build_digest(log, stages, outcome.left_out, outcome.tables_by_name(), is_run=job.skip.lenient)


def _source_or_imported_log(source: Source) -> Source | InputFile:
    """The source; a file that is no log is imported, if nothing about it is ambiguous."""
    if not isinstance(source, str) or source == "-" or "://" in source:
        return source
    from cwcli.input import InputFile, is_file
    from cwcli.logs.format.faults import is_importable_head

    if not is_file(source):
        return source
    try:
        with InputFile.open(source) as file:
            head = bytes(file[0:N_BYTES_TO_RECOGNISE_LOG])
    except CwcliError:  # whoever reads the log says it
        return source
    if not is_importable_head(head):
        return source
    from cwcli.importing.temporary_log import import_to_temporary_log

    return import_to_temporary_log(source) or source


def _console_for_job(job: Job) -> Console:
    to_stdout = job.writing.output == "-"
    if to_stdout and job.talk.json:
        raise UsageError("--json and -o - both want standard output", hint="write the log to a file")
    return Console(quiet=job.talk.quiet, summary_to_stderr=to_stdout)


def _check_output_targets(job: Job) -> None:
    """Check before the work that all outputs can be written."""
    from cwcli.metrics.table import check_table_file_name
    from cwcli.output import refuse_unwritable_targets

    if job.metrics is not None:
        check_table_file_name(job.metrics)
    job.writing.channel_choice.check_patterns_before_run(STAGES[name] for name in job.stages)
    output, parts = (None, job.writing.output) if job.writing.is_folder_of_parts else (job.writing.output, None)
    if parts == "-":
        raise UsageError("--split like-input writes several files, and -o - is one", hint="name a folder with -o")
    folders = (job.metrics_dir, parts)
    refuse_unwritable_targets((output, job.metrics), folders, force=job.writing.force, inputs=source_names(job.source))


def _output_files(job: Job, outcome: RunOutcome) -> OutputFiles:
    """The files that the job's options name."""
    from cwcli.library.writing import OutputFiles

    tables: dict[Path, Table] = {}
    if job.metrics is not None:
        own = next(result for result in outcome.results if result.stage not in job.preceding_stages)
        tables[Path(job.metrics)] = next(iter(own.tables.values()))
    writing = job.writing
    return OutputFiles(
        writing.output,
        tables,
        job.metrics_dir,
        replace=writing.replace,
        is_folder_of_parts=writing.is_folder_of_parts,
        force=writing.force,
    )


def job_document(job: Job, outcome: JobOutcome) -> dict[str, Any]:
    """Make the content of `--json`."""
    run = outcome.run
    return {
        "input": run.name,
        "output": job.writing.output,
        "written": run.written,
        "faults": run.faults,
        "left_out": dict(run.left_out),
        **({"channels_not_made": list(run.unmade)} if run.unmade else {}),
        **({} if outcome.digest is None else {"digest": asdict(outcome.digest)}),
        "stages": {result.stage: result.summary.to_json() for result in run.results},
    }


def print_outcome(job: Job, console: Console, outcome: JobOutcome, next_step: str) -> None:
    """Print the digest, behind it with `--details` the tables and notes of the stages, and notes on the output."""
    run, digest = outcome.run, outcome.digest
    if digest is not None:
        n_behind = len(outcome.notes)
        print_digest(
            console, job.command, digest, run, next_step, with_details=job.talk.details, n_lines_behind=n_behind
        )
    if job.talk.details:
        console.print_summary("")
        for doubt in () if digest is None else digest.doubts[1:]:
            console.print_note(f"doubt: {doubt.sentence} {doubt.advice}")
        _print_details(console, run)
    for reason, count in run.faults.items():
        console.print_note(f"{run.name}: {reason}: {count}")
    for note in outcome.notes:
        console.print_note(note)
    for name in run.unmade:
        console.print_note(f"--channels {name}: this run made no such channel")


def _print_details(console: Console, run: RunOutcome) -> None:
    """Print the summaries of the stages, and notes on left-out stages and on the annotated log."""
    for result in run.results:
        print_stage_summary(console, result.summary)
    for stage, reason in run.left_out.items():
        console.print_note(f"{stage} was left out: {reason}")
    if run.left_profile:
        console.print_note(
            f"the annotated log does not have the profile {run.left_profile}: it holds more than ROS messages"
        )
    print_written_files(console, run.written)
