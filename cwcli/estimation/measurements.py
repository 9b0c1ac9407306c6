"""Input of the estimator: time series of measured quantities as plain arrays."""

from __future__ import annotations

import math
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from cwcli.kernels import ekf
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, Int64Array, select_table_rows


class Kind(IntEnum):
    """Quantity that a measurement measures; `QUANTITY_BY_KIND` has its unit and noise.

    Attributes:
        POSITION: x, y in the map frame, metres.
        VELOCITY: East and north velocity over ground, m/s.
        SPEED: Longitudinal speed, m/s, negative in reverse.
        HEADING: Counter-clockwise from east, rad; any number of turns may be added.
        ACCEL: Longitudinal acceleration, m/s^2.
        YAW_RATE: Counter-clockwise yaw rate, rad/s.
        IMU: Accelerometer (forward, left, up, m/s^2; about +9.8 on up at rest) and gyroscope (rad/s) as mounted.
            The estimator levels it and uses it as one ACCEL and one YAW_RATE series.
    """

    POSITION = ekf.Sensor.POSITION
    VELOCITY = ekf.Sensor.VELOCITY
    SPEED = ekf.Sensor.SPEED
    HEADING = ekf.Sensor.HEADING
    ACCEL = ekf.Sensor.ACCEL
    YAW_RATE = ekf.Sensor.YAW_RATE
    IMU = 6


@dataclass(frozen=True)
class MeasuredQuantity:
    """Prior knowledge about a kind of measurement.

    Attributes:
        width: Number of values in a row.
        unit: Unit of each value; "" where they differ.
        default_sigma: One sigma where the message states none and the log is too short to show it.
        floor_sigma: Least sigma of noise that is found from the log (resolution of the usual messages).
    """

    width: int
    unit: str
    default_sigma: float
    floor_sigma: float


QUANTITY_BY_KIND: dict[Kind, MeasuredQuantity] = {
    Kind.POSITION: MeasuredQuantity(2, "m", 1.0, 0.05),
    Kind.VELOCITY: MeasuredQuantity(2, "m/s", 0.3, 0.05),
    Kind.SPEED: MeasuredQuantity(1, "m/s", 0.3, 0.05),
    Kind.HEADING: MeasuredQuantity(1, "rad", 0.035, 5e-3),
    Kind.ACCEL: MeasuredQuantity(1, "m/s^2", 0.2, 5e-3),
    Kind.YAW_RATE: MeasuredQuantity(1, "rad/s", 0.01, 1e-4),
    Kind.IMU: MeasuredQuantity(6, "", math.nan, math.nan),  # ACCEL and YAW_RATE are used instead
}
"""Width, unit, default sigma and least sigma of each kind. Chosen for common automotive sensors; not fitted."""
KINDS_THAT_IMU_MEASURES_TOO = (Kind.ACCEL, Kind.YAW_RATE)
"""Kinds that an IMU measures as well: they may come a hundred times a second, and with a bias."""


@dataclass(frozen=True)
class Measurements:
    """One source's measurements of one kind.

    Rows need not be sorted and may hold NaN: a row with a value that is not finite is counted and left out.

    Attributes:
        source: Name for messages, usually the topic. Several kinds may share one source.
        kind: Measured quantity.
        stamp_ns: Shape (n,), int64.
        values: Shape (n, d) with d = QUANTITY_BY_KIND[kind].width; (n,) is accepted where d is 1.
        covariance: Shape (n, d, d), or (n, d) for variances alone, or None. NaN, or a variance that is not
            positive, means that the message states none.
        log_time_ns: Shape (n,), int64: when each row was received; None: at its stamp.
        is_exact: From a simulator: it has no outliers and no latency, and its noise is as stated.
    """

    source: str
    kind: Kind
    stamp_ns: Int64Array
    values: FloatArray
    covariance: FloatArray | None = None
    log_time_ns: Int64Array | None = None
    is_exact: bool = False

    def __post_init__(self) -> None:
        """Check the shapes.

        Raises:
            ValueError: If an array has a shape other than the documented ones.
        """
        n, d = len(self.stamp_ns), QUANTITY_BY_KIND[self.kind].width
        values = np.asarray(self.values, dtype=np.float64)
        if values.ndim == 1 and d == 1:
            values = values[:, None]
        if values.shape != (n, d):
            raise ValueError(f"{self.source}: values of {self.kind.name} have shape {values.shape}, expected {(n, d)}")
        object.__setattr__(self, "stamp_ns", np.asarray(self.stamp_ns, dtype=np.int64))
        object.__setattr__(self, "values", values)
        if self.covariance is None:
            return
        covariance = np.asarray(self.covariance, dtype=np.float64)
        if covariance.ndim == 1 and d == 1:
            covariance = covariance[:, None]
        if covariance.shape == (n, d):
            covariance = covariance[:, :, None] * np.eye(d)
        if covariance.shape != (n, d, d):
            raise ValueError(
                f"{self.source}: {self.kind.name} covariance has shape {covariance.shape}, not {(n, d, d)}"
            )
        object.__setattr__(self, "covariance", covariance)

    def __len__(self) -> int:
        return len(self.stamp_ns)

    @property
    def received_ns(self) -> Int64Array:
        """Times at which the rows were received, (n,), ns."""
        return self.stamp_ns if self.log_time_ns is None else self.log_time_ns

    def select_rows(self, rows: npt.NDArray[np.bool_ | np.intp]) -> Measurements:
        """Return the measurements in some rows, given as a mask (n,) or as their numbers."""
        return select_table_rows(self, rows)
