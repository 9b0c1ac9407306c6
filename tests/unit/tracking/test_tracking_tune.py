import numpy as np
import pytest
from scipy.optimize import minimize

from cwcli.tracking.config import FilterConfig
from cwcli.tracking.detections import DetectionKind, Detections, SensorModel
from cwcli.tracking.prepare import prepare_detections
from cwcli.tracking.single_target import filter_single_target, nis_consistency_by_source
from cwcli.tracking.tune import minimise_by_nelder_mead_and_count_calls, scale_sigmas, tune_noise

TRUE = {"noise": 0.8, "lidar": 0.06, "range": 0.5, "azimuth": 0.004, "rate": 0.1}


def constant_velocity_walk(seed, n=1500, dt=0.05):
    """A target driven by white acceleration, exactly the filter's model, and detections with known noise."""
    rng = np.random.default_rng(seed)
    root = np.linalg.cholesky([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]) * TRUE["noise"]
    state = np.zeros((n, 4))
    state[0] = 40.0, 10.0, 1.0, 0.0
    for i in range(1, n):
        kick = root @ rng.standard_normal((2, 2))
        state[i, :2] = state[i - 1, :2] + dt * state[i - 1, 2:] + kick[0]
        state[i, 2:] = state[i - 1, 2:] + kick[1]
    stamp = np.round(np.arange(n) * dt * 1e9).astype(np.int64)
    lidar = state[::2, :2] + TRUE["lidar"] * rng.standard_normal((len(state[::2]), 2))
    s = state[1::2]
    r = np.hypot(s[:, 0], s[:, 1])
    exact = np.stack([r, np.arctan2(s[:, 1], s[:, 0]), (s[:, :2] * s[:, 2:]).sum(axis=1) / r], axis=1)
    radar = exact + rng.standard_normal(exact.shape) * [TRUE["range"], TRUE["azimuth"], TRUE["rate"]]
    return [
        Detections("lidar", DetectionKind.POSITION, stamp[::2], lidar),
        Detections("radar", DetectionKind.RADAR, stamp[1::2], radar),
    ]


@pytest.mark.parametrize("name", ["ukf", "ekf"])
def test_noise_is_found_although_the_defaults_are_wrong_by_up_to_fifteen_times(name) -> None:
    start = SensorModel(sigma=(0.9, 0.9)), SensorModel(sigma=(0.3, 0.03, 1.5))
    rows = prepare_detections(constant_velocity_walk(5), {"lidar": start[0], "radar": start[1]}).rows
    found = tune_noise([rows], FilterConfig(filter=name, model="cv"))
    sigma = {
        "noise": found.config.noise,
        "lidar": 0.9 * found.scale["lidar"][0],
        **dict(zip(("range", "azimuth", "rate"), np.array(found.scale["radar"]) * (0.3, 0.03, 1.5), strict=True)),
    }
    for key, value in TRUE.items():
        assert sigma[key] == pytest.approx(value, rel=0.12), key
    assert found.log_likelihood > found.log_likelihood_before
    tuned = scale_sigmas(rows, found.scale)
    out = filter_single_target(tuned, found.config, smooth=False)
    for check in nis_consistency_by_source(tuned.sources, tuned.source, out.nis, out.n_values, out.status).values():
        assert check.is_within_bounds


def test_too_few_rows_are_left_alone() -> None:
    rows = prepare_detections([Detections("l", DetectionKind.POSITION, np.arange(3), np.zeros((3, 2)))]).rows
    found = tune_noise([rows], FilterConfig())
    assert found.scale == {}
    assert found.n_evaluations == 1
    assert tune_noise([], FilterConfig()).scale == {}


def test_the_search_finds_what_scipy_finds() -> None:
    def valley(x):
        return float(100.0 * (x[1] - x[0] ** 2) ** 2 + (1.0 - x[0]) ** 2 + (x[2] - 0.5) ** 2)

    point, value, calls = minimise_by_nelder_mead_and_count_calls(valley, np.array([-1.0, 1.5, 0.0]), tolerance=1e-7)
    expected = minimize(valley, [-1.0, 1.5, 0.0], method="Nelder-Mead", options={"xatol": 1e-8, "fatol": 1e-8})
    np.testing.assert_allclose(point, expected.x, atol=1e-3)
    assert value < 1e-5
    assert calls < 1500
