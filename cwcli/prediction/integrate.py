"""The integral of a motion model along its path, with its Jacobian, for many starts at once.

Until the car stops, x(t) = x0 + int v cos(phi), y likewise. Speed and heading are known functions of time
(`models.base`), so a quadrature per step gives the position and all its derivatives: d/dv0 = int cos(phi),
d/da0 = int A cos(phi), d/dphi0 = -(y - y0), d/dw0 = -int v W sin(phi), ... A car that stops at ts stays there:
every integral ends at min(t, ts). The moment ts itself adds nothing to the derivatives, as v(ts) = 0.

"exact" takes three Gauss-Legendre points per step. "paper" is song2016's recursion (eq. 2, 10): along the old
heading with v dT + a dT^2/2, then v += a dT, phi += w dT, a += j dT, w += dw dT, with the values of step n-1 on
every right side. Written out for step n -> n+1 it is one node per step with v = v0 + a0 (n + 1/2) dT + j0 dT^2 n^2/2.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.kernels import paths as kernel
from cwcli.lazy_dataclass import dataclass
from cwcli.prediction.driver import DriverPrior
from cwcli.prediction.fleet import (
    HORIZON_KNOTS_S,
    acting_slopes_between_knots,
    interpolate_acting_time_s,
    time_between_knots_s,
)
from cwcli.prediction.models.base import Model, Responses
from cwcli.signals.columns import FloatArray, StateRows
from cwcli.signals.vehicle_state import ACCEL, HEADING, JERK, SPEED, YAW_ACCEL, YAW_RATE, X, Y

GAUSS_NODE_PLACES_ON_0_TO_1 = 0.5 + 0.5 * np.array([-np.sqrt(0.6), 0.0, np.sqrt(0.6)])
"""Nodes of the three-point Gauss-Legendre quadrature on [0, 1]."""
GAUSS_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0
"""Weights of the three-point Gauss-Legendre quadrature on [0, 1]."""
N_STOP_TIME_BISECTIONS = 45
"""Number of bisections of a stop's time: they narrow a step of 0.05 s to below 1e-14 s."""
MAX_STANDSTILL_SPEED_MPS = 1e-9
"""Speed in m/s below which a car stands: the rounding of an acceleration that fades while the car stands."""


@dataclass(frozen=True)
class IntegratedPaths:
    """A model's path for m starts and k times.

    Attributes:
        x_m, y_m, heading_rad, speed_mps: Shape (m, k).
        moving_s: Shape (m, k): time until the point or until the car stopped, whichever is first.
        jacobian: Shape (2, m, k, 8): derivative of x and of y to the start state.
    """

    x_m: FloatArray
    y_m: FloatArray
    heading_rad: FloatArray
    speed_mps: FloatArray
    moving_s: FloatArray
    jacobian: FloatArray


