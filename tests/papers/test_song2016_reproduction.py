"""A small version of `cwcli reproduce song2016`: the paper's numbers on a few seeds; the command is the full one.

Table 1 is in `test_song2016_table1.py`.
"""

import numpy as np
import pytest

from cwcli.estimation.song2016 import SAMPLING_TIME_S, least_squares_slope_of_last_samples
from cwcli.pipeline.result import SummaryTable
from cwcli.reproduction.classes import DIFFERS, FITTED_CLASS, NOT_DETERMINABLE, WITHIN_OWN_BOUND, Finding
from cwcli.reproduction.expectations import load_expectations
from cwcli.reproduction.findings import StudyPart, is_strictly_increasing
from cwcli.reproduction.request import ReproductionRequest
from cwcli.reproduction.song2016 import reproduce
from cwcli.reproduction.song2016.control import braking_control_part
from cwcli.reproduction.song2016.prediction import (
    PredictionErrors,
    compute_prediction_errors,
    prediction_errors_part,
    prediction_horizons_part,
)
from cwcli.reproduction.song2016.reproduce import (
    FIGURES_BY_TASK,
    TASK_KIND_LABELS,
    format_seed_note,
    reproduce_song2016,
)
from cwcli.reproduction.song2016.sensitivity import moment_bands_over_variants
from cwcli.reproduction.song2016.warning import (
    COLLISION_FREE_SCENARIOS_THAT_MUST_NOT_WARN,
    WarningMoments,
    count_false_warnings,
    false_warning_trap_part,
    first_time_below_s,
    simulate_warning_moments,
    warning_moments_part,
)
from cwcli.simulation.scenario import load_scenario

SEEDS = 6
PAPER_MOMENTS_S = {
    "rear-end": {"ideal": 3.5, "jerk": 3.6, "acceleration": 4.0, "speed": 4.5},
    "intersection": {"ideal": 4.62, "jerk": 4.72, "acceleration": 4.80, "speed": 4.88},
}


def nothing() -> None:
    return None


@pytest.fixture(scope="module", params=["rear-end", "intersection"])
def moments(request: pytest.FixtureRequest) -> tuple[str, WarningMoments]:
    return request.param, simulate_warning_moments(request.param, SEEDS, nothing)


def findings(part: StudyPart) -> list[Finding]:
    expected = load_expectations("song2016")
    return [Finding(expected.expectation_of_number(each.figure, each.what), each) for each in part.numbers]


def failed(part: StudyPart) -> list[str]:
    return [
        f"{f.expected.what}: {f.measured.ours} is {f.verdict_class_of_number}" for f in findings(part) if f.has_failed
    ]


def finding_of(part: StudyPart, what: str) -> Finding:
    [found] = [each for each in findings(part) if each.expected.what == what]
    return found


def test_warning_moments_are_the_papers_within_a_tenth(moments: tuple[str, WarningMoments]) -> None:
    name, found = moments
    for family in ("jerk", "acceleration", "speed"):
        assert np.nanmedian(found.warned_s_by_method[family]) == pytest.approx(
            PAPER_MOMENTS_S[name][family], abs=0.1 + 1e-9
        )
    assert found.ideal_s == pytest.approx(PAPER_MOMENTS_S[name]["ideal"], abs=0.1)


def test_the_claimed_classes_of_the_warnings_are_reached(moments: tuple[str, WarningMoments]) -> None:
    part = warning_moments_part(*moments)
    assert failed(part) == []
    # Rear-end: two families and their order; intersection: the ideal moment, three families and their order.
    fitted = {"rear-end": 3, "intersection": 5}[moments[0]]
    assert sum(each.verdict_class_of_number == FITTED_CLASS for each in findings(part)) == fitted
    assert [plot.figure for plot in part.plots] == (
        ["fig 9", "fig 8"] if moments[0] == "rear-end" else ["fig 11", "fig 10"]
    )


def test_the_printed_moments_can_be_told_apart_in_the_plot(moments: tuple[str, WarningMoments]) -> None:
    """The plot is 770 pixels wide, 600 of them within its axes; a diamond is ten pixels wide."""
    plot = warning_moments_part(*moments).plots[0]
    assert plot.x_range is not None
    pixels_per_s = 600.0 / (plot.x_range[1] - plot.x_range[0])
    printed_s = sorted(curve.printed_x for curve in plot.curves)
    assert np.diff(printed_s).min() * pixels_per_s > 20.0


def test_the_seed_that_is_shown_warns_in_every_family(moments: tuple[str, WarningMoments]) -> None:
    dots = [curve.dot_x for curve in warning_moments_part(*moments).plots[0].curves]
    assert np.isfinite(dots).all()
    medians = [np.nanmedian(moments[1].warned_s_by_method[family]) for family in ("speed", "acceleration", "jerk")]
    np.testing.assert_allclose(dots, medians, atol=0.1)


def test_control_comes_out_as_in_the_paper(moments: tuple[str, WarningMoments]) -> None:
    part = braking_control_part(*moments)
    assert failed(part) == []
    assert sum(each.verdict_class_of_number == FITTED_CLASS for each in findings(part)) == (
        4 if moments[0] == "rear-end" else 1
    )


@pytest.mark.parametrize("name", ["straight", "curve"])
def test_order_of_the_families_in_figures_3_and_5(name: str) -> None:
    part = prediction_errors_part(name, compute_prediction_errors(name, SEEDS, nothing))
    assert failed(part) == []
    assert sum(each.verdict_class_of_number == FITTED_CLASS for each in findings(part)) == 2  # mean and maximum


@pytest.mark.parametrize("name", COLLISION_FREE_SCENARIOS_THAT_MUST_NOT_WARN)
def test_default_rule_is_silent_in_the_traps(name: str) -> None:
    assert count_false_warnings(name, 3, nothing)["cwcli"] == 0


