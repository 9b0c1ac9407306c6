"""Direction of travel and horizontal speed of a vehicle from the velocity and the yaw of a device mounted in it.

The heading of a state is the direction of motion; where the car reverses, the speed is negative and the heading stays
that of the car's front, opposite to the course. A device is rarely mounted exactly along the car: the constant part of
the angle between its x axis and the direction of travel is its mounting, and no error of anybody's heading.
"""

from __future__ import annotations

from math import degrees

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.angles import wrap_angle
from cwcli.signals.columns import FloatArray, Int64Array, median_of_values
from cwcli.signals.units import NS_PER_S

ComplexArray = npt.NDArray[np.complex128]

MIN_SPEED_FOR_COURSE_MPS = 1.5
"""Speed in m/s below which the yaw counts, because the noise of a velocity decides its course: people walk at 1.4
m/s."""
SPEED_OF_HALF_COURSE_WEIGHT_MPS = 5.0
"""Speed in m/s at which a course has a weight of one half: its noise is that of the velocity by the speed. Chosen by
hand."""
MIN_MOVING_ROWS_FOR_MOUNTING = 20
"""Least number of rows in motion from which a mounting is estimated. Chosen by hand; not fitted."""
MIN_TRAVEL_FOR_MOUNTING_M = 100.0
"""Least length of way, m, from which a mounting is estimated, so that errors that change slowly show their scatter.
Chosen by hand; not fitted."""
MAX_REVERSE_SPEED_MPS = 12.0
"""Greatest speed of a car in reverse, m/s: the reverse gear ends below 45 km/h."""
MAX_BINS_AVERAGED_FOR_ERROR_CORRELATION = 2000
"""Greatest number of consecutive bins into which a long log is averaged before the correlation of its errors is
examined. Chosen by hand."""
N_FITTED_MOUNTING_COEFFICIENTS = 3
"""Number of coefficients of the fit, which use up as many independent errors."""
MIN_SIGMAS_OF_SIGNIFICANT_MOUNTING = 3.0
"""Distance of a mounting from zero, in sigmas, below which it is taken as zero. Chosen by hand; not fitted."""
MAX_YAW_SCATTER_ABOUT_COURSE_RAD = 0.35
"""Greatest scatter of a yaw about the direction of travel, rad (20 degrees), at which it belongs to that velocity.
Chosen by hand; not fitted."""
DEVICE_AHEAD_OF_REAR_AXLE_SIGMA_M = 3.0
"""One sigma of the distance by which a device lies ahead of the rear axle, m: in a bend its course turns by that times
the curvature. Chosen by hand; not fitted."""
SLIP_PER_LATERAL_ACCEL_SIGMA_RAD_S2PM = 0.006
"""One sigma of the side slip over the lateral acceleration, rad s^2/m: 1,500 kg, half of them on rear tyres of
together 120 kN/rad, slip by 750 / 120,000 rad at 1 m/s^2."""
MAX_TIME_BETWEEN_VELOCITY_POSITIONS_S = 1.0
"""Longest time in s between two positions that give a velocity. Chosen by hand."""
MIN_DISTANCE_BETWEEN_VELOCITY_POSITIONS_M = 0.5
"""Least distance in m between two positions that give a course: 0.05 m of noise makes it uncertain by 8 degrees."""


@dataclass(frozen=True)
class YawMounting:
    """How a device is turned about the vertical against the direction of travel.

    Attributes:
        left_rad: Its yaw minus the direction of travel: positive when its x axis points to the left of it.
        sigma_rad: One sigma.
        n: Rows in motion that it was estimated from.
    """

    left_rad: float
    sigma_rad: float
    n: int

    @property
    def is_significant(self) -> bool:
        """Whether it differs clearly from zero."""
        return abs(self.left_rad) > MIN_SIGMAS_OF_SIGNIFICANT_MOUNTING * self.sigma_rad

    @property
    def correction_rad(self) -> float:
        """What a yaw is corrected by."""
        return self.left_rad if self.is_significant else 0.0

    def mounting_note(self, source: str) -> str:
        """A sentence for the summary."""
        side = "left" if self.left_rad > 0.0 else "right"
        return (
            f"{source}: its device is mounted {degrees(abs(self.left_rad)):.2g} deg to the {side} of the direction of "
            f"travel (sigma {degrees(self.sigma_rad):.1g} deg, from {self.n} rows in motion); this is no error of the "
            "estimated heading"
        )


