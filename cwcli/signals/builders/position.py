"""GNSS fixes: `sensor_msgs/NavSatFix`, `foxglove.LocationFix`."""

from __future__ import annotations

import numpy as np

from cwcli.signals.builders.base import Reading
from cwcli.signals.canonical import PositionSignal
from cwcli.signals.clocks import build_signal_and_quality, repair_and_order_times
from cwcli.signals.columns import Columns, FloatArray, Strings
from cwcli.signals.covariances import usable_plane_covariance_or_nan
from cwcli.signals.leaf_fields import accepted_text_mask, find_field, read_matrix, read_numbers, read_stamps
from cwcli.signals.limits import MAX_ALTITUDE_M, nan_beyond_limit
from cwcli.signals.quality import Quality, RowLedger

NO_FIX_REASON = "no fix"
"""The reason for rejecting a message whose receiver has no fix."""
POSITION_NOT_A_NUMBER_REASON = "latitude or longitude not a number"
"""The reason for rejecting a position that is not a number."""
POSITION_OUT_OF_RANGE_REASON = "latitude or longitude out of range"
"""The reason for rejecting a position beyond 90 degrees of latitude or 180 degrees of longitude."""
ZERO_POSITION_REASON = "position is exactly (0, 0)"
"""The reason for rejecting the position (0, 0), which is an unset field."""


def reject_invalid_positions(ledger: RowLedger, latitude_deg: FloatArray, longitude_deg: FloatArray) -> None:
    """Reject rows whose position is not finite, out of range, or the (0, 0) of an unset field."""
    ledger.reject(~(np.isfinite(latitude_deg) & np.isfinite(longitude_deg)), POSITION_NOT_A_NUMBER_REASON)
    ledger.reject(~((np.abs(latitude_deg) <= 90.0) & (np.abs(longitude_deg) <= 180.0)), POSITION_OUT_OF_RANGE_REASON)
    ledger.reject((latitude_deg == 0.0) & (longitude_deg == 0.0), ZERO_POSITION_REASON)


def build_fix(columns: Columns, reading: Reading) -> tuple[PositionSignal, Quality]:
    """Build fixes from either schema; they share the names `latitude`, `longitude`, `altitude`, `position_covariance`.

    Covariance is row-major over east, north, up in both. `position_covariance_type` 0 (unknown), and a covariance that
    is all zero, mean that it is not given.
    """
    ledger = RowLedger(columns, reading.role)
    latitude_deg, longitude_deg = read_numbers(columns, "latitude"), read_numbers(columns, "longitude")
    altitude_m = nan_beyond_limit(ledger, read_numbers(columns, "altitude"), MAX_ALTITUDE_M, "altitude")
    ledger.reject(read_numbers(columns, "status.status") < 0, NO_FIX_REASON)
    reject_invalid_positions(ledger, latitude_deg, longitude_deg)

    covariance = read_matrix(columns, "position_covariance", 9)
    kind = find_field(columns, "position_covariance_type")
    is_unknown = accepted_text_mask(kind, len(columns), "unknown") if isinstance(kind, Strings) else None
    if is_unknown is None:
        is_unknown = read_numbers(columns, "position_covariance_type") == 0
    covariance = np.where(is_unknown[:, None], np.nan, covariance)
    plane_m2 = usable_plane_covariance_or_nan(ledger, covariance[:, 0], covariance[:, 1], covariance[:, 4])

    timeline = repair_and_order_times(
        ledger, *read_stamps(columns), reading.clock, [latitude_deg, longitude_deg, altitude_m]
    )
    return build_signal_and_quality(
        PositionSignal,
        ledger,
        timeline,
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
        altitude_m=altitude_m,
        covariance_m2=plane_m2,
    )
