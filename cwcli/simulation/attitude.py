"""The pitch and roll of a vehicle: from the road's slope, its springs and its acceleration.

The road is a smooth terrain, z = sum A sin(k . r + phase), so that the slope belongs to the place: a standing car's
pitch stays, and a car that turns on a slope changes its pitch without a pitch rate. All is closed form.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.simulation.streams import random_stream

TERRAIN_WAVELENGTHS_M = np.geomspace(80.0, 1200.0, 12)
"""Wavelengths of the terrain's waves, shape (12,), m. Chosen by hand; not fitted."""
BODY_PITCH_FREQUENCIES_HZ = np.array([1.05, 1.32, 1.61, 1.93])
"""Frequencies at which the body pitches on its springs, shape (4,), Hz: 1 to 2 Hz, as of passenger cars. Chosen by
hand."""
SPEED_OF_HALF_BODY_PITCH_AMPLITUDE_MPS = 2.0
"""Speed v0 at which the body pitches half as much as at full speed, m/s: the amplitude goes with v^2 / (v^2 + v0^2).
Chosen by hand; not fitted."""


@dataclass(frozen=True)
class Attitude:
    """The tilt of one vehicle.

    Attributes:
        slope_deg: Slope of the road, in any direction, 1 sigma.
        bounce_deg: The body's own pitching at full speed, 1 sigma.
        squat_degpmps2: The body's pitch per acceleration: nose up for a positive one.
        vehicle: Name of the vehicle; it selects the phases of the terrain's waves.
    """

    slope_deg: float
    bounce_deg: float
    squat_degpmps2: float
    vehicle: str

    @cached_property
    def _wave_vectors_and_phases_of_terrain(self) -> tuple[FloatArray, FloatArray]:
        """The wave vectors (k, 2), 1/m, and phases (k,), rad, of the terrain."""
        rng = random_stream(0, self.vehicle, "terrain")
        direction = 2.0 * np.pi * rng.random(len(TERRAIN_WAVELENGTHS_M))
        size = 2.0 * np.pi / TERRAIN_WAVELENGTHS_M
        return np.column_stack([size * np.cos(direction), size * np.sin(direction)]), 2 * np.pi * rng.random(len(size))

    def pitch_roll_and_pitch_rate_at(self, time_s: FloatArray, state: FloatArray) -> FloatArray:
        """Pitch, roll and pitch rate at the given times.

        Args:
            time_s: Shape (n,), seconds of the run.
            state: Shape (n, 8): the true states at these times, columns as in `vehicle_state.STATE_NAMES`.

        Returns:
            Shape (n, 3): pitch (nose down positive, rad), roll (right side down positive, rad), and the turn rate about
            the vehicle's left axis (nose down positive, rad/s), which a gyroscope reads. Angles are small: to first
            order in them.
        """
        speed, heading, accel, jerk = state[:, 2], state[:, 3], state[:, 4], state[:, 6]
        tilt = np.zeros((len(state), 3))
        if self.slope_deg:
            waves, phase = self._wave_vectors_and_phases_of_terrain
            ahead = np.column_stack([np.cos(heading), np.sin(heading)]) @ waves.T
            left = np.column_stack([-np.sin(heading), np.cos(heading)]) @ waves.T
            # Each wave has the same part of the slope's variance, sigma^2 along any direction on average.
            height = np.radians(self.slope_deg) * 2.0 / np.sqrt(len(waves)) / np.hypot(*waves.T)
            at = state[:, :2] @ waves.T + phase
            tilt[:, 0] -= (height * ahead * np.cos(at)).sum(axis=1)
            tilt[:, 1] += (height * left * np.cos(at)).sum(axis=1)
            # Turning about the road's normal is no pitch rate; what is left is the road's bend, v h' (d2z) h.
            tilt[:, 2] += speed * (height * ahead**2 * np.sin(at)).sum(axis=1)
        if self.bounce_deg:
            size = np.radians(self.bounce_deg) * np.sqrt(2.0 / len(BODY_PITCH_FREQUENCIES_HZ))
            angle = (
                2.0
                * np.pi
                * (
                    np.outer(time_s, BODY_PITCH_FREQUENCIES_HZ)
                    + np.arange(len(BODY_PITCH_FREQUENCIES_HZ)) / len(BODY_PITCH_FREQUENCIES_HZ)
                )
            )
            full = speed**2 + SPEED_OF_HALF_BODY_PITCH_AMPLITUDE_MPS**2
            moving, change = speed**2 / full, 2.0 * speed * accel * SPEED_OF_HALF_BODY_PITCH_AMPLITUDE_MPS**2 / full**2
            wave, slope = np.sin(angle).sum(axis=1), np.cos(angle) @ (2.0 * np.pi * BODY_PITCH_FREQUENCIES_HZ)
            tilt[:, 0] += size * moving * wave
            tilt[:, 2] += size * (change * wave + moving * slope)
        squat = np.radians(self.squat_degpmps2)
        tilt[:, 0] -= squat * accel
        tilt[:, 2] -= squat * jerk
        return tilt


LEVEL_ATTITUDE = Attitude(0.0, 0.0, 0.0, "")
"""The attitude of a vehicle that is never tilted."""
