"""Builds the table and the summary of a reproduction's findings; every sentence follows from the numbers."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Sequence

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.metrics.table import ColumnDoc, Table
from cwcli.pipeline.result import Cell, StageSummary, SummaryTable
from cwcli.reproduction.classes import (
    CLASS_MEANINGS,
    CLASSES_THAT_MUST_BE_REACHED_WHERE_CLAIMED,
    GROUP_OF_PAPER_METHOD,
    GROUP_TITLES,
    Expectation,
    Finding,
)
from cwcli.reproduction.expectations import PaperExpectations, load_expectations
from cwcli.reproduction.findings import Plot, StudyPart

FINDING_COLUMNS = ("what", "paper", "ours", "tolerance", "class", "why")
"""Headings of the table of findings."""
PROCESSOR_TIMES_SECTION_KEY = "times"
"""Key of the section of processor times, which get no class and stay out of the page: they are the machine's."""


@dataclass(frozen=True)
class Reproduction:
    """The result of reproducing a paper.

    Attributes:
        summary: For people and `--json`.
    """

    expectations: PaperExpectations
    findings: tuple[Finding, ...]
    plots: tuple[Plot, ...]
    table: Table
    summary: StageSummary

    @property
    def failed_findings(self) -> tuple[Finding, ...]:
        """The findings that do not reach what is claimed of them."""
        return tuple(finding for finding in self.findings if finding.has_failed)


def assemble_reproduction(
    paper: str,
    parts: Sequence[StudyPart],
    note: str,
    *,
    sections: Sequence[SummaryTable] = (),
    notes: Sequence[str] = (),
    only: Collection[str] = (),
) -> Reproduction:
    """Assemble the parts of a reproduction, in the order of the expectations.

    Args:
        note: On what the numbers rest ("100 seeds").
        sections: Further tables for the summary, after those of the findings.
        only: Figures that are wanted; none: all.
    """
    expected = load_expectations(paper)
    names = [name for name in expected.figures if not only or name in only]
    findings = tuple(
        Finding(expected.expectation_of_number(each.figure, each.what), each)
        for name in names
        for part in parts
        for each in part.numbers
        if each.figure == name
    )
    pictures = [picture for name in names for picture in expected.figures[name].plot_names]
    plots = [plot for part in parts for plot in part.plots if plot.figure in pictures]
    plots.sort(key=lambda plot: pictures.index(plot.figure))
    summary = StageSummary(
        f"reproduce {paper}",
        (
            *(_figure_section(expected, name, findings_of_papers_own_method(findings, name)) for name in names),
            *tables_of_other_groups(findings),
            *sections,
            *_fits_and_reasons_sections(expected, findings),
            class_counts_table(findings),
        ),
        (),
        (
            printed_numbers_sentence(findings),
            note,
            *notes,
            *unclaimed_class_notes(findings),
            exit_code_sentence(findings),
        ),
    )
    return Reproduction(expected, findings, tuple(plots), findings_table(paper, expected, findings), summary)


def exit_code_sentence(findings: Sequence[Finding]) -> str:
    """Return the sentence that says which exit code follows, and why."""
    n_binding = sum(
        finding.expected.claimed_class in CLASSES_THAT_MUST_BE_REACHED_WHERE_CLAIMED
        or finding.expected.has_bound_of_our_own
        for finding in findings
    )
    failed = [
        f"{f.expected.figure}, {f.expected.what}: {f.verdict_class_of_number} instead of {f.expected.claimed_class}"
        for f in findings
        if f.has_failed
    ]
    if failed:
        return f"exit code 1: {len(failed)} of {n_binding} claims are not met: {'; '.join(failed)}"
    return f"exit code 0: all {n_binding} claims are met"


def unclaimed_class_notes(findings: Sequence[Finding]) -> tuple[str, ...]:
    """Return a note for each number whose class differs from the claimed one without being a failure."""
    return tuple(
        f"{f.expected.figure}, {f.expected.what}: {f.verdict_class_of_number}, "
        f"and {f.expected.claimed_class} was expected"
        for f in findings
        if f.differs_from_claim_without_failing
    )


