"""xiang2019 reproduced: figures 5 and 6, tables 1 and 2, and where an unscented filter beats an extended one.

Every comparison is paired: both filters see the same detections of the same seed. Intervals are 95 % of the mean. The
paper's numbers stand beside ours. What the paper leaves open (noise, the shapes of the four tracks, process noise) is
declared once, here and in `simulation.dual_sensor`, and is the same for both filters: docs/papers/xiang2019-filter.md.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from cwcli.metrics.intervals import normal_interval
from cwcli.signals.columns import FloatArray
from cwcli.simulation.dual_sensor import (
    PAPER_STATIC_RANGES_M,
    TARGET_POSITIONS_BY_PATH_SHAPE,
    DualSensorScene,
    SensorNoise,
    observe_single_target,
    simulate_static_target,
    times_and_true_states_on_path,
)
from cwcli.tracking.config import IS_UNSCENTED_BY_FILTER, FilterConfig
from cwcli.tracking.detections import DetectionKind, Detections, SensorModel
from cwcli.tracking.prepare import DetectionRows, prepare_detections
from cwcli.tracking.single_target import filter_single_target

ASSUMED_SCENE_NOISE = SensorNoise()
"""Noise of both sensors, which the paper leaves open (docs/papers/xiang2019-filter.md)."""
PAPER_FILTER_CONFIG = FilterConfig(
    model="cv", noise=0.3, start_speed_mps=2.0, cartesian_below=0.0, gate_probability=1.0, smooth=False
)
"""The paper's filter: constant velocity, radar update with range and azimuth only (eq. 8), no gate, start at the
first lidar point (eq. 5), never a Cartesian form of the radar. The paper leaves the noise open."""
PROCESS_NOISE_AND_START_SPEED_FOR_STATIC_TARGET = 0.01
"""Process noise and start speed for the standing target (docs/papers/xiang2019-filter.md)."""
N_LOOKS_PER_SENSOR = 4
"""Looks of each sensor at the standing target (xiang2019, figure 5)."""
N_SEGMENT_SAMPLES = 240
"""Number of detections along a segment. Chosen by hand; not fitted."""
N_TIMED_SAMPLES = 500
"""Number of samples that are timed (xiang2019, table 2)."""
PAPER_TABLE_1_MEAN_SQUARE_ERRORS_PER_MILLE_M2: dict[str, dict[str, tuple[float, ...]]] = {
    "ekf": {"x": (3.08, 5.30, 3.29, 5.28), "y": (6.37, 4.72, 6.87, 6.65)},
    "ukf": {"x": (1.91, 3.12, 2.61, 4.33), "y": (5.31, 3.14, 5.14, 5.74)},
}
"""Mean square errors of the paper's table 1, in per mille of a square metre: filter -> axis -> segments."""
PAPER_TABLE_2_TIMES_OF_500_SAMPLES_MS = {"ukf": 2.1, "ekf": 5.9}
"""Times of 500 samples in the paper's table 2, in ms."""

Table = dict[str, list[float] | list[str]]


def detection_rows_of_scene(
    scene: DualSensorScene, noise: SensorNoise, *, lidar: bool = True, radar: bool = True
) -> DetectionRows:
    """Return the scene's detections in order of time; the range rate is left out (eq. 8)."""
    sensors = {
        "lidar": SensorModel(sigma=(noise.lidar_m, noise.lidar_m)),
        "radar": SensorModel(sigma=(noise.range_m, noise.azimuth_rad, noise.rate_mps), use_range_rate=False),
    }
    data = []
    if lidar:
        data.append(Detections("lidar", DetectionKind.POSITION, scene.lidar_stamp_ns, scene.lidar_xy))
    if radar:
        data.append(Detections("radar", DetectionKind.RADAR, scene.radar_stamp_ns, scene.radar))
    return prepare_detections(data, sensors).rows


def _append_row(table: Table, **cells: float | str) -> None:
    """Append a row to a table."""
    for name, value in cells.items():
        table.setdefault(name, []).append(value)  # type: ignore[arg-type]


