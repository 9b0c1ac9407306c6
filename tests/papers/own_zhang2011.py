"""zhang2011 once more, written from the paper with SciPy: model, gains, observers, camera. It shares no code."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp
from scipy.linalg import expm, solve_discrete_are

Array = npt.NDArray[np.float64]
L, LF, LR, KF, KR, INERTIA, PREVIEW = 1.96, 0.90, 1.06, 6e4, 6e4, 2100.0, 33.5  # table 5, section 1.2.3
HALF, FULL = 1215.0, 1460.0
C = np.eye(4)[2:]
R1 = R2 = 0.01


def model(v: float, mass: float) -> tuple[Array, Array]:
    """A and B of eq. 21, with eq. 11 put right, in the paper's signs; v in m/s."""
    a = np.array([
        [-(KF + KR) / (mass * v), (LR * KR - LF * KF) / (mass * v) - v, 0, 0],
        [(LR * KR - LF * KF) / (INERTIA * v), -(LF**2 * KF + LR**2 * KR) / (INERTIA * v), 0, 0],
        [-1, -PREVIEW, 0, v],
        [0, -1, 0, 0],
    ])  # fmt: skip
    return a, np.array([[KF / mass, 0], [LF * KF / INERTIA, 0], [0, 0], [0, v]])


def sampled(a: Array, b: Array, dt: float = 0.1) -> tuple[Array, Array]:
    whole = expm(np.block([[a, b], [np.zeros((2, 6))]]) * dt)
    return whole[:4, :4], whole[:4, 4:]


def gain(v: float, mass: float) -> tuple[Array, Array, Array]:
    """Transition, input and the filter's gain at rest (eq. 16, 17, 19), R1 as intensity of the continuous model."""
    a, b = model(v, mass)
    phi, g = sampled(a, b)
    van_loan = expm(np.block([[-a, R1 * np.eye(4)], [np.zeros((4, 4)), a.T]]) * 0.1)
    q = van_loan[4:, 4:].T @ van_loan[:4, 4:]
    p = solve_discrete_are(phi.T, C.T, q, R2 * np.eye(2))
    return phi, g, p @ C.T @ np.linalg.inv(C @ p @ C.T + R2 * np.eye(2))


def gain_with_curvature_noise(v: float, mass: float) -> Array:
    """The filter's gain at rest with R1 as one number: the variance of the curvature input alone."""
    phi, g = sampled(*model(v, mass))
    p = solve_discrete_are(phi.T, C.T, R1 * np.outer(g[:, 1], g[:, 1]), R2 * np.eye(2))
    return np.asarray(p @ C.T @ np.linalg.inv(C @ p @ C.T + R2 * np.eye(2)))


def steady(v: float, mass: float, delta: float) -> Array:
    a, b = model(v, mass)
    return np.asarray(np.linalg.solve(a[:2, :2], -b[:2, 0] * delta), np.float64)


def driven(v: float, mass: float, delta: float, curvature: float, times: Array) -> Array:
    """States from straight running, integrated numerically, shape (n, 4)."""
    a, b = model(v, mass)
    made = solve_ivp(
        lambda _, x: a @ x + b @ (delta, curvature), (0.0, times[-1]), np.zeros(4), t_eval=times, rtol=1e-10, atol=1e-12
    )
    return made.y.T


def factor(v: float) -> float:
    """f(v) of eq. 13 (corrected), at half load as the paper keeps it."""
    return 1.0 + HALF * (LR * KR - LF * KF) / (L * KF * KR) / L * v**2


