"""Plain NumPy twin of `cwcli.kernels.track`: the textbook forms, with none of the kernel's shortcuts."""

from __future__ import annotations

from typing import Any

import numpy as np

N_STATES = {"cv": 4, "ca": 6, "ctrv": 5}


def wrap(angle):
    return np.arctan2(np.sin(angle), np.cos(angle))


def move(model, x, dt):
    x = np.array(x, float)
    if model == "cv":
        return np.array([x[0] + dt * x[2], x[1] + dt * x[3], x[2], x[3]])
    if model == "ca":
        p, v, a = x[:2], x[2:4], x[4:]
        return np.concatenate([p + v * dt + 0.5 * a * dt**2, v + a * dt, a])
    w = x[4]
    v = complex(x[2], x[3])
    turned = v * np.exp(1j * w * dt)
    moved = (turned - v) / (1j * w) if abs(w) > 1e-6 else v * dt * (1 + 0.5j * w * dt)
    return np.array([x[0] + moved.real, x[1] + moved.imag, turned.real, turned.imag, w])


def jacobian(f, x):
    x = np.asarray(x, float)
    columns = []
    for k in range(len(x)):
        h = np.zeros(len(x))
        h[k] = 1e-6 * max(1.0, abs(x[k]))
        columns.append((f(x + h) - f(x - h)) / (2 * h[k]))
    return np.stack(columns, axis=1)


def process_noise(model, dt, noise, turn_noise):
    d = N_STATES[model]
    q = np.zeros((d, d))
    if model == "ca":
        block = np.array([
            [dt**5 / 20, dt**4 / 8, dt**3 / 6], [dt**4 / 8, dt**3 / 3, dt**2 / 2], [dt**3 / 6, dt**2 / 2, dt]
        ])  # fmt: skip
        for k in range(2):
            q[np.ix_([k, k + 2, k + 4], [k, k + 2, k + 4])] = noise**2 * block
        return q
    block = np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    for k in range(2):
        q[np.ix_([k, k + 2], [k, k + 2])] = noise**2 * block
    if model == "ctrv":
        q[4, 4] = turn_noise**2 * dt
    return q


def sigma_points(x, p, kappa):
    n = len(x)
    root = np.linalg.cholesky((n + kappa) * p)
    points = [x, *(x + root[:, k] for k in range(n)), *(x - root[:, k] for k in range(n))]
    weights = np.array([kappa / (n + kappa), *[0.5 / (n + kappa)] * (2 * n)])
    return np.array(points), weights


def predict(name, model, x, p, dt, noise, turn_noise, kappa):
    """Predicted mean and covariance, and the cross-covariance between the states before and after."""
    q = process_noise(model, dt, noise, turn_noise)
    if name == "ekf":
        f = jacobian(lambda s: move(model, s, dt), x)
        return move(model, x, dt), f @ p @ f.T + q, p @ f.T
    points, w = sigma_points(x, p, kappa)
    moved = np.array([move(model, s, dt) for s in points])
    mean = w @ moved
    return mean, (w[:, None] * (moved - mean)).T @ (moved - mean) + q, (w[:, None] * (points - x)).T @ (moved - mean)


def see(kind, x, origin):
    if kind == 0:
        return x[:2].copy()
    away, speed = x[:2] - origin[:2], x[2:4] - origin[2:]
    r = np.linalg.norm(away)
    z = np.array([r, np.arctan2(away[1], away[0]), away @ speed / r])
    return z[: kind + 1]


def update(name, x, p, kind, z, r, origin, kappa):
    """The plain forms: K = P_xz S^-1, P - K S K^T (xiang2019 eq. 11-13, 14 corrected). Returns also nis and nu."""
    m = 2 if kind == 0 else kind + 1
    r = r[:m, :m]
    if name == "ekf" or kind == 0:
        h = jacobian(lambda s: see(kind, s, origin), x)
        expected, s, cross = see(kind, x, origin), h @ p @ h.T + r, p @ h.T
    else:
        points, w = sigma_points(x[:4], p[:4, :4], kappa)
        seen = np.array([see(kind, s, origin) for s in points])
        turned = seen - seen[0]
        turned[:, 1] = wrap(turned[:, 1])
        mean = w @ turned
        expected = seen[0] + mean
        s = (w[:, None] * (turned - mean)).T @ (turned - mean) + r
        cross4 = (w[:, None] * (points - x[:4])).T @ (turned - mean)
        cross = p[:, :4] @ np.linalg.solve(p[:4, :4], cross4)  # the other states follow by their correlation
    nu = z[:m] - expected
    if kind > 0:
        nu[1] = wrap(nu[1])
    gain = cross @ np.linalg.inv(s)
    nis = nu @ np.linalg.solve(s, nu)
    loglik = -0.5 * (nis + np.linalg.slogdet(s)[1] + m * np.log(2 * np.pi))
    return x + gain @ nu, p - gain @ s @ gain.T, nis, loglik


def run(name, model, time_s, kind, z, r, origin, x0, p0, noise, turn_noise, kappa):
    """Filter from a given first state, then smooth. Returns filtered and smoothed means, covariances, nis, loglik."""
    states, covariances, nis, total = [x0], [p0], [np.nan], 0.0
    predicted: list[Any] = [None]
    for i in range(1, len(time_s)):
        mean, cov, cross = predict(
            name, model, states[-1], covariances[-1], time_s[i] - time_s[i - 1], noise, turn_noise, kappa
        )
        predicted.append((mean, cov, cross))
        x, p, size, loglik = update(name, mean, cov, int(kind[i]), z[i], r[i], origin[i], kappa)
        states.append(x)
        covariances.append(p)
        nis.append(size)
        total += loglik
    smooth, smooth_cov = [states[-1]], [covariances[-1]]
    for i in range(len(time_s) - 2, -1, -1):
        mean, cov, cross = predicted[i + 1]
        gain = cross @ np.linalg.inv(cov)
        smooth.insert(0, states[i] + gain @ (smooth[0] - mean))
        smooth_cov.insert(0, covariances[i] + gain @ (smooth_cov[0] - cov) @ gain.T)
    return np.array(states), np.array(covariances), np.array(smooth), np.array(smooth_cov), np.array(nis), total