def _mean_and_interval_bounds(values: FloatArray) -> tuple[float, float, float]:
    """Return the mean of values and its 95 % interval."""
    low, high = normal_interval(values)
    return float(np.mean(values)), low, high


def distance_error_table(n_seeds: int) -> Table:
    """Compute the error of the distance at the paper's five ranges, of each sensor and of both by the UKF.

    `*_gain` is the error of the mean of a sensor's four looks over that of the filter after all eight, less 1, in per
    cent: like against like. `*_single_gain` is the mean error of one look over it. The paper has 50-400 % (radar) and
    20-150 % (lidar), and does not say of which.
    """
    config = replace(
        PAPER_FILTER_CONFIG,
        noise=PROCESS_NOISE_AND_START_SPEED_FOR_STATIC_TARGET,
        start_speed_mps=PROCESS_NOISE_AND_START_SPEED_FOR_STATIC_TARGET,
    )
    table: Table = {}
    for true_m in PAPER_STATIC_RANGES_M:
        errors = np.zeros((n_seeds, 5))
        for seed in range(n_seeds):
            rng = np.random.default_rng([seed, round(100 * true_m)])
            scene = simulate_static_target(true_m, 2 * N_LOOKS_PER_SENSOR, ASSUMED_SCENE_NOISE, rng)
            state = filter_single_target(detection_rows_of_scene(scene, ASSUMED_SCENE_NOISE), config).state[-1]
            lidar_m, radar_m = np.hypot(*scene.lidar_xy.T) - true_m, scene.radar[:, 0] - true_m
            errors[seed] = (
                abs(lidar_m.mean()),
                abs(radar_m.mean()),
                np.abs(lidar_m).mean(),
                np.abs(radar_m).mean(),
                abs(np.hypot(state[0], state[1]) - true_m),
            )
        lidar, radar, one_lidar, one_radar, both = (_mean_and_interval_bounds(errors[:, k]) for k in range(5))
        _append_row(
            table, range_m=true_m,
            lidar_error_m=lidar[0], radar_error_m=radar[0],
            combined_error_m=both[0], combined_low_m=both[1], combined_high_m=both[2], paper_combined_below_m=0.01,
            lidar_gain_pct=100.0 * (lidar[0] / both[0] - 1.0), radar_gain_pct=100.0 * (radar[0] / both[0] - 1.0),
            lidar_single_gain_pct=100.0 * (one_lidar[0] / both[0] - 1.0),
            radar_single_gain_pct=100.0 * (one_radar[0] / both[0] - 1.0),
        )  # fmt: skip
    return table


def combined_error_by_looks_table(n_seeds: int) -> Table:
    """Compute the combined error at 4.90 m by number of looks, down to the paper's 0.01 m."""
    config = replace(
        PAPER_FILTER_CONFIG,
        noise=PROCESS_NOISE_AND_START_SPEED_FOR_STATIC_TARGET,
        start_speed_mps=PROCESS_NOISE_AND_START_SPEED_FOR_STATIC_TARGET,
    )
    table: Table = {}
    for n_looks in (4, 16, 64, 256):
        errors = np.zeros(n_seeds)
        for seed in range(n_seeds):
            scene = simulate_static_target(
                4.90, 2 * n_looks, ASSUMED_SCENE_NOISE, np.random.default_rng([seed, n_looks])
            )
            state = filter_single_target(
                detection_rows_of_scene(scene, ASSUMED_SCENE_NOISE), replace(config, noise=1e-4)
            ).state[-1]
            errors[seed] = abs(np.hypot(state[0], state[1]) - 4.90)
        mean, low, high = _mean_and_interval_bounds(errors)
        _append_row(table, looks=float(n_looks), error_m=mean, low_m=low, high_m=high)
    return table


