"""The digest: at most 12 lines of 80 columns, failures first, whatever the number of clauses and trials."""

from __future__ import annotations

import math
from xml.etree import ElementTree as ET

import pytest

from cwcli.conformance.clause import clause_names, load_clause
from cwcli.conformance.digest import MAX_DIGEST_LINE_CHARACTERS, MAX_DIGEST_LINES, format_digest
from cwcli.conformance.html_page import format_html_page
from cwcli.conformance.page import format_junit, format_markdown
from cwcli.conformance.results import FAILED, NOT_JUDGED, NOT_VALID, PASSED, ClauseResult, Repetition, TrialResult
from cwcli.conformance.verdict import Verdict


def result(name: str, margins: list[float | None], breaches: tuple[str, ...] = ()) -> ClauseResult:
    """A clause whose trials have one repetition each with these margins; None: not driven."""
    clause = load_clause(name)
    repetitions = [
        () if margin is None else (Repetition("0", Verdict(margin, "s", "warned at TTC 2.00 s"), breaches),)
        for margin in margins
    ]
    trials = zip(clause.trials, repetitions, strict=False)
    settings = {"rule": "cwcli", "grade": "nominal"}
    return ClauseResult(clause, tuple(TrialResult(trial, each, 1) for trial, each in trials), 1, settings)


def test_all_clauses_fit_with_the_failed_ones_first() -> None:
    results = [result(name, [-1.0 if name == "un-r152" else 0.5]) for name in clause_names()]
    lines = format_digest(results)
    assert len(lines) <= MAX_DIGEST_LINES
    assert max(map(len, lines)) <= MAX_DIGEST_LINE_CHARACTERS
    assert lines[0] == f"{len(results)} clauses: 1 fail, {len(results) - 1} pass (numbers as published)"
    assert lines[1].split() == ["clause", "outcome", "passed", "margin"]
    assert lines[2].split() == ["un-r152", "fail", "0", "of", "1", "-1.00", "s"]
    assert "more clauses, 0 of which fail" in lines[-3]
    n_unchecked = sum(load_clause(name).n_unchecked_numbers for name in clause_names())
    n_chosen = sum(load_clause(name).n_chosen_numbers for name in clause_names())
    assert lines[-2] == f"{n_unchecked} numbers as commonly stated, not checked in the standard; {n_chosen} chosen here"


def test_a_grid_of_a_hundred_trials_fits_and_counts_what_is_left_out() -> None:
    margins: list[float | None] = [0.1 * k - 2.0 for k in range(104)]
    lines = format_digest([result("euro-ncap-c2c", margins)])
    assert len(lines) <= MAX_DIGEST_LINES
    assert max(map(len, lines)) <= MAX_DIGEST_LINE_CHARACTERS
    assert "and 98 more trials, 14 of which fail" in "".join(lines)
    assert any(line.startswith("worst: CCRs") for line in lines)


def test_outcomes_of_a_clause() -> None:
    assert result("nhtsa-fcw", [0.1, 0.2, 0.3]).outcome == PASSED
    assert result("nhtsa-fcw", [0.1, -0.2, 0.3]).outcome == FAILED
    assert result("nhtsa-fcw", [0.0, -1e-12, None]).outcome == PASSED
    assert result("nhtsa-fcw", [None, None, None]).outcome == NOT_JUDGED
    broken = result("nhtsa-fcw", [0.1, None, None], ("subject speed 18.00 m/s at 3.00 s",))
    assert broken.outcome == NOT_VALID
    assert "not valid: subject speed 18.00 m/s at 3.00 s" in format_digest([broken])
    assert "one trial of one log: the clause asks for 5 of 7 repetitions of its 3 trials" in format_digest([broken])


def test_five_of_seven_pass_and_four_fail() -> None:
    clause = load_clause("nhtsa-fcw")
    for n_good, outcome in ((5, PASSED), (4, FAILED)):
        margins = [0.1] * n_good + [-0.1] * (7 - n_good)
        repetitions = tuple(Repetition(str(k), Verdict(each, "s", "")) for k, each in enumerate(margins))
        assert TrialResult(clause.trials[0], repetitions, clause.required_passes(7)).outcome == outcome


def test_documents_of_machines_hold_every_trial_and_no_infinite_number() -> None:
    results = [result("nhtsa-fcw", [-0.1, math.nan, None])]
    suite = ET.fromstring(format_junit(results))[0]
    assert [suite.get(key) for key in ("tests", "failures", "skipped")] == ["3", "1", "1"]
    words = "5 numbers as commonly stated, not checked in the standard; 1 chosen here"
    assert suite[0][0].get("value") == f"numbers as published; {words}"
    markdown = format_markdown(results)
    assert f"\n\n{words}.\n\n" in markdown
    assert "| lead vehicle stopped | fail | 0 of 1 | 1 | TTC 2.1 s |" in markdown
    assert "numbers as commonly stated. " in format_markdown([result("un-r130", [0.5])])
    assert format_digest([result("un-r130", [0.5])])[0].startswith("un-r130: pass (numbers as commonly stated; ")
    trials = results[0].to_json()["trials"]
    assert trials[1]["repetitions"][0]["margin"] is None


def test_the_html_page_has_the_verdict_first_and_a_mark_for_each_repetition() -> None:
    page = format_html_page([result("nhtsa-fcw", [-0.1, 0.2, None])])
    assert page.index('class="badge" style="background:#c02f2f">fail') < page.index("<svg") < page.index("<table")
    picture = ET.fromstring(page[page.index("<svg") : page.index("</svg>") + 6])
    assert [len(picture.findall(tag)) for tag in ("circle", "path")] == [1, 1]
    assert "TTC 2.1 s" in page
    assert "0.3 g" in page
    assert "as commonly stated, not checked" in page
    assert "http" not in page
    assert "1 of 2 trials pass, with 1 repetition of each; rule cwcli, grade nominal. Source: DOT HS 811 501;" in page
    assert (
        ". Numbers as published; 5 numbers as commonly stated, not checked in the standard; 1 chosen here.</p>" in page
    )


def test_a_demand_that_no_standard_has_is_marked_where_a_trial_fails_by_it() -> None:
    failed = [result("etsi-101-539", [-0.1])]
    assert "TTC 5 s, shortest TTC 3 s (choice of cwcli)</td>" in format_html_page(failed)
    assert "TTC 5 s, shortest TTC 3 s (choice of cwcli) |" in format_markdown(failed)
    assert "choice" not in format_markdown([result("un-r152", [-0.1])])


def test_the_picture_of_margins_puts_zero_between_failures_and_passes() -> None:
    page = format_html_page([result("nhtsa-fcw", [-0.5, 0.5, None])])
    picture = ET.fromstring(page[page.index("<svg") : page.index("</svg>") + 6])
    (zero,) = (line for line in picture.findall("line") if line.get("stroke") == "#c02f2f")
    cross = float(str(picture.findall("path")[0].get("d"))[1:].split()[0]) + 4.0
    disc = float(str(picture.findall("circle")[0].get("cx")))
    assert disc - float(str(zero.get("x1"))) == pytest.approx(float(str(zero.get("x1"))) - cross, abs=0.3)
