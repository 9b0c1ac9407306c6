"""What a V2X decoder returns: one row a message, SI units, cwcli's signs, before clocks and stations are settled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from cwcli.signals.columns import Columns, FloatArray, Int64Array, Strings
from cwcli.signals.quality import BoolArray, RowLedger


@dataclass(frozen=True)
class RemoteRows:
    """Decoded messages of one channel; every array has n rows. See `canonical.RemoteSignal` for the quantities.

    Attributes:
        is_own: The message was sent by the vehicle that recorded the log.
        is_roadside: The sender is a roadside unit.
        stamp_ns: Generation time, or log time where the message has none.
    """

    station: Strings
    is_own: BoolArray
    is_roadside: BoolArray
    stamp_ns: Int64Array
    latitude_deg: FloatArray
    longitude_deg: FloatArray
    altitude_m: FloatArray
    speed_mps: FloatArray
    heading_rad: FloatArray
    accel_mps2: FloatArray
    lateral_accel_mps2: FloatArray
    yaw_rate_radps: FloatArray
    length_m: FloatArray
    width_m: FloatArray
    position_covariance_m2: FloatArray
    speed_sigma_mps: FloatArray
    heading_sigma_rad: FloatArray
    accel_sigma_mps2: FloatArray
    yaw_rate_sigma_radps: FloatArray


Decode = Callable[[Columns, RowLedger], RemoteRows]
