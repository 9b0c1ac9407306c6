"""Detections of sensors, models of sensors and their mountings, and states of the car that carries them.

Frames. A detection is in its sensor's axes. `axes="body"` is x forward, y left (REP-103); `axes="paper"` is x right,
y forward (xiang2019 figure 1). Azimuth is counter-clockwise from the sensor's x axis in both (xiang2019 eq. 4). The
mounting places the sensor in the body frame of the car, or in the map when `carrier="map"`. Tracks live in the map
frame when the car's states are given, else in the body frame.
"""

from __future__ import annotations

import math
from dataclasses import field
from enum import IntEnum
from typing import Literal

import numpy as np

from cwcli.kernels.track import RowKind
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, Int64Array, Strings
from cwcli.signals.vehicle_state import HEADING, SPEED, YAW_RATE, X, Y

Axes = Literal["body", "paper"]
"""Axes that a sensor reports in; see the module's text."""
YAW_RAD_BY_SENSOR_AXES: dict[str, float] = {"body": 0.0, "paper": -math.pi / 2}
"""Direction of the sensor's x axis relative to its forward direction, by axes."""


class DetectionKind(IntEnum):
    """The meaning of a detection's values."""

    POSITION = RowKind.POSITION  # x, y in m (lidar, xiang2019 eq. 1)
    RADAR = RowKind.RADAR  # range in m, azimuth in rad, range rate in m/s, NaN where not measured (xiang2019 eq. 2-4)


DEFAULT_SIGMAS_BY_KIND: dict[DetectionKind, tuple[float, ...]] = {
    DetectionKind.POSITION: (0.15, 0.15),
    DetectionKind.RADAR: (0.3, 0.03, 0.3),
}
"""Sigmas of the values where neither message nor user gives any: m; m, rad, m/s. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class Detections:
    """The detections of one sensor, in the order of arrival.

    Attributes:
        source: Name of the sensor (a topic); the key of its `SensorModel`.
        kind: What `values` holds.
        stamp_ns: Shape (n,), int64: time of measurement. Equal stamps are one scan.
        values: Shape (n, 2) for POSITION, (n, 3) for RADAR, in the sensor's axes.
        covariance: Shape (n, 2, 2) or (n, 3, 3), in the units of `values`; NaN or zeros = not given. None = never.
        frame: The frame id of each row, or None when the messages carry none.
        scan_stamp_ns: Times of all scans, empty ones included, or None when only the rows are known.
    """

    source: str
    kind: DetectionKind
    stamp_ns: Int64Array
    values: FloatArray
    covariance: FloatArray | None = None
    frame: Strings | None = None
    scan_stamp_ns: Int64Array | None = None

    def __post_init__(self) -> None:
        width = 2 if self.kind == DetectionKind.POSITION else 3
        n = len(self.stamp_ns)
        if self.values.shape != (n, width):
            raise ValueError(f"{self.source}: values {self.values.shape}, expected {(n, width)}")
        if self.covariance is not None and self.covariance.shape != (n, width, width):
            raise ValueError(f"{self.source}: covariance {self.covariance.shape}, expected {(n, width, width)}")

    def __len__(self) -> int:
        return len(self.stamp_ns)


@dataclass(frozen=True)
class SensorModel:
    """Mounting, accuracy and field of view of one sensor.

    Attributes:
        x_m, y_m, yaw_rad: Mounting in the body frame (or the map): position and the direction of the sensor's axes.
        axes: The axes that the sensor reports in; see the module.
        carrier: `body` moves with the car; `map` stands still (its detections are in map coordinates).
        sigma: 1-sigma noise of each value where the message gives none. () takes `DEFAULT_SIGMAS_BY_KIND`.
        frame_ids: Frame ids that are accepted. () accepts all.
        use_range_rate: False leaves the radar's range rate out.
        max_range_m: Detections beyond are rejected; a target beyond is not expected to be seen.
        field_of_view_rad: Full width around the forward direction in which a target is expected to be seen.
        detection_probability: Chance that a scan sees a target in view.
        clutter_density: False detections per scan and unit of the measurement: 1/m^2 (POSITION), 1/(m rad) (RADAR
            without rate), 1/(m rad m/s) (RADAR). None estimates it from the detections.
    """

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0
    axes: Axes = "body"
    carrier: Literal["body", "map"] = "body"
    sigma: tuple[float, ...] = ()
    frame_ids: tuple[str, ...] = ()
    use_range_rate: bool = True
    max_range_m: float = 1.0e4
    field_of_view_rad: float = 2.0 * math.pi
    detection_probability: float = 0.9
    clutter_density: float | None = None

    def __post_init__(self) -> None:
        if any(not (s > 0.0 and math.isfinite(s)) for s in self.sigma):
            raise ValueError(f"sigma {self.sigma} must be positive")
        if not 0.0 < self.detection_probability < 1.0:
            raise ValueError(f"detection_probability {self.detection_probability} is not between 0 and 1")


@dataclass(frozen=True)
class EgoStates:
    """States of the car that carries the sensors, in the map frame.

    Attributes:
        stamp_ns: Shape (m,), int64, increasing.
        x_m, y_m, heading_rad, speed_mps, yaw_rate_radps: Shape (m,).
        max_gap_s: A detection in a longer gap, or outside the states by more than half of it, has no ego state.
    """

    stamp_ns: Int64Array
    x_m: FloatArray
    y_m: FloatArray
    heading_rad: FloatArray
    speed_mps: FloatArray
    yaw_rate_radps: FloatArray
    max_gap_s: float = 0.5

    @classmethod
    def from_states(cls, stamp_ns: Int64Array, state: FloatArray) -> EgoStates:
        """Build them from states (m, 8) in the order of `STATE_NAMES`; an unknown yaw rate counts as zero."""
        yaw_rate_radps = np.where(np.isfinite(state[:, YAW_RATE]), state[:, YAW_RATE], 0.0)
        return cls(stamp_ns, state[:, X], state[:, Y], state[:, HEADING], state[:, SPEED], yaw_rate_radps)


@dataclass
class DetectionCounts:
    """Numbers of detections of one source: read = used + all rejected.

    Attributes:
        read, used: Numbers of detections.
        rejected, repaired: Reason -> number.
    """

    read: int = 0
    used: int = 0
    rejected: dict[str, int] = field(default_factory=dict)
    repaired: dict[str, int] = field(default_factory=dict)

    def count_rejected(self, reason: str, n: int) -> None:
        """Count n rejected detections."""
        if n:
            self.rejected[reason] = self.rejected.get(reason, 0) + n

    def count_repaired(self, reason: str, n: int) -> None:
        """Count n repaired detections."""
        if n:
            self.repaired[reason] = self.repaired.get(reason, 0) + n
