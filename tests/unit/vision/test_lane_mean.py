"""The mean of the lanes around the best one: centre of a peak, middle of a plateau, and what has no place."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.signals.columns import FloatArray
from cwcli.vision.lane_mean import OBJECTIVE_DIFFERENCE_OF_WEIGHT_1_OVER_E, STANDARD_NORMAL_POINTS, weighted_mean_lane
from cwcli.vision.lane_model import BEND, HIGH, LOW, MIDDLE, WIDTH

SIZE = (640, 360)
LANE = np.array([320.0, 0.1, 2.4, 200.0, 160.0, 0.0])
"""u0 px, middle, width, k px^2, v0 px, spiral px^3."""
REACH = np.array([100.0, 1.0, 1.0, 4000.0, 30.0, 0.0])
TABLE = np.column_stack([LANE, np.ones(6), LANE - REACH, LANE + REACH])
NARROW = np.array([2.0, 0.02, 0.03, 60.0, 1.0, 1.0])


def peak(centre: FloatArray, sigmas: FloatArray, lanes: FloatArray) -> FloatArray:
    """A normal distribution's logarithm, as objective."""
    return np.asarray(-0.5 * OBJECTIVE_DIFFERENCE_OF_WEIGHT_1_OVER_E * (((lanes - centre) / sigmas) ** 2).sum(axis=1))


def test_points_fill_a_normal_distribution() -> None:
    np.testing.assert_allclose(STANDARD_NORMAL_POINTS.mean(axis=0), 0.0, atol=0.03)
    np.testing.assert_allclose(np.cov(STANDARD_NORMAL_POINTS.T), np.eye(5), atol=0.1)


def test_peak_beside_the_start() -> None:
    centre = LANE + 0.5 * NARROW * np.array([1.0, -1.0, 1.0, 1.0, -1.0, 0.0])
    found = weighted_mean_lane(lambda lanes: peak(centre, NARROW, lanes), LANE, TABLE, SIZE)
    assert (np.abs(found - centre) < 0.15 * NARROW).all()


def test_plateau_has_its_middle() -> None:
    # The width may be anything from 2.3 to 2.5, and the search ended at its edge: 2.31.
    def objective(lanes: FloatArray) -> FloatArray:
        rest = lanes.copy()
        rest[:, WIDTH] = LANE[WIDTH]
        return np.where(np.abs(lanes[:, WIDTH] - 2.4) < 0.1, 0.0, -1.0) + peak(LANE, NARROW, rest)

    start = LANE.copy()
    start[WIDTH] = 2.31
    found = weighted_mean_lane(objective, start, TABLE, SIZE)
    assert found[WIDTH] == pytest.approx(2.4, abs=0.02)
    assert found[MIDDLE] == pytest.approx(LANE[MIDDLE], abs=0.2 * NARROW[MIDDLE])


def test_lanes_beyond_the_bounds_move_nothing() -> None:
    found = weighted_mean_lane(lambda lanes: np.full(len(lanes), -1e30), LANE, TABLE, SIZE)
    np.testing.assert_allclose(found, LANE, rtol=1e-12)


def test_mean_lies_within_the_bounds() -> None:
    # The objective knows no bounds and likes a width beyond them.
    beyond = LANE.copy()
    beyond[WIDTH], beyond[BEND] = TABLE[WIDTH, HIGH] + 0.2, TABLE[BEND, LOW] - 100.0
    found = weighted_mean_lane(lambda lanes: peak(beyond, NARROW, lanes), beyond, TABLE, SIZE)
    assert found[WIDTH] == TABLE[WIDTH, HIGH]
    assert found[BEND] == TABLE[BEND, LOW]
