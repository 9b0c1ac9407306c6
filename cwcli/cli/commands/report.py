"""`cwcli report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cwcli.cli.console import Console, replace_stdout_path_by_dash
from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.runs import GatesOption, SystemOption
from cwcli.cli.options.shared import ForceOption
from cwcli.cli.progress import Progress
from cwcli.cli.report import print_written_files
from cwcli.cli.targets import check_file_suffix
from cwcli.cli.text import format_count
from cwcli.lazy_dataclass import dataclass
from cwcli.work_share import report_work_share_to

EXAMPLES = (
    "cwcli report out/ -o report.html",
    "cwcli report drive.mcap -o report.html --gate 'ego.position_rmse_m < 0.5'",
    "cwcli report annotated.mcap -o report.pdf --pdf",
    'cwcli report a.mcap -o r.html --tiles "$SERVER" --tiles-attribution "$OWNER"',
    "cwcli report annotated.mcap -o r.html --topic warning=/adas/fcw:data==true",
)
"""Command lines at the end of the command's `--help`."""
PDF_SUFFIX = ".pdf"
"""Suffix of a file name that selects a PDF."""
PAGE_SUFFIXES = (".html", ".htm", PDF_SUFFIX)
"""Suffixes that the page's file may have."""

SourceArgument = Annotated[
    str,
    typer.Argument(
        metavar="SOURCE", help="Output folder of `cwcli run -d`, one annotated log, or a URL; - is standard input."
    ),
]
PageOption = Annotated[
    str, typer.Option("--output", "-o", metavar="FILE", help="Write the page here; - is standard output.")
]
TilesOption = Annotated[
    str | None,
    typer.Option(
        "--tiles",
        metavar="URL",
        help="Address of map tiles to draw below the tracks, with {z}, {x} and {y}. Without it the page requests "
        "nothing.",
    ),
]
AttributionOption = Annotated[
    str | None, typer.Option("--tiles-attribution", metavar="TEXT", help="Attribution of the map tiles.")
]
PdfOption = Annotated[bool, typer.Option("--pdf", help="Print a PDF instead, by Chromium; -o x.pdf does it, too.")]
RecoverOption = Annotated[bool, typer.Option("--recover", help="Read the intact parts of a single damaged log.")]


@dataclass(frozen=True)
class ContentOptions:
    """What is on the page, and its form."""

    topics: SystemOption = None
    gates: GatesOption = None
    tiles: TilesOption = None
    tiles_attribution: AttributionOption = None
    pdf: PdfOption = False


def command(
    source: SourceArgument,
    output: PageOption,
    talk: TalkOptions,
    content: ContentOptions,
    recover: RecoverOption = False,
    force: ForceOption = False,
) -> None:
    """Make one HTML page of a run, or of one annotated log.

    The page needs no network (except with --tiles). It shows what happened, the map, the warnings with the predicted
    paths, the signals with their 1-sigma bands, camera frames with lanes, and how many messages were used. It stays
    under 6 MB: of many logs, failed ones and those with warnings come first, and the page says what is left out. A
    failed gate is shown but does not change the exit code; `cwcli evaluate` does that. Needs the extra
    `cwcli-drive[report]`.
    """
    from cwcli.evaluation.system_topics import parse_other_system_options
    from cwcli.library.pages import PageContent, write_report_page_and_get_size
    from cwcli.output import refuse_unwritable_targets
    from cwcli.report.tiles import parse_tile_server

    target = str(replace_stdout_path_by_dash(output))
    pdf = content.pdf or (target != "-" and Path(target).suffix.lower() == PDF_SUFFIX)
    suffixes, what = ([PDF_SUFFIX], "a PDF") if pdf else (PAGE_SUFFIXES, "a page")
    page_content = PageContent(
        content.gates or (),
        parse_other_system_options(content.topics) if content.topics else None,
        parse_tile_server(content.tiles, content.tiles_attribution),
        recover=recover,
        is_pdf=pdf,
    )
    refuse_unwritable_targets([target], force=force, inputs=[source])
    check_file_suffix(target, suffixes, what=what, required=False)
    console = Console(quiet=talk.quiet, summary_to_stderr=target == "-")
    with Progress(quiet=talk.quiet) as progress, report_work_share_to(progress.show_share):
        report, n_bytes = write_report_page_and_get_size(
            source, target, page_content, force=force, progress=progress.begin_step
        )
    document = {
        "written": target,
        "bytes": n_bytes,
        "logs": report.n_logs,
        "with_figures": report.n_detailed,
        "failed": report.n_failed,
        "left_out": list(report.left_out),
    }
    if talk.json and target != "-":
        console.print_document("report", document)
        return
    console.print_summary(
        f"{format_count(report.n_logs, 'log')}, {report.n_detailed} with figures, {report.n_failed} failed"
    )
    if report.left_out:
        console.print_note(f"{format_count(len(report.left_out), 'log')} only in the table, to keep the page small")
    if target != "-":
        print_written_files(console, [target])
