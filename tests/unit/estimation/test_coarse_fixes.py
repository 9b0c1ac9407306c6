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


def evenly_driven_m(noise_m: float) -> np.ndarray:
    """Fixes ten times a second of a car that drives east at 10 m/s, with noise."""
    noise = noise_m * np.random.default_rng(1).standard_normal((600, 2))
    return np.column_stack([np.arange(600.0), np.zeros(600)]) + noise


def resting_rows(fixes_m: np.ndarray) -> np.ndarray:
    time_s = np.arange(len(fixes_m), dtype=np.float64) * 0.1
    return np.flatnonzero(frozen_row_mask(Kind.POSITION, time_s, fixes_m, FixMotion(time_s, fixes_m)))


@pytest.mark.parametrize("noise_m", [0.02, 0.5])
def test_fixes_that_rest_with_noise_while_the_car_drives_on_are_set_aside(noise_m: float) -> None:
    fixes_m = evenly_driven_m(0.5)
    noise = noise_m * np.random.default_rng(2).standard_normal((100, 2))
    fixes_m[200:300] = np.array([200.0, 0.0]) + noise  # 10 s, in which the car drives 100 m
    rows = resting_rows(fixes_m)
    assert set(rows) <= set(range(195, 300))
    assert len(rows) >= 95


def test_a_car_that_stands_and_a_way_without_a_jump_rest_lawfully() -> None:
    """It brakes within two seconds, stands for ten, and starts again; then its receiver jumps by 30 m as it stands."""
    speed = np.concatenate([np.full(200, 10.0), np.linspace(10, 0, 20), np.zeros(100), np.linspace(0, 10, 50)])
    x_m = 0.1 * np.cumsum(np.concatenate([speed, np.full(230, 10.0)]))
    fixes_m = np.column_stack([x_m, np.zeros(600)]) + 0.3 * np.random.default_rng(3).standard_normal((600, 2))
    assert not len(resting_rows(fixes_m))
    jumped = fixes_m.copy()
    jumped[280:] += [30.0, 0.0]
    assert not len(resting_rows(jumped))
    assert not len(resting_rows(np.rint(evenly_driven_m(0.5) / 11.0) * 11.0))


def test_fixes_of_two_receivers_in_turns_do_not_rest() -> None:
    """Every second fix lies 30 m to the side: a slow car stays for ten seconds within four sigmas of such a noise."""
    speed = np.repeat([10.0, 0.5, 10.0], [200, 100, 200])
    fixes_m = np.column_stack([0.1 * np.cumsum(speed), np.zeros(500)])
    fixes_m[1::2, 1] += 30.0
    assert not len(resting_rows(fixes_m))


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
