"""The true motion of a vehicle: the integral of its profile.

Speed, acceleration, jerk, curvature, yaw rate, yaw acceleration and heading are evaluated in closed form at any time.
The position is the integral of speed along the heading, by three-point Gauss quadrature on steps of 10 ms: its error
is far below a micrometre. The vehicle is a point without side slip that moves along its heading.
"""

from __future__ import annotations

from math import factorial
from typing import Protocol

import numpy as np
import numpy.typing as npt
from numpy.polynomial.polynomial import polyder, polymul, polyval

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.units import STANDARD_GRAVITY_MPS2
from cwcli.simulation.profile import MotionProfile, find_piece_at
from cwcli.toml_text import toml_value_error

QUADRATURE_STEP_S = 0.01
"""Step of the quadrature of the position, s. Edges of the profile's pieces are steps too, so that the motion is smooth
inside each step. Chosen by hand; not fitted."""
TRUTH_BEFORE_RUN_S = 6.0
"""Time for which the truth goes on before the run at constant speed and turn, s: longer than the largest lag of a
sensor."""
TRUTH_AFTER_RUN_S = 10.0
"""Time for which the truth goes on after the run at constant speed and turn, s: for sensors with a negative lag. Chosen
by hand; not fitted."""


_GAUSS_NODE_OFFSET = np.sqrt(0.6)
"""Distance of the outer nodes of three-point Gauss quadrature from the middle of [-1, 1]."""
_GAUSS_NODES = 0.5 * np.array([1 - _GAUSS_NODE_OFFSET, 1.0, 1 + _GAUSS_NODE_OFFSET])
"""Nodes of three-point Gauss quadrature on [0, 1], shape (3,)."""
_GAUSS_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0
"""Weights of three-point Gauss quadrature on [0, 1], shape (3,)."""


N_SPEED_COEFFICIENTS = 5
"""Number of coefficients of the speed: the integral of a smooth ramp of acceleration, which is cubic."""
N_YAW_RATE_COEFFICIENTS = 8
"""Number of coefficients of the yaw rate: the product of a cubic curvature and a quartic speed is of degree 7."""
_YAW_RATE_INTEGRAL_DIVISORS = np.arange(1, N_YAW_RATE_COEFFICIENTS + 1)
"""1 to 8: the coefficient of t^k in the polynomial of the yaw rate is divided by k + 1 when it is integrated to the
heading. Shape (8,)."""


@dataclass(frozen=True)
class _ProfilePolynomials:
    """The profile on the common edges of its pieces, as polynomials of the time since each edge.

    Attributes:
        edge_s: Shape (m,), the start of each piece; the first reaches back without end.
        speed: Shape (m, N_SPEED), ascending powers.
        yaw_rate: Shape (m, N_YAW_RATE), ascending powers.
        heading_rad: Shape (m,), at the edges.
    """

    edge_s: FloatArray
    speed: FloatArray
    yaw_rate: FloatArray
    heading_rad: FloatArray


class Motion(Protocol):
    """The true motion of a vehicle, prescribed (`TrueMotion`) or recorded."""

    def states_at(self, time_s: FloatArray) -> FloatArray: ...
    def is_present_at(self, time_s: FloatArray) -> npt.NDArray[np.bool_]: ...


