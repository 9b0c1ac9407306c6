"""Plain NumPy twin of the kernel `cwcli.kernels.ekf`: dense matrices, textbook formulas, no cleverness.

The smoother is the classic Rauch-Tung-Striebel one with predicted covariances and their inverses, so that it is a real
check of the kernel's modified Bryson-Frazier form.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm

from cwcli.estimation.measurements import Kind
from cwcli.estimation.model import MotionParameters
from cwcli.estimation.passes import MAX_PREDICTION_STEP_S, FilterStart, SensorSeries

F = npt.NDArray[np.float64]


def _yaw_decay(speed_squared: float, p: MotionParameters) -> float:
    standing = 0.25 / (speed_squared + 0.25)
    return 1 / p.yaw_rate_decay_s + (3.3 * standing**2 if standing > 0.02 else 0.0)


def transition(x: F, dt: float, p: MotionParameters, speed_squared: float) -> F:
    """The state after dt; the expected square of the speed decides how the yaw rate decays (not differentiated)."""
    linear = _linear_block(1 / p.accel_decay_s, 1 / p.jerk_decay_s, dt)
    turning = _linear_block(_yaw_decay(speed_squared, p), 1 / p.yaw_accel_decay_s, dt)
    out = x.copy()
    mean_heading = x[3] + x[5] * dt / 2 + x[7] * dt**2 / 6
    distance = x[2] * dt + x[4] * dt**2 / 2 + x[6] * dt**3 / 6
    out[0] += distance * np.cos(mean_heading)
    out[1] += distance * np.sin(mean_heading)
    out[[2, 4, 6]] = linear @ x[[2, 4, 6]]
    out[[3, 5, 7]] = turning @ x[[3, 5, 7]]
    for i, time_constant_s in p.time_constant_s.items():
        out[i] *= np.exp(-dt / time_constant_s)
    return out


@lru_cache(maxsize=4096)
def _linear_block(rate: float, rate_of_change: float, dt: float) -> F:
    system = np.array([[0, 1, 0], [0, 0, 1], [0, -rate * rate_of_change, -rate - rate_of_change]])
    return np.asarray(expm(system * dt))


def process_noise(x: F, cov: F, dt: float, untold_s: float, p: MotionParameters, walk: F) -> F:
    """Continuous white noise behind jerk and yaw acceleration, at the step's beginning state."""
    n = len(x)
    q = np.zeros((n, n))
    white = np.array(
        [[dt**5 / 20, dt**4 / 8, dt**3 / 6], [dt**4 / 8, dt**3 / 3, dt**2 / 2], [dt**3 / 6, dt**2 / 2, dt]]
    )
    speed2 = x[2] ** 2 + cov[2, 2]
    moving = speed2 / (speed2 + p.standstill_speed_mps**2)
    q[np.ix_([2, 4, 6], [2, 4, 6])] += 2 / p.jerk_decay_s * p.jerk_sigma_mps3**2 * white
    turning = 2 / p.yaw_accel_decay_s * p.yaw_accel_sigma_radps2**2 * max(moving, p.standstill_floor)
    q[np.ix_([3, 5, 7], [3, 5, 7])] += turning * white
    spread = cov[3, 3]
    lasts_s = min(untold_s, p.yaw_rate_decay_s)
    astray = speed2 * (1 - np.exp(-spread) - spread * np.exp(-spread)) * lasts_s if spread >= 1e-3 else 0.0
    heading, doubt = x[3] + dt / 2 * x[5] + dt**2 / 6 * x[7], np.sqrt(spread)
    q[:2, :2] += p.side_slip_m**2 * moving * dt * np.eye(2)
    nodes, weights = np.polynomial.hermite_e.hermegauss(60)  # the mean over the errors that the heading may have
    for node, weight in zip(nodes, weights / weights.sum(), strict=True):
        ahead = np.array([np.cos(heading + doubt * node), np.sin(heading + doubt * node)])
        spared = (1 - p.along_share) * p.side_slip_m**2 * moving**2 * dt
        q[:2, :2] -= weight * spared * np.outer(ahead, ahead)
    q[0, 0] += astray * dt
    q[1, 1] += astray * dt
    q[3, 3] += p.course_rad**2 * moving * dt
    for i in range(8, n):
        t = p.time_constant_s.get(i)
        q[i, i] += walk[i] * dt if t is None else walk[i] * t / 2 * (1 - np.exp(-2 * dt / t))
        q[i, i] += p.turn_noise.get(i, 0.0) * abs(x[5]) * dt
    return q


def expected(x: F, s: SensorSeries, row: int) -> F:
    """h(x) of a row, shape (width,)."""
    tau = x[s.latency_state] if s.latency_state >= 0 else 0.0
    ahead, left = s.place_m or (0.0, 0.0)
    ahead += x[s.ahead_state] if s.ahead_state >= 0 else 0.0
    turn = np.array([[np.cos(x[3]), -np.sin(x[3])], [np.sin(x[3]), np.cos(x[3])]])
    if s.kind is Kind.POSITION:
        slow = x[s.slow_state : s.slow_state + 2] if s.slow_state >= 0 else 0.0
        return (
            np.array([x[0] - tau * x[2] * np.cos(x[3]), x[1] - tau * x[2] * np.sin(x[3])]) + slow + turn @ [ahead, left]
        )
    if s.kind is Kind.VELOCITY:
        speed, heading = x[2] - tau * x[4], x[3] - tau * x[5]
        return np.array([speed * np.cos(heading), speed * np.sin(heading)]) + x[5] * turn @ [-left, ahead]
    state, rate = {Kind.SPEED: (2, 4), Kind.HEADING: (3, 5), Kind.ACCEL: (4, 6), Kind.YAW_RATE: (5, 7)}[s.kind]
    bias = (x[s.bias_state] if s.bias_state >= 0 else 0.0) + (x[s.slow_state] if s.slow_state >= 0 else 0.0)
    lever = 0.0
    if s.pitch_rate is not None and s.lever_state >= 0:
        when = s.time_s[row] - s.latency_s
        lever = x[s.lever_state] * np.interp(when, s.pitch_rate.time_s, s.pitch_rate.value_radps)
    apart = {Kind.SPEED: -x[5] * left, Kind.ACCEL: -(x[5] ** 2) * ahead - x[7] * left}.get(s.kind, 0.0)
    scale = 1.0 + (x[s.scale_state] if s.scale_state >= 0 else 0.0)
    return np.array([scale * (x[state] - lever - tau * x[rate] + apart) + bias])


