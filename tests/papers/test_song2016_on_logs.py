"""song2016 on a log: the derivatives that its model of motion (eq. 10) needs, from the filter to the path."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cwcli.channels.predicted_path import LazyPathChannel
from cwcli.estimation.config import EstimatorConfig
from cwcli.estimation.song2016 import SAMPLING_TIME_S, append_jerk_and_yaw_acceleration
from cwcli.logs.read.reader import Log
from cwcli.signals.columns import FloatArray, OutputChannel
from cwcli.stages.estimate import EstimateConfig, estimate
from cwcli.stages.predict import PredictConfig, predict

SAMPLES = Path(__file__).parents[2] / "sample_logs"
WINDOW = 8  # steps, 0.35 s
HORIZON_S = 2.5
FINE_S = 1e-3
ATOL_M = 1e-3
STATE = ("x_m", "y_m", "speed_mps", "heading_rad", "accel_mps2", "yaw_rate_radps", "jerk_mps3", "yaw_accel_radps2")


@pytest.fixture(scope="module", params=["curve", "rear-end"])
def outcome(request: pytest.FixtureRequest) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Ego states (n, 8) of `estimate --model song2016 --causal`, and by model the ends of the paths (n, 2)."""
    with Log.open(SAMPLES / f"{request.param}.mcap") as log:
        made = estimate(log, EstimateConfig(estimator=EstimatorConfig(model="song2016", causal=True)))
        annotated = log.with_channels(made.channels)
        paths = {model: predict(annotated, PredictConfig(model=model)) for model in ("ctra", "cj-cya")}
    state = np.column_stack([column(made.channels, "/cwcli/ego/state", name) for name in STATE])
    return state, {model: ends(each.channels) for model, each in paths.items()}


def ends(channels: tuple[OutputChannel, ...]) -> FloatArray:
    """Of all the paths, those that are not published, too, (n, 2)."""
    (channel,) = (each for each in channels if isinstance(each, LazyPathChannel) and each.topic == "/cwcli/ego/path")
    paths = channel.lazy_paths.plan.paths_of_rows(slice(None))
    return np.stack([paths.x_m[:, -1], paths.y_m[:, -1]], axis=1)


def column(channels: tuple[OutputChannel, ...], topic: str, name: str) -> FloatArray:
    field = next(each for each in channels if each.topic == topic).fields[name]
    assert isinstance(field, np.ndarray)
    return np.asarray(field, np.float64)


def slopes(values: FloatArray) -> FloatArray:
    """Slope per second of the line through each WINDOW of values, by NumPy's polynomial fit, n - WINDOW + 1 of them."""
    time_s = SAMPLING_TIME_S * np.arange(WINDOW)
    return np.array([np.polyfit(time_s, values[k : k + WINDOW], 1)[0] for k in range(len(values) - WINDOW + 1)])


def test_jerk_and_yaw_acceleration_are_the_slopes_of_the_filtered_values(
    outcome: tuple[FloatArray, dict[str, FloatArray]],
) -> None:
    state, _ = outcome
    np.testing.assert_allclose(state[WINDOW - 1 :, 6], slopes(state[:, 4]), atol=2e-3)
    np.testing.assert_allclose(state[WINDOW - 1 :, 7], slopes(state[:, 5]), atol=2e-3)
    assert (state[: WINDOW - 1, 6:] == 0.0).all()


def test_cj_cya_is_the_paper_s_model_and_not_ctra(outcome: tuple[FloatArray, dict[str, FloatArray]]) -> None:
    state, ends = outcome
    time_s = np.arange(0.0, HORIZON_S + FINE_S / 2, FINE_S)
    expected = np.full((len(state), 2), np.nan)
    for k, (x, y, v, heading, a, turn, jerk, turn_accel) in enumerate(state):
        speed = v + a * time_s + jerk * time_s**2 / 2.0  # eq. 10, its steps made fine
        if speed.min() <= 0.0:
            continue  # a stop has its own rule
        course = heading + turn * time_s + turn_accel * time_s**2 / 2.0
        expected[k] = x + np.trapezoid(speed * np.cos(course), time_s), y + np.trapezoid(speed * np.sin(course), time_s)
    moves = np.isfinite(expected[:, 0])
    assert np.count_nonzero(moves) > 100
    np.testing.assert_allclose(ends["cj-cya"][moves], expected[moves], atol=ATOL_M)
    assert np.hypot(*(ends["cj-cya"] - ends["ctra"]).T).max() > 0.5


def test_derivatives_begin_anew_after_a_pause() -> None:
    steps = np.concatenate([np.arange(20), np.arange(100, 120)])
    accel, turn = 0.3 * SAMPLING_TIME_S * steps, -0.2 * SAMPLING_TIME_S * steps
    state = np.column_stack([np.zeros((40, 4)), accel, turn])
    variances = np.array([1.0, 1.0, 1.0, 1.0, 0.04, 0.01])
    whole, covariance = append_jerk_and_yaw_acceleration(state, np.tile(np.diag(variances), (40, 1, 1)), steps)
    is_known = (np.arange(40) % 20) >= WINDOW - 1
    np.testing.assert_allclose(whole[:, 6], np.where(is_known, 0.3, 0.0), atol=1e-12)
    np.testing.assert_allclose(whole[:, 7], np.where(is_known, -0.2, 0.0), atol=1e-12)
    # of a least-squares slope: variance of a value / sum of the squared offsets in time, 42 (0.05 s)^2 for eight
    np.testing.assert_allclose(covariance[is_known, 6, 6], 0.04 / (42.0 * SAMPLING_TIME_S**2))
    np.testing.assert_allclose(covariance[is_known, 7, 7], 0.01 / (42.0 * SAMPLING_TIME_S**2))
    np.testing.assert_allclose(covariance[~is_known, 6, 6], 1.0)  # as the default model begins: 1 m/s^3, 0.2 rad/s^2
    np.testing.assert_allclose(covariance[~is_known, 7, 7], 0.04)
    np.testing.assert_array_equal(covariance[:, :6, :6], np.tile(np.diag(variances), (40, 1, 1)))
    np.linalg.cholesky(covariance)
