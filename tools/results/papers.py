"""The pages of the papers from their result files: no study runs to write docs/papers/NAME.md."""

from __future__ import annotations

import math
from typing import Any

from cwcli.pipeline.result import SummaryTable
from cwcli.reproduction.classes import MeasuredNumber
from cwcli.reproduction.findings import Plot, StudyPart
from cwcli.reproduction.findings_report import Reproduction, assemble_reproduction
from cwcli.reproduction.page import format_markdown_page, sections_at_page_end
from tools.results.result_file import ResultFile

KEY_SEPARATOR = "/"
"""Between figure and name in the keys of a paper's result file."""


def values_of_reproduction(made: Reproduction) -> dict[str, MeasuredNumber]:
    """Return the numbers of a reproduction by `FIGURE/WHAT`."""
    return {
        f"{finding.measured.figure}{KEY_SEPARATOR}{finding.measured.what}": finding.measured
        for finding in made.findings
    }


def more_of_reproduction(made: Reproduction, note: str) -> dict[str, Any]:
    """Return what the page of a reproduction needs besides its numbers: tables, titles of pictures, notes."""
    sections = [
        {"key": each.key, "title": each.title, "columns": list(each.columns), "rows": [list(row) for row in each.rows]}
        for each in sections_at_page_end(made)
    ]
    return {"note": note, "plots": {plot.figure: plot.title for plot in made.plots}, "sections": sections}


def reproduction_from_file(result: ResultFile) -> Reproduction:
    """Return the reproduction of a result file, with plots that have titles only."""
    numbers = []
    for key, value in result.values.items():
        figure, what = key.split(KEY_SEPARATOR, 1)
        ours, low, high = (math.nan if end is None else end for end in (value.value, value.low, value.high))
        numbers.append(MeasuredNumber(figure, what, ours, low, high, text=value.text))
    plots = tuple(Plot(figure, title, "", "", ()) for figure, title in result.more["plots"].items())
    sections = [
        SummaryTable(each["key"], each["title"], tuple(each["columns"]), tuple(tuple(row) for row in each["rows"]))
        for each in result.more["sections"]
    ]
    notes = [f"measured on {result.date} with version {result.version}"]
    return assemble_reproduction(
        result.name, [StudyPart(tuple(numbers), plots)], result.more["note"], sections=sections, notes=notes
    )


def page_from_file(result: ResultFile) -> str:
    """Return the page of a paper from its result file."""
    return format_markdown_page(reproduction_from_file(result))
