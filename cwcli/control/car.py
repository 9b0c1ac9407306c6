"""The longitudinal response of the host: actuator lags, a pressure-to-deceleration gain, jerk and friction limits."""

from __future__ import annotations

import numpy as np

from cwcli.dynamics.friction import CONTROLLER_BRAKING_FRICTION_COEFFICIENT
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.signals.units import STANDARD_GRAVITY_MPS2


@dataclass(frozen=True)
class CarResponse:
    """The response of a mid-size passenger car to its pedals.

    song2016 prints none of these values. Each is a usual one, chosen by hand (docs/papers/song2016-choices.md).

    Attributes:
        brake_gain_mps2_per_mpa: 0.9, so that 10 MPa asks for about the friction limit.
        throttle_gain_mps2: Acceleration at full throttle.
        brake_lag_s, throttle_lag_s: First-order time constants of the hydraulics and the engine.
        max_jerk_mps3: Limit of the change of acceleration; full braking takes about half a second to build up.
        friction: Coefficient between tyre and dry asphalt.
    """

    brake_gain_mps2_per_mpa: float = 0.9
    throttle_gain_mps2: float = 3.0
    brake_lag_s: float = 0.2
    throttle_lag_s: float = 0.3
    max_jerk_mps3: float = 15.0
    friction: float = CONTROLLER_BRAKING_FRICTION_COEFFICIENT


@dataclass(frozen=True)
class CarState:
    """The car in n runs, shape (n,) each: brake pressure and throttle as built up, acceleration, speed, distance."""

    pressure_mpa: FloatArray
    throttle: FloatArray
    accel_mps2: FloatArray
    speed_mps: FloatArray
    travelled_m: FloatArray


def advance_car(
    car: CarResponse, state: CarState, throttle: FloatArray, pressure_mpa: FloatArray, dt_s: float
) -> CarState:
    """Advance the car by one step under the given pedal commands.

    The lags are discretised exactly for a command held over the step. A car that reaches standstill stays there
    while it is braked: speed never turns negative, and the acceleration of a standing car is zero.
    """
    pressure = state.pressure_mpa + (pressure_mpa - state.pressure_mpa) * -np.expm1(-dt_s / car.brake_lag_s)
    opening = state.throttle + (throttle - state.throttle) * -np.expm1(-dt_s / car.throttle_lag_s)
    limit = car.friction * STANDARD_GRAVITY_MPS2
    accel_mps2 = np.clip(car.throttle_gain_mps2 * opening - car.brake_gain_mps2_per_mpa * pressure, -limit, limit)
    step = car.max_jerk_mps3 * dt_s
    accel = state.accel_mps2 + np.clip(accel_mps2 - state.accel_mps2, -step, step)
    stop_time_s = np.where(accel < 0.0, state.speed_mps / np.where(accel < 0.0, -accel, 1.0), np.inf)
    moving_s = np.minimum(dt_s, stop_time_s)
    speed = np.maximum(state.speed_mps + accel * moving_s, 0.0)
    travelled = state.travelled_m + state.speed_mps * moving_s + 0.5 * accel * moving_s**2
    standing = (speed <= 0.0) & (accel <= 0.0)
    return CarState(pressure, opening, np.where(standing, 0.0, accel), np.where(standing, 0.0, speed), travelled)
