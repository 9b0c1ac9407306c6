"""xiang2019: a small version of the reproduction. The full one, 1,000 seeds: docs/papers/xiang2019.md."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.reproduction.xiang2019.reproduce import FILTER, NOISE, PAPER_TABLE_1, reproduce, rows_of
from cwcli.simulation.dual_sensor import PAPER_RANGES_M, static_target
from cwcli.tracking.single import run_filter

N_SEEDS = 30


@pytest.fixture(scope="module")
def small():
    return reproduce(N_SEEDS)


def column(table, name):
    return np.array(table[name], float)


def test_table_1_of_the_paper_is_typed_right():
    for name, (x, y) in {"ekf": (4.24, 6.15), "ukf": (2.99, 4.83)}.items():
        assert np.mean(PAPER_TABLE_1[name]["x"]) == pytest.approx(x, abs=0.006)
        assert np.mean(PAPER_TABLE_1[name]["y"]) == pytest.approx(y, abs=0.006)


def test_figure_6_combining_is_better_than_either_sensor_at_all_five_ranges(small):
    table = small.tables["figure_6"]
    assert table["range_m"] == list(PAPER_RANGES_M)
    assert (column(table, "combined_high_m") < column(table, "lidar_error_m")).all()
    assert (column(table, "lidar_error_m") < column(table, "radar_error_m")).all()
    assert (column(table, "lidar_gain_pct") > 20.0).all()  # the paper's lower ends
    assert (column(table, "radar_gain_pct") > 50.0).all()


def test_figure_6_at_long_range_is_the_weighted_mean_of_the_looks():
    """A standing target straight ahead: the filter must give the inverse-variance mean of the eight looks."""
    scene = static_target(15.2, 8, NOISE, np.random.default_rng(0))
    state = run_filter(rows_of(scene, NOISE), replace(FILTER, noise=1e-6, start_speed_mps=1e-6)).state[-1]
    weight = np.array([1 / NOISE.lidar_m**2, 1 / NOISE.range_m**2])
    mean = (weight * [scene.lidar_xy[:, 1].mean(), scene.radar[:, 0].mean()]).sum() / weight.sum()
    assert state[1] == pytest.approx(mean, abs=2e-3)  # the bearing's curvature is left


def test_table_1_both_filters_reach_the_papers_ukf(small):
    table = small.tables["table_1"]
    assert len(table["segment"]) == 8
    for name in ("ekf", "ukf"):
        assert column(table, name).mean() < column(table, "paper_ukf").mean()


def test_table_1_the_filters_do_not_differ_by_more_than_one_per_cent(small):
    table = small.tables["table_1"]
    np.testing.assert_allclose(column(table, "ekf"), column(table, "ukf"), rtol=0.01)
    assert (column(table, "difference_low") <= column(table, "difference")).all()
    assert set(table["better"]) <= {"ukf", "ekf", "neither"}


def test_where_the_bend_is_large_the_ukf_wins(small):
    table = small.tables["where"]
    bend, gain = column(table, "bend"), column(table, "gain_pct")
    assert (np.abs(gain[bend < 0.1]) < 2.0).all()
    assert gain[bend > 2.0].mean() > 3.0


def test_table_2_takes_less_than_the_papers_time(small):
    table = small.tables["table_2"]
    assert (column(table, "time_ms") < column(table, "paper_ms")).all()
    assert table["samples"] == [500.0, 500.0]


def test_the_verdict_names_figures_tables_and_reasons(small):
    text = "\n".join(small.verdict)
    for word in ("Table 1", "Figure 6", "Table 2", "Where", "Why"):
        assert word in text
