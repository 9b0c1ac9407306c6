"""Parameters of the motion model, each with the reason for its value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import Any

import numpy as np

from cwcli.kernels import ekf
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.columns import FloatArray

MANOEUVRE_SIGMA_FACTOR_LIMITS: dict[str, tuple[float, float]] = {
    "jerk_sigma_mps3": (1.0 / 8.0, 2.0),
    "yaw_accel_sigma_radps2": (1.0 / 8.0, 2.0),
}
"""Fitted sigma of the motion -> least and greatest factor on its first value, chosen by what a driver can do."""


@dataclass(frozen=True)
class MotionParameters:
    """Motion model of the eight-state filter.

    Acceleration and yaw rate follow a damped second-order process: white noise drives the jerk (the yaw acceleration),
    which decays within a fraction of a second (Singer, 1970), and the acceleration (yaw rate) itself is pulled
    back to zero over many seconds, so that a long outage does not let the speed (heading) run away.

    Attributes:
        accel_decay_s: A driver holds an acceleration for some seconds. With the jerk's numbers the stationary sigma of
            the acceleration is 3 m/s^2, and a car can do three of these. With 10 s it would be 6, and a gap of
            25 s without any measurement would end at speeds that no car has.
        jerk_decay_s: Time that a pedal or brake needs to build up.
        jerk_sigma_mps3: Stationary jerk; everyday driving stays within about +-2 m/s^3.
        yaw_rate_decay_s: A turn at a junction takes some seconds; the stationary sigma is 0.36 rad/s. (Near standstill
            it is 0.3 s: a standing car does not turn.)
        yaw_accel_decay_s: Time that a driver needs to turn the wheel in.
        yaw_accel_sigma_radps2: Stationary yaw acceleration; 90 degrees at a junction within 4 s need 0.3 rad/s^2.
        standstill_speed_mps: Below it a car hardly yaws: the yaw noise shrinks with v^2 / (v^2 + standstill^2).
        standstill_floor: Part of the yaw noise that is left at standstill.
        side_slip_m: Position noise in metres per square root of a second, because the point does not move exactly along
            the heading. It acts across the heading of a moving car, and in all directions near standstill, where a car
            is steered on the spot.
        along_share: Share of that variance that acts along the heading, too: wheels slip, and errors of fixes last.
            Chosen among 0, 0.1 and 0.25 by the NEES of the speed on the KITTI drive.
        course_rad: Heading noise in radians per square root of a second: side-slip and roll that the gyroscope does
            not see.
        reverse_mps: Faster reversing means that the heading is wrong by half a turn.
        accel_bias_walk: Random walk of the forward accelerometer's bias, m/s^2 per square root of a second.
        yaw_rate_bias_walk: Random walk of the gyroscope's bias, rad/s per square root of a second.
        time_constant_s: Index of a parameter state -> time constant with which it fades to zero (Gauss-Markov); the
            other parameter states are random walks.
        turn_noise: Index of a parameter state -> additional white noise, variance per radian turned.
    """

    accel_decay_s: float = 3.0
    jerk_decay_s: float = 1.0
    jerk_sigma_mps3: float = 2.0
    yaw_rate_decay_s: float = 4.0
    yaw_accel_decay_s: float = 1.0
    yaw_accel_sigma_radps2: float = 0.2
    standstill_speed_mps: float = 2.0
    standstill_floor: float = 1e-3
    side_slip_m: float = 0.15
    along_share: float = 0.25
    course_rad: float = 5e-4
    reverse_mps: float = 4.0
    accel_bias_walk: float = 0.005
    yaw_rate_bias_walk: float = 1e-5
    time_constant_s: Mapping[int, float] = field(default_factory=dict)
    turn_noise: Mapping[int, float] = field(default_factory=dict)

    def with_manoeuvre_sigma_within_limits(self, name: str, sigma: float, begin: MotionParameters) -> MotionParameters:
        """Return the parameters with one of the two manoeuvre sigmas replaced, limited relative to its first value."""
        first = float(getattr(begin, name))
        limited = float(np.clip(np.log(sigma / first), *np.log(MANOEUVRE_SIGMA_FACTOR_LIMITS[name])))
        return self.with_manoeuvre_sigma(name, first * float(np.exp(limited)))

    def with_manoeuvre_sigma(self, name: str, sigma: float) -> MotionParameters:
        """Return the parameters with one of the two manoeuvre sigmas replaced."""
        change: dict[str, Any] = {name: sigma}
        return replace(self, **change)

    @property
    def hashable_key_of_equal_parameters(self) -> tuple[object, ...]:
        """What equal parameters have in common; unlike the parameters themselves it can be looked up."""
        *numbers, time_constant_s, turn_noise = vars(self).values()
        return *numbers, *time_constant_s.items(), None, *turn_noise.items()

    def to_process_model(self, walk: FloatArray) -> ekf.ProcessModel:
        """Return the kernel's model; walk (n,): white noise behind the parameter states, variance per second."""
        time_constant_s, turn_noise = np.zeros(len(walk)), np.zeros(len(walk))
        for array, stated_values in ((time_constant_s, self.time_constant_s), (turn_noise, self.turn_noise)):
            for i, value in stated_values.items():
                array[i] = value
        jerk_rate, yaw_accel_rate = 1.0 / self.jerk_decay_s, 1.0 / self.yaw_accel_decay_s
        return ekf.ProcessModel.damped(
            {
                "accel_rate": 1.0 / self.accel_decay_s,
                "jerk_rate": jerk_rate,
                "jerk_noise": 2.0 * jerk_rate * self.jerk_sigma_mps3**2,
                "yaw_rate_rate": 1.0 / self.yaw_rate_decay_s,
                "yaw_accel_rate": yaw_accel_rate,
                "yaw_accel_noise": 2.0 * yaw_accel_rate * self.yaw_accel_sigma_radps2**2,
                "standstill_speed": self.standstill_speed_mps,
                "standstill_floor": self.standstill_floor,
                "xy_noise": self.side_slip_m**2,
                "along_share": self.along_share,
                "heading_noise": self.course_rad**2,
                "reverse_speed": self.reverse_mps,
            },
            walk,
            turn_noise,
            time_constant_s,
        )


SIMULATED_JERK_SIGMA_MPS3 = 100.0
"""Jerk sigma of a simulated car, m/s^3: full braking (10 m/s^2) within the longest step of a trace, 0.1 s."""
SIMULATED_YAW_ACCEL_SIGMA_RADPS2 = 10.0
"""Yaw acceleration sigma of a simulated car, rad/s^2: a yaw rate of 1 rad/s within the longest step of a trace."""


def motion_of_simulated_vehicle(parameters: MotionParameters) -> MotionParameters:
    """Return the motion parameters of a simulated vehicle, whose acceleration may change within one step.

    With the jerk of a driver the filter would round off such changes, and a time to collision at a small closing speed
    would be wrong. With these sigmas the states follow the messages.
    """
    return replace(
        parameters, jerk_sigma_mps3=SIMULATED_JERK_SIGMA_MPS3, yaw_accel_sigma_radps2=SIMULATED_YAW_ACCEL_SIGMA_RADPS2
    )
