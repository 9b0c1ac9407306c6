"""xiang2019: a small version of the reproduction. The full one, 1,000 seeds: docs/papers/xiang2019.md."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest

from cwcli.cli.main import run_command_line
from cwcli.reproduction.classes import DIFFERS, REPRODUCED, WITHIN_OWN_BOUND, Finding
from cwcli.reproduction.expectations import load_expectations
from cwcli.reproduction.xiang2019 import report
from cwcli.reproduction.xiang2019.figures import distance_errors_plot, measured_numbers_of_tables
from cwcli.reproduction.xiang2019.reproduce import (
    ASSUMED_SCENE_NOISE,
    PAPER_FILTER_CONFIG,
    PAPER_TABLE_1_MEAN_SQUARE_ERRORS_PER_MILLE_M2,
    compute_tables,
    detection_rows_of_scene,
)
from cwcli.reproduction.xiang2019.sentences import ukf_against_ekf_sentences
from cwcli.simulation.dual_sensor import PAPER_STATIC_RANGES_M, simulate_static_target
from cwcli.tracking.single_target import filter_single_target

N_SEEDS = 30


@pytest.fixture(scope="module")
def small():
    return compute_tables(N_SEEDS)


def column(table, name):
    return np.array(table[name], float)


def test_table_1_of_the_paper_is_typed_right() -> None:
    for name, (x, y) in {"ekf": (4.24, 6.15), "ukf": (2.99, 4.83)}.items():
        assert np.mean(PAPER_TABLE_1_MEAN_SQUARE_ERRORS_PER_MILLE_M2[name]["x"]) == pytest.approx(x, abs=0.006)
        assert np.mean(PAPER_TABLE_1_MEAN_SQUARE_ERRORS_PER_MILLE_M2[name]["y"]) == pytest.approx(y, abs=0.006)


def test_figure_6_combining_is_better_than_either_sensor_s_single_looks(small) -> None:
    table = small["figure_6"]
    assert table["range_m"] == list(PAPER_STATIC_RANGES_M)
    assert (column(table, "lidar_error_m") < column(table, "radar_error_m")).all()
    assert (column(table, "lidar_single_gain_pct") > 20.0).all()  # the paper's lower ends
    assert (column(table, "radar_single_gain_pct") > 50.0).all()


def test_figure_6_like_for_like_is_what_the_noises_say(small) -> None:
    """Inverse-variance weights: sqrt(1 + (0.10 / 0.25)^2) = 1.077 for the lidar, the other way 2.69 for the radar."""
    both = column(small["figure_6"], "combined_error_m").mean()
    lidar, radar = (column(small["figure_6"], f"{sensor}_error_m").mean() for sensor in ("lidar", "radar"))
    assert lidar / both == pytest.approx(
        np.sqrt(1 + (ASSUMED_SCENE_NOISE.lidar_m / ASSUMED_SCENE_NOISE.range_m) ** 2), rel=0.1
    )
    assert radar / both == pytest.approx(
        np.sqrt(1 + (ASSUMED_SCENE_NOISE.range_m / ASSUMED_SCENE_NOISE.lidar_m) ** 2), rel=0.15
    )


def test_figure_6_at_long_range_is_the_weighted_mean_of_the_looks() -> None:
    """A standing target straight ahead: the filter must give the inverse-variance mean of the eight looks."""
    scene = simulate_static_target(15.2, 8, ASSUMED_SCENE_NOISE, np.random.default_rng(0))
    state = filter_single_target(
        detection_rows_of_scene(scene, ASSUMED_SCENE_NOISE),
        replace(PAPER_FILTER_CONFIG, noise=1e-6, start_speed_mps=1e-6),
    ).state[-1]
    weight = np.array([1 / ASSUMED_SCENE_NOISE.lidar_m**2, 1 / ASSUMED_SCENE_NOISE.range_m**2])
    mean = (weight * [scene.lidar_xy[:, 1].mean(), scene.radar[:, 0].mean()]).sum() / weight.sum()
    assert state[1] == pytest.approx(mean, abs=2e-3)  # the bearing's curvature is left


def test_figure_6_has_the_largest_errors_that_the_paper_s_percentages_allow(small) -> None:
    """At most 0.01 m for both together; the lidar alone at most 150 % worse, the radar alone at most 400 %."""
    plot = distance_errors_plot(small["figure_6"])
    printed_m = {curve.label: curve.y[0] for curve in plot.curves if "printed" in curve.label}
    assert printed_m == pytest.approx({"lidar, at most as printed": 0.025, "radar, at most as printed": 0.05})
    assert plot.level == ("all eight, at most as printed", 0.01)


def test_table_1_both_filters_reach_the_papers_ukf(small) -> None:
    table = small["table_1"]
    assert len(table["segment"]) == 8
    for name in ("ekf", "ukf"):
        assert column(table, name).mean() < column(table, "paper_ukf").mean()


def test_table_1_the_filters_do_not_differ_by_more_than_one_per_cent(small) -> None:
    table = small["table_1"]
    np.testing.assert_allclose(column(table, "ekf"), column(table, "ukf"), rtol=0.01)
    assert (column(table, "difference_low") <= column(table, "difference")).all()
    assert set(table["better"]) <= {"ukf", "ekf", "neither"}


def test_where_the_bend_is_large_the_ukf_wins(small) -> None:
    table = small["where"]
    bend, gain = column(table, "bend"), column(table, "gain_pct")
    assert (np.abs(gain[bend < 0.1]) < 2.0).all()
    assert gain[bend > 2.0].mean() > 3.0


def test_the_verdict_names_figures_tables_and_reasons(small) -> None:
    text = "\n".join(ukf_against_ekf_sentences(small))
    for word in ("Table 1", "Figure 6", "Where", "Why"):
        assert word in text


FLIPS = {  # table, its columns' new values -> what was said before, what is said instead
    "the level is reached": (
        "figure_6",
        {"combined_error_m": [0.009] * 5},
        "below 0.01 m, is reached at 0 of 5 distances",
        "below 0.01 m, is reached at 5 of 5 distances: 0.009 to 0.009 m",
    ),
    "both together are worse somewhere": (
        "figure_6",
        {"lidar_gain_pct": [-3.0, 10.0, 10.0, 10.0, 10.0]},
        "combining lowers the error",
        "combining does not always lower the error: four looks of the lidar alone are -3 to 10 % worse",
    ),
    "the UKF wins in table 1": (
        "table_1",
        {"ekf": [4.0] * 8, "ukf": [3.0] * 8, "better": ["ukf"] * 8},
        "Both filters compute nearly the same there; the paper's gap can't come from the unscented transform",
        "the UKF is better in 8, the EKF in 0, neither in 0; the UKF's mean square error differs by -25.000 %",
    ),
    "the process noise does less": (
        "settings",
        {"ekf": [2.4, 2.5, 2.5, 2.5]},
        "the paper's gap of 25 % may come from that",
        "a change of 4 %; the paper's gap of 25 % can not come from that",
    ),
    "the UKF wins nowhere": (
        "where",
        {"gain_pct": [-1.0] * 18, "better": ["ekf"] * 18},
        "arc at 50 m with 10 deg",
        "the UKF wins in 0 of 18 scenes; of the arcs it wins by more than 5 % in: none",
    ),
}


def flipped(tables, name, columns):
    other = copy.deepcopy(tables)
    other[name].update(columns)
    return other


@pytest.mark.parametrize("case", FLIPS)
def test_other_numbers_make_other_sentences(small, case) -> None:
    table, columns, before, after = FLIPS[case]
    calm = flipped(small, "figure_6", {"lidar_gain_pct": [8.0] * 5})  # whatever few seeds do
    assert before in "\n".join(ukf_against_ekf_sentences(calm))
    said = "\n".join(ukf_against_ekf_sentences(flipped(calm, table, columns)))
    assert before not in said
    assert after in said


CLASSES = {  # table, columns, the row -> its class, whether the exit code is 1
    "as it is": ("figure_6", {}, "fig 6, error of both together, largest of the five distances", DIFFERS, False),
    "the level reached": (
        "figure_6",
        {"combined_error_m": [0.009] * 5},
        "fig 6, error of both together, largest of the five distances",
        REPRODUCED,
        False,
    ),
    "a gain of the paper's size": (
        "figure_6",
        {"lidar_gain_pct": [21.0] * 5},
        "fig 6, lidar alone is worse by, four looks averaged, least",
        REPRODUCED,
        True,  # it no longer follows from the assumed noise
    ),
    "a gain that the noises do not give": (
        "figure_6",
        {"radar_gain_pct": [400.0] * 5},
        "fig 6, radar alone is worse by, four looks averaged, mean of the five distances",
        DIFFERS,
        True,
    ),
    "a filter worse than the paper's UKF": (
        "table_1",
        {"ukf": [10.0] * 8},
        "table 1, mean of the eight cells, UKF: mean square error",
        DIFFERS,
        True,
    ),
    "no worse": (
        "table_1",
        {"ukf": [3.9] * 8},
        "table 1, mean of the eight cells, UKF: mean square error",
        WITHIN_OWN_BOUND,
        False,
    ),
    "the paper's gap": (
        "table_1",
        {"gain_pct": [38.0] * 8},
        "table 1, line, x: the UKF is better by",
        REPRODUCED,
        False,
    ),
}


@pytest.mark.parametrize("case", CLASSES)
def test_classes_sentence_and_exit_code_follow_from_the_numbers(
    small, case, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    table, columns, row, reached, is_failure = CLASSES[case]
    tables = flipped(small, "figure_6", {"lidar_gain_pct": [8.0] * 5, "radar_gain_pct": [170.0] * 5})
    tables = flipped(tables, table, columns)
    expected = load_expectations("xiang2019")
    made = [
        Finding(expected.expectation_of_number(each.figure, each.what), each)
        for each in measured_numbers_of_tables(tables)
    ]
    [found] = [each for each in made if f"{each.expected.figure}, {each.expected.what}" == row]
    assert found.verdict_class_of_number == reached
    assert found.has_failed <= is_failure
    monkeypatch.setattr(report, "compute_tables", lambda n_seeds, progress, names: tables)
    code = run_command_line(["reproduce", "xiang2019"])
    said = " ".join(capsys.readouterr().err.split())
    assert code == is_failure
    assert f"exit code {code}: " in said
    assert (f"{row}: {reached} instead of" in said) == found.has_failed
    if reached != found.expected.claimed_class and not is_failure:
        assert f"{row}: {reached}, and {found.expected.claimed_class} was expected" in said
