"""Simulated targets that cross near the middle of a field, before a lidar and a radar."""

from __future__ import annotations

import numpy as np

from cwcli.signals.units import NS_PER_S
from cwcli.simulation.dual_sensor import (
    DualSensorScene,
    SensorNoise,
    measure_positions_with_lidar,
    measure_states_with_radar,
)

N_CROSSING_TARGETS = 5
"""Number of targets that cross; chosen by hand."""
CROSSING_SCAN_PERIOD_S = 0.1
"""Time from a scan of crossing targets to the next, s; chosen by hand."""
CROSSING_HALF_WIDTH_M = 50.0
"""Half the side of the square field in which targets cross, m; chosen by hand."""
CROSSING_SPEED_MPS = 8.0
"""Speed of crossing targets, m/s; chosen by hand."""
CROSSING_DETECTION_PROBABILITY = 0.9
"""Probability that a scan detects a crossing target; chosen by hand."""


def simulate_crossing_targets(
    rng: np.random.Generator,
    *,
    n_scans: int = 100,
    clutter_per_scan: float = 10.0,
    noise: SensorNoise | None = None,
    with_radar: bool = False,
) -> DualSensorScene:
    """Simulate targets that cross near the middle of a square field at one time, with clutter and missed detections.

    Target k comes from direction 2 pi k / n (a little disturbed) and passes the middle within a few metres half-way
    through. Clutter is Poisson, uniform over the field (lidar) or over range, azimuth and +-15 m/s (radar).
    """
    noise = noise or SensorNoise(lidar_m=0.3, range_m=0.3, azimuth_rad=0.01, rate_mps=0.2)
    t = CROSSING_SCAN_PERIOD_S * np.arange(n_scans)
    stamp = np.round(t * NS_PER_S).astype(np.int64)
    n_targets = N_CROSSING_TARGETS
    direction = 2.0 * np.pi * np.arange(n_targets) / n_targets + rng.uniform(-0.2, 0.2, n_targets)
    velocity = CROSSING_SPEED_MPS * np.stack([np.cos(direction), np.sin(direction)], axis=1)
    middle = rng.uniform(-3.0, 3.0, (n_targets, 2))
    truth = np.zeros((n_scans, n_targets, 4))
    truth[:, :, :2] = middle + velocity * (t - t[n_scans // 2])[:, None, None]
    truth[:, :, 2:] = velocity
    lidar, radar, lidar_at, radar_at = [], [], [], []
    reach = CROSSING_HALF_WIDTH_M * np.sqrt(2.0)
    for k in range(n_scans):
        use_radar = with_radar and k % 2 == 1
        seen = truth[k][rng.random(n_targets) < CROSSING_DETECTION_PROBABILITY]
        n_clutter = int(rng.poisson(clutter_per_scan))
        if use_radar:
            low, high = (0.0, -np.pi, -15.0), (reach, np.pi, 15.0)
            found = np.concatenate(
                [measure_states_with_radar(seen, noise, rng), rng.uniform(low, high, (n_clutter, 3))]
            )
            radar.append(rng.permutation(found))
            radar_at.append(np.full(len(found), stamp[k]))
        else:
            clutter = rng.uniform(-CROSSING_HALF_WIDTH_M, CROSSING_HALF_WIDTH_M, (n_clutter, 2))
            found = np.concatenate([measure_positions_with_lidar(seen, noise, rng), clutter])
            lidar.append(rng.permutation(found))
            lidar_at.append(np.full(len(found), stamp[k]))
    is_radar = with_radar & (np.arange(n_scans) % 2 == 1)
    none = np.zeros(0, np.int64)
    return DualSensorScene(
        np.repeat(stamp, n_targets), np.tile(np.arange(1, n_targets + 1), n_scans), truth.reshape(-1, 4),
        np.concatenate([none, *lidar_at]), np.concatenate([np.zeros((0, 2)), *lidar]),
        np.concatenate([none, *radar_at]), np.concatenate([np.zeros((0, 3)), *radar]),
        stamp[~is_radar], stamp[is_radar],
    )  # fmt: skip
