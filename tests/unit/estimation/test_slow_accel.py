"""An accelerometer behind a high-pass filter, against fixes: accelerations are sums of waves, whose filtered form is
known in closed form (gain w T / sqrt(1 + w^2 T^2), phase pi / 2 - atan(w T))."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cwcli.estimation.check_texts import SourceComparisonCheck
from cwcli.estimation.measurements import Kind
from cwcli.estimation.slow_accel import high_pass_time_constant_of_accelerometer_s
from cwcli.estimation.source_checks import Judgement, compare_all_source_pairs
from cwcli.estimation.step_motion import StepMotion, compute_step_motion_by_source, step_edges_s
from cwcli.signals.columns import FloatArray
from tests.unit.estimation.made_drive import as_series

WAVES = ((1.0, 0.12), (0.8, 0.31), (0.6, 0.7))
"""Acceleration, m/s^2, and angular frequency, rad/s, of each wave; the speed stays within 20 +- 12 m/s."""
TIME_S = np.arange(0.0, 240.0, 0.1)
STEP_S = 4.0
FIXES_M = np.column_stack([20.0 * TIME_S - sum(a / w**2 * np.cos(w * TIME_S) for a, w in WAVES), 0.0 * TIME_S])


def _accel_behind_filter_mps2(time_constant_s: float) -> FloatArray:
    """The waves behind the filter; an infinite time constant lets all through."""
    found = np.zeros(len(TIME_S))
    for a, w in WAVES:
        wt = w * time_constant_s
        gain, phase = (1.0, 0.0) if math.isinf(wt) else (wt / math.hypot(1.0, wt), math.pi / 2.0 - math.atan(wt))
        found += a * gain * np.cos(w * TIME_S + phase)
    return found


def _found_time_constant_s(accel_mps2: FloatArray, fixes_m: FloatArray = FIXES_M) -> float:
    fixes = as_series(Kind.POSITION, TIME_S, fixes_m)
    edges_s = step_edges_s([fixes], STEP_S)
    accel = compute_step_motion_by_source(as_series(Kind.ACCEL, TIME_S, accel_mps2[:, None]), edges_s)
    return high_pass_time_constant_of_accelerometer_s(accel, compute_step_motion_by_source(fixes, edges_s), STEP_S)


@pytest.mark.parametrize("time_constant_s", [2.0, 5.0, 10.0, 20.0])
def test_the_time_constant_of_the_filter_is_found(time_constant_s: float) -> None:
    # The fixes tell means over steps: the mid-step integral is off by the curvature within a step, (w step)^2 / 12.
    assert _found_time_constant_s(_accel_behind_filter_mps2(time_constant_s)) == pytest.approx(time_constant_s, rel=0.2)


@pytest.mark.parametrize("bias_mps2", [0.0, 0.4])
def test_a_bias_that_drifts_a_scale_and_hills_are_no_filter(bias_mps2: float) -> None:
    right = _accel_behind_filter_mps2(math.inf)
    noise_m = np.random.default_rng(5).normal(0.0, 0.1, FIXES_M.shape)
    for values in (
        right,
        0.8 * right,
        right + 0.001 * TIME_S,
        right + 0.3 * np.cos(0.2 * TIME_S + 1.0),
        right + 0.01 * np.cumsum(np.random.default_rng(6).normal(0.0, 1.0, len(TIME_S))),
    ):
        assert math.isnan(_found_time_constant_s(values + bias_mps2, FIXES_M + noise_m))


@pytest.mark.parametrize(
    ("n_columns", "t", "is_found"), [(0, 7.9, False), (0, 8.1, True), (2, 7.9, False), (2, 8.1, True)]
)
def test_a_filter_is_told_from_eight_sigmas_on(n_columns: int, t: float, is_found: bool) -> None:
    """In 12 changes of speed a line, the filter and each column of a lever arm are fitted, by `np.linalg.lstsq`."""
    rng = np.random.default_rng(8)
    own, columns, noise = rng.normal(size=12), rng.normal(size=(n_columns, 12)), rng.normal(size=12)
    speed_mps = np.concatenate([[0.0], np.cumsum(own)])
    way = 0.5 * STEP_S * (speed_mps[1:] + speed_mps[:-1])
    fitted = np.column_stack([way, np.ones(12), np.arange(12), *columns])
    noise -= fitted @ np.linalg.lstsq(fitted, noise, rcond=None)[0]
    sigma = math.sqrt(noise @ noise / (12 - 3 - n_columns) * np.linalg.inv(fitted.T @ fitted)[0, 0])
    inverse_time_constant = 0.2
    missing = inverse_time_constant * way + noise * (inverse_time_constant / t / sigma)
    accel, fixes = (
        StepMotion(as_series(Kind.ACCEL, TIME_S[:2], np.zeros(2)), x, x, x, 0.0, x, False)
        for x in (speed_mps, np.concatenate([[0.0], np.cumsum(own + missing)]))
    )
    found_s = high_pass_time_constant_of_accelerometer_s(accel, fixes, STEP_S, list(columns))
    assert found_s == pytest.approx(5.0) if is_found else math.isnan(found_s)


def test_the_comparison_names_the_accelerometer() -> None:
    series = [
        as_series(Kind.POSITION, TIME_S, FIXES_M),
        as_series(Kind.ACCEL, TIME_S, _accel_behind_filter_mps2(5.0)[:, None]),
    ]
    found = [c for c in compare_all_source_pairs(series) if c.check is SourceComparisonCheck.SLOW_ACCEL]
    assert [c.judgement for c in found] == [Judgement.CONTRADICT]
    who = found[0].one if found[0].one.kind is Kind.ACCEL else found[0].other
    assert "loses accelerations in 5 s" in str(found[0].to_contradiction(who))
