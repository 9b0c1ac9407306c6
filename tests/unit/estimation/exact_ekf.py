"""The filter and the smoother of `naive_ekf` in forty digits: what rounding leaves of the kernel's covariances."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import mpmath as mp
import numpy as np
import numpy.typing as npt

from cwcli.estimation.measurements import Kind
from cwcli.estimation.model import MotionParameters
from cwcli.estimation.passes import MAX_PREDICTION_STEP_S, FilterStart, SensorSeries

F = npt.NDArray[np.float64]
DIGITS = 40


def run_exactly(
    series: Sequence[SensorSeries], start: FilterStart, p: MotionParameters, output_s: F
) -> tuple[F, F, F, F]:
    """Filter and smooth positions and speeds; eight states, no gate.

    Returns:
        Filtered state (m, 8) and covariance (m, 8, 8), smoothed state and covariance.
    """
    with mp.workdps(DIGITS):
        return _run(series, start, p, output_s)


def _run(series: Sequence[SensorSeries], start: FilterStart, p: MotionParameters, output_s: F) -> tuple[F, F, F, F]:
    events = [(float(s.time_s[i]), 0, k, i) for k, s in enumerate(series) for i in range(len(s))]
    events += [(float(t), 1, -1, j) for j, t in enumerate(output_s)]
    events.sort(key=lambda event: event[:2])
    x, cov, now = mp.matrix(start.state.tolist()), mp.matrix(start.covariance.tolist()), mp.mpf(start.time_s)
    steps = [(x, cov, mp.eye(8), x, cov)]
    outputs: dict[int, int] = {}
    told = now
    for time, _, k, i in events:
        total = mp.mpf(time) - now
        pieces = max(1, int(np.ceil(float(total) / MAX_PREDICTION_STEP_S - 1e-9)))
        for piece in range(pieces if total > 0 else 0):
            dt = total / pieces
            f, moved = _transition(x, cov, dt, p)
            cov = f * cov * f.T
            heading = x[3] + dt / 2 * x[5] + dt**2 / 6 * x[7]
            cov += _noise(x[2] ** 2 + cov[2, 2], heading, cov[3, 3], dt, now + (piece + 1) * dt - told, p)
            x = moved
            steps.append((x, cov, f, x, cov))
        now = mp.mpf(time)
        if k < 0:
            outputs[i] = len(steps) - 1
            continue
        s = series[k]
        told = now if s.kind is Kind.POSITION else told
        rows = [(0, 0), (1, 2)] if s.kind is Kind.POSITION else [(2, 0)]
        for axis, (state, variance) in enumerate(rows):
            gain = cov[:, state] / (cov[state, state] + mp.mpf(float(s.noise[i, variance])))
            x = x + gain * (mp.mpf(float(s.values[i, axis])) - x[state])
            cov = cov - gain * cov[state, :]
        steps[-1] = (x, cov, *steps[-1][2:])
    smoothed = [(steps[-1][0], steps[-1][1])]
    for (x_k, p_k, *_), (_, _, f, x_next, p_next) in zip(steps[-2::-1], steps[:0:-1], strict=True):
        g = p_k * f.T * mp.inverse(p_next)
        later_x, later_p = smoothed[-1]
        smoothed.append((x_k + g * (later_x - x_next), p_k + g * (later_p - p_next) * g.T))
    smoothed.reverse()
    at = [outputs[j] for j in range(len(output_s))]
    return (
        np.array([_doubles(steps[r][0])[:, 0] for r in at]), np.array([_doubles(steps[r][1]) for r in at]),
        np.array([_doubles(smoothed[r][0])[:, 0] for r in at]), np.array([_doubles(smoothed[r][1]) for r in at]),
    )  # fmt: skip


def _doubles(m: mp.matrix) -> F:
    return np.array(m.tolist(), dtype=np.float64).reshape(m.rows, m.cols)


def _transition(x: mp.matrix, cov: mp.matrix, dt: mp.mpf, p: MotionParameters) -> tuple[mp.matrix, mp.matrix]:
    """Jacobian and state after dt."""
    speed2 = x[2] ** 2 + cov[2, 2]
    standing = mp.mpf(0.25) / (speed2 + mp.mpf(0.25))
    decay = 1 / mp.mpf(p.yaw_rate_decay_s) + (mp.mpf(3.3) * standing**2 if standing > 0.02 else 0)
    forward = _linear(1 / mp.mpf(p.accel_decay_s), 1 / mp.mpf(p.jerk_decay_s), dt)
    turning = _linear(decay, 1 / mp.mpf(p.yaw_accel_decay_s), dt)
    f = mp.eye(8)
    for block, index in ((forward, (2, 4, 6)), (turning, (3, 5, 7))):
        for a, i in enumerate(index):
            for b, j in enumerate(index):
                f[i, j] = block[a, b]
    way, turn = (dt, dt**2 / 2, dt**3 / 6), (mp.mpf(1), dt / 2, dt**2 / 6)
    distance = way[0] * x[2] + way[1] * x[4] + way[2] * x[6]
    heading = turn[0] * x[3] + turn[1] * x[5] + turn[2] * x[7]
    c, s = mp.cos(heading), mp.sin(heading)
    moved = f * x  # x, y: their own part, until the way is in
    for w, i in zip(way, (2, 4, 6), strict=True):
        f[0, i], f[1, i] = w * c, w * s
    for w, i in zip(turn, (3, 5, 7), strict=True):
        f[0, i], f[1, i] = -distance * s * w, distance * c * w
    moved[0] += distance * c
    moved[1] += distance * s
    return f, moved


@lru_cache(maxsize=4096)
def _linear(rate: mp.mpf, rate_of_change: mp.mpf, dt: mp.mpf) -> mp.matrix:
    return mp.expm(mp.matrix([[0, 1, 0], [0, 0, 1], [0, -rate * rate_of_change, -rate - rate_of_change]]) * dt)


def _noise(
    speed2: mp.mpf, heading: mp.mpf, spread: mp.mpf, dt: mp.mpf, untold_s: mp.mpf, p: MotionParameters
) -> mp.matrix:
    q = mp.zeros(8)
    moving = speed2 / (speed2 + mp.mpf(p.standstill_speed_mps) ** 2)
    jerk = 2 * mp.mpf(p.jerk_sigma_mps3) ** 2 / mp.mpf(p.jerk_decay_s)
    yaw = 2 * mp.mpf(p.yaw_accel_sigma_radps2) ** 2 / mp.mpf(p.yaw_accel_decay_s)
    yaw *= max(moving, mp.mpf(p.standstill_floor))
    white = ((dt**5 / 20, dt**4 / 8, dt**3 / 6), (dt**4 / 8, dt**3 / 3, dt**2 / 2), (dt**3 / 6, dt**2 / 2, dt))
    for strength, index in ((jerk, (2, 4, 6)), (yaw, (3, 5, 7))):
        for a, i in enumerate(index):
            for b, j in enumerate(index):
                q[i, j] += strength * white[a][b]
    lasts_s = min(untold_s, mp.mpf(p.yaw_rate_decay_s))
    astray = speed2 * (1 - (1 + spread) * mp.exp(-spread)) * lasts_s if spread >= 1e-3 else 0
    slip, pointed = mp.mpf(p.side_slip_m) ** 2 * moving * dt, mp.exp(-2 * spread)
    spared = moving * (1 - mp.mpf(p.along_share)) / 2
    q[0, 0] = slip * (1 - spared * (1 + pointed * mp.cos(2 * heading))) + astray * dt
    q[1, 1] = slip * (1 - spared * (1 - pointed * mp.cos(2 * heading))) + astray * dt
    q[0, 1] = q[1, 0] = -slip * spared * pointed * mp.sin(2 * heading)
    q[3, 3] += mp.mpf(p.course_rad) ** 2 * moving * dt
    return q
