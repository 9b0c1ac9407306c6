"""song2016 once more, written from the paper: filter, models, warnings, fuzzy control. It shares no code."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

DT = 0.05
G = 9.80665
ANGLES = [3]


def wrapped(angle: Array) -> Array:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def process_noise(jerk: float, yaw_accel: float) -> Array:
    """White noise on a and omega between the steps, integrated into v and phi (eq. 4; the densities are a choice)."""
    q = np.zeros((6, 6))
    for value, rate, sigma in ((2, 4, jerk), (3, 5, yaw_accel)):
        q[np.ix_([value, rate], [value, rate])] = sigma**2 * np.array([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]])
    return q


def filtered(z: Array, sigma: Array) -> Array:
    """Eq. 8 with full matrices: states (n, 6) from vectors (n, 6); begins with the first vector."""
    r = np.diag(sigma**2)
    q = process_noise(0.2, 0.02)
    x, p = z[0].copy(), r.copy()
    out = [x]
    for measured in z[1:]:
        _, _, v, phi, a, omega = x
        way = v * DT + a * DT**2 / 2
        f = np.eye(6)  # eq. 6
        f[0, 2:5] = DT * np.cos(phi), -way * np.sin(phi), DT**2 / 2 * np.cos(phi)
        f[1, 2:5] = DT * np.sin(phi), way * np.cos(phi), DT**2 / 2 * np.sin(phi)
        f[2, 4] = f[3, 5] = DT
        x = x + np.array([way * np.cos(phi), way * np.sin(phi), a * DT, omega * DT, 0.0, 0.0])  # eq. 2
        p = f @ p @ f.T + q
        gain = p @ np.linalg.inv(p + r)
        innovation = measured - x
        innovation[ANGLES] = wrapped(innovation[ANGLES])
        x = x + gain @ innovation
        p = (np.eye(6) - gain) @ p
        out.append(x)
    return np.array(out)


def slopes(values: Array, window: int = 8) -> Array:
    """Slope of the line through the last values, by NumPy's polynomial fit; 0 before there are so many."""
    out = np.zeros(len(values))
    for k in range(window - 1, len(values)):
        out[k] = np.polyfit(DT * np.arange(window), values[k - window + 1 : k + 1], 1)[0]
    return out


def predicted(states: Array, family: str, n_steps: int) -> Array:
    """Eq. 9, 2 or 10 repeated: positions (n, 2)."""
    x, y, v, phi, a, omega = (states[:, k].copy() for k in range(6))
    jerk, yaw_accel = slopes(a), slopes(omega)
    if family == "speed":
        a, omega = np.zeros(len(x)), np.zeros(len(x))
    if family != "jerk":
        jerk, yaw_accel = np.zeros(len(x)), np.zeros(len(x))
    stands = np.zeros(len(x), bool)
    for _ in range(n_steps):
        way = v * DT + a * DT**2 / 2
        stands |= way < 0.0
        way[stands] = 0.0
        x, y = x + way * np.cos(phi), y + way * np.sin(phi)
        v, phi, a, omega = v + a * DT, phi + omega * DT, a + jerk * DT, omega + yaw_accel * DT
    return np.column_stack([x, y])


def first_warning(host: Array, other: Array, family: str) -> float:
    """When the cars are first predicted to be nearer than 2.5 m in 2.5 s; NaN if never. States (n, 6) at 20 Hz."""
    distance = np.linalg.norm(predicted(host, family, 50) - predicted(other, family, 50), axis=1)
    below = np.flatnonzero(distance < 2.5)
    return float(below[0] * DT) if len(below) else float("nan")


def lead(time_s: Array) -> tuple[Array, Array, Array]:
    """Place, speed and acceleration of the car in front: coasts from 1.2 s, brakes from 3.45 s."""
    fine = np.arange(0.0, 14.0, 1e-4)
    accel = np.where(fine < 1.2, 0.0, -np.minimum(2.0 * (fine - 1.2), 1.0))
    accel = np.where(fine < 3.45, accel, -np.minimum(1.0 + 3.0 * (fine - 3.45), 8.0))
    speed = 20.0 + np.concatenate([[0.0], np.cumsum(0.5 * (accel[1:] + accel[:-1]) * 1e-4)])
    slow = int(np.argmax(speed < 8.0**2 / (2 * 20.0)))  # from here on the braking eases by 20 m/s^3 and ends at rest
    left = np.maximum(8.0 / 20.0 - (fine - fine[slow]), 0.0)
    speed[slow:], accel[slow:] = 10.0 * left[slow:] ** 2, -20.0 * left[slow:]
    place = 20.0 + np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * 1e-4)])
    x, v, a = (np.interp(time_s, fine, values) for values in (place, speed, accel))
    return x, v, a


