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

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cwcli.prediction.driver import DriverPrior
from cwcli.prediction.models.base import Model, Responses
from cwcli.prediction.state import ACCEL, HEADING, JERK, SPEED, YAW_ACCEL, YAW_RATE, X, Y
from cwcli.signals.columns import FloatArray

GAUSS_NODES = 0.5 + 0.5 * np.array([-np.sqrt(0.6), 0.0, np.sqrt(0.6)])
GAUSS_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0
BISECTIONS = 45  # a step of 0.05 s to below 1e-14 s


@dataclass(frozen=True)
class Integral:
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


def integrate(model: Model, state: FloatArray, time_s: FloatArray, prior: DriverPrior, discretisation: str) -> Integral:
    """The path of m starts, shape (m, 8), over the times (k,), which start at 0 and have a common step."""
    grid = _paper_grid(model, time_s) if discretisation == "paper" else model.responses(time_s, prior)
    speed = _speed(state, grid)
    stop_s = _stop_time(model, state, speed, time_s, prior, discretisation)
    stops = np.isfinite(stop_s)
    if not stops.any():
        return _path(model, state, time_s[None, :], grid, time_s, prior, discretisation)
    if stops.all():
        return _stopping(model, state, stop_s, time_s, prior, discretisation)
    going = _path(model, state[~stops], time_s[None, :], grid, time_s, prior, discretisation)
    stopping = _stopping(model, state[stops], stop_s[stops], time_s, prior, discretisation)
    return _merge(stops, stopping, going)


def _speed(state: FloatArray, at: Responses) -> FloatArray:
    """v(t), shape (m, ...) for responses of shape (1 or m, ...)."""
    start, accel, jerk = (_column(state, index, at.speed_to_accel.ndim) for index in (SPEED, ACCEL, JERK))
    return np.asarray(start + accel * at.speed_to_accel + jerk * at.speed_to_jerk)


def _heading(state: FloatArray, at: Responses) -> FloatArray:
    """phi(t), shape (m, ...) for responses of shape (1 or m, ...)."""
    ndim = at.speed_to_accel.ndim
    start, rate, rate2 = (_column(state, index, ndim) for index in (HEADING, YAW_RATE, YAW_ACCEL))
    return np.asarray(start + rate * at.heading_to_yaw_rate + rate2 * at.heading_to_yaw_accel)


def _column(state: FloatArray, index: int, ndim: int) -> FloatArray:
    return state[:, index].reshape((-1,) + (1,) * max(ndim - 1, 1))


def _stop_time(
    model: Model, state: FloatArray, speed: FloatArray, time_s: FloatArray, prior: DriverPrior, discretisation: str
) -> FloatArray:
    """When each car comes to a stop, shape (m,); infinity if it doesn't. A car that stands and doesn't start: 0."""
    start = state[:, SPEED]
    direction = np.where(start < 0.0, -1.0, 1.0)
    crossed = direction[:, None] * speed[:, 1:] < 0.0
    standing = (start == 0.0) & (speed[:, 1] <= 0.0)
    stop_s = np.full(len(state), np.inf)
    rows = np.flatnonzero(crossed.any(axis=1) & ~standing)
    if len(rows):
        after = crossed[rows].argmax(axis=1) + 1
        if discretisation == "paper":  # speed is linear inside a step
            before_v, after_v = speed[rows, after - 1], speed[rows, after]
            stop_s[rows] = time_s[after - 1] + (time_s[1] - time_s[0]) * before_v / (before_v - after_v)
        else:
            stop_s[rows] = _bisect(model, state[rows], direction[rows], time_s[after - 1], time_s[after], prior)
    stop_s[standing] = 0.0
    return stop_s


def _bisect(
    model: Model, state: FloatArray, direction: FloatArray, low: FloatArray, high: FloatArray, prior: DriverPrior
) -> FloatArray:
    """The moment between `low` and `high` (each (m,)) where direction * v changes from >= 0 to < 0."""
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        moving = direction * _speed(state, model.responses(middle[:, None], prior))[:, 0] >= 0.0
        low, high = np.where(moving, middle, low), np.where(moving, high, middle)
    return 0.5 * (low + high)


def _stopping(
    model: Model, state: FloatArray, stop_s: FloatArray, time_s: FloatArray, prior: DriverPrior, discretisation: str
) -> Integral:
    """Paths of cars that stop: every integral ends at the stop."""
    moving = np.minimum(time_s[None, :], stop_s[:, None])
    grid = _paper_at(model, moving, time_s) if discretisation == "paper" else model.responses(moving, prior)
    path = _path(model, state, moving, grid, time_s, prior, discretisation)
    speed = np.where(time_s[None, :] >= stop_s[:, None], 0.0, path.speed_mps)
    return Integral(path.x_m, path.y_m, path.heading_rad, speed, path.moving_s, path.jacobian)


