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
from cwcli.signals.columns import BoolArray, Columns, FloatArray, Int64Array
from cwcli.signals.covariances import usable_plane_covariance_or_nan, usable_variances_or_nan
from cwcli.signals.limits import MAX_ALTITUDE_M, MAX_SPEED_MPS, nan_beyond_limit, reject_rows_beyond_limit
from cwcli.signals.quality import Quality, RowLedger
from cwcli.signals.role import Role

MIN_MEDIAN_LOG_DELAY_AFTER_STAMP_WITHOUT_NOTE_S, MAX_MEDIAN_LOG_DELAY_AFTER_STAMP_WITHOUT_NOTE_S = -0.5, 2.0
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


ReadFix = Callable[[Columns, RowLedger], GnssFix]
"""A function that reads the messages of a channel as a `GnssFix`, and tells the ledger what it leaves out."""


GnssSignal = PositionSignal | VelocitySignal | HeadingSignal


def build_signal_of_fix(read_fix: ReadFix, columns: Columns, reading: Reading) -> tuple[GnssSignal, Quality]:
    """Build the signal of the role (position, velocity or heading) from messages that `read_fix` understands."""
    ledger = RowLedger(columns, reading.role)
    return _BUILDERS_BY_ROLE[reading.role](read_fix(columns, ledger), reading, ledger)


def _build_position(fix: GnssFix, reading: Reading, ledger: RowLedger) -> tuple[PositionSignal, Quality]:
    columns = ledger.columns
    ledger.reject(~fix.is_fix, NO_FIX_REASON)
    latitude_deg, longitude_deg = _values_or_nan(fix.latitude_deg, columns), _values_or_nan(fix.longitude_deg, columns)
    reject_invalid_positions(ledger, latitude_deg, longitude_deg)
    altitude_m = nan_beyond_limit(ledger, _values_or_nan(fix.altitude_m, columns), MAX_ALTITUDE_M, "altitude")
    covariance_m2 = _usable_covariance_or_nan(fix.position_covariance_m2, ledger)
    timeline = _timeline_with_clock_note(ledger, fix, reading, [latitude_deg, longitude_deg, altitude_m])
    return build_signal_and_quality(
        PositionSignal,
        ledger,
        timeline,
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
        altitude_m=altitude_m,
        covariance_m2=covariance_m2,
    )


def _build_velocity(fix: GnssFix, reading: Reading, ledger: RowLedger) -> tuple[VelocitySignal, Quality]:
    ledger.reject(~fix.is_fix, NO_FIX_REASON)
    velocity_mps = _values_or_nan(fix.velocity_mps, ledger.columns, 2)
    ledger.reject(np.asarray(np.isnan(velocity_mps).any(axis=1)), "no velocity")
    reject_rows_beyond_limit(ledger, velocity_mps, MAX_SPEED_MPS)
    covariance_m2ps2 = _usable_covariance_or_nan(fix.velocity_covariance_m2ps2, ledger)
    timeline = _timeline_with_clock_note(ledger, fix, reading, [velocity_mps])
    east_mps, north_mps = velocity_mps.T
    return build_signal_and_quality(
        VelocitySignal,
        ledger,
        timeline,
        east_mps=east_mps,
        north_mps=north_mps,
        covariance_m2ps2=covariance_m2ps2,
    )


def _build_heading(fix: GnssFix, reading: Reading, ledger: RowLedger) -> tuple[HeadingSignal, Quality]:
    heading_rad = _values_or_nan(fix.heading_rad, ledger.columns)
    ledger.reject(~fix.is_fix | ~np.isfinite(heading_rad), NO_ORIENTATION_REASON)
    variance = usable_variances_or_nan(ledger, _values_or_nan(fix.heading_variance_rad2, ledger.columns))
    timeline = _timeline_with_clock_note(ledger, fix, reading, [heading_rad])
    return build_signal_and_quality(HeadingSignal, ledger, timeline, heading_rad=heading_rad, variance_rad2=variance)


_BUILDERS_BY_ROLE: dict[Role, Callable[[GnssFix, Reading, RowLedger], tuple[GnssSignal, Quality]]] = {
    Role.EGO_POSITION: _build_position,
    Role.EGO_VELOCITY: _build_velocity,
    Role.EGO_HEADING: _build_heading,
}
"""The function that makes the signal of each role from a fix."""


def _usable_covariance_or_nan(covariance: FloatArray | None, ledger: RowLedger) -> FloatArray:
    """Return plane covariances (n, 3), NaN where not given or unusable; the latter are counted."""
    return usable_plane_covariance_or_nan(ledger, *_values_or_nan(covariance, ledger.columns, 3).T)


def plane_covariances_of_same_variance(variance: FloatArray) -> FloatArray:
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
    if (
        not MIN_MEDIAN_LOG_DELAY_AFTER_STAMP_WITHOUT_NOTE_S
        <= delay_s
        <= MAX_MEDIAN_LOG_DELAY_AFTER_STAMP_WITHOUT_NOTE_S
        and np.isfinite(delay_s)
    ):
        ledger.add_note(
            f"its stamps are {delay_s:.1f} s before the log times; if its clock differs from others, use --clock log"
        )
    return timeline


def _values_or_nan(values: FloatArray | None, columns: Columns, width: int = 1) -> FloatArray:
    """Return the values, or NaN of their shape where the message type has none."""
    if values is not None:
        return values
    return np.full(len(columns) if width == 1 else (len(columns), width), np.nan)
