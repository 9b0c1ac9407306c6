"""The closed loop: the host moves as recorded until the warning, and a policy works its pedals from then on.

The host keeps to its recorded path (only its speed along it changes) and the other car is unaffected, as in song2016,
section 4. Every warning moment of a study is run at once: the arrays have one row per run.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cwcli.control.car import CarResponse, CarState, advance_car
from cwcli.control.controller import (
    ThrottleAndPressure,
    fuzzy_throttle_and_pressure,
    speed_difference_along_heading_mps,
)
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray

COLLISION_DISTANCE_M = 2.5
"""Distance of the cars' reference points below which they have collided, m; song2016, section 4."""
DRIVER_REACTION_TIME_S = 1.5
"""Time from the warning to the driver's braking, s: that of an unprepared driver. Chosen by hand
(docs/papers/song2016-choices.md)."""
DRIVER_BRAKE_PRESSURE_MPA = 7.0
"""Brake pressure of the driver, MPa: hard but not full braking, 6.3 m/s^2. Chosen by hand
(docs/papers/song2016-choices.md)."""


@dataclass(frozen=True)
class RecordedMotion:
    """One car's motion in the map frame.

    Attributes:
        time_s: Shape (k,), strictly increasing.
        x_m, y_m, heading_rad, speed_mps: Shape (k,); heading unwrapped, speed not negative.
        accel_mps2, yaw_rate_radps: Shape (k,), where they were estimated; None: from the speed and the heading.
    """

    time_s: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    heading_rad: FloatArray
    speed_mps: FloatArray
    accel_mps2: FloatArray | None = None
    yaw_rate_radps: FloatArray | None = None

    def resample_at(self, time_s: FloatArray) -> RecordedMotion:
        """Resample the motion linearly at the times (k,); it is held beyond the ends."""

        def interpolate(column: FloatArray) -> FloatArray:
            return np.asarray(np.interp(time_s, self.time_s, column))

        return RecordedMotion(
            time_s,
            interpolate(self.x_m),
            interpolate(self.y_m),
            interpolate(self.heading_rad),
            interpolate(self.speed_mps),
            None if self.accel_mps2 is None else interpolate(self.accel_mps2),
            None if self.yaw_rate_radps is None else interpolate(self.yaw_rate_radps),
        )

    @property
    def acceleration_mps2(self) -> FloatArray:
        """The acceleration along the heading, shape (k,)."""
        return _time_derivative(self.speed_mps, self.time_s) if self.accel_mps2 is None else self.accel_mps2

    @property
    def turn_rate_radps(self) -> FloatArray:
        """The rate of the heading, shape (k,)."""
        return _time_derivative(self.heading_rad, self.time_s) if self.yaw_rate_radps is None else self.yaw_rate_radps


def _time_derivative(values: FloatArray, time_s: FloatArray) -> FloatArray:
    """Central differences of values (k,) over time, per second, shape (k,); 0 for a single point."""
    return np.asarray(np.gradient(values, time_s)) if len(time_s) > 1 else np.zeros(1)


@dataclass(frozen=True)
class PedalSituation:
    """The inputs of a policy at one instant, shape (n,) each.

    Attributes:
        since_warning_s: Negative before the warning.
        ttc_s: Time until the distance is the collision distance, at the present relative velocity and acceleration;
            infinity when it never will be. The acceleration counts because the paper's TTC is that of the predicted
            paths: at the warning it is 2.5 s, long before distance over closing speed says so.
        speed_difference_mps: Eq. 11.
    """

    since_warning_s: FloatArray
    ttc_s: FloatArray
    speed_difference_mps: FloatArray


PedalPolicy = Callable[[PedalSituation], ThrottleAndPressure]
"""A function from what is seen at one instant to the pedals."""


def fuzzy_controller_throttle_and_pressure(situation: PedalSituation) -> ThrottleAndPressure:
    """Throttle and brake pressure of the fuzzy controller (song2016, section 4)."""
    return fuzzy_throttle_and_pressure(situation.ttc_s, situation.speed_difference_mps)


def throttle_and_pressure_of_driver_braking_after_warning(situation: PedalSituation) -> ThrottleAndPressure:
    """Throttle and brake pressure of a driver who brakes hard and steadily 1.5 s after the warning."""
    braking = situation.since_warning_s >= DRIVER_REACTION_TIME_S
    return np.zeros(len(braking)), np.where(braking, DRIVER_BRAKE_PRESSURE_MPA, 0.0)