def findings_of_papers_own_method(findings: Sequence[Finding], figure: str) -> list[Finding]:
    """Return the findings of a figure that the paper's own method gives."""
    return [f for f in findings if f.expected.figure == figure and f.expected.group == GROUP_OF_PAPER_METHOD]


def printed_numbers_sentence(findings: Sequence[Finding]) -> str:
    """Return the sentence that says how many printed numbers there are, and how many of each class."""
    printed = [f for f in findings if f.expected.is_printed and f.expected.group == GROUP_OF_PAPER_METHOD]
    found = Counter(finding.verdict_class_of_number for finding in printed)
    counts = ", ".join(f"{found[name]} {name}" for name in CLASS_MEANINGS if found[name])
    return f"{len(printed)} numbers and strings that the paper prints: {counts or 'none'}"


def class_counts_table(findings: Sequence[Finding]) -> SummaryTable:
    """Count the findings of each class: of printed numbers, of what else the figures hold, and of the other groups."""
    own = [finding for finding in findings if finding.expected.group == GROUP_OF_PAPER_METHOD]
    printed = Counter(finding.verdict_class_of_number for finding in own if finding.expected.is_printed)
    others = Counter(finding.verdict_class_of_number for finding in own if not finding.expected.is_printed)
    classes_of_findings = Counter(
        f.verdict_class_of_number for f in findings if f.expected.group != GROUP_OF_PAPER_METHOD
    )
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (name, printed[name], others[name], classes_of_findings[name], meaning)
        for name, meaning in CLASS_MEANINGS.items()
    )
    columns = ("class", "printed numbers", "statements and own numbers", "repeats and our methods", "meaning")
    return SummaryTable("classes", "How many numbers are of each class", columns, rows)


def tables_of_other_groups(findings: Sequence[Finding]) -> tuple[SummaryTable, ...]:
    """Build the sections of the groups that are counted apart from the paper's own method."""
    sections = []
    for group, title in GROUP_TITLES.items():
        found = [f for f in findings if f.expected.group == group]
        if group != GROUP_OF_PAPER_METHOD and found:
            rows = tuple((f.expected.figure, *finding_cells(f)) for f in found)
            sections.append(SummaryTable(f"group_{group}", title, ("figure", *FINDING_COLUMNS), rows))
    return tuple(sections)


def findings_table(name: str, expected: PaperExpectations, findings: Sequence[Finding]) -> Table:
    """Build the table of findings as columns, one row a finding."""
    rows = [(f.expected, f.measured) for f in findings]
    printed = [row.paper_range or (math.nan, math.nan) for row, _ in rows]
    return Table(
        name,
        {
            "figure": [row.figure for row, _ in rows],
            "what": [row.what for row, _ in rows],
            "unit": [row.unit for row, _ in rows],
            "paper": np.array([low for low, _ in printed], dtype=np.float64),
            "paper_to": np.array([high for _, high in printed], dtype=np.float64),
            "group": [row.group for row, _ in rows],
            "says": [row.paper_statement or row.paper_text for row, _ in rows],
            "ours": np.array([measured.ours for _, measured in rows], dtype=np.float64),
            "low": np.array([measured.low for _, measured in rows], dtype=np.float64),
            "high": np.array([measured.high for _, measured in rows], dtype=np.float64),
            "tolerance": np.array([row.tolerance for row, _ in rows], dtype=np.float64),
            "class": [f.verdict_class_of_number for f in findings],
            "claim": [row.claimed_class for row, _ in rows],
            "has_failed": np.array([f.has_failed for f in findings], dtype=np.bool_),
            "fitted": [_fit_text(expected, row) for row, _ in rows],
            "assumed": [expected.assumptions.get(row.assumption_key, "") for row, _ in rows],
            "why": [expected.reasons.get(row.reason_key, "") for row, _ in rows],
        },
        docs={
            "paper": ColumnDoc(doc="the paper's number, or the least of a range; NaN where it prints none"),
            "paper_to": ColumnDoc(doc="the largest of a range"),
            "group": ColumnDoc(doc="whose number it is where it is not the paper's own method's"),
            "says": ColumnDoc(doc="what the paper says where it prints no number"),
            "low": ColumnDoc(doc="95 % interval over the seeds"),
            "high": ColumnDoc(doc="95 % interval over the seeds"),
            "fitted": ColumnDoc(doc="which inputs were chosen so that it holds"),
            "assumed": ColumnDoc(doc="which value it is, or follows from"),
        },
    )