def _path(
    model: Model,
    state: FloatArray,
    moving: FloatArray,
    grid: Responses,
    time_s: FloatArray,
    prior: DriverPrior,
    discretisation: str,
) -> Integral:
    """Quadrature over the steps of `moving`, shape (1 or m, k)."""
    m, k = len(state), len(time_s)
    width = np.diff(moving, axis=1)[..., None]
    if discretisation == "paper":
        at, weight = _paper_nodes(model, width, time_s), width
    else:
        at = model.responses(moving[:, :-1, None] + width * GAUSS_NODES, prior)
        weight = width * GAUSS_WEIGHTS
    heading = _heading(state, at)
    speed = _speed(state, at)
    cosine, sine = np.cos(heading) * weight, np.sin(heading) * weight
    jacobian = np.zeros((2, m, k, 8))
    jacobian[0, :, :, X] = jacobian[1, :, :, Y] = 1.0
    moved_x, moved_y = speed * cosine, speed * sine
    dx, dy = _running(moved_x), _running(moved_y)
    jacobian[0, :, :, HEADING], jacobian[1, :, :, HEADING] = -dy, dx
    jacobian[0, :, :, SPEED], jacobian[1, :, :, SPEED] = _running(cosine), _running(sine)
    for used, index, response in zip(model.uses[:2], (ACCEL, JERK), (at.speed_to_accel, at.speed_to_jerk), strict=True):
        if used:
            jacobian[0, :, :, index] = _running(cosine * response)
            jacobian[1, :, :, index] = _running(sine * response)
    for used, index, response in zip(
        model.uses[2:], (YAW_RATE, YAW_ACCEL), (at.heading_to_yaw_rate, at.heading_to_yaw_accel), strict=True
    ):
        if used:
            jacobian[0, :, :, index] = -_running(moved_y * response)
            jacobian[1, :, :, index] = _running(moved_x * response)
    return Integral(
        x_m=state[:, X, None] + dx,
        y_m=state[:, Y, None] + dy,
        heading_rad=np.broadcast_to(_heading(state, grid), (m, k)),
        speed_mps=np.broadcast_to(_speed(state, grid), (m, k)),
        moving_s=np.broadcast_to(moving, (m, k)),
        jacobian=jacobian,
    )


def _running(nodes: FloatArray) -> FloatArray:
    """Running sum over the steps of (m, k-1, nodes), from 0: shape (m, k)."""
    out = np.zeros((nodes.shape[0], nodes.shape[1] + 1))
    np.cumsum(nodes.sum(axis=2), axis=1, out=out[:, 1:])
    return out


def _paper_grid(model: Model, time_s: FloatArray) -> Responses:
    """Responses of eq. 10's recursion at its own steps: v_n = v0 + a0 n dT + j0 dT^2 n (n-1)/2; (1, k) each."""
    return _paper_at(model, time_s[None, :], time_s)


def _paper_at(model: Model, moving: FloatArray, time_s: FloatArray) -> Responses:
    """The same at times inside the steps, linear in between, shape of `moving`."""
    step = time_s[1] - time_s[0]
    whole = np.floor(moving / step + 1e-9)
    second = step**2 * whole * (whole - 1.0) / 2.0 + whole * step * (moving - whole * step)
    return _masked(model, Responses(moving, second, moving, second))


def _paper_nodes(model: Model, width: FloatArray, time_s: FloatArray) -> Responses:
    """Mean speed and old heading of each step, (1 or m, k-1, 1); `width` is less than a step where the car stops."""
    step = time_s[1] - time_s[0]
    n = np.arange(len(time_s) - 1, dtype=float)[None, :, None]
    started = step**2 * n * (n - 1.0) / 2.0
    return _masked(
        model,
        Responses(
            n * step + width / 2.0, started + n * step * width / 2.0, n * step + 0.0 * width, started + 0.0 * width
        ),
    )


def _masked(model: Model, at: Responses) -> Responses:
    return Responses(*(value if used else np.zeros_like(value) for used, value in zip(model.uses, at, strict=True)))


def _merge(stops: npt.NDArray[np.bool_], stopping: Integral, going: Integral) -> Integral:
    """Rows of the two groups back in their order."""

    def rows(a: FloatArray, b: FloatArray) -> FloatArray:
        out = np.empty((len(stops), *a.shape[1:]))
        out[stops], out[~stops] = a, b
        return out

    jacobian = np.empty((2, len(stops), *going.jacobian.shape[2:]))
    jacobian[:, stops], jacobian[:, ~stops] = stopping.jacobian, going.jacobian
    return Integral(
        rows(stopping.x_m, going.x_m),
        rows(stopping.y_m, going.y_m),
        rows(stopping.heading_rad, going.heading_rad),
        rows(stopping.speed_mps, going.speed_mps),
        rows(stopping.moving_s, going.moving_s),
        jacobian,
    )
