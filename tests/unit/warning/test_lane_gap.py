"""Where boundaries are along a path in tight bends: circles by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cwcli.prediction.paths import Paths
from cwcli.warning.lane_departure import FrontAxle, LaneBoundaries, LaneDepartureConfig, evaluate_lane_departure
from cwcli.warning.lane_gap import boundary_y_and_direction_at_distances, first_crossing_time_s, last_known_gap_m

RADIUS_M, HALF_LANE_M = 23.0, 1.8


def test_a_boundary_is_a_circle_ahead_and_is_told_a_little_behind_the_camera() -> None:
    # 50 m to the left through (0, 1): y = 51 - sqrt(50^2 - x^2), and its direction there is asin(x / 50)
    line = np.array([[1.0, 0.0, 0.02]])
    y_m, direction_rad = boundary_y_and_direction_at_distances(line, np.array([[-1.0, 0.0, 30.0, 60.0]]), np.zeros(1))
    np.testing.assert_allclose(y_m[0], [1.01, 1.0, 11.0, math.nan])
    np.testing.assert_allclose(direction_rad[0], [-math.atan(0.02), 0.0, math.asin(0.6), math.nan])


def test_the_last_gap_is_the_last_that_is_known() -> None:
    gap_m = np.array([[0.9, 0.8, math.nan], [0.9, 0.8, 0.7], [math.nan, math.nan, math.nan]])
    np.testing.assert_allclose(last_known_gap_m(gap_m), [0.8, 0.7, math.nan])


def test_the_crossing_is_between_points() -> None:
    gap_m = np.array([[0.3, 0.1, -0.1], [0.3, 0.2, math.nan], [-0.1, 0.0, 0.1], [math.nan, 0.1, -0.1]])
    np.testing.assert_allclose(first_crossing_time_s(np.array([0.0, 1.0, 2.0]), gap_m), [1.5, math.inf, 0.0, math.nan])


def test_a_gap_that_is_not_known_hides_no_crossing_behind_it() -> None:
    gap_m = np.array([[1.0, math.nan, -1.0, -2.0], [1.0, 0.5, -0.5, math.nan]])
    np.testing.assert_allclose(first_crossing_time_s(np.array([0.0, 1.0, 2.0, 3.0]), gap_m), [2.0, 1.5])


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("outwards_mps", [0.0, 0.5])
def test_a_ramp_that_is_kept_is_silent_and_one_that_is_left_is_not(side: float, outwards_mps: float) -> None:
    """2 s at 10 m/s round 23 m turn the car by 50 degrees; the parabolas that touch are 1.6 m beside the lane then."""
    n, time_s = 20, np.arange(41.0) * 0.05
    begun_m = outwards_mps * 0.1 * np.arange(n)[:, None]  # so far the car has drifted, frame by frame
    angle_rad = np.tile(10.0 / RADIUS_M * time_s, (n, 1))
    radius_m = RADIUS_M + begun_m + outwards_mps * time_s
    x_m, y_m = radius_m * np.sin(angle_rad), side * (RADIUS_M + begun_m - radius_m * np.cos(angle_rad))
    covariance = np.zeros((n, len(time_s), 3))
    covariance[..., 2] = 1e-4
    paths = Paths(time_s, x_m, y_m, side * angle_rad, np.full_like(x_m, 10.0), covariance)
    left, right = (
        np.column_stack(
            [
                sign * HALF_LANE_M + side * begun_m[:, 0],
                np.zeros(n),
                np.full(n, side / (RADIUS_M - side * sign * HALF_LANE_M)),
            ]
        )
        for sign in (1.0, -1.0)
    )
    stamp_ns = np.arange(n, dtype=np.int64) * 100_000_000
    speed_mps, rule = np.full(n, 10.0), LaneDepartureConfig(min_speed_mps=5.0)
    result = evaluate_lane_departure(
        stamp_ns, stamp_ns, paths, LaneBoundaries(left, right), speed_mps, rule, host=FrontAxle(1.8, 1e-9)
    )
    outer = "right" if side > 0.0 else "left"
    first = result.series.rows_as_dicts()[0]
    # the tyre is 0.9 m inside at first: 1.8 s at 0.5 m/s
    expected_s = 0.9 / outwards_mps if outwards_mps else math.inf
    assert first[f"{outer}_time_to_line_crossing_s"] == pytest.approx(expected_s, abs=0.1)
    assert [event["side"] for event in result.events.rows_as_dicts()] == ([outer] if outwards_mps else [])
