"""The filter and the latch of SAE J2945/1, and what can be taken back of them."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.signals.bsm_sender import (
    ACCEL_FILTER_DELAY_S,
    ACCEL_FILTER_STEP_S,
    apply_senders_acceleration_low_pass,
    freeze_heading_at_standstill,
    repeated_heading_at_standstill_mask,
    undo_low_pass_filter_and_noise_gain,
)
from tests.studies.bsm_senders import compared


def test_it_is_the_butterworth_filter() -> None:
    from scipy.signal import butter, lfilter  # which takes a second to import

    values = np.cumsum(np.random.default_rng(1).normal(size=3000))
    values -= values[0]
    b, a = butter(2, 1.0, fs=1.0 / ACCEL_FILTER_STEP_S)
    # scipy bends the frequency so that the cut-off is exact; at 1 kHz that is one part in 300,000
    np.testing.assert_allclose(apply_senders_acceleration_low_pass(values), lfilter(b, a, values), atol=1e-3)


def test_what_changes_slowly_comes_225_ms_late() -> None:
    time_s = np.arange(0.0, 8.0, ACCEL_FILTER_STEP_S)
    late = apply_senders_acceleration_low_pass(time_s)
    assert time_s[-1] - late[-1] == pytest.approx(ACCEL_FILTER_DELAY_S, abs=1e-6)
    assert pytest.approx(0.2251, abs=1e-4) == ACCEL_FILTER_DELAY_S


@pytest.mark.parametrize("step", [100, 50, 130])
def test_a_ramp_is_found_again_without_a_delay(step: int) -> None:
    time_s = np.arange(0.0, 8.0, ACCEL_FILTER_STEP_S)
    ramp = -3.0 * time_s
    rows = np.arange(0, len(time_s), step)
    found, gain = undo_low_pass_filter_and_noise_gain(time_s[rows], apply_senders_acceleration_low_pass(ramp)[rows])
    settled = time_s[rows] > 2.0
    np.testing.assert_allclose(found[settled], ramp[rows][settled], atol=1e-3)
    assert (gain[2:] > 1.0).all()


def test_the_noise_grows_as_the_gain_says() -> None:
    rng = np.random.default_rng(2)
    time_s = 0.1 * np.arange(20_000.0)
    found, gain = undo_low_pass_filter_and_noise_gain(time_s, 0.01 * rng.normal(size=len(time_s)))
    assert np.std(found[2:]) == pytest.approx(0.01 * gain[2], rel=0.02)


def test_over_a_pause_or_without_a_value_it_stays_as_it_was_sent() -> None:
    time_s = np.array([0.0, 0.1, 0.2, 1.2, 1.3, 1.4, 1.5])
    sent = np.array([0.0, 1.0, 2.0, 3.0, 4.0, np.nan, 5.0])
    found, gain = undo_low_pass_filter_and_noise_gain(time_s, sent)
    np.testing.assert_array_equal(found[[0, 1, 3, 4, 6]], sent[[0, 1, 3, 4, 6]])
    assert np.isnan(found[5])
    np.testing.assert_array_equal(gain[[0, 1, 3, 4, 5, 6]], 1.0)
    # the parabola through 0, 1, 2 is a ramp of 10 m/s^3
    assert found[2] == pytest.approx(2.0 + 10.0 * ACCEL_FILTER_DELAY_S)


def test_the_heading_is_latched_below_and_released_above() -> None:
    speed = np.array([1.0, 0.6, 0.5, 0.6, 0.69, 0.70, 0.6])
    heading = np.arange(7.0)
    assert freeze_heading_at_standstill(heading, speed).tolist() == [0.0, 1.0, 1.0, 1.0, 1.0, 5.0, 6.0]
    assert repeated_heading_at_standstill_mask(freeze_heading_at_standstill(heading, speed), speed).tolist() == [
        False,
        False,
        True,
        True,
        True,
        False,
        False,
    ]
    assert not repeated_heading_at_standstill_mask(
        np.ones(3), np.full(3, 5.0)
    ).any()  # straight on at speed: measured anew


def test_a_braking_car_is_estimated_and_predicted_better() -> None:
    for name, values in compared(2).items():
        assert (values[:, 1] < values[:, 0]).all(), name