class TrueMotion:
    """True states of one vehicle at any time from 6 s before the run to 10 s after it."""

    def __init__(self, profile: MotionProfile, *, x_m: float, y_m: float, heading_rad: float) -> None:
        """Integrate the profile from a start position (east, north) and heading (counter-clockwise from east)."""
        self._pieces = _merge_profile_pieces(profile, heading_rad)
        steps_s = np.arange(-TRUTH_BEFORE_RUN_S, profile.end_s + TRUTH_AFTER_RUN_S, QUADRATURE_STEP_S, dtype=np.float64)
        self._grid_s: FloatArray = np.union1d(steps_s, [*self._pieces.edge_s, profile.end_s + TRUTH_AFTER_RUN_S])
        way_m = self._displacement_m(self._grid_s[:-1], np.diff(self._grid_s))
        track = np.zeros((len(self._grid_s), 2))
        np.cumsum(way_m, axis=0, out=track[1:])
        self._position = track - track[np.searchsorted(self._grid_s, 0.0)] + np.array([x_m, y_m])

    def states_at(self, time_s: FloatArray) -> FloatArray:
        """The true states at the given times.

        Args:
            time_s: Shape (n,), seconds of the run.

        Returns:
            Shape (n, 8): x_m, y_m, speed_mps, heading_rad (continuous, not wrapped), accel_mps2, yaw_rate_radps,
            jerk_mps3, yaw_accel_radps2; `map` frame.

        Raises:
            ValueError: A time outside the range that was integrated.
        """
        time = np.asarray(time_s, dtype=np.float64)
        if len(time) and not (self._grid_s[0] <= time.min() and time.max() <= self._grid_s[-1]):
            raise ValueError(f"truth is known from {self._grid_s[0]} to {self._grid_s[-1]} s only")
        cell = np.clip(np.searchsorted(self._grid_s, time, side="right") - 1, 0, len(self._grid_s) - 1)
        rest = self._displacement_m(self._grid_s[cell], time - self._grid_s[cell])
        return np.column_stack([self._position[cell] + rest, self._speed_heading_accel_and_further_states(time)])

    def is_present_at(self, time_s: FloatArray) -> npt.NDArray[np.bool_]:
        """Tell at which times (n,) the vehicle is on the road: at all."""
        return np.ones(len(time_s), np.bool_)

    def _displacement_m(self, start_s: FloatArray, step_s: FloatArray) -> FloatArray:
        """The displacement (n, 2), m, from each start within each (short) step."""
        total = np.zeros((len(start_s), 2))
        for node, weight in zip(_GAUSS_NODES, _GAUSS_WEIGHTS, strict=True):
            index, t = self._piece_index_and_elapsed_s(start_s + node * step_s)
            way = weight * step_s * _evaluate_polynomials(self._pieces.speed, index, t)
            heading = self._heading_rad(index, t)
            total += np.column_stack([way * np.cos(heading), way * np.sin(heading)])
        return total

    def _piece_index_and_elapsed_s(self, time_s: FloatArray) -> tuple[Int64Array, FloatArray]:
        """The index of the piece that applies at each time (n,), and the time since its edge (n,), s."""
        index = np.clip(np.searchsorted(self._pieces.edge_s, time_s, side="right") - 1, 0, None)
        return index, time_s - self._pieces.edge_s[index]

    def _heading_rad(self, index: Int64Array, time_s: FloatArray) -> FloatArray:
        """The heading (n,), rad, at the times t since the edges of the pieces."""
        return self._pieces.heading_rad[index] + time_s * _evaluate_polynomials(
            self._pieces.yaw_rate / _YAW_RATE_INTEGRAL_DIVISORS, index, time_s
        )

    def _speed_heading_accel_and_further_states(self, time_s: FloatArray) -> FloatArray:
        """The states (n, 6) from speed on, in closed form."""
        pieces = self._pieces
        index, t = self._piece_index_and_elapsed_s(time_s)
        return np.column_stack(
            [
                _evaluate_polynomials(pieces.speed, index, t),
                self._heading_rad(index, t),
                _evaluate_polynomials(_derivative_coefficients(pieces.speed), index, t),
                _evaluate_polynomials(pieces.yaw_rate, index, t),
                _evaluate_polynomials(_derivative_coefficients(_derivative_coefficients(pieces.speed)), index, t),
                _evaluate_polynomials(_derivative_coefficients(pieces.yaw_rate), index, t),
            ]
        )


def _evaluate_polynomials(coefficients: FloatArray, index: Int64Array, t: FloatArray) -> FloatArray:
    """Evaluate row `index` (n,) of the polynomials (ascending powers) at `t` (n,), by Horner's rule."""
    total = np.zeros(len(t))
    for column in coefficients.T[::-1]:
        total = total * t + column[index]
    return total


