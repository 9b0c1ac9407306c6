"""Plain NumPy twins of `cwcli.kernels.observer`, written from the equations, with scipy's matrix exponential."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from cwcli.kernels.observer import CAM, EL, ETA, GYRO, KL, STEER, VY, YL, Begin, EventKind, G


def blend(phi, gamma, gain, *, low, weight, begin, periods, inputs, measured):
    """zhang2011, eq. 15, 18, 22."""
    out = np.full((len(low), 4), np.nan)
    x = None
    for i in range(len(low)):
        if begin[i] == Begin.STOP:
            x = None
        if begin[i] == Begin.ANEW:
            x = np.array([0.0, 0.0, *measured[i]])
        elif x is not None:
            for p in range(periods[i]):
                both = []
                for s in (low[i], low[i] + 1):
                    z = phi[s] @ x + gamma[s] @ inputs[i]
                    if p == periods[i] - 1 and np.isfinite(measured[i]).all():
                        z = z + gain[s] @ (measured[i] - z[2:])
                    both.append(z)
                x = (1 - weight[i]) * both[0] + weight[i] * both[1]
        if x is not None:
            out[i] = x
    return out


def model_matrix(car, v, preview_m, eta, min_speed):
    """A of the nine states without the load's column, and the force that the load scales."""
    ve = max(v, min_speed)
    share = max(-1.0, v / ve)
    m, inertia = car.mass_kg, car.yaw_inertia_kgm2
    kf, kr, lf, lr = car.front_stiffness_nprad, car.rear_stiffness_nprad, car.front_axle_m, car.rear_axle_m
    a = np.zeros((9, 9))
    force = np.zeros(9)
    force[[VY, G, STEER]] = -(kf + kr) / (m * ve), (lr * kr - lf * kf) / (m * ve), kf / m * share
    a[VY] = eta * force
    a[VY, G] -= ve
    a[G, [VY, G, STEER]] = (
        (lr * kr - lf * kf) / (inertia * ve),
        -(lf**2 * kf + lr**2 * kr) / (inertia * ve),
        lf * kf / inertia * share,
    )
    a[YL, [VY, G, EL]] = 1.0, preview_m, v
    a[EL, [G, KL]] = 1.0, v
    return a, force


def walks(q, v, model):
    """Intensities at a speed: K_L's by the metre and v^-6, the steering angle's v^-4, from `chosen_mps` down."""
    slow = max(1.0, model["chosen_mps"] / max(abs(v), model["slowest_mps"]))
    return q * np.array([1, 1, 1, 1, slow**4, slow**6, 1, 1, 1])


def predict(x, p, dt, v, car, preview_m, change, q, min_speed):
    a, force = model_matrix(car, v, preview_m, x[ETA], min_speed)
    drift = np.zeros(9)
    drift[KL] = 0.5 * v * change * dt
    jacobian = a.copy()
    jacobian[VY, ETA] = force @ x
    f = expm(jacobian * dt)
    half = np.diag(0.5 * dt * np.where(np.arange(9) == KL, q * abs(v), q))
    return expm(a * dt) @ (x + drift) + drift, f @ (p + half) @ f.T + half


def move_along(x, p, by_m, change, q):
    """To another preview point: the lane's place, slope and curvature by_m farther, from Taylor's series."""
    f = np.eye(9)
    f[YL, [EL, KL]], f[EL, KL] = (by_m, by_m**2 / 2), by_m
    more = np.zeros(9)
    more[[YL, EL, KL]] = change * np.array([by_m**3 / 6, by_m**2 / 2, by_m])
    half = np.zeros((9, 9))
    half[KL, KL] = 0.5 * q[KL] * abs(by_m)
    return f @ x + more, f @ (p + half) @ f.T + half


def update(x, p, h, z, r, gate):
    s = h @ p @ h + r
    innovation = z - h @ x
    if gate > 0 and innovation**2 > gate**2 * s:
        return x, p, False
    k = p @ h / s
    return x + k * innovation, p - np.outer(k, h @ p), True


def observe(dt, speed, kind, values, sigmas, previews_m, changes, model, car):
    """A run that starts at the first row, a frame, and neither pauses nor restarts."""
    q, start = np.array(model["walk_noise"]), np.array(model["start_sigma"])
    gate, min_speed = model["gate_sigmas"], model["min_speed"]
    v, k, preview_m, change = speed[0], values[0, 2], previews_m[0], changes[0]
    gamma = -v * k
    x = np.zeros(9)
    x[VY] = (
        car.rear_axle_m - car.mass_kg * car.front_axle_m / (car.rear_stiffness_nprad * car.wheelbase_m) * v**2
    ) * gamma
    x[G], x[YL], x[EL], x[KL], x[ETA] = gamma, values[0, 0], values[0, 1], k, 1.0
    x[STEER] = -(car.wheelbase_m + model["understeer"] * v**2) * k
    p = np.diag(start**2)
    p[YL, YL], p[EL, EL], p[KL, KL] = sigmas[0] ** 2
    lever = np.zeros(9)
    lever[[YL, EL]] = preview_m, 1.0
    shear = np.eye(9)
    shear[:, CAM] -= lever
    p = shear @ p @ shear.T
    xs, ps = [x], [p]
    for i in range(1, len(dt)):
        n = max(1, int(np.ceil(dt[i] / model["max_step_s"] - 1e-9)))
        for _ in range(n if dt[i] > 0 else 0):
            ahead_m = preview_m + car.camera_forward_m
            x, p = predict(x, p, dt[i] / n, speed[i], car, ahead_m, change, walks(q, speed[i], model), min_speed)
        if kind[i] == EventKind.LANE:
            change = changes[i] if np.isfinite(values[i, 1]) else 0.0
            if np.isfinite(values[i, 1]):
                x, p = move_along(x, p, previews_m[i] - preview_m, change, walks(q, speed[i], model))
                preview_m = previews_m[i]
        lane = [(1, {EL: 1.0, CAM: 1.0}), (2, {KL: 1.0}), (0, {YL: 1.0, CAM: preview_m})]
        other = [(0, {G: 1.0, GYRO: 1.0} if kind[i] == EventKind.YAW_RATE else {STEER: 1.0})]
        for column, entries in lane if kind[i] == EventKind.LANE else other:
            if np.isnan(values[i, column]):
                continue
            h = np.zeros(9)
            for at, value in entries.items():
                h[at] = value
            x, p, is_used = update(x, p, h, values[i, column], sigmas[i, column] ** 2, gate)
            assert is_used
        xs.append(x)
        ps.append(p)
    return np.array(xs), np.array(ps)