@dataclass(frozen=True)
class ReplayedRuns:
    """The result of a replay, one row per run.

    Attributes:
        time_s: Shape (k,).
        x_m, y_m, heading_rad, speed_mps, accel_mps2, throttle, pressure_mpa: The host, shape (n, k).
        distance_m: Distance of the two cars' reference points, shape (n, k).
        min_distance_m, min_distance_time_s: Shape (n,).
        collided: Shape (n,), bool: the distance fell below `COLLISION_DISTANCE_M`.
        peak_deceleration_mps2, peak_jerk_mps3: Shape (n,), magnitudes after the warning.
    """

    time_s: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    heading_rad: FloatArray
    speed_mps: FloatArray
    accel_mps2: FloatArray
    throttle: FloatArray
    pressure_mpa: FloatArray
    distance_m: FloatArray
    min_distance_m: FloatArray
    min_distance_time_s: FloatArray
    collided: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
    peak_deceleration_mps2: FloatArray
    peak_jerk_mps3: FloatArray


def replay_with_policy(
    host: RecordedMotion,
    other: RecordedMotion,
    warning_time_s: FloatArray,
    policy: PedalPolicy,
    *,
    car: CarResponse | None = None,
    step_s: float = 0.01,
) -> ReplayedRuns:
    """Replay the encounter with the policy at the pedals after each warning moment.

    Args:
        host, other: Recorded motions; they are compared where both are known.
        warning_time_s: Shape (n,), on the motions' clock; infinity for "never warned" (the recorded motion itself).

    Raises:
        ValueError: The two motions do not overlap in time.
    """
    response = car or CarResponse()
    start_s = max(host.time_s[0], other.time_s[0])
    end_s = min(host.time_s[-1], other.time_s[-1])
    if not end_s > start_s:
        raise ValueError("the two motions do not overlap in time")
    time_s = start_s + step_s * np.arange(int((end_s - start_s) / step_s + 1e-9) + 1)
    recorded, obstacle = host.resample_at(time_s), other.resample_at(time_s)
    path, other_car = _RecordedPath(recorded), _OtherCar(obstacle)
    recorded_accel = recorded.acceleration_mps2

    n, k = len(warning_time_s), len(time_s)
    names = ("x_m", "y_m", "heading_rad", "speed_mps", "accel_mps2", "throttle", "pressure_mpa", "distance_m")
    rows = {name: np.empty((n, k)) for name in names}
    zeros = np.zeros(n)
    state = CarState(zeros, zeros, zeros, zeros, zeros)
    for i, now_s in enumerate(time_s):
        free = now_s < warning_time_s
        state = CarState(
            state.pressure_mpa,
            state.throttle,
            np.where(free, recorded_accel[i], state.accel_mps2),
            np.where(free, recorded.speed_mps[i], state.speed_mps),
            np.where(free, path.travelled_m[i], state.travelled_m),
        )
        x, y, heading = path.x_y_and_heading_at_distance(state.travelled_m)
        dx, dy = obstacle.x_m[i] - x, obstacle.y_m[i] - y
        distance = np.hypot(dx, dy)
        situation = _compute_pedal_situation_at_step(
            now_s - warning_time_s, (dx, dy, distance), heading, state, other_car, i
        )
        throttle, pressure = policy(situation)
        throttle, pressure = np.where(free, 0.0, throttle), np.where(free, 0.0, pressure)
        for name, value in zip(
            rows,
            (x, y, heading, state.speed_mps, state.accel_mps2, throttle, state.pressure_mpa, distance),
            strict=True,
        ):
            rows[name][:, i] = value
        state = advance_car(response, state, throttle, pressure, step_s)

    after = time_s[None, :] >= warning_time_s[:, None]
    distance_m, accel_mps2 = rows["distance_m"], rows["accel_mps2"]
    min_distance_m = distance_m.min(axis=1)
    jerk = np.abs(np.diff(accel_mps2, axis=1, prepend=accel_mps2[:, :1])) / step_s
    # The step from the recorded acceleration to the controlled one, and to standstill, is not the controller's jerk.
    own = after & np.roll(after, 1, axis=1) & (rows["speed_mps"] > 0.0)
    return ReplayedRuns(
        time_s=time_s,
        **rows,
        min_distance_m=min_distance_m,
        min_distance_time_s=time_s[distance_m.argmin(axis=1)],
        collided=min_distance_m < COLLISION_DISTANCE_M,
        peak_deceleration_mps2=np.where(after, -accel_mps2, 0.0).max(axis=1, initial=0.0),
        peak_jerk_mps3=np.where(own, jerk, 0.0).max(axis=1, initial=0.0),
    )


