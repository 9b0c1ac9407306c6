"""xiang2019's headline numbers against filters of their own (`own_xiang2019`), on the same detections."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.reproduction.xiang2019.reproduce import (
    ASSUMED_SCENE_NOISE,
    N_SEGMENT_SAMPLES,
    distance_error_table,
    segment_error_table,
)
from cwcli.simulation.dual_sensor import (
    PAPER_STATIC_RANGES_M,
    TARGET_POSITIONS_BY_PATH_SHAPE,
    DualSensorScene,
    observe_single_target,
    simulate_static_target,
    times_and_true_states_on_path,
)
from tests.papers import own_xiang2019 as own


def rows(scene: DualSensorScene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, which are the lidar's, and values, in the order of time."""
    stamps = np.concatenate([scene.lidar_stamp_ns, scene.radar_stamp_ns])
    is_lidar = np.arange(len(stamps)) < len(scene.lidar_stamp_ns)
    values = np.concatenate([scene.lidar_xy, scene.radar[:, :2]])
    order = np.argsort(stamps)
    return stamps[order] * 1e-9, is_lidar[order], values[order]


def test_table_1_and_its_gap() -> None:
    """Number 10 and 11: the mean square errors of both filters on the four segments, and the UKF's gain."""
    n_seeds = 3
    table = segment_error_table(n_seeds)
    for k, name in enumerate(TARGET_POSITIONS_BY_PATH_SHAPE):
        errors = {}
        for unscented in (False, True):
            squares = np.zeros(2)
            for seed in range(n_seeds):
                scene = observe_single_target(
                    *times_and_true_states_on_path(name, N_SEGMENT_SAMPLES),
                    ASSUMED_SCENE_NOISE,
                    np.random.default_rng([seed, k]),
                )
                state = own.filtered(
                    *rows(scene), lidar_m=ASSUMED_SCENE_NOISE.lidar_m,
                    radar=(ASSUMED_SCENE_NOISE.range_m, ASSUMED_SCENE_NOISE.azimuth_rad),
                    noise=0.3,
                    speed_mps=2.0, unscented=unscented,
                )  # fmt: skip
                squares += np.square(state[:, :2] - scene.truth_state[:, :2]).mean(axis=0) / n_seeds
            errors[unscented] = 1e3 * squares
        for axis in range(2):
            row = 2 * k + axis
            assert table["ekf"][row] == pytest.approx(errors[False][axis], rel=1e-6)
            assert table["ukf"][row] == pytest.approx(errors[True][axis], rel=1e-6)
            gap = 100.0 * (1.0 - errors[True][axis] / errors[False][axis])
            assert table["gain_pct"][row] == pytest.approx(gap, abs=1e-4)


def test_figure_6_and_its_gains() -> None:
    """Number 12: the error of both together, and how much worse the mean of four looks of one sensor is."""
    n_seeds = 20
    table = distance_error_table(n_seeds)
    for k, true_m in enumerate(PAPER_STATIC_RANGES_M):
        errors = np.zeros((n_seeds, 3))
        for seed in range(n_seeds):
            scene = simulate_static_target(
                true_m, 8, ASSUMED_SCENE_NOISE, np.random.default_rng([seed, round(100 * true_m)])
            )
            state = own.filtered(
                *rows(scene), lidar_m=ASSUMED_SCENE_NOISE.lidar_m,
                radar=(ASSUMED_SCENE_NOISE.range_m, ASSUMED_SCENE_NOISE.azimuth_rad),
                noise=0.01,
                speed_mps=0.01, unscented=True,
            )[-1]  # fmt: skip
            found = (np.hypot(*scene.lidar_xy.T).mean(), scene.radar[:, 0].mean(), np.hypot(state[0], state[1]))
            errors[seed] = np.abs(np.array(found) - true_m)
        lidar, radar, both = errors.mean(axis=0)
        assert table["combined_error_m"][k] == pytest.approx(both, rel=1e-6)
        assert table["lidar_gain_pct"][k] == pytest.approx(100.0 * (lidar / both - 1.0), abs=1e-3)
        assert table["radar_gain_pct"][k] == pytest.approx(100.0 * (radar / both - 1.0), abs=1e-3)
