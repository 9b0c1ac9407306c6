"""What OpenCV 4 and OpenCV 5 name differently; each function does the same with both."""

from __future__ import annotations

from typing import Any

import numpy as np

from cwcli.signals.columns import FloatArray

OPENCV_LOG_LEVEL_FATAL = 1
"""Level of OpenCV's log from which on it prints: fatal errors alone (`cv::utils::logging::LogLevel`)."""


def print_fatal_errors_only() -> None:
    """Make OpenCV print nothing of damaged frames, which are counted instead."""
    import cv2

    set_log_level = getattr(cv2, "setLogLevel", None)  # until 4
    if set_log_level is not None:
        set_log_level(OPENCV_LOG_LEVEL_FATAL)
    else:
        cv2.utils.logging.setLogLevel(OPENCV_LOG_LEVEL_FATAL)


def undistort_points(
    points_px: FloatArray, matrix: FloatArray, coefficients: FloatArray, criteria: tuple[int, int, float]
) -> FloatArray:
    """Return the ideal points of image points, distortion removed.

    Args:
        points_px: Shape (n, 1, 2).
        matrix: The matrix K of the intrinsics, shape (3, 3).
        coefficients: Of the distortion, as OpenCV orders them.
        criteria: When the iteration ends: kind, number of iterations, change of a point.

    Returns:
        Shape (n, 1, 2), on the plane at depth 1.
    """
    import cv2

    iterate: Any = getattr(cv2, "undistortPointsIter", None)  # until 4, where `undistortPoints` has no criteria
    if iterate is not None:
        return np.asarray(iterate(points_px, matrix, coefficients, None, None, criteria))
    return np.asarray(cv2.undistortPoints(points_px, matrix, coefficients, criteria=criteria))
