"""Errors against what then happened, by hand."""

import numpy as np
import numpy.typing as npt
import pytest

from cwcli.prediction.model_comparison import ComparedStarts, compare_models_at_horizons, horizon_error_table
from cwcli.prediction.outcome import horizon_errors
from cwcli.prediction.paths import Paths
from cwcli.prediction.rollout import roll_out_paths

FloatArray = npt.NDArray[np.float64]
T0_NS = 1_700_000_000_000_000_000


def stamps(time_s: FloatArray) -> npt.NDArray[np.int64]:
    return T0_NS + np.rint(time_s * 1e9).astype(np.int64)


def east_at_ten(time_s: FloatArray) -> FloatArray:
    return np.column_stack([10.0 * time_s, 0.0 * time_s])


def cv_paths(time_s: FloatArray, **values: float) -> Paths:
    state = np.zeros((len(time_s), 8))
    state[:, 0], state[:, 2] = 10.0 * time_s, 10.0
    for name, value in values.items():
        state[:, ("x", "y", "v", "heading").index(name)] = value
    return roll_out_paths("cv", state, None)


def test_errors_split_along_and_across_the_predicted_heading() -> None:
    # predicted north at 10 m/s, went east: after 1 s 10 m behind and 10 m to the right
    time = np.arange(0.0, 5.0, 0.1)
    errors = horizon_errors(
        cv_paths(time[:1], heading=np.pi / 2), stamps(time[:1]), stamps(time), east_at_ten(time), [1.0]
    )
    assert errors.distance_m[0, 0] == pytest.approx(10.0 * np.sqrt(2.0))
    assert errors.along_m[0, 0] == pytest.approx(-10.0)
    assert errors.cross_m[0, 0] == pytest.approx(-10.0)


def test_horizon_between_path_points_and_track_points() -> None:
    time = np.arange(0.0, 5.0, 0.1)
    errors = horizon_errors(cv_paths(time[:20]), stamps(time[:20]), stamps(time), east_at_ten(time), [0.0, 1.234])
    assert errors.is_known.all()
    np.testing.assert_allclose(errors.distance_m, 0.0, atol=1e-6)


def test_nothing_is_compared_inside_a_gap_or_beyond_the_end() -> None:
    time = np.arange(0.0, 5.01, 0.1)
    track = time[(time < 2.05) | (time > 2.95)]  # 0.9 s without data
    starts = np.array([0.0, 0.55, 1.0, 2.0, 2.45, 4.0])
    errors = horizon_errors(cv_paths(starts), stamps(starts), stamps(track), east_at_ten(track), [2.0], max_gap_s=0.5)
    # outcomes at 2.0 (known), 2.55 (gap), 3.0, 4.0, 4.45 (known), 6.0 (over)
    assert errors.is_known[:, 0].tolist() == [True, False, True, True, True, False]
    assert np.isnan(errors.distance_m[~errors.is_known]).all()


def test_mahalanobis_of_a_unit_error() -> None:
    time = np.arange(0.0, 5.0, 0.1)
    covariance = np.zeros((1, 8, 8))
    covariance[0, 0, 0], covariance[0, 1, 1] = 4.0, 1.0
    state = np.zeros((1, 8))
    state[0, :3] = -2.0, 3.0, 0.0  # stands at (-2, 3), truth at (0, 0): 2 m east, 3 m south
    paths = roll_out_paths("cv", state, covariance)
    errors = horizon_errors(paths, stamps(time[:1]), stamps(time), 0.0 * east_at_ten(time), [0.0, 1.0])
    np.testing.assert_allclose(errors.mahalanobis2[0], 4.0 / 4.0 + 9.0 / 1.0)


def test_horizon_outside_the_paths_is_refused() -> None:
    time = np.arange(0.0, 5.0, 0.1)
    with pytest.raises(ValueError, match="outside the paths"):
        horizon_errors(cv_paths(time[:1]), stamps(time[:1]), stamps(time), east_at_ten(time), [3.0])


def test_constant_velocity_is_always_compared() -> None:
    time = np.arange(0.0, 10.0, 0.05)
    state = np.zeros((len(time), 8))
    state[:, 0], state[:, 2], state[:, 4] = 5.0 * time + time**2, 5.0 + 2.0 * time, 2.0
    covariance = np.tile(np.diag([0.01] * 4 + [1e-6] * 4), (len(time), 1, 1))
    errors = compare_models_at_horizons(
        ["ca"], ComparedStarts(stamps(time), state, covariance, stamps(time), state[:, :2])
    )
    assert list(errors) == ["cv", "ca"]
    table = horizon_error_table(errors)
    at = [name == "cv" and horizon == 2.5 for name, horizon in zip(table["model"], table["horizon_s"], strict=True)]
    row = at.index(True)
    # 2 m/s^2 over 2.5 s: 6.25 m short, all of it along; constant acceleration has none of it
    assert table["mean_m"][row] == pytest.approx(6.25, abs=1e-6)
    assert table["along_mean_m"][row] == pytest.approx(6.25, abs=1e-6)
    assert table["cross_rms_m"][row] == pytest.approx(0.0, abs=1e-9)
    assert table["n"][row] == 150
    assert table["mean_m"][-1] == pytest.approx(0.0, abs=1e-6)
    assert table["change_percent"][-1] == pytest.approx(-100.0, abs=1e-4)
    assert table["inside_90"][-1] == 1.0


def test_table_without_the_baseline_is_refused() -> None:
    time = np.arange(0.0, 10.0, 0.05)
    errors = horizon_errors(cv_paths(time), stamps(time), stamps(time), east_at_ten(time), [1.0])
    with pytest.raises(ValueError, match="constant-velocity"):
        horizon_error_table({"ca": errors})


def test_coverage_of_drawn_outcomes_is_the_ellipses_level() -> None:
    # starts whose position error is drawn from their own covariance, cars that stand: 50 % and 90 % of 20,000
    n = 20_000
    rng = np.random.default_rng(1)
    covariance = np.zeros((n, 8, 8))
    covariance[:, :2, :2] = [[2.0, 0.7], [0.7, 1.0]]
    state = np.zeros((n, 8))
    state[:, :2] = rng.multivariate_normal([0.0, 0.0], covariance[0, :2, :2], size=n)
    time = np.array([0.0, 10.0])
    errors = compare_models_at_horizons(
        ["cv"],
        ComparedStarts(np.full(n, T0_NS), state, covariance, stamps(time), np.zeros((2, 2))),
        horizons_s=[1.0],
        max_gap_s=20.0,
        calibrate=False,
    )
    table = horizon_error_table(errors)
    assert table["inside_50"][0] == pytest.approx(0.5, abs=0.015)
    assert table["inside_90"][0] == pytest.approx(0.9, abs=0.01)
