"""`gps_msgs/GPSFix` (`gps_common/GPSFix` in ROS 1): position, and velocity by speed and track.

`err_*` are half-widths of 95 %; 0 is not given. `dip`, `pitch` and `roll` are filled differently by every driver, and
are not read.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.builders.gnss import (
    GnssFix,
    plane_covariances_of_same_variance,
    velocity_from_speed_and_course,
)
from cwcli.signals.columns import Columns, FloatArray
from cwcli.signals.covariances import (
    SIGMAS_PER_95_PERCENT_ELLIPSE_RADIUS,
    SIGMAS_PER_95_PERCENT_HALF_WIDTH,
    xx_xy_yy_covariance_in_turned_axes,
)
from cwcli.signals.leaf_fields import read_matrix, read_numbers, read_stamps
from cwcli.signals.quality import RowLedger


def read_gps_fix(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read position and velocity of the messages."""
    matrices = read_matrix(columns, "position_covariance", 9)[:, [0, 1, 4]]
    is_known = (read_numbers(columns, "position_covariance_type") > 0) & (matrices[:, 0] > 0.0)
    by_error = plane_covariances_of_same_variance(
        _one_sigma_from_stated_error(columns, "err_horz", SIGMAS_PER_95_PERCENT_ELLIPSE_RADIUS) ** 2
    )
    speed_mps, course_deg = read_numbers(columns, "speed"), read_numbers(columns, "track")
    return GnssFix(
        *read_stamps(columns),
        is_fix=~(read_numbers(columns, "status.status") < 0),
        latitude_deg=read_numbers(columns, "latitude"),
        longitude_deg=read_numbers(columns, "longitude"),
        altitude_m=read_numbers(columns, "altitude"),
        position_covariance_m2=np.where(is_known[:, None], matrices, by_error),
        velocity_mps=velocity_from_speed_and_course(speed_mps, course_deg),
        velocity_covariance_m2ps2=_velocity_covariance_from_errors(columns, speed_mps, course_deg),
    )


def _one_sigma_from_stated_error(columns: Columns, name: str, sigmas: float) -> FloatArray:
    values = read_numbers(columns, name)
    with np.errstate(over="ignore"):
        return np.where((values > 0.0) & (values < 1e6), values, np.nan) / sigmas


def _velocity_covariance_from_errors(columns: Columns, speed_mps: FloatArray, course_deg: FloatArray) -> FloatArray:
    """Return velocity covariances (n, 3) from the errors of speed and track; without a track error, they are round."""
    along = _one_sigma_from_stated_error(columns, "err_speed", SIGMAS_PER_95_PERCENT_HALF_WIDTH)
    across = np.abs(speed_mps) * np.deg2rad(
        _one_sigma_from_stated_error(columns, "err_track", SIGMAS_PER_95_PERCENT_HALF_WIDTH)
    )
    across = np.where(np.isfinite(across) & (across > 0.0), across, along)
    own = np.stack([along**2, 0.0 * along, across**2], axis=1)
    with np.errstate(invalid="ignore"):
        return xx_xy_yy_covariance_in_turned_axes(
            own, np.deg2rad(course_deg - 90.0)
        )  # from along and across back to east and north
