"""Angles: wrapping, unwrapping, and the one place where compass degrees and map headings meet.

A heading inside cwcli is in radians, counter-clockwise from east.
A compass course is in degrees, clockwise from north.
"""

from __future__ import annotations

from typing import overload

import numpy as np

from cwcli.signals.columns import FloatArray

TWO_PI = 2.0 * np.pi
"""One full turn, in radians."""


@overload
def wrap_angle(angle_rad: float) -> float: ...
@overload
def wrap_angle(angle_rad: FloatArray) -> FloatArray: ...
def wrap_angle(angle_rad: FloatArray | float) -> FloatArray | float:
    """Bring angles into (-pi, pi]; NaN stays NaN.

    An angle that is inside already comes back with its bits unchanged.

    Args:
        angle_rad: A scalar or any shape, radians. Infinity gives NaN.

    Returns:
        The same shape, in (-pi, pi].
    """
    angle = np.asarray(angle_rad, dtype=np.float64)
    is_inside = (angle > -np.pi) & (angle <= np.pi)
    with np.errstate(invalid="ignore"):
        reduced = np.pi - np.mod(np.pi - angle, TWO_PI)
    reduced = np.where(reduced <= -np.pi, np.pi, reduced)  # rounding of mod can reach 2 pi itself
    wrapped = np.where(is_inside, angle, reduced)
    return float(wrapped) if wrapped.ndim == 0 else wrapped


@overload
def heading_from_compass_deg(compass_deg: float) -> float: ...
@overload
def heading_from_compass_deg(compass_deg: FloatArray) -> FloatArray: ...
def heading_from_compass_deg(compass_deg: FloatArray | float) -> FloatArray | float:
    """Heading (radians ccw from east, in (-pi, pi]) of a compass course (degrees clockwise from north); any shape."""
    course = np.asarray(compass_deg, dtype=np.float64)
    heading = wrap_angle(np.deg2rad(90.0 - course))
    return float(heading) if course.ndim == 0 else heading


@overload
def compass_deg_from_heading(heading_rad: float) -> float: ...
@overload
def compass_deg_from_heading(heading_rad: FloatArray) -> FloatArray: ...
def compass_deg_from_heading(heading_rad: FloatArray | float) -> FloatArray | float:
    """Compass course (degrees clockwise from north, in [0, 360)) of a heading (radians ccw from east), of any shape."""
    heading = np.asarray(heading_rad, dtype=np.float64)
    with np.errstate(invalid="ignore"):
        course = np.mod(90.0 - np.rad2deg(heading), 360.0)
    course = np.where(course >= 360.0, 0.0, course)  # mod of a tiny negative number rounds to 360
    return float(course) if course.ndim == 0 else course


def rotation_matrices_of_unit_quaternions(xyzw: FloatArray) -> FloatArray:
    """Return rotation matrices (n, 3, 3) from the turned axes to the others, of quaternions x, y, z, w (4, n)."""
    x, y, z, w = xyzw
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)