@pytest.mark.parametrize(("ours", "reached"), [(0, WITHIN_OWN_BOUND), (1, DIFFERS)])
def test_class_of_a_trap_follows_from_the_count(ours: int, reached: str) -> None:
    part = false_warning_trap_part("following", {"cwcli": ours, "song2016": 3}, 20)
    finding = finding_of(part, "following: warnings in a hundred runs, our default")
    assert finding.measured.ours == 5.0 * ours
    assert (finding.verdict_class_of_number, finding.has_failed) == (reached, ours > 0)


@pytest.mark.parametrize(
    ("ours_s", "reached", "is_failure"),
    [
        (3.55, WITHIN_OWN_BOUND, False),
        (3.7, WITHIN_OWN_BOUND, False),
        (3.3, WITHIN_OWN_BOUND, False),
        (3.75, DIFFERS, True),
        (np.nan, NOT_DETERMINABLE, True),
    ],
)
def test_class_of_our_warning_follows_from_the_distance_to_the_ideal(
    ours_s: float, reached: str, is_failure: bool
) -> None:
    """The ideal moment is 3.5 s, the jerk family warns at 3.7 s."""
    when = {"jerk": 3.7, "acceleration": 4.0, "speed": 4.5, "cwcli": ours_s, "cwcli-v2x": ours_s}
    moments = WarningMoments(
        load_scenario("rear-end"),
        "lead",
        3.5,
        {key: np.full(3, value) for key, value in when.items()},
        {},
        np.zeros(0),
    )
    part = warning_moments_part("rear-end", moments)
    finding = finding_of(part, "rear-end: our default farther from the ideal moment than jerk by")
    assert (finding.verdict_class_of_number, finding.has_failed) == (reached, is_failure)


@pytest.mark.parametrize(
    ("largest_m", "reached"), [(7.9, "reproduced"), (3.6, DIFFERS), (9.0, DIFFERS), (7.96, DIFFERS)]
)
def test_class_of_figure_7_follows_from_its_number(largest_m: float, reached: str) -> None:
    horizons = {2.1: np.ones(3), 2.5: np.ones(3), 2.9: np.full(3, largest_m)}
    part = prediction_horizons_part(PredictionErrors(np.zeros(0), {}, {}, {}, horizons, {}))
    finding = finding_of(part, "straight: largest error of constant jerk, 2.9 s ahead")
    assert (finding.verdict_class_of_number, finding.has_failed) == (reached, False)  # it is claimed to differ


def test_the_bands_hold_the_moments_as_chosen_and_move_with_the_braking() -> None:
    part, section = moment_bands_over_variants("rear-end", 2)
    bands = {each.what: each for each in part.numbers}
    jerk = bands["rear-end: band over the choices, warning, constant jerk, median"]
    assert jerk.low < jerk.ours < jerk.high
    by_choice = {row[0]: row[1:5] for row in section.rows}
    early, late = (np.array(by_choice[f"braking begins at {at} s"], float) for at in ("3.35", "3.55"))
    assert (early < late).all()
    assert (late - early < 0.3).all()


def test_trailing_slope_of_a_line_is_its_slope() -> None:
    values = 3.0 + 2.0 * SAMPLING_TIME_S * np.arange(20.0)
    slope = least_squares_slope_of_last_samples(values, 8)
    np.testing.assert_allclose(slope[7:], 2.0)
    np.testing.assert_array_equal(slope[:7], 0.0)


def test_trailing_slope_looks_back_only() -> None:
    values = np.where(np.arange(20) < 10, 0.0, 1.0)
    assert np.all(least_squares_slope_of_last_samples(values, 4)[:10] == 0.0)
    assert least_squares_slope_of_last_samples(values, 4)[10] > 0.0


def test_first_below_by_hand() -> None:
    assert first_time_below_s(np.array([0.0, 1.0, 2.0]), np.array([5.0, 2.4, 1.0]), 2.5) == 1.0
    assert np.isnan(first_time_below_s(np.array([0.0, 1.0]), np.array([5.0, 2.5]), 2.5))


def test_strictly_rising() -> None:
    assert is_strictly_increasing([1.0, 2.0, 3.0])
    assert not is_strictly_increasing([1.0, 1.0])


def test_the_note_tells_the_seeds_of_each_part() -> None:
    """As the run takes them: table 1 and the predicted paths at most 20, the moved choices at most 10."""
    found = reproduce_song2016(ReproductionRequest(seeds=2, jobs=1, only=("table 1",)))
    assert found.summary.notes[1] == "2 seeds of table 1"
    tasks = [("traps", "following", 100), ("table 1", "straight", 20), ("prediction", "curve", 20)]
    assert format_seed_note(tasks) == "100 seeds of traps; 20 seeds of table 1, predicted paths"
    assert {*TASK_KIND_LABELS} == {kind for kind, _ in FIGURES_BY_TASK}


def test_the_number_of_seeds_is_bounded_where_the_note_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    taken: dict[str, int] = {}

    def record(kind: str, name: str, n_seeds: int) -> tuple[list[StudyPart], list[SummaryTable]]:
        taken[kind] = n_seeds
        return [], []

    monkeypatch.setattr(reproduce, "_run_task", record)
    note = reproduce_song2016(ReproductionRequest(seeds=100, jobs=1, only=("fig 9", "table 1", "fig 3"))).summary.notes[
        1
    ]
    assert taken == {"warnings": 100, "sensitivity": 10, "table 1": 20, "prediction": 20}
    assert note == "100 seeds of warnings and control; 20 seeds of table 1, predicted paths; 10 seeds of moved choices"
