"""Fixes that are rounded, held or sent by two topics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.estimation.coarse_fixes import covariance_from_coarse_fixes, find_coarse_east_north_steps_m
from cwcli.estimation.frozen_rows import FixMotion, frozen_row_mask
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.prepare import clean_and_sort_measurements_and_note
from cwcli.estimation.source_vote import find_impossible_fixes
from tests.unit.estimation.made_drive import as_series, made_drive

TIME_S, VALUES = made_drive()
FIXES_M = VALUES[Kind.POSITION] + 0.3 * np.random.default_rng(0).standard_normal((len(TIME_S), 2))


def fixes(values: np.ndarray, source: str = "/fix") -> Measurements:
    return Measurements(source, Kind.POSITION, np.rint(TIME_S * 1e9).astype(np.int64), values)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (FIXES_M, (0.0, 0.0)),
        (np.rint(FIXES_M), (1.0, 1.0)),
        (np.floor(FIXES_M / [7.5, 1e-9]) * [7.5, 1e-9], (7.5, 0.0)),
        (np.rint(FIXES_M / 0.11) * 0.11, (0.0, 0.0)),  # 1e-6 degrees
        (np.column_stack([14.0 * np.arange(100.0), np.zeros(100)]), (0.0, 0.0)),  # exact, evenly
    ],
    ids=["fine", "whole metres", "four decimals of longitude", "six decimals", "even motion"],
)
def test_the_step_of_coarse_fixes(values: np.ndarray, expected: tuple[float, float]) -> None:
    np.testing.assert_allclose(find_coarse_east_north_steps_m(values), expected, atol=1e-6)


def test_sigma_holds_half_a_step_to_one_side() -> None:
    coarse = replace(as_series(Kind.POSITION, TIME_S, FIXES_M), coarse_steps_m=(6.0, 0.0))
    # 6^2 / 12 of rounding, and 3^2 with the probability 1/2
    np.testing.assert_allclose(np.diag(covariance_from_coarse_fixes([coarse])), [7.5, 0, 0, 0, 0, 0, 0, 0])
    fine = replace(coarse, coarse_steps_m=(0.0, 0.0))
    assert not covariance_from_coarse_fixes([coarse, fine]).any()


@pytest.mark.parametrize(("way_m", "n_held"), [(40.0, 100), (2.0, 0)])
def test_a_fix_that_is_held_while_the_car_moves_on_is_set_aside(way_m: float, n_held: int) -> None:
    held = FIXES_M.copy()
    held[301:401] = held[300]
    held[401:] += held[300] + [way_m, 0.0] - held[401]
    mask = frozen_row_mask(Kind.POSITION, TIME_S, held, FixMotion(TIME_S, held))
    assert mask.sum() == n_held
    assert mask[301:401].all() == bool(n_held)


def test_a_held_fix_may_move_in_the_map_as_its_height_goes_on() -> None:
    held = FIXES_M.copy()
    held[301:401] = held[300] + 4e-4 * np.sin(np.arange(100.0))[:, None]
    held[401:] += held[300] + [40.0, 0.0] - held[401]
    assert frozen_row_mask(Kind.POSITION, TIME_S, held, FixMotion(TIME_S, held)).sum() == 100


def test_fixes_that_are_repeated_all_the_time_are_not_stuck() -> None:
    slow = np.repeat(FIXES_M[::60], 60, axis=0)  # one each 3 s
    assert not frozen_row_mask(Kind.POSITION, TIME_S, slow, FixMotion(TIME_S, slow)).any()


def test_a_copy_is_left_out_and_a_second_receiver_is_not() -> None:
    other = FIXES_M + 0.01 * np.random.default_rng(1).standard_normal(FIXES_M.shape)
    prepared, notes = clean_and_sort_measurements_and_note(
        [fixes(FIXES_M), fixes(FIXES_M, "/b"), fixes(other, "/c")], 0
    )
    assert [len(p.series) for p in prepared] == [len(TIME_S), 0, len(TIME_S)]
    assert notes == ["/b: position is a copy of /fix, left out"]


@pytest.mark.parametrize(("factor", "n_found"), [(1.0, 0), (111_320.0, 1)])
def test_fixes_that_move_faster_than_a_car_are_told(factor: float, n_found: int) -> None:
    prepared, _ = clean_and_sort_measurements_and_note([fixes(factor * FIXES_M)], 0)
    found = find_impossible_fixes(prepared)
    assert len(found) == n_found
    assert all(each.contradiction_sentence.startswith("ego_position (/fix) contradicts how a car") for each in found)


def test_an_axis_that_never_changes_while_the_other_one_scatters_is_coarse() -> None:
    """The car drives north, and its longitudes are cut: no step is seen, but noise would have been."""
    north_m = 10.0 * np.arange(200.0)
    noise_m = np.random.default_rng(3).standard_normal(200)
    cut = np.column_stack([np.full(200, -7.4), north_m + 0.3 * noise_m])
    assert find_coarse_east_north_steps_m(cut)[0] > 5.0
    assert find_coarse_east_north_steps_m(cut)[1] == 0.0
    simulated = np.column_stack([np.zeros(200), north_m + 0.01 * noise_m])
    assert find_coarse_east_north_steps_m(simulated) == (0.0, 0.0)
    assert find_coarse_east_north_steps_m(cut[:10])[0] == 0.0
