"""xiang2019 once more, written from the paper: both filters with full matrices. Shares no code with the package."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
KAPPA = 0.0


def moved(x: Array, p: Array, dt: float, noise: float) -> tuple[Array, Array]:
    """Constant velocity (eq. 15), accelerations as white noise."""
    f = np.eye(4)
    f[0, 2] = f[1, 3] = dt
    q = np.zeros((4, 4))
    for place, speed in ((0, 2), (1, 3)):
        q[np.ix_([place, speed], [place, speed])] = noise**2 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    return f @ x, f @ p @ f.T + q


def polar(points: Array) -> Array:
    """Eq. 3, 4; points (k, 4)."""
    return np.stack([np.hypot(points[:, 0], points[:, 1]), np.arctan2(points[:, 1], points[:, 0])], axis=1)


def updated_ekf(x: Array, p: Array, z: Array, r: Array) -> tuple[Array, Array]:
    reach2 = x[0] ** 2 + x[1] ** 2
    h = np.zeros((2, 4))
    h[0, :2] = x[:2] / np.sqrt(reach2)
    h[1, :2] = -x[1] / reach2, x[0] / reach2
    s = h @ p @ h.T + r
    gain = p @ h.T @ np.linalg.inv(s)
    difference = z - polar(x[None])[0]
    difference[1] = (difference[1] + np.pi) % (2 * np.pi) - np.pi
    return x + gain @ difference, p - gain @ s @ gain.T


def updated_ukf(x: Array, p: Array, z: Array, r: Array) -> tuple[Array, Array]:
    """Eq. 7 to 14 (eq. 14 with a minus), 2 n + 1 points."""
    n = len(x)
    root = np.linalg.cholesky((n + KAPPA) * p)
    points = np.vstack([x, x + root.T, x - root.T])
    weights = np.full(2 * n + 1, 0.5 / (n + KAPPA))
    weights[0] = KAPPA / (n + KAPPA)
    seen = polar(points)
    seen[:, 1] = seen[0, 1] + (seen[:, 1] - seen[0, 1] + np.pi) % (2 * np.pi) - np.pi
    mean = weights @ seen  # eq. 9
    away = seen - mean
    b = (weights[:, None] * away).T @ away + r  # eq. 10
    cross = (weights[:, None] * (points - x)).T @ away  # eq. 11
    gain = cross @ np.linalg.inv(b)  # eq. 12
    difference = z - mean
    difference[1] = (difference[1] + np.pi) % (2 * np.pi) - np.pi
    return x + gain @ difference, p - gain @ b @ gain.T  # eq. 13, 14 (corrected)


def filtered(
    time_s: Array, is_lidar: Array, z: Array, *, lidar_m: float, radar: tuple[float, float], noise: float,
    speed_mps: float, unscented: bool,
) -> Array:  # fmt: skip
    """States (n, 4) of rows that begin with a lidar's; z: (n, 2), x and y or range and azimuth."""
    h = np.eye(4)[:2]
    r_lidar, r_radar = lidar_m**2 * np.eye(2), np.diag(np.square(radar))
    x = np.array([*z[0], 0.0, 0.0])  # eq. 5
    p = np.diag([lidar_m**2, lidar_m**2, speed_mps**2, speed_mps**2])
    out = [x]
    for k in range(1, len(z)):
        x, p = moved(x, p, float(time_s[k] - time_s[k - 1]), noise)
        if is_lidar[k]:
            gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + r_lidar)
            x, p = x + gain @ (z[k] - h @ x), p - gain @ h @ p
        else:
            x, p = (updated_ukf if unscented else updated_ekf)(x, p, z[k], r_radar)
        out.append(x)
    return np.array(out)
