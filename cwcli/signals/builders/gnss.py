"""Positions, velocities over ground and headings from the data of a receiver, shared by all receivers' files.

A file of a family of messages says what its fields mean, as a `GnssFix`; here it becomes a signal, message by message.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.angles import heading_from_compass_deg
from cwcli.signals.builders.base import Reading
from cwcli.signals.builders.motion import NO_ORIENTATION_REASON
from cwcli.signals.builders.position import NO_FIX_REASON, reject_invalid_positions
from cwcli.signals.canonical import HeadingSignal, PositionSignal, VelocitySignal
from cwcli.signals.clocks import Timeline, build_signal_and_quality, repair_and_order_times
from cwcli.signals.columns import Columns, FloatArray, Int64Array
from cwcli.signals.covariances import usable_plane_covariance_or_nan, usable_variances_or_nan
from cwcli.signals.limits import MAX_ALTITUDE_M, MAX_SPEED_MPS, nan_beyond_limit, reject_rows_beyond_limit
from cwcli.signals.quality import BoolArray, Quality, RowLedger

NO_VELOCITY_REASON = "no velocity"
"""The reason for rejecting a message without a velocity."""
MIN_LOG_DELAY_S, MAX_LOG_DELAY_S = -0.5, 2.0
"""The least and greatest median delay of log times after stamps, in seconds, that needs no note: the range in which
latencies are searched."""


@dataclass(frozen=True)
class GnssFix:
    """The data of n messages of a receiver; None where their type has no such data, NaN where a message has none.

    Attributes:
        stamp_ns, has_stamp: Shape (n,).
        is_fix: Shape (n,): the receiver vouches for it.
        latitude_deg, longitude_deg, altitude_m: Shape (n,); the altitude is above the ellipsoid.
        position_covariance_m2: Shape (n, 3): east-east, east-north, north-north.
        velocity_mps: Shape (n, 2): east, north.
        velocity_covariance_m2ps2: Shape (n, 3).
        heading_rad, heading_variance_rad2: Shape (n,), of the vehicle, not of its way over ground.
    """

    stamp_ns: Int64Array
    has_stamp: BoolArray
    is_fix: BoolArray
    latitude_deg: FloatArray | None = None
    longitude_deg: FloatArray | None = None
    altitude_m: FloatArray | None = None
    position_covariance_m2: FloatArray | None = None
    velocity_mps: FloatArray | None = None
    velocity_covariance_m2ps2: FloatArray | None = None
    heading_rad: FloatArray | None = None
    heading_variance_rad2: FloatArray | None = None


Read = Callable[[Columns, RowLedger], GnssFix]


def make_position_builder(read: Read) -> Callable[[Columns, Reading], tuple[PositionSignal, Quality]]:
    """Return a builder of positions from messages that `read` understands."""

    def build(columns: Columns, reading: Reading) -> tuple[PositionSignal, Quality]:
        ledger = RowLedger(columns, reading.role)
        fix = read(columns, ledger)
        ledger.reject(~fix.is_fix, NO_FIX_REASON)
        latitude_deg, longitude_deg = (
            _values_or_nan(fix.latitude_deg, columns),
            _values_or_nan(fix.longitude_deg, columns),
        )
        reject_invalid_positions(ledger, latitude_deg, longitude_deg)
        altitude_m = nan_beyond_limit(ledger, _values_or_nan(fix.altitude_m, columns), MAX_ALTITUDE_M, "altitude")
        given = _values_or_nan(fix.position_covariance_m2, columns, 3)
        covariance = usable_plane_covariance_or_nan(ledger, given[:, 0], given[:, 1], given[:, 2])
        values = [latitude_deg, longitude_deg, altitude_m]
        timeline = _timeline_with_clock_note(ledger, fix, reading, values)
        return build_signal_and_quality(
            PositionSignal,
            ledger,
            timeline,
            latitude_deg=latitude_deg,
            longitude_deg=longitude_deg,
            altitude_m=altitude_m,
            covariance_m2=covariance,
        )

    return build


def make_velocity_builder(read: Read) -> Callable[[Columns, Reading], tuple[VelocitySignal, Quality]]:
    """Return a builder of velocities over ground from messages that `read` understands."""

    def build(columns: Columns, reading: Reading) -> tuple[VelocitySignal, Quality]:
        ledger = RowLedger(columns, reading.role)
        fix = read(columns, ledger)
        ledger.reject(~fix.is_fix, NO_FIX_REASON)
        velocity_mps = _values_or_nan(fix.velocity_mps, columns, 2)
        ledger.reject(np.asarray(np.isnan(velocity_mps).any(axis=1)), NO_VELOCITY_REASON)
        reject_rows_beyond_limit(ledger, velocity_mps, MAX_SPEED_MPS)
        given = _values_or_nan(fix.velocity_covariance_m2ps2, columns, 3)
        covariance = usable_plane_covariance_or_nan(ledger, given[:, 0], given[:, 1], given[:, 2])
        timeline = _timeline_with_clock_note(ledger, fix, reading, [velocity_mps])
        return build_signal_and_quality(
            VelocitySignal,
            ledger,
            timeline,
            east_mps=velocity_mps[:, 0],
            north_mps=velocity_mps[:, 1],
            covariance_m2ps2=covariance,
        )

    return build


def make_heading_builder(read: Read) -> Callable[[Columns, Reading], tuple[HeadingSignal, Quality]]:
    """Return a builder of headings from messages that `read` understands."""

    def build(columns: Columns, reading: Reading) -> tuple[HeadingSignal, Quality]:
        ledger = RowLedger(columns, reading.role)
        fix = read(columns, ledger)
        heading_rad = _values_or_nan(fix.heading_rad, columns)
        ledger.reject(~fix.is_fix | ~np.isfinite(heading_rad), NO_ORIENTATION_REASON)
        variance = usable_variances_or_nan(ledger, _values_or_nan(fix.heading_variance_rad2, columns))
        timeline = _timeline_with_clock_note(ledger, fix, reading, [heading_rad])
        return build_signal_and_quality(
            HeadingSignal, ledger, timeline, heading_rad=heading_rad, variance_rad2=variance
        )

    return build


def isotropic_covariance(variance: FloatArray) -> FloatArray:
    """Return plane covariances (n, 3) with the same variance (n,) in every direction."""
    return np.stack([variance, 0.0 * variance, variance], axis=1)


def covariance_of_east_north_sigmas(east_sigma: FloatArray, north_sigma: FloatArray) -> FloatArray:
    """Return plane covariances (n, 3) from the sigmas (n,) along east and north."""
    with np.errstate(invalid="ignore", over="ignore"):
        return np.stack([east_sigma**2, 0.0 * east_sigma, north_sigma**2], axis=1)


def velocity_from_speed_and_course(speed_mps: FloatArray, course_deg: FloatArray) -> FloatArray:
    """Return the east and north velocity (n, 2) of a speed (m/s) and its course (degrees clockwise from north).

    A receiver that stands leaves the course out: a speed of exactly 0 needs none.
    """
    course_rad = np.deg2rad(np.where(np.isfinite(course_deg) & (np.abs(course_deg) <= 720.0), course_deg, np.nan))
    with np.errstate(invalid="ignore", over="ignore"):
        velocity = speed_mps[:, None] * np.stack([np.sin(course_rad), np.cos(course_rad)], axis=1)
    return np.where((speed_mps == 0.0)[:, None], 0.0, velocity)


def heading_from_compass_or_nan(compass_deg: FloatArray) -> FloatArray:
    """Return the heading (rad) of a compass angle (n,) in degrees; NaN where the angle is invalid."""
    return heading_from_compass_deg(np.where(np.abs(compass_deg) <= 720.0, compass_deg, np.nan))


def _timeline_with_clock_note(
    ledger: RowLedger, fix: GnssFix, reading: Reading, values: Sequence[FloatArray]
) -> Timeline:
    """Order the rows in time, and add a note where the receiver's clock and the recorder's are far apart.

    A receiver keeps its own time where no driver stamps it. What lies between the latencies that the estimator looks
    for and the steps that the clock repair covers would place it wrong beside the other sensors.
    """
    timeline = repair_and_order_times(ledger, fix.stamp_ns, fix.has_stamp, reading.clock, values)
    delay_s = ledger.quality.delay_s
    if not MIN_LOG_DELAY_S <= delay_s <= MAX_LOG_DELAY_S and np.isfinite(delay_s):
        ledger.add_note(
            f"its stamps are {delay_s:.1f} s before the log times; if its clock differs from others, use --clock log"
        )
    return timeline


def _values_or_nan(values: FloatArray | None, columns: Columns, width: int = 1) -> FloatArray:
    """Return the values, or NaN of their shape where the message type has none."""
    if values is not None:
        return values
    return np.full(len(columns) if width == 1 else (len(columns), width), np.nan)
