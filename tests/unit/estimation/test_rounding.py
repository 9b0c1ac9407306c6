"""What rounding leaves of covariances where precise fixes end a time in which little was known."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.estimation.measurements import Kind
from cwcli.estimation.model import MotionParameters
from cwcli.estimation.passes import FilterStart, SensorSeries, run_filter_pass
from tests.unit.estimation.exact_ekf import run_exactly

RTOL = 1e-7  # of a covariance, in units of both states' sigmas; the state in units of its sigma
FIX_VARIANCE_M2 = 1e-4


def _drive(time_s: np.ndarray) -> list[SensorSeries]:
    """Positions good to a centimetre and a speed, of a car at 5 m/s along x."""
    n = len(time_s)
    xy = np.stack([5.0 * time_s, np.zeros(n)], axis=1)
    noise = np.tile([FIX_VARIANCE_M2, 0.0, FIX_VARIANCE_M2], (n, 1))
    speed = np.stack([np.full(n, 5.0), np.zeros(n)], axis=1)
    return [
        SensorSeries("fix", Kind.POSITION, time_s, xy, noise),
        SensorSeries("speed", Kind.SPEED, time_s, speed, noise),
    ]


def _start(variance_m2: float) -> FilterStart:
    variance = np.array([variance_m2, variance_m2, 1.0, 0.01, 1.0, 0.01, 1.0, 0.01])
    return FilterStart(0.0, np.array([0.0, 0, 5, 0, 0, 0, 0, 0]), np.diag(variance))


def _check(series: list[SensorSeries], start: FilterStart, output_s: np.ndarray) -> None:
    parameters = MotionParameters()
    motion = parameters.to_process_model(np.zeros(8))
    exact = run_exactly(series, start, parameters, output_s)
    for smooth, (state, covariance) in ((False, exact[:2]), (True, exact[2:])):
        found = run_filter_pass(series, start, motion, output_s, smooth=smooth, reset_after=10)
        sigma = np.sqrt(np.einsum("nii->ni", covariance))
        scaled = (found.covariance - covariance) / (sigma[:, :, None] * sigma[:, None, :])
        assert np.abs(scaled).max() < RTOL
        assert np.abs((found.state - state) / sigma).max() < RTOL
        np.linalg.cholesky(found.covariance)


@pytest.mark.parametrize("variance_m2", [1.0, 1e4, 1e8, 1e13])
def test_covariances_keep_their_digits_from_a_start_that_is_hardly_known(variance_m2: float) -> None:
    """Of a variance of 1e8 m^2 all but 1e-4 m^2 is taken away: P - P Lambda P has no digit left of that."""
    _check(_drive(np.arange(1.0, 2.5, 0.1)), _start(variance_m2), np.arange(0.0, 2.5, 0.1))


def test_covariances_keep_their_digits_across_an_outage() -> None:
    gap_s = 30.0
    before = np.arange(0.0, 1.0, 0.1)
    time_s = np.concatenate([before, before + gap_s])
    output_s = np.concatenate([before, np.linspace(1.0, gap_s, 8), before + gap_s + 0.05])
    _check(_drive(time_s), _start(1.0), output_s)