def find_yaw_mounting(
    stamp_ns: Int64Array, velocity: ComplexArray, yaw_rad: FloatArray, yaw_rate_radps: FloatArray
) -> YawMounting | None:
    """Estimate the mounting of a device from its velocity and its yaw; None where too little motion shows it.

    The angle between yaw and direction of travel is fitted, robustly, by a constant, the curvature of the way times the
    device's distance from the rear axle, and the lateral acceleration times a slip (the linear single-track model). The
    last two have priors, so a log that only turns to one side leaves the constant uncertain.

    Args:
        stamp_ns: Shape (n,), increasing.
        velocity: Shape (n,), horizontal, x + iy in the axes in which the yaw counts, m/s; NaN where not known.
        yaw_rad: Shape (n,), of the device's x axis.
        yaw_rate_radps: Shape (n,), NaN where not known.
    """
    speed = np.abs(velocity)
    use = (
        np.isfinite(speed)
        & np.isfinite(yaw_rad)
        & (np.where(np.isfinite(speed), speed, 0.0) > MIN_SPEED_FOR_COURSE_MPS)
    )
    if (
        np.count_nonzero(use) < MIN_MOVING_ROWS_FOR_MOUNTING
        or travelled_distance_m(stamp_ns, velocity) < MIN_TRAVEL_FOR_MOUNTING_M
    ):
        return None
    against_yaw = velocity[use] * np.exp(-1j * yaw_rad[use])
    axis = _front_quarter_turn_rad(against_yaw)
    forward = against_yaw * np.exp(-1j * axis)
    is_reversing = forward.real < 0.0
    speed = np.where(is_reversing, -1.0, 1.0) * speed[use]
    left = wrap_angle(-np.angle(np.where(is_reversing, -forward, forward)))
    if median_of_values(np.abs(left - median_of_values(left))) > MAX_YAW_SCATTER_ABOUT_COURSE_RAD:
        return None
    turning = np.where(np.isfinite(yaw_rate_radps[use]), yaw_rate_radps[use], 0.0)
    regressors = np.column_stack([np.ones(len(left)), -turning / speed, turning * speed])
    constant, sigma = _huber_intercept_and_sigma(
        left, regressors, speed**2 / (speed**2 + SPEED_OF_HALF_COURSE_WEIGHT_MPS**2)
    )
    return YawMounting(wrap_angle(constant - axis), sigma, len(left))


def travel_direction_and_signed_speed(
    velocity: ComplexArray, yaw_rad: FloatArray, left_rad: float
) -> tuple[FloatArray, FloatArray]:
    """Direction of travel and signed horizontal speed.

    In motion the heading is the course, turned round where the velocity points behind the device; at less than walking
    speed it is the yaw without the mounting, and the speed is the velocity along it.

    Args:
        velocity: Shape (n,), horizontal, x + iy, m/s.
        yaw_rad: Shape (n,), of the device's x axis, in the same axes.
        left_rad: The device's mounting, see `YawMounting`.

    Returns:
        Radians in (-pi, pi] and m/s, negative in reverse; shape (n,) each. Where the yaw is not known the car is taken
        to drive forward.
    """
    axis_rad = wrap_angle(yaw_rad - left_rad)
    along = (velocity * np.exp(-1j * axis_rad)).real
    sign = np.where(along < 0.0, -1.0, 1.0)
    speed = np.abs(velocity)
    in_motion = speed > MIN_SPEED_FOR_COURSE_MPS
    heading = np.where(in_motion, wrap_angle(np.angle(sign * velocity)), axis_rad)
    return heading, np.where(in_motion, sign * speed, np.where(np.isfinite(along), along, speed))


def velocity_of_positions(stamp_ns: Int64Array, xy_m: FloatArray) -> ComplexArray:
    """Velocity from the way between the positions before and after each, x + iy, m/s, shape (n,); NaN where unclear.

    Args:
        stamp_ns: Shape (n,), increasing.
        xy_m: Shape (n, 2).
    """
    velocity = np.full(len(stamp_ns), np.nan + 0j)
    if len(stamp_ns) < 3:
        return velocity
    way = xy_m[2:] - xy_m[:-2]
    step_s = (stamp_ns[2:] - stamp_ns[:-2]) / NS_PER_S
    is_clear = (
        (step_s > 0.0)
        & (step_s <= MAX_TIME_BETWEEN_VELOCITY_POSITIONS_S)
        & (np.hypot(*way.T) >= MIN_DISTANCE_BETWEEN_VELOCITY_POSITIONS_M)
    )
    velocity[1:-1][is_clear] = (way[is_clear, 0] + 1j * way[is_clear, 1]) / step_s[is_clear]
    return velocity