def velocity_squared(x: F, cov: F) -> F:
    """E(v v'), (2, 2): speed and heading independent and normal; the mean over the heading by quadrature."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(60)
    heading = x[3] + np.sqrt(cov[3, 3]) * nodes
    ahead = np.stack([np.cos(heading), np.sin(heading)])
    return np.asarray((x[2] ** 2 + cov[2, 2]) * (ahead * weights / weights.sum()) @ ahead.T)


def jacobian(function, x: F, step: float = 1e-6) -> F:
    """Central finite differences."""
    columns = []
    for i in range(len(x)):
        d = np.zeros_like(x)
        d[i] = step
        columns.append((function(x + d) - function(x - d)) / (2 * step))
    return np.stack(columns, axis=1)


@dataclass
class NaiveResult:
    """Filtered and smoothed states and covariances at the output times, log-likelihood, NIS in time order."""

    filtered: F
    filtered_p: F
    smoothed: F
    smoothed_p: F
    log_likelihood: float
    nis: list[float]


def run(series: Sequence[SensorSeries], start: FilterStart, p: MotionParameters, walk: F, output_s: F) -> NaiveResult:
    """Filter and smooth without gate; outputs must not be before the start."""
    events = [
        (s.time_s[i] - s.latency_s, 0, k, i)
        for k, s in enumerate(series)
        for i in range(len(s))
        if s.time_s[i] - s.latency_s >= start.time_s
    ]
    events += [(float(t), 1, -1, j) for j, t in enumerate(output_s)]
    events.sort(key=lambda event: event[:2])
    x, cov, now = start.state.copy(), start.covariance.copy(), start.time_s
    steps: list[tuple[F, F, F, F, F]] = []  # x, P after the step; F, x and P predicted into it
    outputs: dict[int, int] = {}
    likelihood, nis, told = 0.0, [], start.time_s
    for time, _, k, i in events:
        total = time - now
        pieces = max(1, int(np.ceil(total / MAX_PREDICTION_STEP_S - 1e-9)))
        for piece in range(pieces if total > 0 else 0):
            dt = total / pieces
            v2 = x[2] ** 2 + cov[2, 2]
            f = jacobian(lambda v, dt=dt, v2=v2: transition(v, dt, p, v2), x)
            cov = f @ cov @ f.T + process_noise(x, f @ cov @ f.T, dt, now + (piece + 1) * dt - told, p, walk)
            x = transition(x, dt, p, v2)
            steps.append((x.copy(), cov.copy(), f, x.copy(), cov.copy()))
        now = time
        if not steps:
            steps.append((x.copy(), cov.copy(), np.eye(len(x)), x.copy(), cov.copy()))
        if k < 0:
            outputs[i] = len(steps) - 1
            continue
        s = series[k]
        told = time if s.kind in (Kind.POSITION, Kind.VELOCITY, Kind.HEADING) else told
        h = jacobian(lambda v, s=s, i=i: expected(v, s, i), x)
        r = np.array([[s.noise[i, 0], s.noise[i, 1]], [s.noise[i, 1], s.noise[i, 2]]])[
            : s.n_values_per_row, : s.n_values_per_row
        ]
        if s.kind is Kind.POSITION:
            r = r + s.stamp_error.value**2 * velocity_squared(x, cov)
        nu = s.values[i, : s.n_values_per_row] - expected(x, s, i)
        if s.kind is Kind.HEADING:
            nu = np.angle(np.exp(1j * nu))
        big_s = h @ cov @ h.T + r
        gain = cov @ h.T @ np.linalg.inv(big_s)
        nis.append(float(nu @ np.linalg.solve(big_s, nu)))
        likelihood -= 0.5 * (np.log(np.linalg.det(2 * np.pi * big_s)) + nis[-1])
        x = x + gain @ nu
        keep = np.eye(len(x)) - gain @ h
        cov = keep @ cov @ keep.T + gain @ r @ gain.T
        steps[-1] = (x.copy(), cov.copy(), *steps[-1][2:])
    smoothed = [(steps[-1][0], steps[-1][1])]
    for (x_k, p_k, *_), (_, _, f, x_next, p_next) in zip(steps[-2::-1], steps[:0:-1], strict=True):
        g = p_k @ f.T @ np.linalg.inv(p_next)
        later_x, later_p = smoothed[-1]
        smoothed.append((x_k + g @ (later_x - x_next), p_k + g @ (later_p - p_next) @ g.T))
    smoothed.reverse()
    rows = [outputs[j] for j in range(len(output_s))]
    return NaiveResult(
        np.array([steps[r][0] for r in rows]), np.array([steps[r][1] for r in rows]),
        np.array([smoothed[r][0] for r in rows]), np.array([smoothed[r][1] for r in rows]), likelihood, nis,
    )  # fmt: skip