def turning(time_s: Array) -> Array:
    """Places (n, 2) of the car from the right: west at 10 m/s; from 4.5 s its curvature grows in 2 s to 1/40 m."""
    fine = np.arange(0.0, 10.0, 1e-4)
    curvature = np.clip(0.0125 * (fine - 4.5), 0.0, 0.025)
    heading = np.pi + np.concatenate([[0.0], np.cumsum(10.0 * 0.5 * (curvature[1:] + curvature[:-1]) * 1e-4)])
    way = np.stack([np.cos(heading), np.sin(heading)], axis=1) * 10.0
    places = np.array([78.2, 1.75]) + np.concatenate(
        [np.zeros((1, 2)), np.cumsum((way[1:] + way[:-1]) / 2 * 1e-4, axis=0)]
    )
    return np.column_stack([np.interp(time_s, fine, places[:, k]) for k in range(2)])


def trapezoid(x: Array | float, feet: tuple[float, float, float, float]) -> Array:
    a, b, c, d = feet
    up = np.ones_like(np.asarray(x, float)) if a == b else np.clip((np.asarray(x) - a) / (b - a), 0.0, 1.0)
    down = np.ones_like(up) if c == d else np.clip((d - np.asarray(x)) / (d - c), 0.0, 1.0)
    return np.minimum(up, down)


TTC = ((0, 0, 1, 2), (1, 2, 2, 2.9), (2, 2.9, 2.9, 4.5), (2.9, 4.5, 6, 6))
DV = ((-5, -5, -2, 0), (-2, 0, 0, 3), (0, 3, 3, 8), (3, 8, 20, 20))
NONE, LIGHT, MEDIUM, STRONG, FULL = (0, 0, 0, 0.4), (0.5, 2, 2, 3.5), (3, 5, 5, 7), (6, 7.5, 7.5, 9), (9.2, 10, 10, 10)
RULES = (
    (LIGHT, FULL, FULL, FULL),
    (NONE, STRONG, FULL, FULL),
    (NONE, MEDIUM, STRONG, FULL),
    (NONE, MEDIUM, MEDIUM, STRONG),
)


Trapezoid = tuple[float, float, float, float]
CLOSED, SMALL, HALF = (0, 0, 0, 0.04), (0, 0.15, 0.15, 0.3), (0.3, 0.5, 0.5, 0.7)
THROTTLE_RULES = (
    (CLOSED, CLOSED, CLOSED, CLOSED),
    (CLOSED, CLOSED, CLOSED, CLOSED),
    (SMALL, CLOSED, CLOSED, CLOSED),
    (HALF, CLOSED, CLOSED, CLOSED),
)


def inferred(ttc_s: float, dv_mps: float, rules: tuple[tuple[Trapezoid, ...], ...], most: float) -> float:
    """Mamdani: minimum, maximum, centroid over 0 to the most."""
    at = np.linspace(0.0, most, 2001)
    total = np.zeros(len(at))
    ttc, dv = min(max(ttc_s, 0.0), 6.0), min(max(dv_mps, -5.0), 20.0)
    for row, near in zip(rules, TTC, strict=True):
        for out, closing in zip(row, DV, strict=True):
            strength = min(float(trapezoid(ttc, near)), float(trapezoid(dv, closing)))
            total = np.maximum(total, np.minimum(strength, trapezoid(at, out)))
    return float((total * at).sum() / total.sum())


def least_distance(warned_s: float, *, until_s: float = 12.0, friction: float = 0.8) -> float:
    """Rear-end under control from a warning on: lags 0.2 and 0.3 s, 0.9 m/s^2 per MPa, 3 m/s^2, 15 m/s^3."""
    step = 0.01
    times = np.arange(0.0, until_s, step)
    other_x, other_v, other_a = lead(times)
    x, v, a, p, opening = 0.0, 20.0, 0.0, 0.0, 0.0
    nearest = np.inf
    for time_s, ox, ov, oa in zip(times, other_x, other_v, other_a, strict=True):
        distance = abs(ox - x)
        nearest = min(nearest, distance)
        if time_s >= warned_s:
            direction = 1.0 if ox >= x else -1.0
            gap, rate, change = max(distance - 2.5, 0.0), direction * (ov - v), direction * (oa - a)
            roots = np.roots([change / 2, rate, gap]) if abs(change) > 1e-9 else np.array([-gap / rate if rate else -1])
            ttc = min((float(root.real) for root in roots if abs(root.imag) < 1e-9 and root.real >= 0), default=np.inf)
            pressure = inferred(ttc, v - ov, RULES, 10.0)
            throttle = 0.0 if pressure > 0.5 else inferred(ttc, v - ov, THROTTLE_RULES, 1.0)
            p += (pressure - p) * (1.0 - np.exp(-step / 0.2))
            opening += (throttle - opening) * (1.0 - np.exp(-step / 0.3))
            wanted = min(max(3.0 * opening - 0.9 * p, -friction * G), friction * G)
            a += np.clip(wanted - a, -15.0 * step, 15.0 * step)
        x += max(v * step + a * step**2 / 2, 0.0)
        v = max(v + a * step, 0.0)
    return float(nearest)
