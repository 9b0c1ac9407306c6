"""`septentrio_gnss_driver/PVTGeodetic` and `INSNavGeod`: the SBF blocks of the same names.

Latitude and longitude are radians. -2e10 and the largest unsigned number say "do not use". The heading of `INSNavGeod`
is not read: an option of the driver turns its axes, and the message does not tell.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.builders.gnss import (
    GnssFix,
    covariance_of_east_north_sigmas,
    plane_covariances_of_same_variance,
)
from cwcli.signals.columns import Columns, FloatArray, StampsNsAndIsGiven
from cwcli.signals.gnss_time import utc_ns_and_is_time_from_gps_weeks
from cwcli.signals.leaf_fields import read_numbers, read_stamps
from cwcli.signals.quality import RowLedger

PVT_MODE_BITS = 15
"""The bits of `mode` that hold the type of the solution; 0 is no solution (SBF reference guide)."""
MIN_MAGNITUDE_OF_DO_NOT_USE_NUMBER = 1e10
"""The magnitude from which a number means "do not use"; SBF writes -2e10."""
DO_NOT_USE_UINT16, DO_NOT_USE_UINT32 = 65_535, 4_294_967_295
"""The unsigned numbers of 16 and 32 bits that mean "do not use" (SBF reference guide)."""
M_PER_CM = 1e-2
"""One centimetre in metres."""
TWO_DRMS_PER_SIGMA = 2.0 * 2.0**0.5
"""The ratio of 2DRMS to the sigma along one axis: `h_accuracy` is twice the root mean square distance, sqrt(2) sigmas
of an axis each."""


def read_ins_nav_geod(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read position and velocity of `INSNavGeod`, fused with an IMU."""
    east, north = _read_usable_numbers(columns, "longitude_std_dev"), _read_usable_numbers(columns, "latitude_std_dev")
    velocity_east, velocity_north = (
        _read_usable_numbers(columns, "ve_std_dev"),
        _read_usable_numbers(columns, "vn_std_dev"),
    )
    return GnssFix(
        *_read_stamps_or_gps_time_and_is_usable(columns, ledger),
        is_fix=read_numbers(columns, "error") == 0,
        latitude_deg=np.rad2deg(_read_usable_numbers(columns, "latitude")),
        longitude_deg=np.rad2deg(_read_usable_numbers(columns, "longitude")),
        altitude_m=_read_usable_numbers(columns, "height"),
        position_covariance_m2=covariance_of_east_north_sigmas(east, north),
        velocity_mps=np.stack([_read_usable_numbers(columns, "ve"), _read_usable_numbers(columns, "vn")], axis=1),
        velocity_covariance_m2ps2=covariance_of_east_north_sigmas(velocity_east, velocity_north),
    )


def read_pvt_geodetic(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read position and velocity of `PVTGeodetic`."""
    mode = read_numbers(columns, "mode")
    is_octet = (mode >= 0) & (mode <= 255)
    is_placed = (np.where(is_octet, mode, 0.0).astype(np.int64) & PVT_MODE_BITS) > 0
    accuracy = read_numbers(columns, "h_accuracy")
    sigma_m = (
        M_PER_CM * np.where((accuracy > 0) & (accuracy < DO_NOT_USE_UINT16), accuracy, np.nan) / TWO_DRMS_PER_SIGMA
    )
    return GnssFix(
        *_read_stamps_or_gps_time_and_is_usable(columns, ledger),
        is_fix=is_placed & (read_numbers(columns, "error") == 0),
        latitude_deg=np.rad2deg(_read_usable_numbers(columns, "latitude")),
        longitude_deg=np.rad2deg(_read_usable_numbers(columns, "longitude")),
        altitude_m=_read_usable_numbers(columns, "height"),
        position_covariance_m2=plane_covariances_of_same_variance(sigma_m**2),
        velocity_mps=np.stack([_read_usable_numbers(columns, "ve"), _read_usable_numbers(columns, "vn")], axis=1),
    )


def _read_stamps_or_gps_time_and_is_usable(columns: Columns, ledger: RowLedger) -> StampsNsAndIsGiven:
    """Return stamps in ns and whether they are usable, both (n,): the header's, else GPS week and time of week."""
    stamp_ns, has_stamp = read_stamps(columns)
    week, time_of_week_ms = read_numbers(columns, "block_header.wnc"), read_numbers(columns, "block_header.tow")
    is_told = (week != DO_NOT_USE_UINT16) & (time_of_week_ms != DO_NOT_USE_UINT32)
    gps_ns, is_time = utc_ns_and_is_time_from_gps_weeks(ledger, week, time_of_week_ms, ~has_stamp & is_told)
    return np.where(has_stamp, stamp_ns, gps_ns), has_stamp | is_time


def _read_usable_numbers(columns: Columns, name: str) -> FloatArray:
    values = read_numbers(columns, name)
    return np.where(np.abs(values) < MIN_MAGNITUDE_OF_DO_NOT_USE_NUMBER, values, np.nan)
