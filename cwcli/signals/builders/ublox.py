"""`ublox_msgs/NavPVT`: u-blox's position, velocity and time, UBX-NAV-PVT (0x01 0x07). It has no header.

Its time is that of the epoch, in UTC, once the receiver says that date and time are valid and resolved.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.builders.gnss import (
    GnssFix,
    heading_from_compass_or_nan,
    plane_covariances_of_same_variance,
)
from cwcli.signals.columns import BoolArray, Columns
from cwcli.signals.gnss_time import undo_week_rollover, utc_ns_and_is_time_from_date
from cwcli.signals.leaf_fields import read_matrix, read_numbers
from cwcli.signals.quality import RowLedger

NO_FIX_TYPE, TIME_ONLY_FIX_TYPE = 0, 5
"""The fix types without a fix and with time only (u-blox interface description)."""
VALID_TIME_BITS = 0b111
"""The bits of `valid` that must be set: valid date, valid time, fully resolved."""
FIX_OK_BIT, VEHICLE_HEADING_BIT = 1, 32
"""The bits of `flags` that say that the fix is valid and that the vehicle's heading is valid."""
INVALID_POSITION_BIT = 1
"""The bit of `reserved1` (`flags3` of newer receivers) that marks the position as invalid."""
DEG_PER_POSITION_COUNT, DEG_PER_HEADING_COUNT = 1e-7, 1e-5
"""One count of a position and of a heading, in degrees."""
M_PER_MM = 1e-3
"""One millimetre in metres."""


def read_nav_pvt(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read position, velocity and heading; `h_acc` and `s_acc` are one sigma along each axis, as in u-blox's ROS
    driver."""
    parts = ("year", "month", "day", "hour", "min", "sec", "nano")
    year, month, day, hour, minute, second, nano = (read_numbers(columns, name) for name in parts)
    stamp_ns, is_time = utc_ns_and_is_time_from_date(year, month, day, 3600.0 * hour + 60.0 * minute + second, nano)
    is_time &= _all_bits_set_mask(columns, "valid", VALID_TIME_BITS) & (hour < 24) & (minute < 60) & (second <= 60)
    fix_type = read_numbers(columns, "fix_type", "fixType")
    is_invalid = np.isin(read_matrix(columns, "reserved1", 6)[:, 0] % 2, INVALID_POSITION_BIT)
    is_placed = (
        ~is_invalid
        & (fix_type > NO_FIX_TYPE)
        & (fix_type < TIME_ONLY_FIX_TYPE)
        & _all_bits_set_mask(columns, "flags", FIX_OK_BIT)
    )
    compass_deg = DEG_PER_HEADING_COUNT * read_numbers(columns, "head_veh", "headVeh")
    heading_sigma = np.deg2rad(DEG_PER_HEADING_COUNT * read_numbers(columns, "head_acc", "headAcc"))
    has_heading = _all_bits_set_mask(columns, "flags", VEHICLE_HEADING_BIT)
    position_sigma, velocity_sigma = (
        M_PER_MM * read_numbers(columns, *names) for names in (("h_acc", "hAcc"), ("s_acc", "sAcc"))
    )
    velocity = [M_PER_MM * read_numbers(columns, *names) for names in (("vel_e", "velE"), ("vel_n", "velN"))]
    with np.errstate(over="ignore"):
        return GnssFix(
            undo_week_rollover(ledger, stamp_ns, is_time),
            is_time,
            is_fix=is_placed,
            latitude_deg=DEG_PER_POSITION_COUNT * read_numbers(columns, "lat"),
            longitude_deg=DEG_PER_POSITION_COUNT * read_numbers(columns, "lon"),
            altitude_m=M_PER_MM * read_numbers(columns, "height"),
            position_covariance_m2=plane_covariances_of_same_variance(position_sigma**2),
            velocity_mps=np.stack(velocity, axis=1),
            velocity_covariance_m2ps2=plane_covariances_of_same_variance(velocity_sigma**2),
            heading_rad=np.where(has_heading, heading_from_compass_or_nan(compass_deg), np.nan),
            heading_variance_rad2=heading_sigma**2,
        )


def _all_bits_set_mask(columns: Columns, name: str, bits: int) -> BoolArray:
    """Return where all these bits of an 8-bit field are set, (n,)."""
    values = read_numbers(columns, name)
    is_octet = (values >= 0) & (values <= 255)
    has_all: BoolArray = is_octet & (np.where(is_octet, values, 0.0).astype(np.int64) & bits == bits)
    return has_all
