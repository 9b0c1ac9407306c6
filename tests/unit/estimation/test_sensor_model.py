"""Slow errors, scales and lever arms: their states, and what a planted drive shows of them."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.estimation.measurements import Kind
from cwcli.estimation.parameter import ParameterStatus
from cwcli.kernels.estimation import fading_integral
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


def test_a_slow_error_is_found_of_one_fix_a_second_where_the_white_noise_does_not_settle() -> None:
    """Planted: 1.5 m over 15 s. The noise swings between two values in such trials, and so did their scores."""
    drive = simulated("phone", 30121)
    lean = variants(measurements_of(drive))["lean"]
    once_a_second = [m.select_rows(np.arange(len(m)) % 10 == 0) if m.kind is Kind.POSITION else m for m in lean]
    _, nees, track = estimated(drive, once_a_second)
    fix = next(s for s in track.sources if s.source == "gnss")
    assert fix.slow_error.status is ParameterStatus.USED
    assert 0.8 < fix.slow_error.sigma < 3.0
    assert nees < 4.0
