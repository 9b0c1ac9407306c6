"""Fewer points: extremes, bands, dots and tracks survive."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from cwcli.report.decimate import (
    first_row_per_grid_cell,
    min_max_row_indices,
    reduce_band_to_rows_and_bounds,
    simplified_track_row_indices,
)


def distance_to_line(points: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Least distance of each point to a polyline, by brute force over its segments."""
    best = np.full(len(points), np.inf)
    for start, end in pairwise(line):
        along = end - start
        length = float(along @ along) or 1.0
        share = np.clip((points - start) @ along / length, 0.0, 1.0)
        best = np.minimum(best, np.hypot(*(points - start - share[:, None] * along).T))
    return best


def test_envelope_keeps_a_single_spike_and_both_ends() -> None:
    values = np.zeros(10_000)
    values[4321], values[777] = 5.0, -3.0
    rows = min_max_row_indices(values, 100)
    assert {0, 777, 4321, 9_999} <= set(rows.tolist())
    assert len(rows) <= 2 * 100 + 2
    assert (np.diff(rows) > 0).all()


def test_envelope_keeps_the_extremes_of_every_piece() -> None:
    values = np.random.default_rng(3).normal(size=5_000)
    rows = min_max_row_indices(values, 50)
    for piece in np.array_split(np.arange(5_000), 50):
        kept = values[np.intersect1d(rows, piece)]
        assert kept.min() == values[piece].min()
        assert kept.max() == values[piece].max()


def test_envelope_of_a_short_signal_is_all_of_it() -> None:
    assert min_max_row_indices(np.arange(20.0), 10).tolist() == list(range(20))


def test_envelope_keeps_a_gap() -> None:
    values = np.ones(1_000)
    values[500:510] = np.nan
    rows = min_max_row_indices(values, 20)
    assert np.isnan(values[rows]).any()


def test_band_covers_every_sample() -> None:
    rng = np.random.default_rng(4)
    middle, sigma = rng.normal(size=3_000), rng.uniform(0.1, 1.0, 3_000)
    rows, lower, upper = reduce_band_to_rows_and_bounds(middle - sigma, middle + sigma, 60)
    for piece, low, high, row in zip(np.split(np.arange(3_000), 60), lower, upper, rows, strict=True):
        assert low == (middle - sigma)[piece].min()
        assert high == (middle + sigma)[piece].max()
        assert row in piece


def test_spots_are_drawn_once_and_outliers_stay() -> None:
    x, y = np.repeat([0.0, 1.0], 500), np.zeros(1_000)
    x, y = np.append(x, 0.5), np.append(y, 9.0)
    assert first_row_per_grid_cell(x, y, 10, 10).tolist() == [0, 500, 1_000]


def test_spots_leave_out_what_is_not_finite() -> None:
    x = np.array([np.nan, 1.0, 2.0])
    assert first_row_per_grid_cell(x, np.array([0.0, np.nan, 5.0]), 10, 10).tolist() == [2]


@pytest.mark.parametrize("tolerance_m", [0.05, 0.5])
def test_track_keeps_every_point_within_the_tolerance(tolerance_m: float) -> None:
    angle = np.linspace(0.0, 4.0, 2_000)
    xy = np.column_stack([50.0 * np.cos(angle), 30.0 * np.sin(2.0 * angle)])
    rows = simplified_track_row_indices(xy, tolerance_m)
    assert len(rows) < 400
    assert distance_to_line(xy, xy[rows]).max() <= tolerance_m + 1e-9


def test_track_of_a_standing_car_and_with_a_gap() -> None:
    xy = np.zeros((100, 2))
    xy[60:] = [5.0, 5.0]
    xy[50] = np.nan
    rows = simplified_track_row_indices(xy, 0.1).tolist()
    assert {0, 49, 50, 51, 59, 60, 99} >= set(rows) >= {0, 49, 50, 51, 99}
