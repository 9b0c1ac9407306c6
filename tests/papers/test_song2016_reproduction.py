"""A small version of `cwcli reproduce song2016`: the paper's numbers on a few seeds; the command is the full one.

Table 1 is in `test_song2016_table1.py`.
"""

import numpy as np
import pytest

from cwcli.estimation.song2016 import STEP_S, trailing_slope
from cwcli.reproduction.findings import Finding, Part, ordered, within
from cwcli.reproduction.findings_report import exit_note, reproduction
from cwcli.reproduction.song2016.control import control_part
from cwcli.reproduction.song2016.prediction import Errors, horizon_part, prediction_errors, prediction_part
from cwcli.reproduction.song2016.warning import (
    PAPER_MOMENTS_S,
    TRAPS,
    Moments,
    false_warnings,
    figure_part,
    first_below,
    trap_part,
    warning_moments,
)
from cwcli.simulation.scenario import load_scenario

SEEDS = 6


def nothing() -> None:
    return None


@pytest.fixture(scope="module", params=["rear-end", "intersection"])
def moments(request: pytest.FixtureRequest) -> tuple[str, Moments]:
    return request.param, warning_moments(request.param, SEEDS, nothing)


def required(findings: tuple[Finding, ...]) -> list[Finding]:
    return [finding for finding in findings if finding.is_required]


def test_warning_moments_are_the_papers_within_a_tenth(moments: tuple[str, Moments]) -> None:
    name, found = moments
    for family in ("jerk", "acceleration", "speed"):
        assert np.nanmedian(found.by_method[family]) == pytest.approx(PAPER_MOMENTS_S[name][family], abs=0.1 + 1e-9)
    assert found.ideal_s == pytest.approx(PAPER_MOMENTS_S[name]["ideal"], abs=0.1)


def test_no_required_warning_finding_fails(moments: tuple[str, Moments]) -> None:
    failed = [f"{f.what}: {f.ours}" for f in required(figure_part(*moments).findings) if f.has_failed]
    assert not failed


def test_control_comes_out_as_in_the_paper(moments: tuple[str, Moments]) -> None:
    findings = required(control_part(*moments).findings)
    assert len(findings) >= 1
    assert not [f"{f.what}: {f.ours}" for f in findings if f.has_failed]


@pytest.mark.parametrize("name", ["straight", "curve"])
def test_order_of_the_families_in_figures_3_and_5(name: str) -> None:
    findings = required(prediction_part(name, prediction_errors(name, SEEDS, nothing)).findings)
    assert len(findings) == 2  # mean and maximum
    assert not [f"{f.what}: {f.ours}" for f in findings if f.has_failed]


@pytest.mark.parametrize("name", TRAPS)
def test_default_rule_is_silent_in_the_traps(name: str) -> None:
    assert false_warnings(name, 3, nothing)["cwcli"] == 0


@pytest.mark.parametrize(
    ("ours", "papers", "verdict"), [(0, 3, "better"), (0, 0, "reproduced"), (1, 3, "worse"), (1, 0, "worse")]
)
def test_verdict_of_a_trap_follows_from_both_counts(ours: int, papers: int, verdict: str) -> None:
    finding = trap_part("following", {"cwcli": ours, "song2016": papers}, 20).findings[0]
    assert finding.verdict == verdict
    assert finding.has_failed == (verdict == "worse")


@pytest.mark.parametrize(
    ("ours_s", "verdict"),
    [(3.55, "better"), (3.7, "reproduced"), (3.3, "reproduced"), (3.75, "worse"), (np.nan, "worse")],
)
def test_verdict_of_our_warning_follows_from_the_distance_to_the_ideal(ours_s: float, verdict: str) -> None:
    """The ideal moment is 3.5 s, the jerk family warns at 3.7 s."""
    when = {"jerk": 3.7, "acceleration": 4.0, "speed": 4.5, "cwcli": ours_s, "cwcli-v2x": ours_s}
    moments = Moments(
        load_scenario("rear-end"),
        "front",
        3.5,
        {key: np.full(3, value) for key, value in when.items()},
        {},
        np.zeros(0),
    )
    [finding] = [each for each in figure_part("rear-end", moments).findings if "our default, median" in each.what]
    assert finding.verdict == verdict


@pytest.mark.parametrize(("largest_m", "verdict"), [(7.9, "reproduced"), (3.6, "differs"), (9.0, "differs")])
def test_verdict_of_figure_7_follows_from_its_number(largest_m: float, verdict: str) -> None:
    horizons = {2.1: np.ones(3), 2.5: np.ones(3), 2.9: np.full(3, largest_m)}
    findings = horizon_part(Errors(np.zeros(0), {}, {}, {}, horizons, {})).findings
    assert [each.verdict for each in findings] == ["reported", "reported", verdict]


def test_note_tells_the_exit_code_and_why() -> None:
    nan = float("nan")
    holds = Finding("fig 9", "moment", "s", 1.0, 1.0, nan, nan, "reproduced", is_required=True)
    misses = Finding("fig 9", "order", "", 1.0, 0.0, nan, nan, "differs", is_required=True)
    may_miss = Finding("fig 7", "level", "m", 7.9, 3.6, nan, nan, "differs")
    assert exit_note([holds, may_miss]) == "exit code 0: all 1 findings that must hold do"
    assert exit_note([holds, misses, may_miss]) == (
        "exit code 1: 1 of 2 findings that must hold do not: fig 9, order: differs"
    )
    made = reproduction("song2016", [Part((holds, misses, may_miss))], "3 seeds")
    assert made.summary.notes == ("3 seeds", exit_note(made.findings))
    assert made.failed == (misses,)
    assert [row[-1] for section in made.summary.sections for row in section.rows] == ["yes", "yes", ""]


def test_trailing_slope_of_a_line_is_its_slope() -> None:
    values = 3.0 + 2.0 * STEP_S * np.arange(20)
    slope = trailing_slope(values, 8)
    np.testing.assert_allclose(slope[7:], 2.0)
    np.testing.assert_array_equal(slope[:7], 0.0)


def test_trailing_slope_looks_back_only() -> None:
    values = np.where(np.arange(20) < 10, 0.0, 1.0)
    assert np.all(trailing_slope(values, 4)[:10] == 0.0)
    assert trailing_slope(values, 4)[10] > 0.0


def test_first_below_by_hand() -> None:
    assert first_below(np.array([0.0, 1.0, 2.0]), np.array([5.0, 2.4, 1.0]), 2.5) == 1.0
    assert np.isnan(first_below(np.array([0.0, 1.0]), np.array([5.0, 2.5]), 2.5))


def test_verdicts() -> None:
    assert within(3.7, 3.6, 0.1) == "reproduced"
    assert within(3.71, 3.6, 0.1) == "differs"
    assert ordered([1.0, 2.0, 3.0])
    assert not ordered([1.0, 1.0])
    nan = float("nan")
    assert Finding("fig 9", "", "s", 1.0, 2.0, nan, nan, "differs", is_required=True).has_failed
    assert not Finding("fig 9", "", "s", 1.0, 2.0, nan, nan, "differs").has_failed
