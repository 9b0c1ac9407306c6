"""`septentrio_gnss_driver/PVTGeodetic` and `INSNavGeod`: the SBF blocks of the same names.

Latitude and longitude are radians. -2e10 and the largest unsigned number say "do not use". The heading of `INSNavGeod`
is not read: an option of the driver turns its axes, and the message does not tell.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.builders.gnss import GnssFix, axes_covariance, position_builder, round_covariance, velocity_builder
from cwcli.signals.columns import Columns, FloatArray, Int64Array
from cwcli.signals.gnss_time import utc_of_weeks
from cwcli.signals.leaf_fields import numbers, stamps
from cwcli.signals.quality import BoolArray, RowLedger

MODE_BITS = 15
"""The bits of `mode` that hold the type of the solution; 0 is no solution (SBF reference guide)."""
MAX_VALUE = 1e10
"""The magnitude from which a number means "do not use"; SBF writes -2e10."""
NO_UINT16, NO_UINT32 = 65_535, 4_294_967_295
"""The unsigned numbers of 16 and 32 bits that mean "do not use" (SBF reference guide)."""
M_PER_CM = 1e-2
"""One centimetre in metres."""
DRMS2_PER_SIGMA = 2.0 * 2.0**0.5
"""The ratio of 2DRMS to the sigma along one axis: `h_accuracy` is twice the root mean square distance, sqrt(2) sigmas
of an axis each."""


def read_ins_nav_geod(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read position and velocity of `INSNavGeod`, fused with an IMU."""
    east, north = _usable(columns, "longitude_std_dev"), _usable(columns, "latitude_std_dev")
    velocity_east, velocity_north = _usable(columns, "ve_std_dev"), _usable(columns, "vn_std_dev")
    return GnssFix(
        *_times(columns, ledger),
        is_fix=numbers(columns, "error") == 0,
        latitude_deg=np.rad2deg(_usable(columns, "latitude")),
        longitude_deg=np.rad2deg(_usable(columns, "longitude")),
        altitude_m=_usable(columns, "height"),
        position_covariance_m2=axes_covariance(east, north),
        velocity_mps=np.stack([_usable(columns, "ve"), _usable(columns, "vn")], axis=1),
        velocity_covariance_m2ps2=axes_covariance(velocity_east, velocity_north),
    )


def read_pvt_geodetic(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read position and velocity of `PVTGeodetic`."""
    mode = numbers(columns, "mode")
    is_octet = (mode >= 0) & (mode <= 255)
    is_placed = (np.where(is_octet, mode, 0.0).astype(np.int64) & MODE_BITS) > 0
    accuracy = numbers(columns, "h_accuracy")
    sigma_m = M_PER_CM * np.where((accuracy > 0) & (accuracy < NO_UINT16), accuracy, np.nan) / DRMS2_PER_SIGMA
    return GnssFix(
        *_times(columns, ledger),
        is_fix=is_placed & (numbers(columns, "error") == 0),
        latitude_deg=np.rad2deg(_usable(columns, "latitude")),
        longitude_deg=np.rad2deg(_usable(columns, "longitude")),
        altitude_m=_usable(columns, "height"),
        position_covariance_m2=round_covariance(sigma_m**2),
        velocity_mps=np.stack([_usable(columns, "ve"), _usable(columns, "vn")], axis=1),
    )


build_position = position_builder(read_pvt_geodetic)
build_velocity = velocity_builder(read_pvt_geodetic)
build_ins_position = position_builder(read_ins_nav_geod)
build_ins_velocity = velocity_builder(read_ins_nav_geod)


def _times(columns: Columns, ledger: RowLedger) -> tuple[Int64Array, BoolArray]:
    """Return stamps in ns and whether they are usable, both (n,): the header's, else GPS week and time of week."""
    stamp_ns, has_stamp = stamps(columns)
    week, time_of_week_ms = numbers(columns, "block_header.wnc"), numbers(columns, "block_header.tow")
    is_told = (week != NO_UINT16) & (time_of_week_ms != NO_UINT32)
    gps_ns, is_time = utc_of_weeks(ledger, week, time_of_week_ms, ~has_stamp & is_told)
    return np.where(has_stamp, stamp_ns, gps_ns), has_stamp | is_time


def _usable(columns: Columns, name: str) -> FloatArray:
    values = numbers(columns, name)
    return np.where(np.abs(values) < MAX_VALUE, values, np.nan)