@dataclass(frozen=True)
class _DiscretisedModel:
    """A model with its prior, in one discretisation, for m starts.

    Attributes:
        time_s: Shape (k,): the path's times.
        hold_s: Shape (m, 2) or None: see `Model.hold`.
        points: Shape (p,): which of the times are wanted; None: all.
        acted: Shape (m, 2, k) or None: for how long acceleration and yaw rate act by each knot, instead of the model's
            responses to them (`prediction.fleet.acting_time_from_displacement_share_s`).
    """

    model: Model
    prior: DriverPrior
    time_s: FloatArray
    is_paper: bool
    hold_s: FloatArray | None
    points: npt.NDArray[np.intp] | None = None
    acting_s: FloatArray | None = None

    def select_starts(self, rows: npt.NDArray[np.bool_ | np.intp]) -> _DiscretisedModel:
        """The discretised model of some of the starts."""
        hold_s = None if self.hold_s is None else self.hold_s[rows]
        acted = None if self.acting_s is None else self.acting_s[rows]
        return _DiscretisedModel(self.model, self.prior, self.time_s, self.is_paper, hold_s, self.points, acted)

    def select_columns_of_kept_points(self, values: FloatArray) -> FloatArray:
        """Those columns of values (..., k) whose points are asked for."""
        return values if self.points is None else values[..., self.points]

    def speed_and_heading_responses_at_times(self, moving_s: FloatArray) -> Responses:
        """The responses at times of shape (1 or m, ...)."""
        if self.is_paper:
            return _song2016_speed_and_heading_responses(self.model, moving_s, self.time_s)
        if self.acting_s is not None:
            none = np.zeros_like(moving_s)
            return Responses(
                interpolate_acting_time_s(self.acting_s[:, 0], moving_s),
                none,
                interpolate_acting_time_s(self.acting_s[:, 1], moving_s),
                none,
            )
        if self.hold_s is None:
            return self.model.responses(moving_s, self.prior)
        shape = (-1,) + (1,) * (moving_s.ndim - 1)
        jerk_s, yaw_s = (np.minimum(moving_s, self.hold_s[:, i].reshape(shape)) for i in (0, 1))
        free = self.model.responses(moving_s, self.prior)
        jerk, yaw = (self.model.responses(acting, self.prior) for acting in (jerk_s, yaw_s))
        # after the hold the rate's share in acceleration (yaw rate) stays: it grows linearly from there
        return Responses(
            free.speed_to_accel,
            jerk.speed_to_jerk + jerk_s * (moving_s - jerk_s),
            free.heading_to_yaw_rate,
            yaw.heading_to_yaw_accel + yaw_s * (moving_s - yaw_s),
        )

    def responses_weights_and_slopes_at_quadrature_nodes(
        self, moving_s: FloatArray
    ) -> tuple[Responses, FloatArray, tuple[FloatArray, FloatArray] | None]:
        """Responses at the quadrature nodes of each step of the times (1 or m, k), and the nodes' weights, (1 or m,
        nodes, k - 1).

        Where acting times have the same nodes, responses to acceleration and yaw rate are (parts, nodes, k - 1), and
        the third are the factors of the parts, (m, parts) each.
        """
        step_width_s = np.diff(moving_s, axis=1)[:, None, :]
        if self.is_paper:
            at = _song2016_mean_responses_of_steps(self.model, step_width_s, self.time_s)
            return at, np.ascontiguousarray(step_width_s), None
        node_s = moving_s[:, None, :-1] + step_width_s * GAUSS_NODE_PLACES_ON_0_TO_1[:, None]
        weight = step_width_s * GAUSS_WEIGHTS[:, None]
        if self.acting_s is None or len(moving_s) > 1:
            return self.speed_and_heading_responses_at_times(node_s), weight, None
        none = np.zeros_like(node_s)
        along, across = (acting_slopes_between_knots(self.acting_s[:, i]) for i in (0, 1))
        inside = time_between_knots_s(node_s[0])
        return Responses(inside, none, inside, none), weight, (along, across)


def integrate_paths(
    model: Model,
    state: StateRows,
    time_s: FloatArray,
    prior: DriverPrior,
    discretisation: str,
    kept_point_indices: npt.NDArray[np.intp] | None = None,
    acting_s: FloatArray | None = None,
) -> IntegratedPaths:
    """The path of m starts, shape (m, 8), over the times (k,), which start at 0 and have a common step.

    With `kept_point_indices` the integral holds these of the times only: the same numbers as without. `acting_s`: see
    `_DiscretisedModel`.
    """
    hold_s = None if model.hold is None else model.hold(state, prior)
    motion = _DiscretisedModel(model, prior, time_s, discretisation == "paper", hold_s, kept_point_indices, acting_s)
    grid = motion.speed_and_heading_responses_at_times(time_s[None, :])
    stop_s = _stop_times_s(motion, state, _speed_at_times_mps(state, grid))
    stops = np.isfinite(stop_s)
    if not stops.any():
        return _integrate_steps(motion, state, time_s[None, :], grid)
    if stops.all():
        return _integrate_stopping_paths(motion, state, stop_s)
    going = _integrate_steps(
        motion.select_starts(~stops),
        state[~stops],
        time_s[None, :],
        motion.select_starts(~stops).speed_and_heading_responses_at_times(time_s[None, :]),
    )
    stopping = _integrate_stopping_paths(motion.select_starts(stops), state[stops], stop_s[stops])
    return _merge_paths_of_stopping_and_going_cars(stops, stopping, going)


def _speed_at_times_mps(state: StateRows, at: Responses) -> FloatArray:
    """v(t), shape (m, ...) for responses of shape (1 or m, ...)."""
    return _speed_or_heading_after_responses(state, (SPEED, ACCEL, JERK), at.speed_to_accel, at.speed_to_jerk)


def _heading_at_times_rad(state: StateRows, at: Responses) -> FloatArray:
    """phi(t), shape (m, ...) for responses of shape (1 or m, ...)."""
    return _speed_or_heading_after_responses(
        state, (HEADING, YAW_RATE, YAW_ACCEL), at.heading_to_yaw_rate, at.heading_to_yaw_accel
    )


