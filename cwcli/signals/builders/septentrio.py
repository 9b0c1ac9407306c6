"""`septentrio_gnss_driver/PVTGeodetic`: the SBF block of the same name.

Latitude and longitude are radians. -2e10 and the largest unsigned number say "do not use".
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.builders.gnss import GnssFix, position_builder, round_covariance, velocity_builder
from cwcli.signals.columns import Columns, FloatArray
from cwcli.signals.gnss_time import utc_of_weeks
from cwcli.signals.leaf_fields import numbers, stamps
from cwcli.signals.quality import RowLedger

MODE_BITS = 15
MAX_VALUE = 1e10
NO_UINT16, NO_UINT32 = 65_535, 4_294_967_295
M_PER_CM = 1e-2
DRMS2_PER_SIGMA = 2.0 * 2.0**0.5
"""`h_accuracy` is 2DRMS, twice the root mean square of the horizontal distance: sqrt(2) sigmas along an axis each."""


def read_pvt_geodetic(columns: Columns, ledger: RowLedger) -> GnssFix:
    """What the messages say."""
    stamp_ns, has_stamp = stamps(columns)
    week, time_of_week_ms = numbers(columns, "block_header.wnc"), numbers(columns, "block_header.tow")
    is_told = (week != NO_UINT16) & (time_of_week_ms != NO_UINT32)
    gps_ns, is_time = utc_of_weeks(ledger, week, time_of_week_ms, ~has_stamp & is_told)
    mode = numbers(columns, "mode")
    is_octet = (mode >= 0) & (mode <= 255)
    is_placed = (np.where(is_octet, mode, 0.0).astype(np.int64) & MODE_BITS) > 0
    accuracy = numbers(columns, "h_accuracy")
    sigma_m = M_PER_CM * np.where((accuracy > 0) & (accuracy < NO_UINT16), accuracy, np.nan) / DRMS2_PER_SIGMA
    return GnssFix(
        np.where(has_stamp, stamp_ns, gps_ns),
        has_stamp | is_time,
        is_fix=is_placed & (numbers(columns, "error") == 0),
        latitude_deg=np.rad2deg(_usable(columns, "latitude")),
        longitude_deg=np.rad2deg(_usable(columns, "longitude")),
        altitude_m=_usable(columns, "height"),
        position_covariance_m2=round_covariance(sigma_m**2),
        velocity_mps=np.stack([_usable(columns, "ve"), _usable(columns, "vn")], axis=1),
    )


build_position = position_builder(read_pvt_geodetic)
build_velocity = velocity_builder(read_pvt_geodetic)


def _usable(columns: Columns, name: str) -> FloatArray:
    values = numbers(columns, name)
    return np.where(np.abs(values) < MAX_VALUE, values, np.nan)
