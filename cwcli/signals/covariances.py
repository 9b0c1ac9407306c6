"""Covariances in messages: which count as given, and error ellipses converted to east-north."""

from __future__ import annotations

import numpy as np

from cwcli.signals.columns import BoolArray, FloatArray
from cwcli.signals.quality import RowLedger

SIGMAS_PER_95_PERCENT_HALF_WIDTH = 1.959964
"""Half-width of the central 95 % interval of a normal distribution, in standard deviations."""
SIGMAS_PER_95_PERCENT_ELLIPSE_RADIUS = 2.447747
"""Radius that holds 95 % of a two-dimensional normal distribution: sqrt(5.9915), chi-square with 2 degrees."""

MIN_MEASUREMENT_VARIANCE = 1e-18
"""The least variance that a measurement can have, in the square of its SI unit (a nanometre's); chosen by hand."""
UNUSABLE_COVARIANCE_REASON = "covariance unusable, left out"
"""The reason for leaving out a covariance that is not positive definite, or a variance that is invalid."""


def usable_variances_or_nan(ledger: RowLedger, variance: FloatArray) -> FloatArray:
    """Replace variances that mean "not given" or are invalid by NaN; invalid ones are counted as repairs.

    Zero means "not filled in" in ROS messages, -1 "not measured" (`sensor_msgs/Imu`). Another negative one, an
    infinite one or one below `MIN_MEASUREMENT_VARIANCE` is a fault: counted as a repair.

    Args:
        variance: Shape (n,) or (n, k).

    Returns:
        The same shape: positive and finite, or NaN.
    """
    table = variance[:, None] if variance.ndim == 1 else variance
    is_given = np.isfinite(table) & (table >= MIN_MEASUREMENT_VARIANCE)
    is_wrong = np.isinf(table) | (table < MIN_MEASUREMENT_VARIANCE) & (table != 0.0) & (table != -1.0)
    ledger.count_repaired(is_wrong.any(axis=1), UNUSABLE_COVARIANCE_REASON)
    return np.where(is_given, table, np.nan).reshape(variance.shape)


def usable_plane_covariance_or_nan(ledger: RowLedger, xx: FloatArray, xy: FloatArray, yy: FloatArray) -> FloatArray:
    """Return plane covariances (n, 3), NaN where not given or not positive definite; the latter are counted.

    Args:
        xx, xy, yy: Shape (n,). All zero, or NaN in any, means not given.
    """
    covariance = np.stack([xx, xy, yy], axis=1)
    is_absent = np.isnan(covariance).any(axis=1) | ((xx == 0.0) & (yy == 0.0)) | (xx == -1.0)
    with np.errstate(invalid="ignore", over="ignore"):
        is_definite = (
            (xx >= MIN_MEASUREMENT_VARIANCE)
            & (yy >= MIN_MEASUREMENT_VARIANCE)
            & (xx * yy > xy * xy)
            & np.isfinite(covariance).all(axis=1)
        )
    ledger.count_repaired(~is_absent & ~is_definite, UNUSABLE_COVARIANCE_REASON)
    return np.where((is_definite & ~is_absent)[:, None], covariance, np.nan)


def xx_xy_yy_covariance_in_turned_axes(covariance: FloatArray, angle_rad: FloatArray) -> FloatArray:
    """Rotate plane covariances into axes that are turned counter-clockwise by an angle.

    Args:
        covariance: Shape (..., 3): xx, xy, yy.
        angle_rad: Shape (...), or one that broadcasts with it. With a heading, what comes out is along and across it.
    """
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    xx, xy, yy = np.moveaxis(covariance, -1, 0)
    return np.stack(
        [
            cos**2 * xx + 2.0 * cos * sin * xy + sin**2 * yy,
            cos * sin * (yy - xx) + (cos**2 - sin**2) * xy,
            sin**2 * xx - 2.0 * cos * sin * xy + cos**2 * yy,
        ],
        axis=-1,
    )


def east_north_covariance_from_ellipse(
    semi_major_sigma_m: FloatArray, semi_minor_sigma_m: FloatArray, major_compass_deg: FloatArray
) -> FloatArray:
    """Return the east-north covariance of an error ellipse.

    Where the orientation is not given, the larger axis is taken in all directions.

    Args:
        semi_major_sigma_m, semi_minor_sigma_m: Shape (n,), one standard deviation along each axis; NaN is not given.
        major_compass_deg: Shape (n,), direction of the major axis, degrees clockwise from north; NaN is not given.

    Returns:
        Shape (n, 3): east-east, east-north, north-north, m^2. NaN where an axis is not given.
    """
    larger = np.fmax(semi_major_sigma_m, semi_minor_sigma_m) + 0.0 * (semi_major_sigma_m + semi_minor_sigma_m)
    is_round: BoolArray = ~np.isfinite(major_compass_deg)
    major_var = np.where(is_round, larger, semi_major_sigma_m) ** 2
    minor_var = np.where(is_round, larger, semi_minor_sigma_m) ** 2
    azimuth_rad = np.deg2rad(np.where(is_round, 0.0, major_compass_deg))
    east, north = np.sin(azimuth_rad), np.cos(azimuth_rad)  # unit vector of the major axis
    return np.stack(
        [
            major_var * east**2 + minor_var * north**2,
            (major_var - minor_var) * east * north,
            major_var * north**2 + minor_var * east**2,
        ],
        axis=1,
    )