def _speed_or_heading_after_responses(
    state: StateRows,
    value_and_derivative_columns: tuple[int, int, int],
    first_derivative_response: FloatArray,
    second_derivative_response: FloatArray,
) -> FloatArray:
    """Speed or heading from its start value and the responses to its first and second derivative, (m, ...)."""
    start, rate, rate2 = (
        _state_column_for_broadcast(state, column, first_derivative_response.ndim)
        for column in value_and_derivative_columns
    )
    out = np.asarray(rate * first_derivative_response)
    out += start
    if second_derivative_response.any():
        out += rate2 * second_derivative_response
    return out


def _state_column_for_broadcast(state: StateRows, index: int, ndim: int) -> FloatArray:
    """A column of the states (m, 8), shaped to broadcast with responses of `ndim` dimensions."""
    return state[:, index].reshape((-1,) + (1,) * max(ndim - 1, 1))


def _stop_times_s(motion: _DiscretisedModel, state: StateRows, speed_mps: FloatArray) -> FloatArray:
    """When each car comes to a stop, shape (m,); infinity if it doesn't. A car that stands and doesn't start: 0.

    `speed` is the free one on the grid, (m, k).
    """
    time_s, start = motion.time_s, state[:, SPEED]
    direction = np.where(start < 0.0, -1.0, 1.0)
    crossed = direction[:, None] * speed_mps[:, 1:] < MAX_STANDSTILL_SPEED_MPS
    standing = (start == 0.0) & (speed_mps[:, 1] <= 0.0)
    stop_s = np.full(len(state), np.inf)
    rows = np.flatnonzero(crossed.any(axis=1) & ~standing)
    if len(rows):
        after = crossed[rows].argmax(axis=1) + 1
        if motion.is_paper:  # speed is linear inside a step
            before_v, after_v = speed_mps[rows, after - 1], speed_mps[rows, after]
            stop_s[rows] = time_s[after - 1] + (time_s[1] - time_s[0]) * before_v / (before_v - after_v)
        else:
            found = _interpolate_stop_times_s if motion.acting_s is not None else _bisect_stop_times_s
            stop_s[rows] = found(
                motion.select_starts(rows), state[rows], direction[rows], time_s[after - 1], time_s[after]
            )
    stop_s[standing] = 0.0
    return stop_s


def _bisect_stop_times_s(
    motion: _DiscretisedModel, state: StateRows, direction: FloatArray, low_s: FloatArray, high_s: FloatArray
) -> FloatArray:
    """The time from `low_s` to `high_s`, (m,) each, at which direction * v falls below 0; `high_s` if it does not."""
    for _ in range(N_STOP_TIME_BISECTIONS):
        middle = 0.5 * (low_s + high_s)
        moving = (
            direction * _speed_at_times_mps(state, motion.speed_and_heading_responses_at_times(middle[:, None]))[:, 0]
            >= 0.0
        )
        low_s, high_s = np.where(moving, middle, low_s), np.where(moving, high_s, middle)
    return 0.5 * (low_s + high_s)


def _interpolate_stop_times_s(
    motion: _DiscretisedModel, state: StateRows, direction: FloatArray, low_s: FloatArray, high_s: FloatArray
) -> FloatArray:
    """The time as of `_bisect_stop_times_s` for a speed that is linear between knots, as a measured acting time makes
    it."""

    def ahead_mps(time_s: FloatArray) -> FloatArray:
        return np.asarray(
            direction * _speed_at_times_mps(state, motion.speed_and_heading_responses_at_times(time_s[:, None]))[:, 0]
        )

    for knot_s in HORIZON_KNOTS_S.tolist():
        inside = (low_s < knot_s) & (knot_s < high_s)
        if inside.any():
            moving = ahead_mps(np.full(len(state), knot_s)) >= 0.0
            low_s, high_s = np.where(inside & moving, knot_s, low_s), np.where(inside & ~moving, knot_s, high_s)
    before, after = np.maximum(ahead_mps(low_s), 0.0), np.minimum(ahead_mps(high_s), 0.0)
    return np.asarray(low_s + (high_s - low_s) * before / np.maximum(before - after, MAX_STANDSTILL_SPEED_MPS))


