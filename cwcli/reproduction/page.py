"""Formats a reproduction as a page in Markdown: every figure and table next to ours, nothing written by hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from cwcli.pipeline.result import SummaryTable
from cwcli.reproduction.classes import NOT_IN_PAPER, Finding
from cwcli.reproduction.expectations import PaperFigure
from cwcli.reproduction.findings_report import (
    FINDING_COLUMNS,
    PROCESSOR_TIMES_SECTION_KEY,
    Reproduction,
    class_counts_table,
    finding_cells,
    findings_of_papers_own_method,
)

PICTURE_FOLDER_NAME = "figures"
"""Name of the folder of pictures next to the page."""
KEYS_OF_SECTIONS_WHOSE_NUMBERS_ARE_ALL_IN_FINDINGS = frozenset({"looks", "settings"})
"""Keys of sections whose numbers are all among the findings of the figure `where`."""
FINDINGS_GRID_CELLS_NOTE = "behind a number its bound and key, if any"
"""Sentence part above a grid of findings that says what its cells hold."""
COLUMNS_LEFT_OUT_WHERE_ALL_ROWS_ARE_EMPTY = frozenset({"paper", "tolerance", "why"})
"""Columns of findings that a table leaves out where no row has anything in them."""
COLUMNS_SHOWN_ONCE_ABOVE_TABLE_WHERE_ALL_ROWS_AGREE = frozenset({"tolerance", "class", "why"})
"""Columns of findings that stand once above a table where all rows have the same."""


def picture_folder_path(paper: str) -> str:
    """Return the path of a page's pictures, relative to the page."""
    return f"{PICTURE_FOLDER_NAME}/{paper}"


def format_markdown_page(reproduction: Reproduction) -> str:
    """Format a whole reproduction as a page in Markdown."""
    expected = reproduction.expectations
    ours = {section.key: section for section in reproduction.summary.sections}
    parts = [
        f"# {expected.paper}: the paper beside ours",
        f"\n{expected.source}.\n",
        f"Made by `cwcli reproduce {expected.paper} --report DIR`: the words from `expectations.toml`, the numbers and",
        "classes from the run. A cell that all rows of a table share stands once, above it.\n",
        *(f"- {note}" for note in reproduction.summary.notes),
        *(f"- see also [{name}]({name})" for name in expected.notes),
        "\n## Classes\n",
        _classes_that_occur(class_counts_table(reproduction.findings)).to_markdown(),
        "\n## Figures and tables",
    ]
    for name, figure in expected.figures.items():
        findings = findings_of_papers_own_method(reproduction.findings, name)
        parts += _format_figure(name, figure, findings, reproduction)
    parts += _format_groups(reproduction)
    for key in ("fits", "assumptions", "reasons"):
        if ours[key].rows:
            parts += [f"\n## {ours[key].title}\n", ours[key].to_markdown()]
    for section in sections_at_page_end(reproduction):
        parts += [f"\n## {section.title}\n", section.to_markdown()]
    return "\n".join(parts) + "\n"


def _format_groups(reproduction: Reproduction) -> list[str]:
    """Format the groups that are counted apart; what the paper has no number for is in `cwcli reproduce` alone."""
    parts = []
    for section in reproduction.summary.sections:
        if not section.key.startswith("group_"):
            continue
        at = section.columns.index("class")
        rows = tuple(row for row in section.rows if row[at] != NOT_IN_PAPER)
        if rows:
            parts += [f"\n## {section.title}", *_format_findings(replace(section, rows=rows))]
    return parts


def _cell_shared_by_all_rows(table: SummaryTable, at: int) -> str:
    """Return the cell that all rows have in a column, "" if they differ."""
    cells = {str(row[at]) for row in table.rows}
    return cells.pop() if len(cells) == 1 else ""


