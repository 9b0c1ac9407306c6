"""The drivers that steer the simulated cars.

`TargetLineDriver` has deviations of a known size and can drift out of the lane (many runs of `lane_drive` at once).
`SwayingDriver` sways as a human does in rendered drives (`road`). Recorded results and bundled logs depend on both.
"""

from __future__ import annotations

import math

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray


@dataclass(frozen=True)
class TargetLineDriver:
    """Steers back to a target line with a preview of the road, lagged and not quite steadily.

    Attributes:
        stiffness_radps: Natural frequency of the correction. damping: Its damping ratio.
        lag_s: First-order lag of the arms and the steering.
        unrest_mps2, unrest_s: Standard deviation and correlation time of the unwanted lateral acceleration.
        look_ahead_s: Time ahead of which the driver follows the curvature, which cancels the lag.
    """

    stiffness_radps: float = 0.6
    damping: float = 0.9
    lag_s: float = 0.15
    unrest_mps2: float = 0.10
    unrest_s: float = 0.7
    look_ahead_s: float = 0.15

    def correcting_curvature_1pm(
        self, speed_mps: FloatArray, offset_m: FloatArray, course_rad: FloatArray
    ) -> FloatArray:
        """Curvature that leads back to the target line, shape (n,), 1/m, from offset and course relative to it."""
        return -(
            (self.stiffness_radps / speed_mps) ** 2 * offset_m
            + 2.0 * self.damping * self.stiffness_radps / speed_mps * course_rad
        )


@dataclass(frozen=True)
class SwayingDriver:
    """Aims at a point of the lane some way ahead, and sways in the lane.

    Attributes:
        preview_s: Time to the point that the driver looks at.
        lag_s: First-order lag of hand and steering.
        wander_m: Amplitudes of the sway in the lane.
        wander_s: Periods of the sway.
        wander_rad: Phases of the sway.
    """

    preview_s: float = 1.3
    lag_s: float = 0.12
    wander_m: tuple[float, ...] = (0.18, 0.08)
    wander_s: tuple[float, ...] = (17.0, 7.3)
    wander_rad: tuple[float, ...] = (0.0, 1.0)

    def wanted_offset_m(self, time_s: float) -> float:
        """Offset from the lane's centre that the driver wants at a time, m."""
        parts = zip(self.wander_m, self.wander_s, self.wander_rad, strict=True)
        return sum(size * math.sin(2 * math.pi * time_s / period + phase) for size, period, phase in parts)

    def correcting_curvature_1pm(self, time_s: float, speed_mps: float, offset_m: float, course_rad: float) -> float:
        """Curvature that leads to the wanted offset at the point ahead, 1/m, from offset and course in the lane."""
        ahead_m = speed_mps * self.preview_s
        missing_m = self.wanted_offset_m(time_s + self.preview_s) - offset_m - ahead_m * course_rad
        return 1.2 * missing_m / ahead_m**2
