"""Steering angle: Autoware's `SteeringReport`, `AckermannDriveStamped`."""

from __future__ import annotations

from cwcli.signals.builders.base import Reading
from cwcli.signals.canonical import SteerSignal
from cwcli.signals.clocks import build_signal_and_quality, repair_and_order_times
from cwcli.signals.columns import Columns
from cwcli.signals.leaf_fields import read_numbers, read_stamps
from cwcli.signals.limits import MAX_STEER_RAD, reject_rows_beyond_limit
from cwcli.signals.quality import Quality, RowLedger


def build_steering_report(columns: Columns, reading: Reading) -> tuple[SteerSignal, Quality]:
    """Build a steering angle of the front wheels; both message types count it in radians, left positive."""
    ledger = RowLedger(columns, reading.role)
    steer_rad = read_numbers(columns, "steering_tire_angle", "drive.steering_angle")
    reject_rows_beyond_limit(ledger, steer_rad, MAX_STEER_RAD)
    timeline = repair_and_order_times(ledger, *read_stamps(columns), reading.clock, [steer_rad])
    return build_signal_and_quality(SteerSignal, ledger, timeline, steer_rad=steer_rad)
