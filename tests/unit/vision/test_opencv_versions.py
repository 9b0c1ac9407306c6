"""OpenCV 4 and 5 give the same points, and both are quiet; the one that is not installed is played by a stand-in."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from cwcli.vision.opencv_versions import OPENCV_LOG_LEVEL_FATAL, print_fatal_errors_only, undistort_points

MATRIX = np.array([[900.0, 0.0, 640.0], [0.0, 890.0, 360.0], [0.0, 0.0, 1.0]])
COEFFICIENTS = np.array([-0.31, 0.12, 1e-3, -5e-4, -0.02])
STOP = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-9)
ATOL = 1e-6
"""Of the ideal points, on the plane at depth 1; without criteria OpenCV stops after 5 rounds, farther off."""


def test_points_without_distortion_project_back_to_where_they_were() -> None:
    ideal = np.random.default_rng(3).uniform(-0.5, 0.5, (40, 2))
    seen = cv2.projectPoints(np.column_stack([ideal, np.ones(40)]), np.zeros(3), np.zeros(3), MATRIX, COEFFICIENTS)[0]
    found = undistort_points(seen.reshape(-1, 1, 2).astype(np.float64), MATRIX, COEFFICIENTS, STOP)
    np.testing.assert_allclose(found.reshape(-1, 2), ideal, atol=ATOL)


def test_opencv_4_iterates_in_a_function_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[tuple[Any, ...]] = []

    def undistort_points_iter(*arguments: Any) -> Any:
        calls.append(arguments)
        return np.zeros((2, 1, 2))

    monkeypatch.setattr(cv2, "undistortPointsIter", undistort_points_iter, raising=False)
    found = undistort_points(np.ones((2, 1, 2)), MATRIX, COEFFICIENTS, STOP)
    assert found.shape == (2, 1, 2)
    ((_, matrix, _, rotation, projection, criteria),) = calls
    assert matrix is MATRIX
    assert (rotation, projection, criteria) == (None, None, STOP)


def test_opencv_4_is_quiet_by_another_function(monkeypatch: pytest.MonkeyPatch) -> None:
    levels: list[int] = []
    monkeypatch.setattr(cv2, "setLogLevel", levels.append, raising=False)
    print_fatal_errors_only()
    assert levels == [OPENCV_LOG_LEVEL_FATAL]
