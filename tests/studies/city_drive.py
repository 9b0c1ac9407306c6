"""A compact simulator of a city drive: smooth motion, song2016's sensor noise, planted latencies and biases."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cwcli.estimation import Kind, Measurements

F = npt.NDArray[np.float64]
EPOCH_NS = 1_700_000_000_000_000_000
GRAVITY = 9.81


@dataclass(frozen=True)
class Drive:
    """Truth at 200 Hz: all arrays (n,)."""

    time_s: F
    x_m: F
    y_m: F
    speed_mps: F
    heading_rad: F
    accel_mps2: F
    yaw_rate_radps: F

    def at(self, time_s: F) -> dict[str, F]:
        """Truth at other times, by linear interpolation of the 200 Hz grid."""
        names = ("x_m", "y_m", "speed_mps", "heading_rad", "accel_mps2", "yaw_rate_radps")
        return {name: np.interp(time_s, self.time_s, getattr(self, name)) for name in names}


def city_drive(seed: int, duration_s: float = 300.0) -> Drive:
    """Blocks of driving between junctions: accelerate, cruise, brake to a stop or a turn, wait, turn left or right."""
    rng = np.random.default_rng(seed)
    dt = 0.005
    n = int(duration_s / dt)
    target_accel, target_yaw = np.zeros(n), np.zeros(n)
    k, speed = int(rng.uniform(1.0, 4.0) / dt), 0.0
    while k < n:
        cruise, turn = rng.uniform(8.0, 15.0), rng.uniform(3.5, 6.0)
        stop = rng.random() < 0.4
        for wanted, rate in ((cruise, rng.uniform(1.2, 2.5)), (0.0 if stop else turn, -rng.uniform(1.2, 2.8))):
            length = int(abs(wanted - speed) / abs(rate) / dt)
            target_accel[k : k + length] = rate
            k += length
            speed = wanted
            k += int(rng.uniform(2.0, 8.0) / dt) if wanted == cruise else 0
        if stop:
            k += int(rng.uniform(2.0, 8.0) / dt)
        else:
            length = int(rng.uniform(2.5, 4.5) / dt)
            angle = rng.choice([-1.0, 1.0]) * rng.uniform(0.6, 1.6)
            target_yaw[k : k + length] = angle / (length * dt)
            k += length
    accel, yaw = _smoothed(target_accel, 0.4, dt), _smoothed(target_yaw, 0.6, dt)
    speed_mps = _integral(accel, dt)
    yaw = yaw * (speed_mps > 0.2)
    heading = rng.uniform(-np.pi, np.pi) + _integral(yaw, dt)
    x, y = _integral(speed_mps * np.cos(heading), dt), _integral(speed_mps * np.sin(heading), dt)
    time_s: F = np.asarray(np.arange(n) * dt, dtype=np.float64)
    return Drive(time_s, x, y, speed_mps, heading, accel, yaw)


def _integral(rate: F, dt: float) -> F:
    return np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1])) * dt))


def _smoothed(value: F, width_s: float, dt: float) -> F:
    kernel = np.hanning(int(width_s / dt) + 2)[1:-1]
    return np.convolve(value, kernel / kernel.sum(), mode="same")


@dataclass(frozen=True)
class Sensors:
    """Rates and one-sigma noise: song2016's, with an IMU at 100 Hz; 0.5 % of acceleration read as 0.5 % of g."""

    position_hz: float = 10.0
    speed_hz: float = 20.0
    heading_hz: float = 10.0
    imu_hz: float = 100.0
    position_m: float = 0.6
    speed_mps: float = 0.5
    heading_rad: float = np.radians(1.0)
    accel_mps2: float = 0.005 * GRAVITY
    yaw_rate_radps: float = np.radians(0.1)
    accel_bias_mps2: float = -0.4
    yaw_rate_bias_radps: float = 0.004


def measure(drive: Drive, seed: int, latency_s: dict[str, float], sensors: Sensors = Sensors()) -> list[Measurements]:
    """Sample the drive: sources "gnss" (POSITION), "speed" (SPEED), "heading" (HEADING) and "imu" (IMU).

    A source with latency L stamps at t what was true at t - L.
    """
    rng = np.random.default_rng([seed, 7])
    first, last = drive.time_s[0], drive.time_s[-1]

    def times(rate: float) -> F:
        grid = np.arange(first + rng.uniform(0, 1.0 / rate), last, 1.0 / rate)
        return grid + rng.uniform(-0.05, 0.05, len(grid)) / rate

    def stamps(time: F, source: str) -> npt.NDArray[np.int64]:
        return EPOCH_NS + np.round((time + latency_s.get(source, 0.0)) * 1e9).astype(np.int64)

    out = []
    t = times(sensors.position_hz)
    true = drive.at(t)
    xy = np.stack([true["x_m"], true["y_m"]], axis=1) + sensors.position_m * rng.standard_normal((len(t), 2))
    out.append(Measurements("gnss", Kind.POSITION, stamps(t, "gnss"), xy))
    t = times(sensors.speed_hz)
    speed = drive.at(t)["speed_mps"] + sensors.speed_mps * rng.standard_normal(len(t))
    out.append(Measurements("speed", Kind.SPEED, stamps(t, "speed"), speed))
    t = times(sensors.heading_hz)
    heading = drive.at(t)["heading_rad"] + sensors.heading_rad * rng.standard_normal(len(t))
    out.append(Measurements("heading", Kind.HEADING, stamps(t, "heading"), heading))
    t = times(sensors.imu_hz)
    true = drive.at(t)
    imu = np.zeros((len(t), 6))
    imu[:, 0] = true["accel_mps2"] + sensors.accel_bias_mps2
    imu[:, 1] = true["speed_mps"] * true["yaw_rate_radps"]
    imu[:, 2] = GRAVITY
    imu[:, 5] = true["yaw_rate_radps"] + sensors.yaw_rate_bias_radps
    imu[:, :3] += sensors.accel_mps2 * rng.standard_normal((len(t), 3))
    imu[:, 3:] += sensors.yaw_rate_radps * rng.standard_normal((len(t), 3))
    out.append(Measurements("imu", Kind.IMU, stamps(t, "imu"), imu))
    return out
