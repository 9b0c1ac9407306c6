"""Writes the page of a run or of one annotated log (`cwcli.report`)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from cwcli.input import remember_inputs
from cwcli.lazy_dataclass import dataclass
from cwcli.library.result import Result
from cwcli.output import refuse_unwritable_targets, write_file

if TYPE_CHECKING:
    from cwcli.evaluation.system_topics import OtherSystemTopics
    from cwcli.report.overview import Report
    from cwcli.report.tiles import TileServer

PDF_SUFFIX = ".pdf"
"""Suffix of a file name that selects a PDF."""


@dataclass(frozen=True)
class PageContent:
    """What is on a page, and its form.

    Attributes:
        gates: Conditions whose outcome is shown, beside those of the run.
        system: Another system in the logs, which is judged too, or None.
        tiles: What is drawn below the maps, or None.
        recover: Read the intact parts of a single damaged log.
        is_pdf: Print a PDF, by Chromium.
    """

    gates: Sequence[str] = ()
    system: OtherSystemTopics | None = None
    tiles: TileServer | None = None
    recover: bool = False
    is_pdf: bool = False


def write_report(
    source: str | Path | Result,
    target: str | Path,
    *,
    gates: Sequence[str] = (),
    topics: Sequence[str] = (),
    recover: bool = False,
    force: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Path:
    """Write one page about a run, an annotated log or a result. Needs the extra `cwcli-drive[report]`.

    Args:
        source: Output folder of `cwcli run -d`, an annotated log, or what `Log.run` returned.
        target: The page; a PDF if the name ends in `.pdf`.
        gates: Conditions whose outcome is shown: `["ego.position_rmse_m < 0.5"]`.
        topics: Another system in the logs, as `cwcli report --topic` takes it.
        recover: Read what is intact of a damaged log.
        force: Overwrite a file that exists.
        progress: Called with a text when a step begins.

    Returns:
        The page's file.

    Raises:
        UsageError: The extra is not installed, or a gate or a topic is wrong.
        InputError: The source can't be read.
        MissingSignalError: No stage of cwcli has run on the log.
        OutputError: The file exists, or can't be written.
    """
    from cwcli.evaluation.system_topics import parse_other_system_options

    system = parse_other_system_options(topics) if topics else None
    name = f"./{target}" if str(target) == "-" else str(target)
    content = PageContent(gates, system, recover=recover, is_pdf=Path(name).suffix.lower() == PDF_SUFFIX)
    with remember_inputs():
        if not isinstance(source, Result):
            write_report_page_and_get_size(str(source), name, content, force=force, progress=progress)
            return Path(target)
        refuse_unwritable_targets([name], force=force)
        with TemporaryDirectory(prefix="cwcli-") as folder:
            [annotated] = source.save(Path(folder) / (Path(source.name).name or "log.mcap"), replace=True)
            write_report_page_and_get_size(str(annotated), name, content, force=force, progress=progress)
    return Path(target)


def write_report_page_and_get_size(
    source: str, target: str, content: PageContent, *, force: bool, progress: Callable[[str], None] | None = None
) -> tuple[Report, int]:
    """Build the page and write it; `cwcli.report` and the command come here.

    Returns:
        The report, and the size of the written file in bytes.

    Raises:
        CwcliError: As `write_report` does.
    """
    from cwcli.array_memory import bounded_array_memory
    from cwcli.report.build import build_report
    from cwcli.report.pdf import find_browser, print_html_to_pdf

    say = progress or (lambda text: None)
    browser = find_browser() if content.is_pdf else None
    refuse_unwritable_targets([target], force=force, inputs=[source])
    with bounded_array_memory():
        report = build_report(
            source,
            gates=content.gates,
            system=content.system,
            tiles=content.tiles,
            recover=content.recover,
            progress=lambda name: say(f"report {name}"),
        )
        if browser is not None:
            say("printing")
        page = report.html if browser is None else print_html_to_pdf(report.html, browser)
        write_file(target, page, force=force)
    return report, len(page)