def _compute_pedal_situation_at_step(
    since_warning_s: FloatArray,
    offset_m: tuple[FloatArray, FloatArray, FloatArray],
    heading_rad: FloatArray,
    car: CarState,
    obstacle: _OtherCar,
    i: int,
) -> PedalSituation:
    """Compute a policy's inputs at step i from the cars' relative motion: time to collision and eq. 11's dv.

    Args:
        offset_m: The other car's position minus the controlled car's: x, y and distance, map frame, shape (n,) each.
    """
    (dx_m, dy_m, distance_m), speed_mps, accel_mps2 = offset_m, car.speed_mps, car.accel_mps2
    cosine, sine = np.cos(heading_rad), np.sin(heading_rad)
    relative_vx = obstacle.vx_mps[i] - speed_mps * cosine
    relative_vy = obstacle.vy_mps[i] - speed_mps * sine
    relative_ax = obstacle.ax_mps2[i] - accel_mps2 * cosine
    relative_ay = obstacle.ay_mps2[i] - accel_mps2 * sine
    reach = np.maximum(distance_m, 1e-6)
    rate = (dx_m * relative_vx + dy_m * relative_vy) / reach
    across2 = np.maximum(relative_vx**2 + relative_vy**2 - rate**2, 0.0)
    rate_change = (dx_m * relative_ax + dy_m * relative_ay + across2) / reach
    gap = np.maximum(distance_m - COLLISION_DISTANCE_M, 0.0)
    motion = obstacle.motion
    dv = speed_difference_along_heading_mps(speed_mps, motion.speed_mps[i], heading_rad - motion.heading_rad[i])
    return PedalSituation(since_warning_s, time_to_close_gap_s(gap, rate, rate_change), dv)


def time_to_close_gap_s(gap_m: FloatArray, rate_mps: FloatArray, rate_change_mps2: FloatArray) -> FloatArray:
    """Time until the gap closes, shape (n,), s: first t >= 0 with gap + rate t + rate_change t^2 / 2 = 0, else inf."""
    quadratic = rate_mps**2 - 2.0 * rate_change_mps2 * gap_m
    root = np.sqrt(np.maximum(quadratic, 0.0))
    # 2 g / (-r + sqrt(r^2 - 2 a g)) is the smaller positive root, without cancellation for a near 0.
    below = root - rate_mps
    time = np.divide(2.0 * gap_m, below, out=np.full_like(gap_m, np.inf), where=below > 1e-9)
    return np.asarray(np.where(quadratic < 0.0, np.inf, time))


class _OtherCar:
    """The other car, with its velocity and acceleration in the map frame, shape (k,) each."""

    def __init__(self, motion: RecordedMotion) -> None:
        self.motion = motion
        self.vx_mps = motion.speed_mps * np.cos(motion.heading_rad)
        self.vy_mps = motion.speed_mps * np.sin(motion.heading_rad)
        along, across = motion.acceleration_mps2, motion.speed_mps * motion.turn_rate_radps
        self.ax_mps2 = along * np.cos(motion.heading_rad) - across * np.sin(motion.heading_rad)
        self.ay_mps2 = along * np.sin(motion.heading_rad) + across * np.cos(motion.heading_rad)


class _RecordedPath:
    """The recorded path as a function of the distance travelled; straight on beyond its end.

    The distance is the integral of the speed, not the sum of the steps between positions: noise of the positions would
    lengthen the latter, most of all where the car stands.
    """

    def __init__(self, motion: RecordedMotion) -> None:
        steps = 0.5 * (motion.speed_mps[1:] + motion.speed_mps[:-1]) * np.diff(motion.time_s)
        self.travelled_m = np.concatenate(([0.0], np.cumsum(steps)))
        has_moved = np.concatenate(([True], steps > 0.0))
        self._s = self.travelled_m[has_moved]
        self._x, self._y = motion.x_m[has_moved], motion.y_m[has_moved]
        self._heading = motion.heading_rad[has_moved]

    def x_y_and_heading_at_distance(self, travelled_m: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """x, y (m) and heading (rad) at the distances travelled (n,), shape (n,) each."""
        heading = np.interp(travelled_m, self._s, self._heading)
        beyond = np.maximum(travelled_m - self._s[-1], 0.0)
        x = np.interp(travelled_m, self._s, self._x) + beyond * np.cos(heading)
        y = np.interp(travelled_m, self._s, self._y) + beyond * np.sin(heading)
        return x, y, heading
