"""Builds the table and the summary of a reproduction's findings; every sentence follows from the numbers."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from cwcli.metrics.table import ColumnDoc, Table
from cwcli.pipeline.result import Cell, Section, Summary
from cwcli.reproduction.classes import BINDING, CLASSES, Expectation, Finding
from cwcli.reproduction.expectations import Expectations, load_expectations
from cwcli.reproduction.findings import Part, Plot

COLUMNS = ("what", "paper", "ours", "tolerance", "class", "why")
"""Headings of the table of findings."""


@dataclass(frozen=True)
class Reproduction:
    """The result of reproducing a paper.

    Attributes:
        expectations: Of the paper.
        findings: One line each.
        plots: The redrawn figures.
        table: The findings as columns.
        summary: For people and `--json`.
    """

    expectations: Expectations
    findings: tuple[Finding, ...]
    plots: tuple[Plot, ...]
    table: Table
    summary: Summary

    @property
    def failed(self) -> tuple[Finding, ...]:
        """The findings that do not reach what is claimed of them."""
        return tuple(finding for finding in self.findings if finding.has_failed)


def reproduction(
    paper: str,
    parts: Sequence[Part],
    note: str,
    *,
    sections: Sequence[Section] = (),
    notes: Sequence[str] = (),
    only: Collection[str] = (),
) -> Reproduction:
    """Assemble the parts of a reproduction, in the order of the expectations.

    Args:
        paper: Key of the paper.
        parts: Their numbers and plots.
        note: On what the numbers rest ("100 seeds").
        sections: Further tables for the summary, after those of the findings.
        notes: Further notes.
        only: Figures that are wanted; none: all.
    """
    expected = load_expectations(paper)
    names = [name for name in expected.figures if not only or name in only]
    findings = tuple(
        Finding(expected.row(each.figure, each.what), each)
        for name in names
        for part in parts
        for each in part.measured
        if each.figure == name
    )
    pictures = [picture for name in names for picture in expected.figures[name].pictures]
    plots = [plot for part in parts for plot in part.plots if plot.figure in pictures]
    plots.sort(key=lambda plot: pictures.index(plot.figure))
    summary = Summary(
        f"reproduce {paper}",
        (
            *(_section(expected, name, [f for f in findings if f.expected.figure == name]) for name in names),
            *sections,
            *_keys(expected, findings),
            counts(findings),
        ),
        (),
        (note, *notes, *claims(findings), exit_note(findings)),
    )
    return Reproduction(expected, findings, tuple(plots), findings_table(paper, expected, findings), summary)


def exit_note(findings: Sequence[Finding]) -> str:
    """Return the sentence that says which exit code follows, and why."""
    n_binding = sum(finding.expected.claim in BINDING or finding.expected.is_bounded for finding in findings)
    failed = [
        f"{f.expected.figure}, {f.expected.what}: {f.reached} instead of {f.expected.claim}"
        for f in findings
        if f.has_failed
    ]
    if failed:
        return f"exit code 1: {len(failed)} of {n_binding} claims are not met: {'; '.join(failed)}"
    return f"exit code 0: all {n_binding} claims are met"


def claims(findings: Sequence[Finding]) -> tuple[str, ...]:
    """Return a note for each number whose class differs from the claimed one without being a failure."""
    return tuple(
        f"{f.expected.figure}, {f.expected.what}: {f.reached}, and {f.expected.claim} was expected"
        for f in findings
        if f.is_stale
    )


def counts(findings: Sequence[Finding]) -> Section:
    """Count the findings of each class."""
    found = Counter(finding.reached for finding in findings)
    rows: tuple[tuple[Cell, ...], ...] = tuple((name, found[name], meaning) for name, meaning in CLASSES.items())
    return Section("classes", "How many numbers are of each class", ("class", "numbers", "meaning"), rows)


def findings_table(name: str, expected: Expectations, findings: Sequence[Finding]) -> Table:
    """Build the table of findings as columns, one row a finding."""
    rows = [(f.expected, f.measured) for f in findings]
    printed = [row.paper or (math.nan, math.nan) for row, _ in rows]
    return Table(
        name,
        {
            "figure": [row.figure for row, _ in rows],
            "what": [row.what for row, _ in rows],
            "unit": [row.unit for row, _ in rows],
            "paper": np.array([low for low, _ in printed], dtype=np.float64),
            "paper_to": np.array([high for _, high in printed], dtype=np.float64),
            "says": [row.says for row, _ in rows],
            "ours": np.array([measured.ours for _, measured in rows], dtype=np.float64),
            "low": np.array([measured.low for _, measured in rows], dtype=np.float64),
            "high": np.array([measured.high for _, measured in rows], dtype=np.float64),
            "tolerance": np.array([row.tolerance for row, _ in rows], dtype=np.float64),
            "class": [f.reached for f in findings],
            "claim": [row.claim for row, _ in rows],
            "has_failed": np.array([f.has_failed for f in findings], dtype=np.bool_),
            "fitted": [_fit_text(expected, row) for row, _ in rows],
            "why": [expected.reasons.get(row.why, "") for row, _ in rows],
        },
        docs={
            "paper": ColumnDoc(doc="the paper's number, or the least of a range; NaN where it prints none"),
            "paper_to": ColumnDoc(doc="the largest of a range"),
            "says": ColumnDoc(doc="what the paper says where it prints no number"),
            "low": ColumnDoc(doc="95 % interval over the seeds"),
            "high": ColumnDoc(doc="95 % interval over the seeds"),
            "fitted": ColumnDoc(doc="which inputs were chosen so that it holds"),
        },
    )


def row_cells(finding: Finding) -> tuple[Cell, ...]:
    """Return a finding's cells under the headings of `COLUMNS`."""
    row, measured = finding.expected, finding.measured
    printed = row.says
    if row.paper is not None:
        low, high = row.paper
        printed = f"{low:g}" if low == high else f"{low:g} to {high:g}"
    ours = "-" if math.isnan(measured.ours) else f"{measured.ours:.4g}"
    if not math.isnan(measured.low):
        ours += f" ({measured.low:.4g} to {measured.high:.4g})"
    keys = ", ".join(key for key in (row.fit, row.why) if key)
    reached = finding.reached + (f" (claimed: {row.claim})" if finding.has_failed else "")
    what = f"{row.what} [{row.unit}]" if row.unit else row.what
    return (what, printed or "-", ours, tolerance_text(row), reached, keys)


