"""A car that keeps to a lane: the linear single-track model with a preview driver.

zhang2011, eq. 11 (corrected) with the car of its table 5, half load. The body's y axis points to the left.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cwcli.signals.columns import FloatArray

STEP_S = 0.01
MASS_KG, INERTIA_KGM2 = 1215.0, 2100.0
FRONT_M, REAR_M = 0.90, 1.06
FRONT_NPRAD = REAR_NPRAD = 60000.0
WHEELBASE_M = FRONT_M + REAR_M
UNDERSTEER_S2PM2 = MASS_KG * (REAR_M * REAR_NPRAD - FRONT_M * FRONT_NPRAD) / (WHEELBASE_M**2 * FRONT_NPRAD * REAR_NPRAD)
"""f = 1 + UNDERSTEER v^2 (zhang2011, eq. 13 corrected): 0.000843 in the paper."""
MIN_SPEED_MPS = 3.0

LATERAL_SPEED, YAW_RATE, STATION, OFFSET, HEADING, X, Y, BEARING, STEER = range(9)
STATES = 9


@dataclass(frozen=True)
class Driver:
    """How the driver steers.

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


def drive_along(
    curvature_at: Callable[[float], float],
    speed_at: Callable[[float], float],
    driver: Driver,
    duration_s: float,
) -> tuple[FloatArray, FloatArray]:
    """Drive; Runge-Kutta of fourth order at 10 ms.

    Args:
        curvature_at: Station -> curvature of the lane, left positive.
        speed_at: Time -> longitudinal speed, at least 3 m/s.
        driver: Who steers.
        duration_s: How long.

    Returns:
        Times (n,) and states (n, 9): lateral speed (m/s, left), yaw rate (rad/s), station along the lane (m), offset
        from its centre (m, left), heading from its direction (rad), x and y (m) and bearing (rad) in the frame of the
        start, steering angle of the front wheels (rad, left).
    """
    n = round(duration_s / STEP_S) + 1
    states = np.zeros((n, STATES))
    k0, v0 = curvature_at(0.0), max(speed_at(0.0), MIN_SPEED_MPS)
    state = np.zeros(STATES)
    # Start as the car would go round a steady bend of this curvature.
    state[YAW_RATE] = k0 * v0
    state[LATERAL_SPEED] = k0 * v0 * (REAR_M - MASS_KG * FRONT_M * v0**2 / (WHEELBASE_M * REAR_NPRAD))
    state[OFFSET] = driver.wish_m(0.0)
    state[HEADING] = -state[LATERAL_SPEED] / v0
    state[STEER] = WHEELBASE_M * (1.0 + UNDERSTEER_S2PM2 * v0**2) * k0

    def rate(time_s: float, q: FloatArray) -> FloatArray:
        v = max(speed_at(time_s), MIN_SPEED_MPS)
        v_y, yaw_rate, station, offset, heading, steer = q[[0, 1, 2, 3, 4, 8]]
        kappa = curvature_at(station)
        ahead_m = v * driver.preview_s
        missing = driver.wish_m(time_s + driver.preview_s) - offset - ahead_m * (heading + v_y / v)
        wanted = curvature_at(station + 0.4 * ahead_m) + 1.2 * missing / ahead_m**2
        command = WHEELBASE_M * (1.0 + UNDERSTEER_S2PM2 * v**2) * wanted
        front = FRONT_NPRAD * (steer - (v_y + FRONT_M * yaw_rate) / v)
        rear = -REAR_NPRAD * (v_y - REAR_M * yaw_rate) / v
        along = (v * math.cos(heading) - v_y * math.sin(heading)) / (1.0 - kappa * offset)
        bearing = q[BEARING]
        return np.array(
            [
                (front + rear) / MASS_KG - v * yaw_rate,
                (FRONT_M * front - REAR_M * rear) / INERTIA_KGM2,
                along,
                v * math.sin(heading) + v_y * math.cos(heading),
                yaw_rate - kappa * along,
                v * math.cos(bearing) - v_y * math.sin(bearing),
                v * math.sin(bearing) + v_y * math.cos(bearing),
                yaw_rate,
                (command - steer) / driver.lag_s,
            ]
        )

    for i in range(n):
        states[i] = state
        t = i * STEP_S
        k1 = rate(t, state)
        k2 = rate(t + STEP_S / 2, state + STEP_S / 2 * k1)
        k3 = rate(t + STEP_S / 2, state + STEP_S / 2 * k2)
        k4 = rate(t + STEP_S, state + STEP_S * k3)
        state = state + STEP_S / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return np.asarray(np.arange(n) * STEP_S), states
