"""The single-track car with two degrees of freedom, and the same car before a camera (zhang2011, eq. 11-13, 20, 21).

Signs. Lateral speed, yaw rate and steering angle are those of the body frame (REP-103): left and counter-clockwise are
positive. The lane's deviations are the paper's: y_L is positive where the lane's centre is to the right of the car's
axis at the preview point, e_L where the car points counter-clockwise of the lane, K_L where the lane bends to the
right. The paper also counts v_y, gamma and delta positive to the right. Eq. 11 is the same either way; in eq. 10 and
20 the three change their sign.

The printed eq. 11 and matrix A have wrong signs and lack the term -v gamma; see docs/papers/zhang2011-motion.md.
"""

from __future__ import annotations

import math

import numpy as np

from cwcli.dynamics.vehicle import Vehicle
from cwcli.signals.columns import FloatArray

MIN_MODEL_SPEED_MPS = 2.0
"""Lowest speed of the model, m/s: the tyres' slip angles divide by the speed (see `lateral_state_matrices`). Chosen by
hand; not fitted."""


def lateral_state_matrices(vehicle: Vehicle, speed_mps: float) -> tuple[FloatArray, FloatArray]:
    """A of shape (2, 2) and B of shape (2, 1) of d[v_y, gamma]/dt = A [v_y, gamma] + B delta, eq. 11 (corrected).

    Below `MIN_MODEL_SPEED_MPS` the model of that speed is kept and the steering input is scaled by v over that speed,
    so that the steady yaw rate goes to v delta / L: zero at standstill, negative in reverse.
    """
    v = max(speed_mps, MIN_MODEL_SPEED_MPS)
    share = max(-1.0, speed_mps / v)
    m, inertia = vehicle.mass_kg, vehicle.yaw_inertia_kgm2
    kf, kr = vehicle.front_stiffness_nprad, vehicle.rear_stiffness_nprad
    lf, lr = vehicle.front_axle_m, vehicle.rear_axle_m
    moment = lr * kr - lf * kf
    a = np.array(
        [
            [-(kf + kr) / (m * v), moment / (m * v) - v],
            [moment / (inertia * v), -(lf**2 * kf + lr**2 * kr) / (inertia * v)],
        ]
    )
    return a, share * np.array([[kf / m], [lf * kf / inertia]])


def lateral_accel_mps2_and_yaw_accel_radps2(
    vehicle: Vehicle,
    speed_mps: FloatArray | float,
    lateral_mps: FloatArray,
    yaw_rate_radps: FloatArray,
    steer_rad: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """dv_y/dt (m/s^2) and dgamma/dt (rad/s^2) of eq. 11 (corrected), from the tyres' forces; for forward speeds."""
    v = np.maximum(speed_mps, MIN_MODEL_SPEED_MPS)
    lf, lr = vehicle.front_axle_m, vehicle.rear_axle_m
    front = vehicle.front_stiffness_nprad * (steer_rad * (speed_mps / v) - (lateral_mps + lf * yaw_rate_radps) / v)
    rear = -vehicle.rear_stiffness_nprad * (lateral_mps - lr * yaw_rate_radps) / v
    return (front + rear) / vehicle.mass_kg - v * yaw_rate_radps, (lf * front - lr * rear) / vehicle.yaw_inertia_kgm2


def preview_state_matrices(vehicle: Vehicle, speed_mps: float, preview_m: float) -> tuple[FloatArray, FloatArray]:
    """A of shape (4, 4) and B of shape (4, 2) of eq. 21 (corrected).

    State [v_y, gamma, y_L, e_L], input [delta, K_L]; the signs are this module's.

    Args:
        speed_mps: Forward speed.
        preview_m: D_L, from the centre of gravity to the preview point.
    """
    a = np.zeros((4, 4))
    b = np.zeros((4, 2))
    a[:2, :2], b[:2, :1] = lateral_state_matrices(vehicle, speed_mps)
    a[2] = 1.0, preview_m, 0.0, speed_mps  # eq. 20: dy_L = v e_L - v_y - gamma D_L in the paper's signs
    a[3, 1] = 1.0  # de_L = v K_L - gamma
    b[3, 1] = speed_mps
    return a, b


def understeer_gradient_rad_per_mps2(vehicle: Vehicle, mass_kg: float | None = None) -> float:
    """K_mu of eq. 13, rad s^2/m: how much more steering angle a metre per second squared of lateral acceleration needs.

    Negative for a car that oversteers.
    """
    kf, kr = vehicle.front_stiffness_nprad, vehicle.rear_stiffness_nprad
    moment = vehicle.rear_axle_m * kr - vehicle.front_axle_m * kf
    return (vehicle.mass_kg if mass_kg is None else mass_kg) * moment / (vehicle.wheelbase_m * kf * kr)


def critical_speed_mps(vehicle: Vehicle) -> float:
    """Speed above which a car that oversteers is unstable; infinite for one that does not."""
    gradient = understeer_gradient_rad_per_mps2(vehicle)
    return math.sqrt(-vehicle.wheelbase_m / gradient) if gradient < 0.0 else math.inf


def steady_yaw_rate_per_steering_angle_1ps(vehicle: Vehicle, speed_mps: FloatArray | float) -> FloatArray:
    """The ratio gamma / delta in a steady turn, 1/s: v / (L + K_mu v^2), eq. 12."""
    v = np.asarray(speed_mps, dtype=np.float64)
    return v / (vehicle.wheelbase_m + understeer_gradient_rad_per_mps2(vehicle) * v**2)


def steady_lateral_speed_per_yaw_rate_m(vehicle: Vehicle, speed_mps: FloatArray | float) -> FloatArray:
    """The ratio v_y / gamma in a steady turn, m: l_r - m l_f v^2 / (k_r L), positive at low speed, negative at high."""
    v = np.asarray(speed_mps, dtype=np.float64)
    slip = vehicle.mass_kg * vehicle.front_axle_m / (vehicle.rear_stiffness_nprad * vehicle.wheelbase_m)
    return vehicle.rear_axle_m - slip * v**2


def steady_lateral_speed_and_yaw_rate(vehicle: Vehicle, speed_mps: float, steer_rad: float) -> tuple[float, float]:
    """The lateral speed v_y (m/s) and the yaw rate gamma (rad/s) of a steady turn."""
    yaw_rate = float(steady_yaw_rate_per_steering_angle_1ps(vehicle, speed_mps)) * steer_rad
    return float(steady_lateral_speed_per_yaw_rate_m(vehicle, speed_mps)) * yaw_rate, yaw_rate
