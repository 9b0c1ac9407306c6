"""Who steers the simulated cars.

Two drivers, for two purposes: one whose deviations have a known size and who can be told to drift out of the lane (many
runs of `lane_drive` at once), and one whose sway looks natural in a film (`road`). Recorded results and bundled logs
depend on both, so neither takes the other's place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from cwcli.signals.columns import FloatArray


@dataclass(frozen=True)
class TargetLineDriver:
    """Steers back to a target line with a preview of the road, lagged and not quite steadily.

    Attributes:
        stiffness_radps: Natural frequency of the correction. damping: Its damping ratio.
        lag_s: First-order lag of the arms and the steering.
        unrest_mps2: Standard deviation of the unwanted lateral acceleration, correlated over `unrest_s`.
        look_ahead_s: The driver answers to the curvature this far ahead, which cancels the lag.
    """

    stiffness_radps: float = 0.6
    damping: float = 0.9
    lag_s: float = 0.15
    unrest_mps2: float = 0.10
    unrest_s: float = 0.7
    look_ahead_s: float = 0.15

    def correction_1pm(self, speed_mps: FloatArray, offset_m: FloatArray, course_rad: FloatArray) -> FloatArray:
        """Curvature that leads back to the line, from the offset and the course against it."""
        return -(
            (self.stiffness_radps / speed_mps) ** 2 * offset_m
            + 2.0 * self.damping * self.stiffness_radps / speed_mps * course_rad
        )


@dataclass(frozen=True)
class SwayingDriver:
    """Aims at a point of the lane some way ahead, and sways in it.

    Attributes:
        preview_s: Looks this far ahead.
        lag_s: First-order lag of hand and steering.
        wander_m: Amplitudes of the sway in the lane.
        wander_s: Its periods.
        wander_rad: Its phases.
    """

    preview_s: float = 1.3
    lag_s: float = 0.12
    wander_m: tuple[float, ...] = (0.18, 0.08)
    wander_s: tuple[float, ...] = (17.0, 7.3)
    wander_rad: tuple[float, ...] = (0.0, 1.0)

    def wish_m(self, time_s: float) -> float:
        """Offset from the lane's centre that the driver wants."""
        parts = zip(self.wander_m, self.wander_s, self.wander_rad, strict=True)
        return sum(size * math.sin(2 * math.pi * time_s / period + phase) for size, period, phase in parts)

    def correction_1pm(self, time_s: float, speed_mps: float, offset_m: float, course_rad: float) -> float:
        """Curvature that leads to the wanted offset at the point ahead, from the offset and the course in the lane."""
        ahead_m = speed_mps * self.preview_s
        missing_m = self.wish_m(time_s + self.preview_s) - offset_m - ahead_m * course_rad
        return 1.2 * missing_m / ahead_m**2
