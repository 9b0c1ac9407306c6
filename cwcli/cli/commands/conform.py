"""`cwcli conform`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from cwcli.cli.console import Console, replace_stdout_path_by_dash
from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.runs import MarkdownOption
from cwcli.cli.options.shared import ForceOption
from cwcli.cli.progress import Progress
from cwcli.cli.report import print_written_files
from cwcli.cli.tables import format_table
from cwcli.cli.targets import check_outputs_and_list_file_names
from cwcli.cli.text import escape_control_characters, wrap_paragraph
from cwcli.errors import EXIT_DONE, EXIT_GATE_FAILED, UsageError
from cwcli.lazy_dataclass import dataclass

if TYPE_CHECKING:
    from cwcli.conformance.results import ClauseResult

EXAMPLES = (
    "cwcli conform --list",
    "cwcli conform nhtsa-fcw",
    "cwcli conform un-r152 --policy full --seeds 20 --junit r152.xml",
    "cwcli conform all --seeds 10 --cache conform-cache",
    "cwcli conform nhtsa-fcw --log drive.mcap",
    "cwcli conform nhtsa-fcw --log drive.mcap --system /adas/fcw:data==true",
)
"""Command lines at the end of the command's `--help`."""
ALL_CLAUSES_NAME = "all"
"""Name that stands for every clause."""


def _complete_clauses(incomplete: str) -> list[str]:
    from cwcli.conformance.clause import clause_names

    return [name for name in (*clause_names(), ALL_CLAUSES_NAME) if name.startswith(incomplete)]


@dataclass(frozen=True)
class TrialOptions:
    """How trials are simulated and judged."""

    seeds: Annotated[
        int | None,
        typer.Option(
            "--seeds",
            metavar="N",
            show_default="as many as the clause says",
            help="Repetitions of each trial; the share of them that must pass stays that of the clause.",
        ),
    ] = None
    jobs: Annotated[
        int | None,
        typer.Option(
            "--jobs",
            metavar="N",
            show_default="all processors",
            help="Number of processes; results don't depend on it.",
        ),
    ] = None
    rule: Annotated[
        str, typer.Option("--rule", metavar="NAME", help="The warning rule that is judged, as in `cwcli warn`.")
    ] = "cwcli"
    horizon: Annotated[
        float | None,
        typer.Option(
            "--horizon",
            metavar="SECONDS",
            show_default="2.5",
            help="How far the predicted paths and the rule look ahead.",
        ),
    ] = None
    policy: Annotated[
        str | None,
        typer.Option(
            "--policy",
            metavar="NAME",
            show_default="the clause's own",
            help="How the car brakes once it is warned: none, full, driver (1.5 s later), fuzzy.",
        ),
    ] = None
    grade: Annotated[
        str | None,
        typer.Option(
            "--grade",
            metavar="NAME",
            show_default="the clause's own",
            help="Noise of the simulated sensors and messages: nominal, fine, j2945.",
        ),
    ] = None
    cache: Annotated[
        str | None,
        typer.Option(
            "--cache",
            metavar="FOLDER",
            show_default=False,
            help="Store finished repetitions in this folder; a later run computes only new ones.",
        ),
    ] = None


@dataclass(frozen=True)
class LogOptions:
    """A recorded trial instead of simulated ones."""

    log: Annotated[str | None, typer.Option("--log", metavar="LOG", help="Judge a recorded trial in this log.")] = None
    system: Annotated[
        str | None,
        typer.Option(
            "--system",
            metavar="/TOPIC:FIELD==VALUE",
            show_default="the warnings of cwcli",
            help="With --log: judge the warnings of another system, as `cwcli evaluate --topic warning=` reads them.",
        ),
    ] = None
    lead: Annotated[
        str | None,
        typer.Option(
            "--lead",
            metavar="ID",
            show_default="the only one",
            help="With --log: the other vehicle of the trial, where several could be it.",
        ),
    ] = None
    start: Annotated[
        float | None, typer.Option("--start", metavar="SECONDS", help="With --log: the trial begins here.")
    ] = None
    end: Annotated[float | None, typer.Option("--end", metavar="SECONDS", help="With --log: the trial ends here.")] = (
        None
    )


@dataclass(frozen=True)
class ResultOptions:
    """What is shown and written."""

    show_list: Annotated[bool, typer.Option("--list", help="List the clauses and stop.")] = False
    details: Annotated[
        bool, typer.Option("--details", help="Show every repetition, and every number with its source.")
    ] = False
    junit: Annotated[
        str | None, typer.Option("--junit", metavar="FILE", help="Write the trials as JUnit XML here.")
    ] = None
    markdown_file: MarkdownOption = None
    html: Annotated[
        str | None,
        typer.Option(
            "--html", metavar="FILE", help="Write a page with the margins as a picture here, without network."
        ),
    ] = None
    force: ForceOption = False