def _format_grids(table: SummaryTable) -> list[str]:
    """Format findings of one class as tables with one row for each figure and case, and one column a quantity.

    A case is what stands before the first colon. Cases with the same quantities share a table; a cell has our
    number, its tolerance and its keys.
    """
    shared_class, shared_keys = (
        _cell_shared_by_all_rows(table, table.columns.index(column)) for column in ("class", "why")
    )
    cells: dict[tuple[str, str], dict[str, str]] = {}
    for row in table.rows:
        finding = {"figure": "", **dict(zip(table.columns, map(str, row), strict=True))}
        case, _, quantity = finding["what"].partition(": ")
        keys = "" if shared_keys else finding["why"]
        shown = "; ".join(text for text in (finding["ours"], finding["tolerance"], keys) if text)
        cells.setdefault((finding["figure"], case), {})[quantity] = shown
    rows_by_quantities: dict[tuple[str, ...], list[tuple[str, ...]]] = {}
    for heads, each in cells.items():
        rows_by_quantities.setdefault(tuple(each), []).append((*heads, *each.values()))
    why = f"; why: {shared_keys}" if shared_keys else ""
    parts = ["", f"All rows: class: {shared_class}{why}; {FINDINGS_GRID_CELLS_NOTE}."]
    for quantities, rows in rows_by_quantities.items():
        columns = ("figure", "case", *quantities)
        used = [at for at in range(len(columns)) if at or "figure" in table.columns]
        shown_rows = tuple(tuple(row[at] for at in used) for row in rows)
        parts += ["", replace(table, columns=tuple(columns[at] for at in used), rows=shown_rows).to_markdown()]
    return parts


def _classes_that_occur(counts: SummaryTable) -> SummaryTable:
    """Return the table of classes without those that no number has."""
    return replace(counts, rows=tuple(row for row in counts.rows if any(row[1:4])))


def _format_findings(table: SummaryTable) -> list[str]:
    """Format a table of findings; empty columns are left out, and a shared class or key stands above the table."""
    of_paper, of_class = (table.columns.index(column) for column in ("paper", "class"))
    if (
        len(table.rows) > 1
        and {row[of_paper] for row in table.rows} == {"-"}
        and _cell_shared_by_all_rows(table, of_class)
    ):
        return _format_grids(table)
    shared, particular = [], []
    for at, column in enumerate(table.columns):
        cells = {row[at] for row in table.rows}
        if column in COLUMNS_LEFT_OUT_WHERE_ALL_ROWS_ARE_EMPTY and cells <= {"", "-"}:
            continue
        if column in COLUMNS_SHOWN_ONCE_ABOVE_TABLE_WHERE_ALL_ROWS_AGREE and len(cells) == 1 < len(table.rows):
            shared.append(f"{column}: {cells.pop()}")
        else:
            particular.append(at)
    rows = tuple(tuple(row[at] for at in particular) for row in table.rows)
    short = replace(table, columns=tuple(table.columns[at] for at in particular), rows=rows)
    return [*(["", f"All rows: {'; '.join(shared)}."] if shared else []), "", short.to_markdown()]


def sections_at_page_end(reproduction: Reproduction) -> list[SummaryTable]:
    """Return the tables at the end of the page: what a study adds to its findings, without this machine's times."""
    figures = {name.replace(" ", "_") for name in reproduction.expectations.figures}
    elsewhere = {
        "fits",
        "assumptions",
        "reasons",
        "classes",
        PROCESSOR_TIMES_SECTION_KEY,
        *figures,
        *KEYS_OF_SECTIONS_WHOSE_NUMBERS_ARE_ALL_IN_FINDINGS,
    }
    return [
        section
        for section in reproduction.summary.sections
        if section.key not in elsewhere and not section.key.startswith("group_")
    ]


def _format_figure(
    name: str, figure: PaperFigure, findings: Sequence[Finding], reproduction: Reproduction
) -> list[str]:
    """Format the part of one figure."""
    lines = [
        f"\n### {name}\n",
        f"In the paper: {figure.description}." if not figure.is_beyond_paper else f"{figure.description}.",
    ]
    if figure.reason_for_absence:
        lines.append(f"Ours: none, {figure.reason_for_absence}.")
    if findings:
        rows = tuple(finding_cells(finding) for finding in findings)
        lines += _format_findings(SummaryTable(name, name, FINDING_COLUMNS, rows))
    elif any(row.group == "" for row in figure.expectation_by_number.values()):
        lines.append("Ours: not in this run.")
    drawn = {plot.figure: plot.title for plot in reproduction.plots}
    folder = picture_folder_path(reproduction.expectations.paper)
    lines += [
        f"\n![ours, {picture}: {drawn[picture]}]({folder}/{picture.replace(' ', '-')}.png)"
        for picture in figure.plot_names
        if picture in drawn
    ]
    return lines
