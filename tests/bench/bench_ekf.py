"""The six-state filter against filterpy's ExtendedKalmanFilter on the same vectors, in one run.

    python tests/bench/bench_ekf.py

It prints a Markdown table and exits with 1 when the filter is not at least 20 times as fast per step, or the two do
not agree. Beside it: the time for the ego of a ten-minute log with the search for latencies, and for 20 remote
vehicles.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

sys.path.insert(0, str(Path(__file__).parents[2]))

from cwcli.estimation import EstimatorConfig, Kind, Measurements, estimate_track, estimate_tracks
from cwcli.estimation.song2016 import filtered_states_and_covariances_of_matrix, process_noise_covariance
from cwcli.reproduction.song2016.methods import measure_vehicle
from cwcli.simulation.scenario import EGO_VEHICLE_KEY, load_scenario
from tests.studies import city_drive

LIMIT = 20.0
STEP_S = 0.05
REPEATS = 5


def filterpy_filter(z: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Eq. 8 with filterpy, as its documentation asks for: F and the predicted state set by the user, then `update`."""
    ekf = ExtendedKalmanFilter(dim_x=6, dim_z=6)
    ekf.x, ekf.P, ekf.R, ekf.Q = (
        z[0].copy(),
        np.diag(np.square(sigma)),
        np.diag(np.square(sigma)),
        process_noise_covariance(STEP_S),
    )
    identity, dt = np.eye(6), STEP_S
    f = np.eye(6)
    f[2, 4] = f[3, 5] = dt
    out = [ekf.x.copy()]
    for row in z[1:]:
        x, y, v, heading, a, w = ekf.x
        distance, c, s = v * dt + a * dt**2 / 2, np.cos(heading), np.sin(heading)
        f[0, 2:5] = dt * c, -distance * s, dt**2 * c / 2
        f[1, 2:5] = dt * s, distance * c, dt**2 * s / 2
        ekf.P = f @ ekf.P @ f.T + ekf.Q
        ekf.x = np.array([x + distance * c, y + distance * s, v + a * dt, heading + w * dt, a, w])
        ekf.update(row, lambda _: identity, lambda state: state)
        out.append(ekf.x.copy())
    return np.array(out)


def best(function: Callable[[], object], repeats: int = REPEATS) -> float:
    """Return the shortest of some runs, seconds."""
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        function()
        times.append(time.perf_counter() - begin)
    return min(times)


def ten_minutes() -> tuple[list[Measurements], np.ndarray]:
    """An ego with IMU 100 Hz, GNSS position and velocity 10 Hz."""
    drive = city_drive.city_drive(5, 600.0)
    position, _, _, imu = city_drive.measure(drive, 5, {"gnss": 0.1})
    rng = np.random.default_rng(0)
    t = np.arange(0.05, 599.9, 0.1)
    true = drive.at(t)
    course = np.stack([np.cos(true["heading_rad"]), np.sin(true["heading_rad"])], axis=1)
    velocity = true["speed_mps"][:, None] * course + 0.1 * rng.standard_normal((len(t), 2))
    stamp = city_drive.EPOCH_NS + ((t + 0.2) * 1e9).astype(np.int64)
    output = city_drive.EPOCH_NS + (np.arange(1.0, 599.0, 0.05) * 1e9).astype(np.int64)
    return [position, Measurements("vel", Kind.VELOCITY, stamp, velocity), imu], output


def fleet() -> list[tuple[list[Measurements], np.ndarray]]:
    """20 remote vehicles, 6000 messages each with position, speed and heading."""
    rng = np.random.default_rng(0)
    groups = []
    for k in range(20):
        drive = city_drive.city_drive(k, 600.0)
        t = np.arange(0.03, 599.9, 0.1)
        true, n = drive.at(t), len(t)
        stamp = city_drive.EPOCH_NS + (t * 1e9).astype(np.int64)
        xy = np.stack([true["x_m"], true["y_m"]], axis=1) + 0.3 * rng.standard_normal((n, 2))
        groups.append(
            (
                [
                    Measurements("v2x", Kind.POSITION, stamp, xy),
                    Measurements("v2x", Kind.SPEED, stamp, true["speed_mps"] + 0.1 * rng.standard_normal(n)),
                    Measurements("v2x", Kind.HEADING, stamp, true["heading_rad"] + 0.02 * rng.standard_normal(n)),
                ],
                stamp,
            )
        )
    return groups


def main() -> int:
    """Print the table; return the exit code."""
    run = measure_vehicle(load_scenario("curve"), EGO_VEHICLE_KEY, seed=0)
    z, sigma = run.vectors, run.sigma
    ours, theirs = filtered_states_and_covariances_of_matrix(z, tuple(sigma))[0], filterpy_filter(z, sigma)
    difference = float(np.abs(ours - theirs).max())
    many = np.concatenate([z] * 20)
    fast = best(lambda: filtered_states_and_covariances_of_matrix(many, tuple(sigma))) / len(many)
    slow = best(lambda: filterpy_filter(z, sigma), 2) / len(z)
    ratio = slow / fast
    print("| six-state filter | us per step | ratio |")
    print("|---|---|---|")
    print(f"| filterpy ExtendedKalmanFilter | {1e6 * slow:.1f} | 1 |")
    print(f"| cwcli | {1e6 * fast:.2f} | {ratio:.0f} |")
    print(f"\nlargest difference of a state: {difference:.1e}")
    measurements, output = ten_minutes()
    ego = best(lambda: estimate_track(measurements, EstimatorConfig(), output), 3)
    groups = fleet()
    remote = best(lambda: estimate_tracks(groups, EstimatorConfig(latency="none")), 3)
    print(f"ego of ten minutes (IMU 100 Hz, GNSS 10 Hz, latencies searched): {ego:.2f} s")
    print(f"20 remote vehicles of 6000 messages: {remote:.2f} s")
    agrees = difference < 1e-8
    if ratio < LIMIT or not agrees:
        print(f"FAILED: ratio {ratio:.1f} (limit {LIMIT:.0f}), agreement {agrees}")
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