def tolerance_text(row: Expectation) -> str:
    """Format the tolerance around the paper's number, or our own bound."""
    texts = [f"+-{row.tolerance:g}"] if row.paper is not None and row.is_comparable else []
    texts += [f"at least {row.at_least:g}"] if math.isfinite(row.at_least) else []
    texts += [f"at most {row.at_most:g}"] if math.isfinite(row.at_most) else []
    return ", ".join(texts)


def _section(expected: Expectations, name: str, findings: Sequence[Finding]) -> Section:
    """Build the section of one figure."""
    figure = expected.figures[name]
    key = name.replace(" ", "_")
    if not findings:
        text = figure.why_none or f"a picture: {', '.join(figure.pictures)}"
        return Section(key, name, ("in the paper", "ours"), ((figure.prints, text),))
    return Section(key, f"{name}: {figure.prints}", COLUMNS, tuple(row_cells(finding) for finding in findings))


def _keys(expected: Expectations, findings: Sequence[Finding]) -> tuple[Section, ...]:
    """Build the sections that explain the keys of the column "why"."""
    rows = [finding.expected for finding in findings]
    fits = {row.fit for row in rows}
    whys = {row.why for row in rows}
    return (
        Section(
            "fits",
            "Inputs that were chosen so that something holds",
            ("key", "what was chosen", "how wide the choice is"),
            tuple((key, fit.what, fit.width) for key, fit in expected.fits.items() if key in fits),
        ),
        Section(
            "reasons",
            "Reasons",
            ("key", "reason"),
            tuple((key, text) for key, text in expected.reasons.items() if key in whys),
        ),
    )


def _fit_text(expected: Expectations, row: Expectation) -> str:
    """Describe which inputs were fitted; "" if none were."""
    return f"{expected.fits[row.fit].what} ({expected.fits[row.fit].width})" if row.fit else ""
