"""`ublox_msgs/NavPVT`: u-blox's position, velocity and time, UBX-NAV-PVT (0x01 0x07). It has no header.

Its time is that of the epoch, in UTC, once the receiver says that date and time are valid and resolved.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.builders.gnss import (
    GnssFix,
    heading_builder,
    heading_of_compass,
    position_builder,
    round_covariance,
    velocity_builder,
)
from cwcli.signals.columns import Columns
from cwcli.signals.gnss_time import unrolled, utc_of_date
from cwcli.signals.leaf_fields import matrix, numbers
from cwcli.signals.quality import BoolArray, RowLedger

NO_FIX, TIME_ONLY = 0, 5
"""The fix types without a fix and with time only (u-blox interface description)."""
VALID_TIME = 0b111
"""The bits of `valid` that must be set: valid date, valid time, fully resolved."""
GNSS_FIX_OK, HEADING_OF_VEHICLE = 1, 32
"""The bits of `flags` that say that the fix is valid and that the vehicle's heading is valid."""
INVALID_PLACE = 1
"""The bit of `reserved1` (`flags3` of newer receivers) that marks the position as invalid."""
DEG_PER_COUNT, COMPASS_DEG_PER_COUNT = 1e-7, 1e-5
"""One count of a position and of a heading, in degrees."""
M_PER_MM = 1e-3
"""One millimetre in metres."""


def read_nav_pvt(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read position, velocity and heading; `h_acc` and `s_acc` are one sigma along each axis, as in u-blox's ROS
    driver."""
    parts = ("year", "month", "day", "hour", "min", "sec", "nano")
    year, month, day, hour, minute, second, nano = (numbers(columns, name) for name in parts)
    stamp_ns, is_time = utc_of_date(year, month, day, 3600.0 * hour + 60.0 * minute + second, nano)
    is_time &= _has_bits(columns, "valid", VALID_TIME) & (hour < 24) & (minute < 60) & (second <= 60)
    fix_type = numbers(columns, "fix_type", "fixType")
    is_invalid = np.isin(matrix(columns, "reserved1", 6)[:, 0] % 2, INVALID_PLACE)
    is_placed = ~is_invalid & (fix_type > NO_FIX) & (fix_type < TIME_ONLY) & _has_bits(columns, "flags", GNSS_FIX_OK)
    compass_deg = COMPASS_DEG_PER_COUNT * numbers(columns, "head_veh", "headVeh")
    heading_sigma = np.deg2rad(COMPASS_DEG_PER_COUNT * numbers(columns, "head_acc", "headAcc"))
    has_heading = _has_bits(columns, "flags", HEADING_OF_VEHICLE)
    position_sigma, velocity_sigma = (
        M_PER_MM * numbers(columns, *names) for names in (("h_acc", "hAcc"), ("s_acc", "sAcc"))
    )
    velocity = [M_PER_MM * numbers(columns, *names) for names in (("vel_e", "velE"), ("vel_n", "velN"))]
    with np.errstate(over="ignore"):
        return GnssFix(
            unrolled(ledger, stamp_ns, is_time),
            is_time,
            is_fix=is_placed,
            latitude_deg=DEG_PER_COUNT * numbers(columns, "lat"),
            longitude_deg=DEG_PER_COUNT * numbers(columns, "lon"),
            altitude_m=M_PER_MM * numbers(columns, "height"),
            position_covariance_m2=round_covariance(position_sigma**2),
            velocity_mps=np.stack(velocity, axis=1),
            velocity_covariance_m2ps2=round_covariance(velocity_sigma**2),
            heading_rad=np.where(has_heading, heading_of_compass(compass_deg), np.nan),
            heading_variance_rad2=heading_sigma**2,
        )


build_position = position_builder(read_nav_pvt)
build_velocity = velocity_builder(read_nav_pvt)
build_heading = heading_builder(read_nav_pvt)


def _has_bits(columns: Columns, name: str, bits: int) -> BoolArray:
    """Return where all these bits of an 8-bit field are set, (n,)."""
    values = numbers(columns, name)
    is_octet = (values >= 0) & (values <= 255)
    has_all: BoolArray = is_octet & (np.where(is_octet, values, 0.0).astype(np.int64) & bits == bits)
    return has_all
