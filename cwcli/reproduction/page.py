"""Formats a reproduction as a page in Markdown: every figure and table next to ours, nothing written by hand."""

from __future__ import annotations

from collections.abc import Sequence

from cwcli.pipeline.result import Cell, Section
from cwcli.reproduction.classes import Finding
from cwcli.reproduction.expectations import Figure
from cwcli.reproduction.findings_report import COLUMNS, Reproduction, counts, row_cells

PICTURES = "figures"
"""Name of the folder of pictures next to the page."""


def picture_folder(paper: str) -> str:
    """Return the path of a page's pictures, relative to the page."""
    return f"{PICTURES}/{paper}"


def page(made: Reproduction) -> str:
    """Format a whole reproduction as a page in Markdown."""
    expected = made.expectations
    ours = {section.key: section for section in made.summary.sections}
    parts = [
        f"# {expected.paper}: the paper beside ours",
        f"\n{expected.source}.\n",
        f"Made by `cwcli reproduce {expected.paper} --report DIR`: nothing on this page is written by hand. What it",
        "says of the paper, and the reasons, come from its `expectations.toml`, numbers and classes from the run.\n",
        *(f"- {note}" for note in made.summary.notes),
        *(f"- see also [{name}]({name})" for name in expected.notes),
        "\n## Classes\n",
        _table(counts(made.findings)),
        "\n## Figures and tables",
    ]
    for name, figure in expected.figures.items():
        findings = [finding for finding in made.findings if finding.expected.figure == name]
        parts += _figure(name, figure, findings, made)
    for key in ("fits", "reasons"):
        if ours[key].rows:
            parts += [f"\n## {ours[key].title}\n", _table(ours[key])]
    shown = {"fits", "reasons", "classes", *(name.replace(" ", "_") for name in expected.figures)}
    for section in made.summary.sections:
        if section.key not in shown:
            parts += [f"\n## {section.title}\n", _table(section)]
    return "\n".join(parts) + "\n"


def _figure(name: str, figure: Figure, findings: Sequence[Finding], made: Reproduction) -> list[str]:
    """Format the part of one figure."""
    lines = [f"\n### {name}\n", f"In the paper: {figure.prints}." if not figure.is_beyond else f"{figure.prints}."]
    if figure.why_none:
        lines.append(f"Ours: none, {figure.why_none}.")
    if findings:
        rows = tuple(row_cells(finding) for finding in findings)
        lines += ["", _table(Section(name, name, COLUMNS, rows))]
    elif figure.rows:
        lines.append("Ours: not in this run.")
    drawn = {plot.figure: plot.title for plot in made.plots}
    folder = picture_folder(made.expectations.paper)
    lines += [
        f"\n![ours, {picture}: {drawn[picture]}]({folder}/{picture.replace(' ', '-')}.png)"
        for picture in figure.pictures
        if picture in drawn
    ]
    return lines


def _table(section: Section) -> str:
    """Format a section's table."""
    lines = [_row(section.columns), _row(["---"] * len(section.columns))]
    lines += [_row([_text(cell) for cell in row]) for row in section.rows]
    return "\n".join(lines)


def _row(cells: Sequence[str]) -> str:
    """Format one row of a table."""
    return f"| {' | '.join(cells)} |"


def _text(cell: Cell) -> str:
    """Format one cell."""
    if cell is None:
        return ""
    text = f"{cell:.4g}" if isinstance(cell, float) else str(cell)
    return text.replace("|", "\\|").replace("<", "&lt;")