def _paired_squared_errors_m2(
    n_seeds: int,
    truth: tuple[FloatArray, FloatArray],
    noise: SensorNoise,
    config: FilterConfig,
    key: int,
    **which: bool,
) -> dict[str, FloatArray]:
    """Compute squared errors (n_seeds, 2) of x and y, means over the track, of both filters on the same detections."""
    out: dict[str, FloatArray] = {name: np.zeros((n_seeds, 2)) for name in IS_UNSCENTED_BY_FILTER}
    for seed in range(n_seeds):
        scene = observe_single_target(*truth, noise, np.random.default_rng([seed, key]))
        rows = detection_rows_of_scene(scene, noise, **which)
        at = np.searchsorted(scene.truth_stamp_ns, rows.stamp_ns)
        for name in IS_UNSCENTED_BY_FILTER:
            state = filter_single_target(rows, replace(config, filter=name)).state
            out[name][seed] = np.square(state[:, :2] - scene.truth_state[at, :2]).mean(axis=0)
    return out


def _filter_with_smaller_error(ekf_minus_ukf_low: float, ekf_minus_ukf_high: float) -> str:
    """Return the name of the filter that the interval of EKF minus UKF shows to be better, or `neither`."""
    return "ukf" if ekf_minus_ukf_low > 0.0 else ("ekf" if ekf_minus_ukf_high < 0.0 else "neither")


def segment_error_table(n_seeds: int) -> Table:
    """Compute the mean square errors of x and y on the four segments, in per mille of a square metre.

    `difference` is EKF minus UKF, paired; `better` is decided by its 95 % interval.
    """
    table: Table = {}
    for k, name in enumerate(TARGET_POSITIONS_BY_PATH_SHAPE):
        errors = _paired_squared_errors_m2(
            n_seeds, times_and_true_states_on_path(name, N_SEGMENT_SAMPLES), ASSUMED_SCENE_NOISE, PAPER_FILTER_CONFIG, k
        )
        for axis, label in enumerate("xy"):
            ekf, ukf = (1e3 * errors[f][:, axis] for f in ("ekf", "ukf"))
            mean, low, high = _mean_and_interval_bounds(ekf - ukf)
            _append_row(
                table, segment=name, axis=label, ekf=float(ekf.mean()), ukf=float(ukf.mean()),
                difference=mean, difference_low=low, difference_high=high, better=_filter_with_smaller_error(low, high),
                gain_pct=100.0 * mean / float(ekf.mean()), gain_low_pct=100.0 * low / float(ekf.mean()),
                gain_high_pct=100.0 * high / float(ekf.mean()),
                paper_ekf=PAPER_TABLE_1_MEAN_SQUARE_ERRORS_PER_MILLE_M2["ekf"][label][k],
                paper_ukf=PAPER_TABLE_1_MEAN_SQUARE_ERRORS_PER_MILLE_M2["ukf"][label][k],
            )  # fmt: skip
    return table


def process_noise_table(n_seeds: int) -> Table:
    """Compute the mean square errors over the four segments, in per mille, with other process noises."""
    table: Table = {}
    for noise in (0.1, 0.3, 1.0, 3.0):
        config = replace(PAPER_FILTER_CONFIG, noise=noise)
        errors = [
            _paired_squared_errors_m2(
                n_seeds, times_and_true_states_on_path(name, N_SEGMENT_SAMPLES), ASSUMED_SCENE_NOISE, config, k
            )
            for k, name in enumerate(TARGET_POSITIONS_BY_PATH_SHAPE)
        ]
        ekf, ukf = (1e3 * float(np.mean([e[f].mean() for e in errors])) for f in ("ekf", "ukf"))
        _append_row(table, process_noise=noise, ekf=ekf, ukf=ukf)
    return table


def ukf_and_ekf_time_table(repeats: int = 200) -> Table:
    """Measure the time of 500 samples, the best of `repeats`, inside the process."""
    truth = times_and_true_states_on_path("arc", N_TIMED_SAMPLES)
    rows = detection_rows_of_scene(
        observe_single_target(*truth, ASSUMED_SCENE_NOISE, np.random.default_rng(0)), ASSUMED_SCENE_NOISE
    )
    table: Table = {}
    for name in ("ukf", "ekf"):
        config, best = replace(PAPER_FILTER_CONFIG, filter=name), np.inf
        for _ in range(repeats):
            start = time.perf_counter()
            filter_single_target(rows, config)
            best = min(best, time.perf_counter() - start)
        _append_row(
            table,
            filter=name,
            samples=float(N_TIMED_SAMPLES),
            time_ms=1e3 * best,
            paper_ms=PAPER_TABLE_2_TIMES_OF_500_SAMPLES_MS[name],
        )
    return table


