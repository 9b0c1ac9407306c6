"""A car that keeps to a lane: the linear single-track model with a preview driver.

zhang2011, eq. 11 (corrected). The body's y axis points to the left.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cwcli.dynamics.single_track import lateral_accel_mps2_and_yaw_accel_radps2
from cwcli.dynamics.vehicle import Vehicle
from cwcli.signals.columns import FloatArray
from cwcli.simulation.drivers import SwayingDriver

INTEGRATION_STEP_S = 0.01
"""Time step of the integration, s. Chosen by hand; not fitted."""
MIN_DRIVEN_SPEED_MPS = 3.0
"""Lowest speed of the car, m/s, below which the linear model loses its meaning. Chosen by hand; not fitted."""

LATERAL_SPEED, YAW_RATE, STATION, OFFSET, HEADING, X, Y, BEARING, STEER = range(9)
"""Columns of the car's states, in the order of the integrated model."""
N_CAR_STATES = 9
"""Number of the car's states."""


def understeer_factor_s2pm2(vehicle: Vehicle) -> float:
    """The factor k of the steering correction f = 1 + k v^2, s^2/m^2 (zhang2011, eq. 13 corrected; 0.000843 there).

    The order of operations, other than that of `understeer_gradient_rad_per_mps2`, keeps the bits of simulated logs.
    """
    kf, kr = vehicle.front_stiffness_nprad, vehicle.rear_stiffness_nprad
    moment = vehicle.rear_axle_m * kr - vehicle.front_axle_m * kf
    return vehicle.mass_kg * moment / (vehicle.wheelbase_m**2 * kf * kr)


def times_and_states_of_drive_along_lane(
    curvature_at: Callable[[float], float],
    speed_at: Callable[[float], float],
    driver: SwayingDriver,
    duration_s: float,
    vehicle: Vehicle,
) -> tuple[FloatArray, FloatArray]:
    """Simulate a drive along a lane by Runge-Kutta steps of fourth order at 10 ms.

    Args:
        curvature_at: Station -> curvature of the lane, left positive.
        speed_at: Time -> longitudinal speed, at least 3 m/s.
        vehicle: The car, with its load.

    Returns:
        Times (n,) and states (n, 9): lateral speed (m/s, left), yaw rate (rad/s), station along the lane (m), offset
        from its centre (m, left), heading from its direction (rad), x and y (m) and bearing (rad) in the frame of the
        start, steering angle of the front wheels (rad, left).
    """
    mass, front_m, rear_m = vehicle.mass_kg, vehicle.front_axle_m, vehicle.rear_axle_m
    wheelbase_m, understeer = vehicle.wheelbase_m, understeer_factor_s2pm2(vehicle)
    n = round(duration_s / INTEGRATION_STEP_S) + 1
    states = np.zeros((n, N_CAR_STATES))
    k0, v0 = curvature_at(0.0), max(speed_at(0.0), MIN_DRIVEN_SPEED_MPS)
    state = np.zeros(N_CAR_STATES)
    # Start as the car would go round a steady bend of this curvature.
    state[YAW_RATE] = k0 * v0
    state[LATERAL_SPEED] = k0 * v0 * (rear_m - mass * front_m * v0**2 / (wheelbase_m * vehicle.rear_stiffness_nprad))
    state[OFFSET] = driver.wanted_offset_m(0.0)
    state[HEADING] = -state[LATERAL_SPEED] / v0
    state[STEER] = wheelbase_m * (1.0 + understeer * v0**2) * k0

    def state_derivative(time_s: float, q: FloatArray) -> FloatArray:
        v = max(speed_at(time_s), MIN_DRIVEN_SPEED_MPS)
        v_y, yaw_rate, station, offset, heading, steer = q[[0, 1, 2, 3, 4, 8]]
        kappa = curvature_at(station)
        correction = driver.correcting_curvature_1pm(time_s, v, offset, heading + v_y / v)
        wanted = curvature_at(station + 0.4 * (v * driver.preview_s)) + correction
        command = wheelbase_m * (1.0 + understeer * v**2) * wanted
        along = (v * math.cos(heading) - v_y * math.sin(heading)) / (1.0 - kappa * offset)
        bearing = q[BEARING]
        return np.array(
            [
                *lateral_accel_mps2_and_yaw_accel_radps2(vehicle, v, v_y, yaw_rate, steer),
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
        t = i * INTEGRATION_STEP_S
        k1 = state_derivative(t, state)
        k2 = state_derivative(t + INTEGRATION_STEP_S / 2, state + INTEGRATION_STEP_S / 2 * k1)
        k3 = state_derivative(t + INTEGRATION_STEP_S / 2, state + INTEGRATION_STEP_S / 2 * k2)
        k4 = state_derivative(t + INTEGRATION_STEP_S, state + INTEGRATION_STEP_S * k3)
        state = state + INTEGRATION_STEP_S / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return np.asarray(np.arange(n) * INTEGRATION_STEP_S), states
