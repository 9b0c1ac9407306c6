"""Covariances of the vehicle filter and of the observer stay symmetric and positive on any input.

The rows make no sense: any place, any time step, noise that is stated from far too small to huge. Each seed rounds
otherwise, so an update that loses digits fails on every processor, whatever its rounding.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.dynamics.config import FilterNoise, ObserverConfig
from cwcli.dynamics.filter import build_kernel_model
from cwcli.dynamics.vehicle import load_vehicle
from cwcli.estimation.measurements import Kind
from cwcli.estimation.model import MotionParameters
from cwcli.estimation.passes import FilterStart, SensorSeries, run_filter_pass
from cwcli.kernels import observer
from cwcli.kernels.observer import Begin, EventKind

EIGENVALUE_ROUNDING = 1e-12
"""How far below zero rounding may put an eigenvalue of a correlation matrix of up to 16 states: some thousand times the
unit of the last place, since an eigenvalue routine errs by n of them itself."""
N_ROWS = 60


def check_covariances(p: np.ndarray) -> None:
    """Finite, symmetric to the last bit, and no correlation matrix has an eigenvalue below its rounding."""
    assert np.isfinite(p).all()
    np.testing.assert_array_equal(p, p.transpose(0, 2, 1))
    variance = np.diagonal(p, axis1=1, axis2=2)
    assert (variance >= 0.0).all()
    assert (p[variance == 0.0] == 0.0).all()  # what is known exactly goes with nothing
    scale = np.sqrt(np.where(variance == 0.0, 1.0, variance))
    assert np.linalg.eigvalsh(p / (scale[:, :, None] * scale[:, None, :])).min() > -EIGENVALUE_ROUNDING


def any_series(rng: np.random.Generator, parameters: MotionParameters) -> list[SensorSeries]:
    """One series of each kind of sensor."""
    series = []
    for kind in Kind:
        step_s = rng.choice([0.0, 0.01, 0.1, 3.0, 100.0], N_ROWS, p=[0.2, 0.3, 0.3, 0.15, 0.05])
        wide = kind in (Kind.POSITION, Kind.VELOCITY)
        variance = 10.0 ** rng.uniform(-12, 4, N_ROWS)
        noise = np.stack([variance, 0.9 * variance * wide, variance * wide], axis=1)
        values = rng.normal(0.0, 30.0 if wide else 1.0, (N_ROWS, 2))
        series.append(SensorSeries(kind.name, kind, 1.0 + np.cumsum(step_s), values, noise))
    return series


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("seeds", [range(k, k + 20) for k in (0, 20, 40)], ids=str)
def test_covariances_of_the_vehicle_filter(seeds: range, smooth: bool) -> None:
    for seed in seeds:
        check_covariances(covariances_of_any_rows(seed, smooth=smooth))


def covariances_of_any_rows(seed: int, *, smooth: bool) -> np.ndarray:
    """Of the vehicle filter at the times of all rows, shape (n, 8, 8)."""
    rng = np.random.default_rng(seed)
    parameters = MotionParameters()
    series = any_series(rng, parameters)
    output_s = np.unique(np.concatenate([each.time_s for each in series]))
    variance = np.array([1e12, 1e12, 1e4, 10.0, 100.0, 1.0, 100.0, 1.0])
    start = FilterStart(0.0, np.array([0.0, 0, 5, 0, 0, 0, 0, 0]), np.diag(variance))
    found = run_filter_pass(
        series, start, parameters.to_process_model(np.zeros(8)), output_s, smooth=smooth, reset_after=3
    )
    return found.covariance


@pytest.mark.parametrize("seed", range(20))
def test_covariances_of_the_observer(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = 10 * N_ROWS
    kind = rng.choice([EventKind.LANE, EventKind.YAW_RATE, EventKind.STEERING_ANGLE], n).astype(np.int8)
    kind[0] = EventKind.LANE
    begin = np.full(n, Begin.GO_ON, np.int8)
    begin[0] = Begin.ANEW
    events = observer.Events(
        dt_s=rng.choice([0.0, 0.01, 0.1, 5.0], n),
        speed_mps=rng.uniform(-5.0, 60.0, n),
        kind=kind,
        begin=begin,
        values=rng.normal(0.0, [1.0, 0.1, 0.01], (n, 3)),
        sigmas=10.0 ** rng.uniform(-8, 2, (n, 3)),
        preview_m=rng.uniform(0.0, 50.0, n),
        change_1pm2=rng.normal(0.0, 1e-4, n),
    )
    config = ObserverConfig(noise=replace(FilterNoise(), gate=1e9))
    _, p, _, _ = observer.observe(events, build_kernel_model(load_vehicle(), config))
    check_covariances(p)
