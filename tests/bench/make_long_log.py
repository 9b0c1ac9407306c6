"""Long logs for tests of memory: twenty cars round the ego for as long as wanted, all near enough to be measured.

    python -m tests.bench.make_long_log long.mcap --seconds 7200

The ego drives round a circle in the middle of three lanes at 15 m/s, with fixes at 10 Hz and an IMU at 100 Hz; the
others go with it, before and behind it, and swing forwards and backwards. They send a BSM at 20 Hz each, in CDR: every
row of every car is predicted, compared with the ego, and measured.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from tests.bench.make_log import GNSS_HZ, IMU_HZ, N_CARS, NS_PER_S, T0_NS, Drive, write_cdr

CAR_HZ = 20
RADIUS_M, LANE_M, SPEED_MPS = 1000.0, 3.5, 15.0
APART_M, SWING_M, SWING_S = 9.0, 6.0, 40.0
M_PER_DEG = 111_200.0
START_DEG = (49.0, 8.0)


def long_drive(seconds: int, seed: int = 1) -> Drive:
    """The numbers of such a log."""
    rng = np.random.default_rng(seed)

    def times(rate_hz: int, count: int = 1) -> np.ndarray:
        ns = T0_NS + np.arange(seconds * rate_hz, dtype=np.int64) * (NS_PER_S // rate_hz) + 5_000_000
        return np.repeat(ns, count)

    def degrees(radius_m: np.ndarray | float, turned_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        north_m, east_m = radius_m * np.sin(turned_rad), RADIUS_M - radius_m * np.cos(turned_rad)
        m_per_deg = M_PER_DEG * np.cos(np.radians(START_DEG[0]))
        return START_DEG[0] + north_m / M_PER_DEG, START_DEG[1] + east_m / m_per_deg

    imu_ns, gnss_ns, bsm_ns = times(IMU_HZ), times(GNSS_HZ), times(CAR_HZ, N_CARS)
    car = np.tile(np.arange(N_CARS), seconds * CAR_HZ)
    car_ns = bsm_ns + car * 1_000_003
    n = len(car_ns)
    t_s = (car_ns - 5_000_000 - T0_NS) / NS_PER_S
    lane_m = LANE_M * (car % 3 - 1)
    swing = 2.0 * np.pi * t_s / SWING_S + car
    along_m = SPEED_MPS * t_s + APART_M * (car - N_CARS // 2 + 0.5) + SWING_M * np.sin(swing)
    swing_rate = 2.0 * np.pi / SWING_S
    speed_mps = SPEED_MPS + SWING_M * swing_rate * np.cos(swing)
    accel_mps2 = -SWING_M * swing_rate**2 * np.sin(swing)
    turned = along_m / RADIUS_M
    latitude, longitude = degrees(RADIUS_M + lane_m, turned)
    bsm = {
        "msgCnt": np.arange(n) // N_CARS % 128,
        "secMark": (car_ns - 5_000_000) // 1_000_000 % 60_000,
        "lat": np.rint(1e7 * latitude + rng.normal(0, 20, n)).astype(np.int64),
        "long": np.rint(1e7 * longitude + rng.normal(0, 30, n)).astype(np.int64),
        "elev": np.full(n, 1100),
        "speed": np.rint(50 * (speed_mps + rng.normal(0, 0.1, n))).astype(np.int64),
        "heading": np.rint(80 * np.degrees(turned)).astype(np.int64) % 28_800,
        "accelLong": np.rint(100 * (accel_mps2 + rng.normal(0, 0.1, n))).astype(np.int64),
        "accelLat": np.rint(100 * speed_mps**2 / RADIUS_M).astype(np.int64),
        "yaw": np.rint(100 * np.degrees(speed_mps / RADIUS_M)).astype(np.int64),
    }
    fix_s = (gnss_ns - 5_000_000 - T0_NS) / NS_PER_S
    position = np.column_stack([*degrees(RADIUS_M, SPEED_MPS * fix_s / RADIUS_M), np.full(len(fix_s), 110.0)])
    clockwise = [0.0, 0.0, -SPEED_MPS / RADIUS_M]
    return Drive(
        imu_ns,
        gnss_ns,
        car_ns,
        times(1)[:0],
        rng.normal([0, -(SPEED_MPS**2) / RADIUS_M, 9.81], 0.1, (len(imu_ns), 3)),
        rng.normal(clockwise, 0.003, (len(imu_ns), 3)),
        position + rng.normal(0, [2e-6, 3e-6, 0.5], position.shape),
        car,
        bsm,
    )


def main() -> None:
    """Write the log."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("target", type=Path)
    parser.add_argument("--seconds", type=int, default=600)
    options = parser.parse_args()
    write_cdr(options.target, long_drive(options.seconds), images=False)


if __name__ == "__main__":
    main()
