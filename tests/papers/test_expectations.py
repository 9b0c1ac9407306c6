"""The expectations of the papers: their form, that no verdict is claimed without a right to it, and the classes."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest

from cwcli.reproduction.classes import (
    BETTER,
    CLASS_MEANINGS,
    DIFFERS,
    FITTED_CLASS,
    FOLLOWS_FROM_INPUT,
    NOT_DETERMINABLE,
    NOT_IN_PAPER,
    REPRODUCED,
    WITHIN_OWN_BOUND,
    Expectation,
    Finding,
    MeasuredNumber,
)
from cwcli.reproduction.expectations import load_expectations, parse_expectations
from cwcli.reproduction.findings import StudyPart
from cwcli.reproduction.findings_report import (
    assemble_reproduction,
    class_counts_table,
    exit_code_sentence,
    printed_numbers_sentence,
    unclaimed_class_notes,
)
from tools.results.papers import page_from_file, reproduction_from_file
from tools.results.result_file import read_result_file

DOCS = Path(__file__).parents[2] / "docs" / "papers"
PAPERS = ("song2016", "xiang2019", "zhang2011")
NUMBERED = {  # of each paper, counted in the papers themselves
    "song2016": ([f"fig {n}" for n in range(1, 16)], ["table 1"]),
    "xiang2019": ([f"fig {n}" for n in range(1, 9)], ["table 1", "table 2"]),
    "zhang2011": ([f"fig {n}" for n in range(1, 20)], [f"table {n}" for n in range(1, 6)]),
}


@pytest.mark.parametrize("paper", PAPERS)
def test_every_numbered_figure_and_table_has_a_row_a_picture_or_a_reason(paper: str) -> None:
    expected = load_expectations(paper)
    drawings, tables = NUMBERED[paper]
    for name in (*drawings, *tables):
        figure = expected.figures[name]
        assert figure.expectation_by_number or figure.plot_names or figure.reason_for_absence, name
        assert len(figure.description) > 10, name


@pytest.mark.parametrize("paper", PAPERS)
def test_no_row_claims_reproduced_with_a_fitted_input_or_without_a_printed_number(paper: str) -> None:
    document = tomllib.loads(
        files(f"cwcli.reproduction.{paper}").joinpath("expectations.toml").read_text(encoding="utf-8")
    )
    rows = [row for figure in document["figures"].values() for row in figure.get("rows", ())]
    assert len(rows) > 20
    for row in rows:
        assert row["class"] in CLASS_MEANINGS
        if row["class"] == "reproduced":
            assert ("paper" in row and "tolerance" in row) or "text" in row
            assert "fit" not in row
            assert "assumes" not in row
        if row["class"] == "follows":
            assert document["assumptions"][row["assumes"]]
        if row["class"] == "fitted":
            assert document["fits"][row["fit"]]["what"]
            assert document["fits"][row["fit"]]["width"]
        if row["class"] in {"better", "differs", "not determinable", "not in the paper"}:
            assert document["reasons"][row["why"]]


@pytest.mark.parametrize("paper", PAPERS)
def test_the_page_in_the_docs_is_that_of_the_expectations_and_the_result_file(paper: str) -> None:
    assert (DOCS / f"{paper}.md").read_text(encoding="utf-8") == page_from_file(read_result_file(paper))
    for figure in load_expectations(paper).figures.values():
        for picture in figure.plot_names:
            assert (DOCS / "figures" / paper / f"{picture.replace(' ', '-')}.png").exists()


@pytest.mark.parametrize("paper", PAPERS)
def test_every_class_is_earned(paper: str) -> None:
    """On the numbers of the result file; a number that deviates by more than is allowed loses its class."""
    made = reproduction_from_file(read_result_file(paper))
    assert not made.failed_findings
    assert unclaimed_class_notes(made.findings) == ()
    for finding in made.findings:
        row, reached = finding.expected, finding.verdict_class_of_number
        assert reached == row.claimed_class, row
        for planted in planted_deviations(finding):
            assert planted.verdict_class_of_number != reached, planted


def planted_deviations(finding: Finding) -> list[Finding]:
    """The finding with a number, a print or a bound that must not have its class."""
    row, number = finding.expected, finding.measured
    if row.paper_text:
        return [Finding(row, replace(number, text=number.text[::-1] + "1"))]
    if finding.verdict_class_of_number in {REPRODUCED, FITTED_CLASS, FOLLOWS_FROM_INPUT, WITHIN_OWN_BOUND}:
        low = max(row.at_least, -math.inf if row.paper_range is None else row.paper_range[0] - row.tolerance)
        high = min(row.at_most, math.inf if row.paper_range is None else row.paper_range[1] + row.tolerance)
        off = 0.01 * max(abs(number.ours), 1e-3)
        return [
            Finding(row, replace(number, ours=end, low=end, high=end))
            for end in (low - off, high + off)
            if math.isfinite(end)
        ]
    if finding.verdict_class_of_number == BETTER:
        assert row.paper_range is not None
        paper = row.paper_range[0] if row.better_direction == "lower" else row.paper_range[1]
        return [
            Finding(row, replace(number, ours=paper, low=paper, high=paper)),
            Finding(replace(row, group="smoother"), number),
        ]
    if finding.verdict_class_of_number == DIFFERS:
        paper = sum(row.paper_range) / 2 if row.paper_range is not None else max(row.at_least, row.at_most)
        return [Finding(row, replace(number, ours=paper, low=paper, high=paper))] if math.isfinite(paper) else []
    if finding.verdict_class_of_number == NOT_DETERMINABLE:
        return [Finding(replace(row, is_comparable=True), number)]
    return [Finding(replace(row, paper_range=(number.ours, number.ours)), number)]


def document_with(**fields: Any) -> dict[str, Any]:
    row = {"what": "speed", "class": "reproduced", "paper": 1.0, "tolerance": 0.1, **fields}
    return {
        "paper": "a",
        "source": "b",
        "figures": {"fig 1": {"prints": "c", "rows": [{k: v for k, v in row.items() if v is not None}]}},
        "fits": {"f": {"what": "w", "width": "v"}} if "fit" in fields else {},
        "reasons": {"beyond": "x"} | ({"r": "y"} if "why" in fields else {}),
    }


def test_a_row_with_every_right_is_taken() -> None:
    assert parse_expectations(document_with()).figures["fig 1"].expectation_by_number["speed"].paper_range == (1.0, 1.0)


WRONG: dict[str, dict[str, Any]] = {
    "reproduced without a number": {"paper": None, "tolerance": None},
    "reproduced on what cannot be compared": {"comparable": False, "tolerance": None},
    "reproduced with a fit": {"fit": "f"},
    "no tolerance": {"tolerance": None},
    "a tolerance around nothing": {"class": "within own bound", "paper": None, "at_most": 1.0},
    "fitted without a fit": {"class": "fitted"},
    "follows without an assumption": {"class": "follows"},
    "not determinable without a printed number": {
        "class": "not determinable",
        "paper": None,
        "tolerance": None,
        "why": "r",
    },
    "not determinable without what was tried": {
        "class": "not determinable",
        "comparable": False,
        "tolerance": None,
        "why": "r",
    },
    "not in the paper, and printed": {"class": "not in the paper", "why": "r"},
    "better for a method that looks ahead": {"class": "better", "better": "lower", "why": "r", "group": "smoother"},
    "an unknown group": {"group": "others"},
    "an own bound beside a printed number": {"class": "within own bound", "at_most": 1.0},
    "an own bound that is none": {"class": "within own bound", "paper": None, "tolerance": None},
    "better without a direction": {"class": "better", "why": "r"},
    "better in an unknown direction": {"class": "better", "why": "r", "better": "faster"},
    "differs without a reason": {"class": "differs"},
    "an unknown class": {"class": "good"},
    "an unknown key": {"colour": "red"},
    "an unknown fit": {"class": "fitted", "fit": "g"},
    "an unknown reason": {"why": "s"},
}


@pytest.mark.parametrize("case", WRONG)
def test_a_row_without_the_right_to_its_class_is_refused(case: str) -> None:
    with pytest.raises(ValueError, match=r"fig 1|there is no|is not used"):
        parse_expectations(document_with(**WRONG[case]))


ROW = Expectation("fig 1", "speed", "m/s", REPRODUCED, paper_range=(1.0, 1.0), tolerance=0.1)
SAID = Expectation("fig 1", "order", "", FITTED_CLASS, paper_statement="a before b", at_least=1.0, fit_key="f")
NAN = math.nan


@pytest.mark.parametrize(
    ("row", "ours", "reached", "has_failed"),
    [
        (ROW, (1.1, NAN, NAN), REPRODUCED, False),
        (ROW, (1.11, NAN, NAN), DIFFERS, True),
        (ROW, (NAN, NAN, NAN), NOT_DETERMINABLE, True),
        (replace(ROW, claimed_class=FITTED_CLASS, fit_key="f"), (0.95, NAN, NAN), FITTED_CLASS, False),
        (replace(ROW, claimed_class=FITTED_CLASS, fit_key="f"), (0.8, NAN, NAN), DIFFERS, True),
        (replace(ROW, claimed_class=DIFFERS), (0.8, NAN, NAN), DIFFERS, False),
        (replace(ROW, claimed_class=DIFFERS), (1.0, NAN, NAN), REPRODUCED, False),
        (replace(ROW, better_direction="lower"), (0.8, 0.7, 0.99), BETTER, False),
        (replace(ROW, better_direction="lower", claimed_class=BETTER), (0.8, 0.7, 0.99), BETTER, False),
        (
            replace(ROW, better_direction="lower", claimed_class=BETTER),
            (0.8, 0.7, 1.01),
            DIFFERS,
            True,
        ),  # not with all of its interval
        (replace(ROW, better_direction="lower", claimed_class=BETTER), (0.95, 0.7, 0.99), REPRODUCED, True),
        (replace(ROW, better_direction="higher", claimed_class=BETTER), (1.2, 1.1, 1.3), BETTER, False),
        (replace(ROW, better_direction="higher", claimed_class=BETTER), (0.8, 0.7, 0.9), DIFFERS, True),
        (replace(ROW, paper_range=(1.0, 5.0), tolerance=0.0), (5.0, NAN, NAN), REPRODUCED, False),
        (replace(ROW, paper_range=(1.0, 5.0), tolerance=0.0), (5.1, NAN, NAN), DIFFERS, True),
        (replace(ROW, claimed_class=NOT_DETERMINABLE, is_comparable=False), (9.0, NAN, NAN), NOT_DETERMINABLE, False),
        (
            replace(ROW, claimed_class=NOT_DETERMINABLE, is_comparable=False, at_most=8.0),
            (9.0, NAN, NAN),
            DIFFERS,
            True,
        ),
        (
            replace(ROW, claimed_class=WITHIN_OWN_BOUND, paper_range=None, at_most=2.0),
            (2.0, NAN, NAN),
            WITHIN_OWN_BOUND,
            False,
        ),
        (replace(ROW, claimed_class=WITHIN_OWN_BOUND, paper_range=None, at_most=2.0), (2.1, NAN, NAN), DIFFERS, True),
        (replace(ROW, claimed_class=NOT_IN_PAPER, paper_range=None), (2.1, NAN, NAN), NOT_IN_PAPER, False),
        (
            replace(ROW, claimed_class=FOLLOWS_FROM_INPUT, assumption_key="a"),
            (1.1, NAN, NAN),
            FOLLOWS_FROM_INPUT,
            False,
        ),
        (replace(ROW, claimed_class=FOLLOWS_FROM_INPUT, assumption_key="a"), (1.2, NAN, NAN), DIFFERS, True),
        (replace(ROW, better_direction="lower", group="smoother"), (0.8, 0.7, 0.8), DIFFERS, True),
        (SAID, (1.0, NAN, NAN), FITTED_CLASS, False),
        (SAID, (0.0, NAN, NAN), DIFFERS, True),
        (replace(SAID, claimed_class=DIFFERS, fit_key=""), (0.0, NAN, NAN), DIFFERS, False),
    ],
)
def test_the_class_follows_from_the_number(
    row: Expectation, ours: tuple[float, float, float], reached: str, has_failed: bool
) -> None:
    finding = Finding(row, MeasuredNumber(row.figure, row.what, *ours))
    assert (finding.verdict_class_of_number, finding.has_failed) == (reached, has_failed)


def test_the_note_tells_the_exit_code_and_why() -> None:
    good, bad = (Finding(ROW, MeasuredNumber("fig 1", "speed", ours)) for ours in (1.0, 2.0))
    may_miss = Finding(replace(ROW, what="level", claimed_class=DIFFERS), MeasuredNumber("fig 1", "level", 3.0))
    assert exit_code_sentence([good, may_miss]) == "exit code 0: all 1 claims are met"
    assert exit_code_sentence([good, bad, may_miss]) == (
        "exit code 1: 1 of 2 claims are not met: fig 1, speed: differs instead of reproduced"
    )
    counts = class_counts_table([good, bad, may_miss]).rows
    assert [row[:2] for row in counts[:1]] == [("reproduced", 1)]
    assert [row[1] for row in counts] == [1, 0, 0, 0, 0, 2, 0, 0]


def test_the_first_line_counts_the_printed_numbers_of_the_papers_own_method() -> None:
    printed = [Finding(ROW, MeasuredNumber("fig 1", "speed", ours)) for ours in (1.0, 2.0)]
    others = [
        Finding(replace(ROW, group="smoother"), MeasuredNumber("fig 1", "speed", 1.0)),
        Finding(replace(ROW, paper_range=None, claimed_class=NOT_IN_PAPER), MeasuredNumber("fig 1", "speed", 1.0)),
    ]
    assert printed_numbers_sentence([*printed, *others]) == (
        "2 numbers and strings that the paper prints: 1 reproduced, 1 differs"
    )


def test_a_tolerance_that_reaches_another_printed_number_is_refused() -> None:
    document = document_with(paper=4.72, tolerance=0.1)
    document["figures"]["fig 1"]["rows"].append(
        {"what": "other", "class": "reproduced", "paper": 4.8, "tolerance": 0.01}
    )
    with pytest.raises(ValueError, match=r"0\.1 is not below 0\.08"):
        parse_expectations(document)
    document["figures"]["fig 1"]["rows"][0]["tolerance"] = 0.04
    assert parse_expectations(document)


def test_a_printed_string_is_reproduced_letter_by_letter() -> None:
    row = Expectation("eq 5", "string", "", REPRODUCED, paper_text="0110")
    classes = [Finding(row, MeasuredNumber("eq 5", "string", NAN, text=text)) for text in ("0110", "0111", "")]
    assert [each.verdict_class_of_number for each in classes] == [REPRODUCED, DIFFERS, DIFFERS]
    assert [each.has_failed for each in classes] == [False, True, True]


FLIPS = {
    "song2016": ("fig 9", "rear-end: warning, constant speed, median", 4.5, 4.7),
    "xiang2019": ("fig 6", "radar alone is worse by, four looks averaged, mean of the five distances", 170.0, 30.0),
    "zhang2011": ("eq 13", "f(v) - 1 over v^2, half load", 0.000843, 0.00085),
}


@pytest.mark.parametrize("paper", PAPERS)
def test_another_number_makes_another_class_sentence_and_exit_code(paper: str) -> None:
    figure, what, right, wrong = FLIPS[paper]
    good, bad = (
        assemble_reproduction(paper, [StudyPart((MeasuredNumber(figure, what, ours),))], "1 seed")
        for ours in (right, wrong)
    )
    assert not good.failed_findings
    assert len(bad.failed_findings) == 1
    assert good.summary.notes[-1] == "exit code 0: all 1 claims are met"
    assert bad.summary.notes[-1].startswith(f"exit code 1: 1 of 1 claims are not met: {figure}, {what}: differs")
    assert [row["class"] for row in bad.table.rows_as_dicts()] == [DIFFERS]
    [row] = next(section.rows for section in bad.summary.sections if section.key == figure.replace(" ", "_"))
    assert row[4] == f"differs (claimed: {good.findings[0].expected.claimed_class})"


def test_a_number_without_an_expectation_is_a_mistake() -> None:
    with pytest.raises(KeyError):
        assemble_reproduction("song2016", [StudyPart((MeasuredNumber("fig 9", "something else", 1.0),))], "1 seed")
