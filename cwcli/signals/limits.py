"""Limits beyond which no sensor of a road vehicle can have measured.

Far beyond anything real, so that no sound value is lost; within them every square and sum stays finite.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.columns import BoolArray, FloatArray
from cwcli.signals.quality import RowLedger

MAX_SPEED_MPS = 1e3
"""The largest speed that is accepted, in m/s; chosen far beyond any vehicle."""
MAX_ACCEL_MPS2 = 1e4
"""The largest acceleration that is accepted, in m/s^2; chosen far beyond any vehicle."""
MAX_TURN_RATE_RADPS = 1e3
"""The largest turn rate that is accepted, in rad/s; chosen far beyond any vehicle."""
MAX_ALTITUDE_M = 1e6
"""The largest altitude that is accepted, in metres; chosen far beyond any road."""
MAX_ROAD_WHEEL_STEER_RAD = 1.6
"""The largest steering angle of a wheel that is accepted, in rad: a little more than a right angle."""
MAX_COORDINATE_M = 1e8
"""The largest coordinate that is accepted, in metres; chosen beyond the size of the Earth."""
MAX_ANGLE_RAD = 1e6
"""Greatest angle in rad, also of angles that are counted on through every turn; beyond, doubles lose its small digits.
Chosen by hand."""
MAX_ROAD_USER_SIZE_M = 1e3
"""Greatest length or width of a road user, and distance of its axle from its middle, m. Chosen by hand."""

NOT_FINITE_REASON = "value not a number"
"""The reason for rejecting a value that is not a number."""
OUT_OF_RANGE_REASON = "value out of range"
"""The reason for rejecting a value beyond its limit."""


def reject_rows_beyond_limit(
    ledger: RowLedger, values: FloatArray, limit: float, *, unless: BoolArray | None = None
) -> None:
    """Reject the rows with a value that is not finite or beyond the limit.

    Args:
        values: Shape (n,) or (n, k).
        unless: Shape (n,): rows whose values mean nothing anyway.
    """
    table = values[:, None] if values.ndim == 1 else values
    is_asked: BoolArray = np.ones(len(values), dtype=np.bool_) if unless is None else ~unless
    ledger.reject(is_asked & ~np.isfinite(table).all(axis=1), NOT_FINITE_REASON)
    ledger.reject(is_asked & (np.abs(table) > limit).any(axis=1), OUT_OF_RANGE_REASON)


def nan_beyond_limit(ledger: RowLedger, values: FloatArray, limit: float, name: str) -> FloatArray:
    """Return the values (n,), NaN where not finite or beyond the limit; those beyond it are counted as repairs.

    Args:
        values: Shape (n,), in the unit of `limit`.
    """
    with np.errstate(invalid="ignore"):
        is_beyond = np.isfinite(values) & (np.abs(values) > limit)
    ledger.count_repaired(is_beyond, f"{name} out of range, left out")
    return np.where(np.isfinite(values) & ~is_beyond, values, np.nan)