def radar_scene_table(n_seeds: int) -> Table:
    """Compare the filters with radar alone: an arc far and near, with narrow and wide beams.

    `bend` says why: with the azimuth's sigma a, the arc of points at range r departs from its tangent by r a^2 / 2.
    In units of the range noise that is the nonlinearity that a Jacobian does not see (Lerro, Bar-Shalom, IEEE TAES
    29(3), 1993, give r a^2 / sigma_r = 0.4 as the limit of an extended filter).
    """
    table: Table = {}
    times, arc = times_and_true_states_on_path("arc", N_SEGMENT_SAMPLES)
    for range_m in (5.0, 15.0, 50.0, 150.0):
        state = arc.copy()
        state[:, 1] += range_m - 3.0
        for azimuth_deg in (0.5, 2.0, 5.0, 10.0):
            _append_ekf_ukf_comparison_in_radar_scene(
                table, n_seeds, f"arc at {range_m:g} m", range_m, azimuth_deg, (times, state)
            )
    for miss_m in (0.3, 1.0):  # past the sensor: the bearing turns by 180 degrees
        state = np.stack([1.5 * (times - times[-1] / 2), *np.full((1, N_SEGMENT_SAMPLES), miss_m)], axis=1)
        state = np.concatenate([state, np.tile([1.5, 0.0], (N_SEGMENT_SAMPLES, 1))], axis=1)
        _append_ekf_ukf_comparison_in_radar_scene(table, n_seeds, f"pass at {miss_m:g} m", miss_m, 0.5, (times, state))
    return table


def _append_ekf_ukf_comparison_in_radar_scene(
    table: Table,
    n_seeds: int,
    scene: str,
    range_m: float,
    azimuth_sigma_deg: float,
    truth: tuple[FloatArray, FloatArray],
) -> None:
    """Compare both filters in one radar scene and append the row."""
    noise = replace(ASSUMED_SCENE_NOISE, azimuth_rad=float(np.radians(azimuth_sigma_deg)))
    errors = _paired_squared_errors_m2(
        n_seeds, truth, noise, PAPER_FILTER_CONFIG, round(10 * range_m + azimuth_sigma_deg), lidar=False
    )
    ekf, ukf = (errors[name].sum(axis=1) for name in ("ekf", "ukf"))
    _, low, high = _mean_and_interval_bounds(ekf - ukf)
    _append_row(
        table, scene=scene, azimuth_sigma_deg=azimuth_sigma_deg,
        bend=range_m * noise.azimuth_rad**2 / (2.0 * noise.range_m),
        ekf_rmse_m=float(np.sqrt(ekf.mean())), ukf_rmse_m=float(np.sqrt(ukf.mean())),
        gain_pct=100.0 * (1.0 - float(ukf.mean() / ekf.mean())), gain_low_pct=100.0 * low / float(ekf.mean()),
        gain_high_pct=100.0 * high / float(ekf.mean()), better=_filter_with_smaller_error(low, high),
    )  # fmt: skip


def compute_tables(
    n_seeds: int = 1000, *, progress: Callable[[str], None] = lambda name: None, names: Sequence[str] = ()
) -> dict[str, Table]:
    """Compute the tables, all or those of `names`; all take about half a minute."""
    tables: dict[str, Table] = {}
    steps: dict[str, Callable[[], Table]] = {
        "figure_6": lambda: distance_error_table(n_seeds),
        "looks": lambda: combined_error_by_looks_table(max(20, n_seeds // 10)),
        "table_1": lambda: segment_error_table(n_seeds),
        "settings": lambda: process_noise_table(max(20, n_seeds // 10)),
        "table_2": ukf_and_ekf_time_table,
        "where": lambda: radar_scene_table(n_seeds),
    }
    for name, step in steps.items():
        if names and name not in names:
            continue
        progress(name)
        tables[name] = step()
    return tables