def _derivative_coefficients(coefficients: FloatArray) -> FloatArray:
    """The coefficients of the derivatives of polynomials (m, k), shape (m, k - 1)."""
    return coefficients[:, 1:] * np.arange(1, coefficients.shape[1])


def _merge_profile_pieces(profile: MotionProfile, heading_rad: float) -> _ProfilePolynomials:
    """Merge the profile's pieces on common edges, and add the time before and after the run."""
    starts = {piece.start_s for piece in profile.speed} | {piece.start_s for piece in profile.turn}
    inner = sorted(start for start in starts if 0 < start < profile.end_s)
    edges = np.array([-TRUTH_BEFORE_RUN_S, 0.0, *inner, profile.end_s])
    speed = np.zeros((len(edges), N_SPEED_COEFFICIENTS))
    yaw_rate = np.zeros((len(edges), N_YAW_RATE_COEFFICIENTS))
    speed[0, 0] = profile.speed[0].coefficients[0]
    for i, edge in enumerate(edges[1:].tolist(), start=1):
        speed_piece, turn_piece = find_piece_at(profile.speed, edge), find_piece_at(profile.turn, edge)
        v = _shift_polynomial_origin(speed_piece.coefficients, edge - speed_piece.start_s)
        turn = _shift_polynomial_origin(turn_piece.coefficients, edge - turn_piece.start_s)
        if edge == profile.end_s:  # after the run: constant speed and turn
            v, turn = v[:1], turn[:1]
        w = polymul(turn, v) if turn_piece.is_curvature else turn  # yaw rate = curvature * speed
        speed[i, : len(v)], yaw_rate[i, : len(w)] = v, w
    spans = np.diff(edges)
    turned_rad = spans * _evaluate_polynomials(yaw_rate / _YAW_RATE_INTEGRAL_DIVISORS, np.arange(len(spans)), spans)
    headings = heading_rad + np.concatenate([[0.0], np.cumsum(turned_rad)])
    return _ProfilePolynomials(edges, speed, yaw_rate, headings)


def _shift_polynomial_origin(coefficients: tuple[float, ...], shift: float) -> FloatArray:
    """Shift the origin of a polynomial's time by `shift` (Taylor's formula)."""
    return np.array(
        [polyval(shift, polyder(coefficients, k)) / factorial(k) for k in range(len(coefficients))], dtype=np.float64
    )


def check_motion_is_drivable(
    motion: TrueMotion, *, end_s: float, friction: float, turning_radius_m: float, path: str, source: str
) -> None:
    """Refuse a motion that no car can make.

    Args:
        motion: The motion, checked every 10 ms of the run and at its end.
        end_s: Length of the run.
        turning_radius_m: The tightest radius.
        path, source: Place in the file, and the file, for the message.

    Raises:
        UsageError: More acceleration than friction allows, or a tighter turn than the vehicle can drive.
    """
    time_s = np.append(np.arange(0.0, end_s, 0.01), end_s)
    state = motion.states_at(time_s)
    speed, accel, yaw_rate = state[:, 2], state[:, 4], state[:, 5]
    demand = np.hypot(accel, speed * yaw_rate)
    limit = friction * STANDARD_GRAVITY_MPS2
    worst = int(np.argmax(demand))
    if demand[worst] > limit:
        raise toml_value_error(
            source,
            path,
            f"needs {demand[worst]:.2f} m/s^2 of the tyres at {time_s[worst]:.2f} s",
            f"0 to {limit:.2f} m/s^2 (friction {friction:g} * g, acceleration and cornering combined)",
        )
    too_tight = np.abs(yaw_rate) * turning_radius_m > np.abs(speed) + 1e-9
    if too_tight.any():
        first = int(np.argmax(too_tight))
        raise toml_value_error(
            source,
            path,
            f"turns at {np.degrees(yaw_rate[first]):.1f} deg/s with {speed[first]:.2f} m/s at {time_s[first]:.2f} s",
            f"a radius of {turning_radius_m:g} m or more",
        )
