"""The findings of a reproduction as a table and as a summary."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cwcli.metrics.table import ColumnDoc, Table
from cwcli.pipeline.result import Cell, Section, Summary
from cwcli.reproduction.findings import Finding, Part, Plot


@dataclass(frozen=True)
class Reproduction:
    """What came out.

    Attributes:
        findings: One line each.
        plots: The redrawn figures.
        table: The findings as columns.
        summary: For people and `--json`.
    """

    findings: tuple[Finding, ...]
    plots: tuple[Plot, ...]
    table: Table
    summary: Summary

    @property
    def failed(self) -> tuple[Finding, ...]:
        """The findings that are worse where they must not be."""
        return tuple(finding for finding in self.findings if finding.has_failed)


def reproduction(
    paper: str, parts: Sequence[Part], note: str, sections: Sequence[Section] = (), notes: Sequence[str] = ()
) -> Reproduction:
    """Put the parts together, in their order.

    Args:
        paper: Key of the paper.
        parts: Their findings and plots.
        note: On what the numbers rest ("100 seeds").
        sections: Further tables for the summary, after those of the findings.
        notes: Further notes.
    """
    findings = tuple(finding for part in parts for finding in part.findings)
    plots = tuple(plot for part in parts for plot in part.plots)
    summary = Summary(
        f"reproduce {paper}",
        (*findings_sections(findings), *sections),
        (),
        (note, *notes, exit_note(findings)),
    )
    return Reproduction(findings, plots, findings_table(paper, findings), summary)


def exit_note(findings: Sequence[Finding]) -> str:
    """What the exit code is, and why."""
    n_required = sum(finding.is_required for finding in findings)
    failed = [f"{f.figure}, {f.what}: {f.verdict}" for f in findings if f.has_failed]
    if failed:
        return f"exit code 1: {len(failed)} of {n_required} findings that must hold do not: {'; '.join(failed)}"
    return f"exit code 0: all {n_required} findings that must hold do"


def findings_table(name: str, findings: Sequence[Finding]) -> Table:
    """One row a finding."""
    texts = ("figure", "what", "unit", "verdict")
    numbers = ("paper", "ours", "low", "high")
    return Table(
        name,
        {
            **{name: [str(getattr(f, name)) for f in findings] for name in texts},
            **{name: np.array([getattr(f, name) for f in findings], dtype=np.float64) for name in numbers},
            "is_required": np.array([f.is_required for f in findings], dtype=np.bool_),
        },
        docs={
            "paper": ColumnDoc(doc="the paper's number; NaN where it prints none"),
            "low": ColumnDoc(doc="95 % interval over the seeds"),
            "high": ColumnDoc(doc="95 % interval over the seeds"),
        },
    )


def findings_sections(findings: Sequence[Finding]) -> tuple[Section, ...]:
    """One table a figure of the paper."""
    sections = []
    for figure in dict.fromkeys(finding.figure for finding in findings):
        rows: list[tuple[Cell, ...]] = [
            (f.what, f.unit, _number(f.paper), _number(f.ours), _interval(f), f.verdict, "yes" if f.is_required else "")
            for f in findings
            if f.figure == figure
        ]
        columns = ("what", "unit", "paper", "ours", "95 % interval", "verdict", "must hold")
        sections.append(Section(figure.replace(" ", "_"), figure, columns, tuple(rows)))
    return tuple(sections)


def _number(value: float) -> Cell:
    return None if math.isnan(value) else value


def _interval(finding: Finding) -> str:
    return "" if math.isnan(finding.low) else f"{finding.low:.4g} to {finding.high:.4g}"
