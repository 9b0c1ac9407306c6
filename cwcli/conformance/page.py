"""Clauses as tables, Markdown and JUnit XML: every trial, every number with its source, and the failures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from xml.etree import ElementTree as ET

from cwcli.conformance.clause import MEANING_BY_TTC_DEFINITION, TEXT_BY_BASIS_OF_CLAUSE_NUMBER, Clause
from cwcli.conformance.results import FAILED, NOT_JUDGED, NOT_VALID, ClauseResult
from cwcli.pipeline.result import Cell, SummaryTable
from cwcli.text import format_count

CLAUSE_COLUMNS = ("name of the clause", "outcome", "trials passed", "worst margin to the limit")
TRIAL_COLUMNS = (
    "trial", "outcome", "repetitions passed", "passes required", "required warning or braking", "what happened",
    "worst margin to the limit",
)  # fmt: skip
REPETITION_COLUMNS = ("trial", "seed or log", "outcome", "margin to the limit", "what happened")
NUMBER_COLUMNS = ("quantity", "value", "basis of the value", "source", "page", "definition of TTC")


def trials_table(result: ClauseResult) -> SummaryTable:
    """One row a trial, with its worst repetition."""
    rows: list[tuple[Cell, ...]] = []
    for trial in result.trials:
        rows.append(
            (
                trial.trial.name,
                trial.outcome,
                trial.passed_text,
                trial.n_required,
                trial.trial.demands_text or "no warning",
                trial.worst_repetition_text,
                trial.margin_text,
            )
            if trial.outcome != NOT_JUDGED
            else (trial.trial.name, trial.outcome, None, None, trial.trial.demands_text, "", "")
        )
    return SummaryTable("trials", f"{result.clause.name}: trials", TRIAL_COLUMNS, tuple(rows))


def repetitions_table(result: ClauseResult) -> SummaryTable:
    """One row a repetition."""
    rows: list[tuple[Cell, ...]] = []
    for trial in result.trials:
        for each in trial.repetitions:
            verdict = each.verdict
            known = verdict is not None and not math.isnan(verdict.margin)
            margin = f"{verdict.margin:+.3f} {verdict.unit}".rstrip() if verdict is not None and known else ""
            text = "; ".join(each.breaches) or ("" if verdict is None else verdict.text)
            rows.append((trial.trial.name, each.label, each.outcome, margin, text))
    return SummaryTable("repetitions", f"{result.clause.name}: repetitions", REPETITION_COLUMNS, tuple(rows))


def published_numbers_table(clause: Clause) -> SummaryTable:
    """One row a number, with its source."""
    named = [*clause.numbers.items(), *((f"tolerance of {name}", each) for name, each in clause.tolerances.items())]
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (
            name,
            number.text,
            TEXT_BY_BASIS_OF_CLAUSE_NUMBER[number.basis],
            number.source,
            number.page_text,
            MEANING_BY_TTC_DEFINITION[number.ttc] if number.ttc else "",
        )
        for name, number in named
    )
    return SummaryTable("numbers", f"{clause.name}: numbers of the standard", NUMBER_COLUMNS, rows)


def detail_tables(result: ClauseResult) -> list[SummaryTable]:
    """What `--details` shows."""
    tables = [trials_table(result), repetitions_table(result), published_numbers_table(result.clause)]
    if result.clause.left_out:
        rows = tuple(result.clause.left_out.items())
        tables.append(SummaryTable("left_out", f"{result.clause.name}: not judged here", ("trials", "why"), rows))
    return tables


def clause_rows(results: Sequence[ClauseResult]) -> list[tuple[str, str, str, str]]:
    """One row of `CLAUSE_COLUMNS` a clause."""
    return [
        (
            result.clause.name,
            result.outcome,
            result.passed_text,
            result.worst_margin_text,
        )
        for result in results
    ]


def format_markdown(results: Sequence[ClauseResult]) -> str:
    """Format clauses as sections of a page in Markdown."""
    lines = [SummaryTable("clauses", "clauses", CLAUSE_COLUMNS, tuple(clause_rows(results))).to_markdown()]
    for result in results:
        clause = result.clause
        settings = ", ".join(f"{name} {value}" for name, value in result.settings.items())
        lines += [
            f"\n## {clause.name}\n",
            f"{clause.title}. Source: {clause.source}; {clause.basis_text}. {settings}; "
            f"{format_count(result.n_repetitions, 'repetition')} of each trial.",
        ]
        if clause.unchecked_text:
            lines += ["", f"{clause.unchecked_text}."]
        if clause.reading:
            lines += ["", f"How the numbers are read: {clause.reading}"]
        lines += ["", trials_table(result).to_markdown()]
        if clause.left_out:
            lines += ["", "Not judged here:", "", *(f"- {name}: {why}." for name, why in clause.left_out.items())]
    return "\n".join(lines) + "\n"


def format_junit(results: Sequence[ClauseResult]) -> bytes:
    """Format clauses as JUnit XML: one suite a clause, one case a trial."""
    root = ET.Element("testsuites", {"name": "cwcli conform"})
    for result in results:
        outcomes = [trial.outcome for trial in result.trials]
        n_skipped = sum(outcome in (NOT_VALID, NOT_JUDGED) for outcome in outcomes)
        counts = {
            "tests": str(len(outcomes)),
            "failures": str(outcomes.count(FAILED)),
            "errors": "0",
            "skipped": str(n_skipped),
            "time": "0",
        }
        suite = ET.SubElement(root, "testsuite", {"name": result.clause.name, **counts})
        properties = ET.SubElement(suite, "properties")
        basis = "; ".join(filter(None, (result.clause.basis_text, result.clause.unchecked_text)))
        ET.SubElement(properties, "property", name="numbers", value=basis)
        for trial in result.trials:
            case = ET.SubElement(suite, "testcase", classname=result.clause.name, name=trial.trial.name, time="0")
            text = f"{trial.passed_text} passed, at least {trial.n_required} must pass; {trial.worst_repetition_text}"
            if trial.outcome == FAILED:
                ET.SubElement(case, "failure", message=text, type="clause").text = text
            elif trial.outcome in (NOT_VALID, NOT_JUDGED):
                breaches = [breach for each in trial.repetitions for breach in each.breaches]
                ET.SubElement(case, "skipped", message="; ".join(breaches) or trial.outcome)
            else:
                ET.SubElement(case, "system-out").text = text
    ET.indent(root)
    document: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return document + b"\n"
