"""The numbers that ad-rss-lib (LGPL-2.1, Intel) expects of its formulas in its own unit tests."""

import numpy as np
import pytest

from cwcli.measures import MEASURES
from cwcli.measures.pair import ActualTrack, Pair
from cwcli.measures.safe_distance import (
    HOST_RESPONSE_TIME_S,
    MAX_ACCEL_IN_RESPONSE_TIME_MPS2,
    MIN_BRAKING_AFTER_RESPONSE_MPS2,
    OTHER_RESPONSE_TIME_S,
    safe_gap_opposite_direction_m,
    safe_gap_same_direction_m,
    safe_lateral_gap_m,
    stopping_distance_m,
)

ATOL_M = 0.02
LATERAL_ATOL_M = 0.01
KMH = 1.0 / 3.6


@pytest.mark.parametrize(("speed_kmh", "expected_m"), [(0.0, 1.1), (1.0, 1.19), (-1.0, 1.19), (5.0, 2.9), (-5.0, 2.9)])
def test_lateral_at_one_speed(speed_kmh: float, expected_m: float) -> None:
    found = safe_lateral_gap_m(speed_kmh * KMH, speed_kmh * KMH, OTHER_RESPONSE_TIME_S, OTHER_RESPONSE_TIME_S)
    assert found == pytest.approx(expected_m, abs=LATERAL_ATOL_M)


@pytest.mark.parametrize(("speed_kmh", "left_m", "right_m"), [(1.0, 1.84, 0.45), (5.0, 5.77, 0.0)])
def test_lateral_where_one_moves(speed_kmh: float, left_m: float, right_m: float) -> None:
    both = OTHER_RESPONSE_TIME_S, OTHER_RESPONSE_TIME_S
    for sign, expected in ((1.0, left_m), (-1.0, right_m)):
        margin = 0.1 if expected else 0.0  # their margin is part of the outline, and 0 is never less
        moved = safe_lateral_gap_m(sign * speed_kmh * KMH, 0.0, *both, fluctuation_m=margin)
        assert moved == pytest.approx(expected, abs=LATERAL_ATOL_M)
        mirrored = safe_lateral_gap_m(0.0, -sign * speed_kmh * KMH, *both, fluctuation_m=margin)
        assert mirrored == pytest.approx(expected, abs=LATERAL_ATOL_M)


def test_a_wider_margin_on_one_side_counts_half() -> None:
    # theirs is (mu_l + mu_r) / 2: 0.5 m more on the left is 0.25 m more
    assert safe_lateral_gap_m(0.0, 0.0, 2.0, 2.0, 0.35) - safe_lateral_gap_m(0.0, 0.0, 2.0, 2.0, 0.1) == pytest.approx(
        0.25
    )


@pytest.mark.parametrize(
    ("speed_kmh", "response_s", "accel", "braking", "expected_m"),
    [
        (100.0, OTHER_RESPONSE_TIME_S, MAX_ACCEL_IN_RESPONSE_TIME_MPS2, MIN_BRAKING_AFTER_RESPONSE_MPS2, 213.74),
        (100.0, HOST_RESPONSE_TIME_S, MAX_ACCEL_IN_RESPONSE_TIME_MPS2, MIN_BRAKING_AFTER_RESPONSE_MPS2, 151.81),
        (50.0, OTHER_RESPONSE_TIME_S, 2.0, 4.0, 71.77),
    ],
)
def test_stated_braking(speed_kmh: float, response_s: float, accel: float, braking: float, expected_m: float) -> None:
    assert stopping_distance_m(speed_kmh * KMH, response_s, accel, braking) == pytest.approx(expected_m, abs=ATOL_M)


def test_towards_each_other() -> None:
    assert safe_gap_opposite_direction_m(100.0 * KMH, 100.0 * KMH) == pytest.approx(406.32, abs=ATOL_M)


def test_behind_a_much_faster_one_nothing_is_needed() -> None:
    assert safe_gap_same_direction_m(10.0 * KMH, 100.0 * KMH, OTHER_RESPONSE_TIME_S) == 0.0


def test_lateral_pattern_against_the_acceleration() -> None:
    # speed -10 m/s, 3.5 m/s^2 for t, then braking by 4: to the metre
    expected = [-8.0, -13.0, -14.0, -10.0, 0.0, 18.0, 42.0, 72.0]
    found = [float(stopping_distance_m(-10.0, t, 3.5, 4.0)) for t in range(1, 9)]
    np.testing.assert_allclose(found, expected, atol=1.0)


def behind(gap_m: float, across_m: float = 0.0) -> Pair:
    stamps = np.arange(2) * 10**8
    host = ActualTrack(stamps, np.array([[0.0, 0.0, 20.0, 0.0]] * 2))
    other = ActualTrack(stamps, np.array([[gap_m + 4.5, across_m, 20.0, 0.0]] * 2))
    return Pair(host, other, (4.5, 1.8), (4.5, 1.8), 0.5)


@pytest.mark.parametrize(("gap_m", "across_m", "braking"), [(60.0, 0.0, 4.0), (70.0, 0.0, 0.0), (60.0, 3.5, 0.0)])
def test_proper_response(gap_m: float, across_m: float, braking: float) -> None:
    # 20 + 1.75 + 23.5^2 / 8 - 400 / 16 = 65.78 m along; across 0.625 + 0.1 m
    found = behind(gap_m, across_m).evaluate_measure(MEASURES["rss-response"])
    assert found.tolist() == [braking] * 2
    along = behind(gap_m, across_m).evaluate_measure(MEASURES["rss-long"])
    np.testing.assert_allclose(along, gap_m - 65.78125)
