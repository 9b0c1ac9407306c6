"""Slow errors, scales and lever arms: their states, and what a planted drive shows of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cwcli.estimation import sensor_search
from cwcli.estimation.measurements import Kind
from cwcli.estimation.noise_matching import noise_variance_factor
from cwcli.estimation.parameter import ParameterStatus
from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.sensor_model import SensorModel
from cwcli.estimation.sensor_search import _SensorModelTrial
from cwcli.estimation.trial import MAX_NOISE_FACTOR_AT_CONVERGENCE
from cwcli.kernels.estimation import fading_integral
from cwcli.signals.columns import FloatArray
from tests.studies.lying_sensors import estimated, simulated, variants
from tests.studies.sensor_model import measurements_of, one_run


def test_fading_integral_of_a_constant_rate_goes_to_rate_times_time_constant() -> None:
    """u' = -u / T + q from 0: u = q T (1 - exp(-t / T))."""
    time_s = np.arange(0.0, 30.0, 0.01)
    found = fading_integral(time_s, np.full(len(time_s), 0.02), decay_s=5.0, max_gap_s=0.2)
    np.testing.assert_allclose(found, 0.02 * 5.0 * (1.0 - np.exp(-time_s / 5.0)), atol=1e-12)


def test_fading_integral_turns_by_nothing_in_a_gap() -> None:
    found = fading_integral(np.array([0.0, 0.1, 1.1]), np.ones(3), decay_s=5.0, max_gap_s=0.2)
    assert found[2] == pytest.approx(found[1] * np.exp(-1.0 / 5.0), abs=1e-12)


def test_what_is_planted_in_a_phone_s_drive_is_found() -> None:
    """Scale -1 %, lever arm 1.2 m, slow errors of 1.5 m; the speed within 0.03 m/s (0.6 without the sensor model)."""
    run = one_run("phone", 1000, "given")
    speed = next(s for s in run.track.sources if s.source == "speed")
    fix = next(s for s in run.track.sources if s.source == "gnss")
    assert speed.scale.value == pytest.approx(0.99, abs=0.002)
    assert speed.lever_arm_m.value == pytest.approx(1.2, abs=0.05)
    assert fix.slow_error.status is ParameterStatus.USED
    assert 0.8 < fix.slow_error.sigma < 3.0
    assert run.rms["speed"] < 0.03
    assert 0.3 < run.nees["speed"] < 2.0


def test_a_slow_error_is_found_of_one_fix_a_second_whose_white_noise_settles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Planted: 1.5 m over 15 s. White noise takes turns with it: matched in whole steps it swings between two values,
    and so do the scores."""
    change_at_end: list[float] = []

    def noted_factor(s: SensorSeries, nis: FloatArray) -> float:
        factor = noise_variance_factor(s, nis)
        if s.kind is Kind.POSITION:
            change_at_end[-1] = abs(math.log(factor))
        return factor

    class NotedTrials(sensor_search._SensorModelTrials):
        def _run_until_noise_settles(self, model: SensorModel, similar: _SensorModelTrial | None) -> _SensorModelTrial:
            change_at_end.append(0.0)
            return super()._run_until_noise_settles(model, similar)

    monkeypatch.setattr(sensor_search, "noise_variance_factor", noted_factor)
    monkeypatch.setattr(sensor_search, "_SensorModelTrials", NotedTrials)
    drive = simulated("phone", 30121)
    lean = variants(measurements_of(drive))["lean"]
    once_a_second = [m.select_rows(np.arange(len(m)) % 10 == 0) if m.kind is Kind.POSITION else m for m in lean]
    _, nees, track = estimated(drive, once_a_second)
    fix = next(s for s in track.sources if s.source == "gnss")
    assert fix.slow_error.status is ParameterStatus.USED
    assert 0.8 < fix.slow_error.sigma < 3.0
    assert nees < 4.0
    # The others begin too far away: a round changes a variance by at most 64.
    assert np.mean(np.array(change_at_end) < math.log(MAX_NOISE_FACTOR_AT_CONVERGENCE)) > 0.8