def finding_cells(finding: Finding) -> tuple[Cell, ...]:
    """Return a finding's cells under the headings of `FINDING_COLUMNS`."""
    row, measured = finding.expected, finding.measured
    printed = row.paper_text or row.paper_statement
    if row.paper_range is not None:
        low, high = row.paper_range
        printed = f"{low:g}" if low == high else f"{low:g} to {high:g}"
    ours = "-" if math.isnan(measured.ours) else f"{measured.ours:.4g}"
    if not math.isnan(measured.low):
        ours += f" ({measured.low:.4g} to {measured.high:.4g})"
    if measured.text:
        ours = measured.text
    keys = ", ".join(key for key in (row.fit_key, row.assumption_key, row.reason_key) if key)
    reached = finding.verdict_class_of_number + (f" (claimed: {row.claimed_class})" if finding.has_failed else "")
    what = f"{row.what} [{row.unit}]" if row.unit else row.what
    return (what, printed or "-", ours, tolerance_text(row), reached, keys)


def tolerance_text(row: Expectation) -> str:
    """Format the tolerance around the paper's number, or our own bound."""
    texts = [f"+-{row.tolerance:g}"] if row.paper_range is not None and row.is_comparable else []
    texts += [f"at least {row.at_least:g}"] if math.isfinite(row.at_least) else []
    texts += [f"at most {row.at_most:g}"] if math.isfinite(row.at_most) else []
    return ", ".join(texts)


def _figure_section(expected: PaperExpectations, name: str, findings: Sequence[Finding]) -> SummaryTable:
    """Build the section of one figure."""
    figure = expected.figures[name]
    key = name.replace(" ", "_")
    if not findings:
        text = figure.reason_for_absence or f"a picture: {', '.join(figure.plot_names)}"
        return SummaryTable(key, name, ("in the paper", "ours"), ((figure.description, text),))
    return SummaryTable(
        key, f"{name}: {figure.description}", FINDING_COLUMNS, tuple(finding_cells(finding) for finding in findings)
    )


def _fits_and_reasons_sections(expected: PaperExpectations, findings: Sequence[Finding]) -> tuple[SummaryTable, ...]:
    """Build the sections that explain the keys of the column "why"."""
    rows = [finding.expected for finding in findings]
    fits = {row.fit_key for row in rows}
    assumed = {row.assumption_key for row in rows}
    whys = {row.reason_key for row in rows}
    return (
        SummaryTable(
            "fits",
            "Inputs that were chosen so that something holds",
            ("key", "what was chosen", "how wide the choice is"),
            tuple((key, fit.chosen_inputs, fit.choice_width) for key, fit in expected.fits.items() if key in fits),
        ),
        SummaryTable(
            "assumptions",
            "Values that were put in or assumed",
            ("key", "value"),
            tuple((key, text) for key, text in expected.assumptions.items() if key in assumed),
        ),
        SummaryTable(
            "reasons",
            "Reasons",
            ("key", "reason"),
            tuple((key, text) for key, text in expected.reasons.items() if key in whys),
        ),
    )


def _fit_text(expected: PaperExpectations, row: Expectation) -> str:
    """Describe which inputs were fitted; "" if none were."""
    return (
        f"{expected.fits[row.fit_key].chosen_inputs} ({expected.fits[row.fit_key].choice_width})" if row.fit_key else ""
    )