def _integrate_stopping_paths(motion: _DiscretisedModel, state: StateRows, stop_s: FloatArray) -> IntegratedPaths:
    """Integrate the paths of cars that stop at `stop_s` (m,) and stay there."""
    time_s = motion.time_s
    moving = np.minimum(time_s[None, :], stop_s[:, None])
    path = _integrate_steps(motion, state, moving, motion.speed_and_heading_responses_at_times(moving))
    speed = np.where(motion.select_columns_of_kept_points(time_s)[None, :] >= stop_s[:, None], 0.0, path.speed_mps)
    return IntegratedPaths(path.x_m, path.y_m, path.heading_rad, speed, path.moving_s, path.jacobian)


def _integrate_steps(
    motion: _DiscretisedModel, state: StateRows, moving_s: FloatArray, grid: Responses
) -> IntegratedPaths:
    """Integrate position and Jacobian over the steps of the times `moving_s`, shape (1 or m, k)."""
    at, weight, acting_slopes = motion.responses_weights_and_slopes_at_quadrature_nodes(moving_s)
    points = np.arange(moving_s.shape[1]) if motion.points is None else motion.points
    moving_s = motion.select_columns_of_kept_points(moving_s)
    grid = grid if motion.points is None else Responses(*(motion.select_columns_of_kept_points(each) for each in grid))
    m, k = len(state), len(points)
    jacobian = kernel.quadrature(
        state, weight=weight, responses=at, uses=motion.model.uses, points=points, acting_slopes=acting_slopes
    )
    # a turn by d moves the point (dx, dy) by d (-dy, dx)
    dx, dy = jacobian[1, :, :, HEADING], -jacobian[0, :, :, HEADING]
    return IntegratedPaths(
        x_m=state[:, X, None] + dx,
        y_m=state[:, Y, None] + dy,
        heading_rad=np.broadcast_to(_heading_at_times_rad(state, grid), (m, k)),
        speed_mps=np.broadcast_to(_speed_at_times_mps(state, grid), (m, k)),
        moving_s=np.broadcast_to(moving_s, (m, k)),
        jacobian=jacobian,
    )


def _song2016_speed_and_heading_responses(model: Model, moving_s: FloatArray, time_s: FloatArray) -> Responses:
    """Responses of eq. 10's recursion, v_n = v0 + a0 n dT + j0 dT^2 n (n-1)/2, linear inside the steps."""
    step = time_s[1] - time_s[0]
    whole = np.floor(moving_s / step + 1e-9)
    second = step**2 * whole * (whole - 1.0) / 2.0 + whole * step * (moving_s - whole * step)
    return _zero_unused_responses(model, Responses(moving_s, second, moving_s, second))


def _song2016_mean_responses_of_steps(model: Model, width: FloatArray, time_s: FloatArray) -> Responses:
    """Mean speed and old heading of each step, (1 or m, 1, k-1); `width` is less than a step where the car stops."""
    step = time_s[1] - time_s[0]
    n = np.arange(len(time_s) - 1, dtype=float)
    started = step**2 * n * (n - 1.0) / 2.0
    return _zero_unused_responses(
        model,
        Responses(
            n * step + width / 2.0, started + n * step * width / 2.0, n * step + 0.0 * width, started + 0.0 * width
        ),
    )


def _zero_unused_responses(model: Model, at: Responses) -> Responses:
    """Set the responses to derivatives that the model does not use to 0."""
    return Responses(*(value if used else np.zeros_like(value) for used, value in zip(model.uses, at, strict=True)))


def _merge_paths_of_stopping_and_going_cars(
    stops: npt.NDArray[np.bool_], stopping: IntegratedPaths, going: IntegratedPaths
) -> IntegratedPaths:
    """Put the paths of stopping and going cars back in the order of the mask `stops` (m,)."""

    def interleave(a: FloatArray, b: FloatArray) -> FloatArray:
        out = np.empty((len(stops), *a.shape[1:]))
        out[stops], out[~stops] = a, b
        return out

    jacobian = np.empty((2, len(stops), *going.jacobian.shape[2:]))
    jacobian[:, stops], jacobian[:, ~stops] = stopping.jacobian, going.jacobian
    return IntegratedPaths(
        interleave(stopping.x_m, going.x_m),
        interleave(stopping.y_m, going.y_m),
        interleave(stopping.heading_rad, going.heading_rad),
        interleave(stopping.speed_mps, going.speed_mps),
        interleave(stopping.moving_s, going.moving_s),
        jacobian,
    )
