"""Simulated scenes before a lidar and a radar: truth, detections, clutter, missed detections. Plain arrays.

Axes: x right, y forward as in xiang2019 figure 1 for the paper's scenes (`simulate_static_target`,
`observe_single_target`). The sensors stand at the origin. Azimuth is counter-clockwise from the x axis.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.units import NS_PER_S

FloatArray = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]

PAPER_STATIC_RANGES_M = (1.10, 3.20, 4.90, 9.30, 15.20)
"""Ranges of the paper's static comparison, m; xiang2019, section 4.1."""
PAPER_SAMPLE_PERIOD_S = 0.05
"""Sampling period in which lidar and radar alternate, s; xiang2019, section 4.2."""


@dataclass(frozen=True)
class SensorNoise:
    """The standard deviations of lidar and radar.

    The paper only says that the radar system's resolution is 0.125 m (section 4.2). The
    lidar value is an IBEO LUX's, the radar values those of a Delphi ESR in mid range (data sheets: about 0.1 m; 0.25 m,
    0.5 deg, 0.12 m/s).
    """

    lidar_m: float = 0.1
    range_m: float = 0.25
    azimuth_rad: float = 0.0087
    rate_mps: float = 0.12


@dataclass(frozen=True)
class DualSensorScene:
    """The truth and the detections of a scene.

    Attributes:
        truth_stamp_ns, truth_id: Shape (t,).
        truth_state: Shape (t, 4): x, y, vx, vy.
        lidar_stamp_ns: Shape (a,); lidar_xy: (a, 2).
        radar_stamp_ns: Shape (b,); radar: (b, 3): range, azimuth, range rate.
        lidar_scan_ns, radar_scan_ns: All scans, empty ones included.
    """

    truth_stamp_ns: Int64Array
    truth_id: Int64Array
    truth_state: FloatArray
    lidar_stamp_ns: Int64Array
    lidar_xy: FloatArray
    radar_stamp_ns: Int64Array
    radar: FloatArray
    lidar_scan_ns: Int64Array
    radar_scan_ns: Int64Array


def measure_positions_with_lidar(state: FloatArray, noise: SensorNoise, rng: np.random.Generator) -> FloatArray:
    """Noisy lidar positions (n, 2), m, of states (n, 4) (xiang2019 eq. 1)."""
    return state[:, :2] + noise.lidar_m * rng.standard_normal((len(state), 2))


def measure_states_with_radar(state: FloatArray, noise: SensorNoise, rng: np.random.Generator) -> FloatArray:
    """Noisy radar range, azimuth, range rate (n, 3) of states (n, 4) (xiang2019 eq. 2-4); ranges stay positive."""
    reach = np.hypot(state[:, 0], state[:, 1])
    rate = (state[:, :2] * state[:, 2:]).sum(axis=1) / np.maximum(reach, 1e-9)
    exact = np.stack([reach, np.arctan2(state[:, 1], state[:, 0]), rate], axis=1)
    sigma = (noise.range_m, noise.azimuth_rad, noise.rate_mps)
    out: FloatArray = exact + rng.standard_normal(exact.shape) * sigma
    out[:, 0] = np.abs(out[:, 0])
    out[:, 1] = (out[:, 1] + np.pi) % (2.0 * np.pi) - np.pi
    return out


def observe_single_target(
    time_s: FloatArray, state: FloatArray, noise: SensorNoise, rng: np.random.Generator
) -> DualSensorScene:
    """Observe one target at every time: with the lidar at the even samples, with the radar at the odd ones."""
    stamp = np.round(time_s * NS_PER_S).astype(np.int64)
    lidar, radar = slice(0, None, 2), slice(1, None, 2)
    return DualSensorScene(
        stamp, np.ones(len(stamp), np.int64), state,
        stamp[lidar], measure_positions_with_lidar(state[lidar], noise, rng),
        stamp[radar], measure_states_with_radar(state[radar], noise, rng),
        stamp[lidar], stamp[radar],
    )  # fmt: skip


def simulate_static_target(range_m: float, n: int, noise: SensorNoise, rng: np.random.Generator) -> DualSensorScene:
    """Simulate n observations of a target that stands straight ahead (xiang2019 figures 5 and 6)."""
    state = np.tile([0.0, range_m, 0.0, 0.0], (n, 1))
    return observe_single_target(np.arange(n, dtype=np.float64) * PAPER_SAMPLE_PERIOD_S, state, noise, rng)


def _line_path_positions(time_s: FloatArray) -> FloatArray:
    """Positions (n, 2), m, on a straight line at the times (n,)."""
    return np.stack([2.0 + 0.1 * time_s, 4.0 + 1.5 * time_s], axis=1)


def _arc_path_positions(time_s: FloatArray) -> FloatArray:
    """Positions (n, 2), m, on an arc at the times (n,)."""
    angle = 0.12 * time_s
    return np.stack([12.0 * np.sin(angle) - 4.0, 3.0 + 12.0 * (1.0 - np.cos(angle))], axis=1)


def _weave_path_positions(time_s: FloatArray) -> FloatArray:
    """Positions (n, 2), m, on a weaving path at the times (n,)."""
    return np.stack([1.5 * np.sin(0.6 * time_s), 5.0 + 1.2 * time_s], axis=1)


def _turn_path_positions(time_s: FloatArray) -> FloatArray:
    """Positions (n, 2), m, on two lines joined by a turn at the times (n,)."""
    angle = np.clip(time_s - 4.0, 0.0, 5.0) * 0.3
    straight, beyond = np.minimum(time_s, 4.0), np.maximum(time_s - 9.0, 0.0)
    x = -3.0 + 5.0 * (1.0 - np.cos(angle)) + 1.5 * beyond * np.sin(angle)
    y = 3.0 + 1.5 * straight + 5.0 * np.sin(angle) + 1.5 * beyond * np.cos(angle)
    return np.stack([x, y], axis=1)


TARGET_POSITIONS_BY_PATH_SHAPE: dict[str, Callable[[FloatArray], FloatArray]] = {
    "line": _line_path_positions, "arc": _arc_path_positions, "weave": _weave_path_positions,
    "turn": _turn_path_positions,
}  # fmt: skip
"""Paths of a target by name: time (n,) -> position (n, 2), m. Chosen by hand, because figure 7 of xiang2019 is not in
the text: at walking pace within 25 m, as the paper's site and laser range finder allow."""


def times_and_true_states_on_path(
    name: str, n: int, *, period_s: float = PAPER_SAMPLE_PERIOD_S
) -> tuple[FloatArray, FloatArray]:
    """Times (n,) and true states (n, 4) on a named path; the velocity is the path's central difference."""
    t = np.arange(n, dtype=np.float64) * period_s
    path, h = TARGET_POSITIONS_BY_PATH_SHAPE[name], 1e-5
    return t, np.concatenate([path(t), (path(t + h) - path(t - h)) / (2.0 * h)], axis=1)
