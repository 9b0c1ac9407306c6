"""Inertial measurements: `sensor_msgs/Imu`, as CDR or as JSON with the same names."""

from __future__ import annotations

import numpy as np

from cwcli.signals.builders.base import Reading
from cwcli.signals.canonical import ImuSignal
from cwcli.signals.clocks import build_signal_and_quality, repair_and_order_times
from cwcli.signals.columns import Columns, FloatArray
from cwcli.signals.covariances import usable_variances_or_nan
from cwcli.signals.leaf_fields import read_matrix, read_stamps, read_vector
from cwcli.signals.limits import MAX_ACCEL_MPS2, MAX_TURN_RATE_RADPS, reject_rows_beyond_limit
from cwcli.signals.quality import Quality, RowLedger


def build_imu(columns: Columns, reading: Reading) -> tuple[ImuSignal, Quality]:
    """Build inertial measurements.

    A covariance whose first element is -1 says that the quantity is not measured (REP-145): NaN. So does a vector that
    is exactly zero in every message.
    """
    ledger = RowLedger(columns, reading.role)
    accel_mps2, accel_variance = _read_vector_and_variances(columns, ledger, "linear_acceleration", MAX_ACCEL_MPS2)
    gyro_radps, gyro_variance = _read_vector_and_variances(columns, ledger, "angular_velocity", MAX_TURN_RATE_RADPS)
    timeline = repair_and_order_times(ledger, *read_stamps(columns), reading.clock, [accel_mps2, gyro_radps])
    return build_signal_and_quality(
        ImuSignal,
        ledger,
        timeline,
        accel_mps2=accel_mps2,
        gyro_radps=gyro_radps,
        accel_variance=accel_variance,
        gyro_variance=gyro_variance,
    )


def _read_vector_and_variances(
    columns: Columns, ledger: RowLedger, name: str, limit: float
) -> tuple[FloatArray, FloatArray]:
    """Read a vector of the message and its variances, both of shape (n, 3)."""
    values = read_vector(columns, name)
    covariance = read_matrix(columns, f"{name}_covariance", 9)
    is_absent = covariance[:, 0] == -1.0
    if len(values) > 1 and not np.any(values):
        ledger.add_note(f"{name} is exactly 0 in every message, taken as not measured")
        is_absent = np.ones(len(values), dtype=np.bool_)
    reject_rows_beyond_limit(ledger, values, limit, unless=is_absent)
    variance = usable_variances_or_nan(ledger, covariance[:, [0, 4, 8]])
    return np.where(is_absent[:, None], np.nan, values), np.where(is_absent[:, None], np.nan, variance)