def command(
    talk: TalkOptions,
    trials: TrialOptions,
    recorded: LogOptions,
    output: ResultOptions,
    clauses: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="NAME",
            autocompletion=_complete_clauses,
            help="Clauses by name (--list), a file with a clause of your own, or all.",
        ),
    ] = None,
) -> int:
    """Judge warnings by the trials of public standards, with their numbers as published.

    Every trial is simulated as a scenario with noisy sensors; cwcli's stages warn as they would online, and the
    warnings are judged. With --log a recorded trial is found in the log, checked against the clause's tolerances, and
    judged; a trial outside its tolerances is not valid. This is no certification. The exit code is 1 if a clause fails,
    or if no trial of the log is valid.
    """
    console = Console(quiet=talk.quiet, summary_to_stderr=replace_stdout_path_by_dash(output.markdown_file) == "-")
    if output.show_list:
        return _list_clauses(console, as_json=talk.json)
    if not clauses:
        raise UsageError("conform needs the name of a clause", hint="cwcli conform --list")
    markdown_file = replace_stdout_path_by_dash(output.markdown_file)
    inputs = [recorded.log] if recorded.log else []
    targets = check_outputs_and_list_file_names(
        inputs, talk, metrics=None, texts=(output.junit, markdown_file, output.html), force=output.force
    )
    with Progress(quiet=talk.quiet) as progress:
        results = _run_or_read_trials(clauses, trials, recorded, progress)
    _write_result_files(results, output, markdown_file)
    if talk.json:
        document = {"written": targets, "clauses": [result.to_json() for result in results]}
        console.print_document("conform", document)
    else:
        _print_results(console, results, details=output.details)
        print_written_files(console, targets)
    failed = [result for result in results if result.outcome not in ("pass", "not judged")]
    if failed:
        if talk.quiet:
            names = ", ".join(result.clause.name for result in failed)
            console.print_failure(f"clauses that do not pass: {names}")
        return EXIT_GATE_FAILED
    return EXIT_DONE


def _run_or_read_trials(
    clauses: list[str], trials: TrialOptions, recorded: LogOptions, progress: Progress
) -> list[ClauseResult]:
    """Run or read the trials.

    Raises:
        CwcliError: A clause does not exist or is wrong, or the log holds no such trial.
    """
    from cwcli.conformance.cache import RepetitionCache
    from cwcli.conformance.clause import clause_names
    from cwcli.conformance.run import ConformConfig, run_clauses
    from cwcli.process_pool import count_available_processors

    names = list(
        dict.fromkeys(each for name in clauses for each in (clause_names() if name == ALL_CLAUSES_NAME else (name,)))
    )
    jobs = count_available_processors() if trials.jobs is None else trials.jobs
    config = ConformConfig(trials.seeds, jobs, trials.rule, trials.horizon, trials.policy, trials.grade)
    if recorded.log is None:
        for option, value in (
            ("--system", recorded.system),
            ("--lead", recorded.lead),
            ("--start", recorded.start),
            ("--end", recorded.end),
        ):
            if value is not None:
                raise UsageError(f"{option} is for a recorded trial", hint="name the log with --log")
        progress.begin_step(f"driving the trials of {', '.join(names)}")

        def show_progress(text: str, n_done: int, n_trials: int) -> None:
            progress.begin_step(text)
            progress(n_done, n_trials)

        return run_clauses(names, config, show_progress, RepetitionCache(trials.cache) if trials.cache else None)
    from cwcli.conformance.recorded import LogTrial, judge_log_by_clauses

    if trials.seeds is not None or trials.grade is not None or trials.cache is not None:
        raise UsageError("--seeds, --grade and --cache are for simulated trials", hint="leave them out with --log")
    progress.begin_step(f"reading {recorded.log}")
    place = LogTrial(recorded.log, recorded.system, recorded.lead, recorded.start, recorded.end)
    return judge_log_by_clauses(names, place, config)


def _list_clauses(console: Console, *, as_json: bool) -> int:
    """Print the clauses with their titles."""
    from cwcli.conformance.clause import clause_names, load_clause

    known = [load_clause(name) for name in clause_names()]
    if as_json:
        rows = [{"name": each.name, "title": each.title, "trials": len(each.trials)} for each in known]
        console.print_document("conform", {"clauses": rows})
        return EXIT_DONE
    console.print_summary(
        format_table(
            ("name of the clause", "number of trials", "standard and subject"),
            [(c.name, len(c.trials), c.title) for c in known],
        )
    )
    return EXIT_DONE


def _print_results(console: Console, results: list[ClauseResult], *, details: bool) -> None:
    """Print the digest, and the tables behind it."""
    from cwcli.conformance.digest import format_digest
    from cwcli.conformance.page import detail_tables

    first, *rest = format_digest(results)
    console.print_heading(first)
    for line in rest:
        console.print_summary(escape_control_characters(line))
    if not details:
        return
    for result in results:
        console.print_summary("")
        clause = result.clause
        console.print_summary(wrap_paragraph(escape_control_characters(f"{clause.title}. Source: {clause.source}.")))
        if clause.reading:
            console.print_summary(wrap_paragraph(escape_control_characters(clause.reading)))
        for table in detail_tables(result):
            console.print_summary("")
            console.print_heading(table.title)
            console.print_summary(format_table(table.columns, table.rows))


def _write_result_files(results: list[ClauseResult], output: ResultOptions, markdown_file: str | None) -> None:
    """Write all files or none."""
    from cwcli.conformance.html_page import format_html_page
    from cwcli.conformance.page import format_junit, format_markdown
    from cwcli.output import AtomicGroup, write_file

    with AtomicGroup() as together:
        if output.junit is not None:
            write_file(output.junit, format_junit(results), force=output.force, together=together)
        if markdown_file is not None:
            write_file(markdown_file, format_markdown(results).encode(), force=output.force, together=together)
        if output.html is not None:
            write_file(output.html, format_html_page(results).encode(), force=output.force, together=together)