def travelled_distance_m(stamp_ns: Int64Array, velocity: ComplexArray) -> float:
    """The way of rows in motion that are less than MAX_TIME_BETWEEN_VELOCITY_POSITIONS_S apart."""
    speed, step_s = np.abs(velocity[1:]), np.diff(stamp_ns) / NS_PER_S
    use = np.isfinite(speed) & (step_s > 0.0) & (step_s <= MAX_TIME_BETWEEN_VELOCITY_POSITIONS_S)
    return float(speed[use] @ step_s[use])


def _front_quarter_turn_rad(against_yaw: ComplexArray) -> float:
    """The direction of the car's front against the device's x axis: 0, a quarter turn, half a turn or three quarters.

    The x axis is taken to point ahead (REP-103), unless the way lies across it, or most of it goes backwards faster
    than a car reverses: then the front is where most of the way goes.
    """
    speed = np.abs(against_yaw)
    across = float(np.sum(against_yaw**2 / speed).real) < 0.0
    if across:
        return float(np.pi / 2 if np.sum(against_yaw.imag) > 0.0 else -np.pi / 2)
    backward_m = float(speed[against_yaw.real < -MAX_REVERSE_SPEED_MPS].sum())
    return float(np.pi) if backward_m > 0.5 * float(speed.sum()) else 0.0


def _huber_intercept_and_sigma(values: FloatArray, regressors: FloatArray, weights: FloatArray) -> tuple[float, float]:
    """The first coefficient of a Huber regression with priors on the others, and its sigma.

    Args:
        values: Shape (n,).
        regressors: Shape (n, 3): 1, the way's curvature (negative) and the lateral acceleration.
        weights: Shape (n,).
    """
    prior = np.diag([0.0, DEVICE_AHEAD_OF_REAR_AXLE_SIGMA_M**-2, SLIP_PER_LATERAL_ACCEL_SIGMA_RAD_S2PM**-2])
    own = weights
    coefficients, variance, slow = np.array([median_of_values(values), 0.0, 0.0]), 1.0, 1.0
    information = np.eye(3)
    for _ in range(10):
        residual = values - regressors @ coefficients
        scale = max(1.4826 * median_of_values(np.abs(residual - median_of_values(residual))), 1e-6)
        own = weights * np.minimum(1.0, 2.0 * scale / np.maximum(np.abs(residual), 1e-12))
        variance = float(own @ residual**2 / own.sum()) + 1e-12
        slow = _variance_factor_of_slow_errors(residual, own)
        information = (regressors.T * own) @ regressors / (variance * slow) + prior
        coefficients = np.linalg.solve(information, (regressors.T * own) @ values / (variance * slow))
    return float(coefficients[0]), float(np.sqrt(np.linalg.inv(information)[0, 0]))


def _variance_factor_of_slow_errors(residual: FloatArray, weights: FloatArray) -> float:
    """How much greater the variance of the weighted mean is than of rows that err independently; at least 1.

    From the autocorrelation of the residuals up to its first negative value (Geyer's initial positive sequence,
    simplified), with what the fit takes off their number.
    """
    n = len(residual)
    bins = min(n, MAX_BINS_AVERAGED_FOR_ERROR_CORRELATION)
    own = np.sqrt(weights / weights.mean())
    series = np.array([part.mean() for part in np.array_split(own * residual, bins)])
    centred = series - series.mean()
    power = float(np.einsum("i,i", centred, centred))
    of_rows = float(weights @ residual**2 / weights.sum())
    if power <= 0.0 or of_rows <= 0.0:
        return 1.0
    total = 0.0
    for lag in range(1, bins - 1):
        rho = float(np.einsum("i,i", centred[:-lag], centred[lag:])) / power
        if rho < 0.0:
            break
        total += rho
    independent = bins / (1.0 + 2.0 * total)
    of_mean = power / bins / independent * (independent / max(independent - N_FITTED_MOUNTING_COEFFICIENTS, 1.0))
    return max(1.0, n * of_mean / of_rows)