def static_errors(v_kmh: float, delta: float, mass: float, told_mass: float, *, seconds: float = 5.0) -> Array:
    """Largest error of the last second of v_y and gamma, per cent: the car turns at once, the observer begins at 0.

    Input of the observer: delta_D = f(v) delta_k with eq. 10 on the exact lane (eq. 15 with the new frame's angle).
    """
    v = v_kmh / 3.6
    a, b = model(v, mass)
    phi, g = sampled(a, b)
    u = np.array([delta, 0.001])
    n = round(seconds / 0.1) + 1
    true = np.zeros((n, 4))
    true[0, :2] = steady(v, mass, delta)
    for k in range(1, n):
        true[k] = phi @ true[k - 1] + g @ u
    low = 10.0 * np.floor(v_kmh / 10.0)
    bank = [gain(kmh / 3.6, told_mass) for kmh in (low, low + 10.0)]
    weight = (v_kmh - low) / 10.0  # eq. 22 (corrected)
    state = np.array([0.0, 0.0, true[0, 2], true[0, 3]])
    errors = []
    for k in range(1, n):
        kinematic = L * 0.001 - (true[k, 3] - true[k - 1, 3]) * L / (v * 0.1)  # eq. 10
        told = np.array([factor(v) * kinematic, 0.001])
        both = []
        for phi_i, g_i, k_i in bank:
            ahead = phi_i @ state + g_i @ told
            both.append(ahead + k_i @ (true[k, 2:] - C @ ahead))
        state = (1.0 - weight) * both[0] + weight * both[1]
        if 0.1 * k >= seconds - 1.0 - 1e-9:
            errors.append(100.0 * np.abs(state[:2] / true[k, :2] - 1.0))
    return np.max(errors, axis=0)


def static_errors_of_figure_15(steer_rad: float = 0.01) -> Array:
    """Return what `static_errors` returns, for a speed that grows from 60 to 80 km/h by 0.2 m/s^2.

    The bend goes right, as a positive angle does.
    The gains come from a table of multiples of 10 km/h; the last second is the one that ends at 27.8 s.
    """

    def at(t: float) -> float:
        return min(60 / 3.6 + 0.2 * t, 80 / 3.6)

    bank = {kmh: gain(kmh / 3.6, HALF) for kmh in (60.0, 70.0, 80.0, 90.0)}
    u = np.array([steer_rad, 0.001])
    x = np.concatenate([steady(60 / 3.6, HALF, u[0]), np.zeros(2)])
    state, errors = np.array([0.0, 0.0, x[2], x[3]]), []
    for k in range(1, 279):
        before = x
        for i in range(10):
            a, b = model(at(0.1 * (k - 1) + 0.01 * (i + 0.5)), HALF)
            phi, g = sampled(a, b, 0.01)
            x = phi @ x + g @ u
        v = at(0.1 * k)
        told = np.array([factor(v) * (L * u[1] - (x[3] - before[3]) * L / (v * 0.1)), u[1]])
        low = 10.0 * np.floor(3.6 * v / 10.0 + 1e-9)
        both = []
        for phi_i, g_i, k_i in (bank[low], bank[low + 10.0]):
            ahead = phi_i @ state + g_i @ told
            both.append(ahead + k_i @ (x[2:] - C @ ahead))
        weight = (3.6 * v - low) / 10.0
        state = (1.0 - weight) * both[0] + weight * both[1]
        errors.append(100.0 * np.abs(state[:2] / x[:2] - 1.0))
    return np.max(errors[-11:], axis=0)


def decoded(code: str, regions: tuple[tuple[float, float, int, int], ...]) -> list[float]:
    """Eq. 5: low, high, bits and decimals of each parameter."""
    out, at = [], 0
    for low, high, bits, decimals in regions:
        whole = int(code[at : at + bits], 2)
        out.append(round(low + whole / (2**bits - 1) * (high - low), decimals))
        at += bits
    return out


def seen(points: Array, *, height_m: float, focal_px: float, centre: tuple[float, float], pitch_rad: float) -> Array:
    """Columns and rows (n, 2) of points (x ahead, y left) on a flat road: a pinhole camera turned down by its pitch."""
    turn = np.array([[np.cos(pitch_rad), 0, -np.sin(pitch_rad)], [0, 1, 0], [np.sin(pitch_rad), 0, np.cos(pitch_rad)]])
    body = np.column_stack([points, np.full(len(points), -height_m)]) @ turn.T
    return np.array(centre) - focal_px * body[:, 1:] / body[:, :1]
