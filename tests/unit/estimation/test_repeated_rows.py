"""Rows that hold no new measurement: repeated values and straight lines between measurements."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.prepare import clean_and_sort_measurements_and_note
from cwcli.estimation.repeated_rows import find_stale_rows
from tests.unit.estimation.made_drive import made_drive

TIME_S = np.arange(0.0, 120.0, 0.1)


def fixes(time_s: np.ndarray, noise_m: float = 0.3, seed: int = 0) -> np.ndarray:
    """Positions of the drive by hand with noise, (n, 2), m."""
    drive_s, values = made_drive()
    exact = np.column_stack([np.interp(time_s, drive_s, column) for column in values[Kind.POSITION].T])
    return exact + noise_m * np.random.default_rng(seed).standard_normal(exact.shape)


def held(values: np.ndarray, time_s: np.ndarray, period_s: float) -> np.ndarray:
    """The value of the last multiple of the period at each time."""
    return values[np.searchsorted(time_s, np.floor(time_s / period_s + 1e-9) * period_s - 1e-9)]


def rounded_to_degrees(values_m: np.ndarray, digits: int) -> np.ndarray:
    """Positions as a receiver rounds them: degrees with so many digits, of 111,320 and 73,000 m."""
    size_m = np.array([73_000.0, 111_320.0])
    return np.round(values_m / size_m, digits) * size_m


@pytest.mark.parametrize("digits", [15, 7])
def test_of_fixes_once_a_second_that_are_repeated_ten_times_the_first_counts(digits: int) -> None:
    found = find_stale_rows(Kind.POSITION, TIME_S, rounded_to_degrees(held(fixes(TIME_S), TIME_S, 1.0), digits))
    np.testing.assert_array_equal(~found.is_repetition, np.arange(len(TIME_S)) % 10 == 0)
    assert found.period_s == pytest.approx(1.0)
    assert not found.is_interpolated.any()
    (note,) = found.notes_for_user("/gps", Kind.POSITION)
    assert note.startswith("/gps: 1080 of 1200 position rows repeat the value before them")


def test_ten_fixes_a_second_published_twelve_times_are_repeated_every_sixth_time() -> None:
    time_s = np.arange(0.0, 120.0, 1 / 12)
    measured_s = np.arange(0.0, 121.0, 0.1)
    values = fixes(measured_s)[np.searchsorted(measured_s, time_s + 1e-9) - 1]
    found = find_stale_rows(Kind.POSITION, time_s, values)
    assert found.is_repetition.sum() == pytest.approx(240, abs=2)  # 1440 rows of 1200 fixes


def test_repeated_fixes_with_stamps_of_whole_seconds_are_counted_without_a_warning() -> None:
    """Five fixes a second, each published twice; most neighbouring stamps are equal."""
    time_s = np.floor(TIME_S + 1e-9)
    found = find_stale_rows(Kind.POSITION, time_s, held(fixes(TIME_S), TIME_S, 0.2))
    np.testing.assert_array_equal(found.is_repetition, np.arange(len(TIME_S)) % 2 == 1)
    assert found.period_s == pytest.approx(0.2, rel=0.02)


def test_rows_of_one_stamp_are_left_alone() -> None:
    assert not find_stale_rows(
        Kind.POSITION, np.zeros_like(TIME_S), held(fixes(TIME_S), TIME_S, 0.2)
    ).repeated_or_interpolated_row_mask.any()


@pytest.mark.parametrize("kind", [Kind.SPEED, Kind.HEADING, Kind.VELOCITY])
def test_a_speed_a_heading_and_a_velocity_are_seen_to_repeat_too(kind: Kind) -> None:
    drive_s, values = made_drive()
    whole = values[kind].reshape(len(drive_s), -1)
    noisy = whole + 0.05 * np.random.default_rng(1).standard_normal(whole.shape)
    found = find_stale_rows(kind, drive_s, held(noisy, drive_s, 0.5))
    assert (~found.is_repetition).sum() == pytest.approx(240, abs=2)


def test_a_standing_car_is_measured_once_a_period() -> None:
    """Its fixes do not change: one row each second stays, so that no gap comes from it."""
    values = fixes(TIME_S)
    values = np.concatenate([values[:500], np.tile(values[500], (300, 1)), values[500:900]])
    found = find_stale_rows(Kind.POSITION, TIME_S, held(values, TIME_S, 1.0))
    assert (~found.is_repetition)[500:800].sum() == pytest.approx(30, abs=1)


def test_fixes_that_stop_while_the_car_goes_on_count_once() -> None:
    values = held(fixes(TIME_S), TIME_S, 1.0)
    values[500:600] = values[500]  # 10 s, over 100 m
    assert (~find_stale_rows(Kind.POSITION, TIME_S, values).is_repetition)[500:600].sum() == 1


@pytest.mark.parametrize("digits", [7, 6, 5])
def test_a_coarse_fix_of_a_slow_car_repeats_lawfully(digits: int) -> None:
    """It stands for a minute, and creeps with 0.3 m/s: 3 cm from row to row, where the last digit is 1.1 m."""
    way_m = np.where(TIME_S < 60.0, 0.0, 0.3 * (TIME_S - 60.0))
    values = rounded_to_degrees(np.column_stack([way_m, 0.5 * way_m]), digits)
    assert not find_stale_rows(Kind.POSITION, TIME_S, values).repeated_or_interpolated_row_mask.any()


def test_a_rounded_speed_repeats_lawfully() -> None:
    drive_s, values = made_drive()
    for step in (1.0 / 3.6, 0.02, 0.1):
        rounded = np.round(values[Kind.SPEED] / step)[:, None] * step
        assert not find_stale_rows(Kind.SPEED, drive_s, rounded).repeated_or_interpolated_row_mask.any()


def test_sound_fixes_are_all_new() -> None:
    for noise_m in (0.0, 0.01, 0.3, 3.0):
        for digits in (15, 7):
            values = rounded_to_degrees(fixes(TIME_S, noise_m), digits)
            assert not find_stale_rows(Kind.POSITION, TIME_S, values).repeated_or_interpolated_row_mask.any()


@pytest.mark.parametrize("digits", [15, 7])
def test_fixes_on_straight_lines_between_those_of_each_second_are_interpolated(digits: int) -> None:
    measured = np.arange(0.0, 120.0, 1.0)
    values = fixes(measured)
    values[50:60] = values[50]  # the car stands
    drawn = np.column_stack([np.interp(TIME_S, measured, column) for column in values.T])
    found = find_stale_rows(Kind.POSITION, TIME_S, rounded_to_degrees(drawn, digits))
    assert not found.is_repetition.any()
    assert found.period_s == pytest.approx(1.0)
    used = np.flatnonzero(~found.is_interpolated & (TIME_S <= 119.0))
    np.testing.assert_array_equal(used, np.arange(0, 1200, 10))
    assert "are interpolated between two measurements" in found.notes_for_user("/gps", Kind.POSITION)[0]


def test_an_inertial_navigator_that_is_corrected_each_second_is_not_interpolated() -> None:
    """Its track bends between the corrections, by up to 0.25 m in a second at 2 m/s^2."""
    time_s = np.arange(0.0, 100.0, 0.01)
    steps_m = 0.05 * np.random.default_rng(2).standard_normal((100, 2))
    values = fixes(time_s, 0.0) + steps_m[np.floor(time_s + 1e-9).astype(int)]
    assert not find_stale_rows(Kind.POSITION, time_s, values).repeated_or_interpolated_row_mask.any()


def test_the_estimator_gets_the_first_of_the_repeated_fixes_alone() -> None:
    stamp_ns = np.rint(TIME_S * 1e9).astype(np.int64)
    repeated = Measurements("/gps", Kind.POSITION, stamp_ns, held(fixes(TIME_S), TIME_S, 1.0))
    (cleaned,), (note,) = clean_and_sort_measurements_and_note([repeated], 0)
    np.testing.assert_array_equal(cleaned.series.values, repeated.values[::10])
    assert (cleaned.n_read, cleaned.n_repeated) == (1200, 1080)
    assert "repeat the value before them" in note
