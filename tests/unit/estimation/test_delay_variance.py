"""What sigma holds of delays that are not corrected."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.estimation.delay_variance import (
    DelaySigmas,
    covariance_from_delays,
    delay_sigmas_of_best_known_sources,
    unknown_delay_sigma_s,
)
from cwcli.estimation.latency import Latency, LatencyStatus
from cwcli.estimation.latency_clock import (
    SourceLatency,
    disputed_clock_sigma_s,
    shift_latencies_to_agreed_clock_and_note,
)
from cwcli.estimation.measurements import Kind
from tests.unit.estimation.made_drive import as_series

STATE = np.array([[5.0, 7.0, 10.0, np.pi / 2, 2.0, 0.3, 1.0, 0.1]])
"""10 m/s to the north, 2 m/s^2, 0.3 rad/s, 1 m/s^3 and 0.1 rad/s^2."""


def test_a_delay_lies_along_the_course_and_in_the_changes_of_speed_and_heading() -> None:
    found = covariance_from_delays(STATE, DelaySigmas(position=0.05, speed=0.03, heading=0.02))[0]
    expected = np.zeros((8, 8))
    expected[1, 1] = (10.0 * 0.05) ** 2
    expected[2, 2] = (2.0 * 0.03) ** 2
    expected[3, 3] = (0.3 * 0.02) ** 2
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_a_clock_that_is_off_moves_the_whole_state() -> None:
    """The states of 0.1 s ago differ by 0.1 s times their rates of change, all at once: rank one."""
    found = covariance_from_delays(STATE, DelaySigmas(clock=0.1))[0]
    rate = np.array([0.0, 10.0, 2.0, 0.3, 1.0, 0.1, 0.0, 0.0])
    np.testing.assert_allclose(found, 0.01 * np.outer(rate, rate), atol=1e-12)


@pytest.mark.parametrize(
    ("latency", "expected_s"),
    [
        (Latency(LatencyStatus.OFF), 0.0),  # the user trusts the stamps
        (Latency(LatencyStatus.GIVEN, 0.3), 0.0),
        (Latency(LatencyStatus.REFERENCE), 0.0),  # the states have its clock
        (Latency(LatencyStatus.APPLIED, 0.3, 0.01, 0.005), 0.01),
        # 60 +- 50 ms beside a prior of 50 ms: 30 ms and a sigma of 35 ms
        (Latency(LatencyStatus.NOT_SIGNIFICANT, 0.06, 0.05, 0.02), np.hypot(0.03, 0.05 / np.sqrt(2.0))),
        (Latency(LatencyStatus.CONTRADICTS, 1.5, 0.2), np.hypot(1.5, 0.2)),  # not combined with the prior
        (Latency(LatencyStatus.NOT_OBSERVABLE), 0.05),
        (Latency(LatencyStatus.NOT_OBSERVABLE, bound_s=0.01, reach_s=0.05), 0.05 / np.sqrt(2.0)),
    ],
)
def test_what_is_not_known_of_a_delay(latency: Latency, expected_s: float) -> None:
    assert unknown_delay_sigma_s(latency) == pytest.approx(expected_s)


@pytest.mark.parametrize(
    ("latency", "place_m", "expected_s"),
    [
        (Latency(LatencyStatus.APPLIED, -0.3, 0.04), None, 0.3027),  # sqrt(0.3^2 + 0.04^2): or 3 m ahead at 10 m/s
        (Latency(LatencyStatus.APPLIED, 0.3, 0.04), None, 0.04),
        (Latency(LatencyStatus.APPLIED, -0.3, 0.04), (3.0, 0.0), 0.04),  # the antenna's place is known
        (Latency(LatencyStatus.GIVEN, -0.3), None, 0.0),
    ],
)
def test_fixes_that_seem_early_may_be_those_of_an_antenna_ahead(
    latency: Latency, place_m: tuple[float, float] | None, expected_s: float
) -> None:
    fixes = replace(as_series(Kind.POSITION, np.arange(100.0), np.zeros((100, 2))), place_m=place_m)
    found = delay_sigmas_of_best_known_sources([fixes], [latency])
    assert found.position == pytest.approx(expected_s, abs=1e-4)


def test_the_larger_of_two_sigmas_counts_for_each_quantity() -> None:
    assert DelaySigmas(1.0, 0.1, 0.3).at_least(DelaySigmas(0.5, 0.2, 0.3, 0.4)) == DelaySigmas(1.0, 0.2, 0.3, 0.4)


def test_the_best_known_source_of_a_quantity_counts_and_a_speed_before_fixes() -> None:
    time_s = np.arange(10.0)
    kinds = (Kind.POSITION, Kind.POSITION, Kind.SPEED)
    series = [as_series(kind, time_s, np.zeros((10, 2 if kind is Kind.POSITION else 1))) for kind in kinds]
    sigmas_s = (0.03, 0.02, 0.04)
    latencies = [Latency(LatencyStatus.APPLIED, 0.3, sigma_s, sigma_s) for sigma_s in sigmas_s]
    assert delay_sigmas_of_best_known_sources(series, latencies) == DelaySigmas(position=0.02, speed=0.04, heading=0.0)
    assert delay_sigmas_of_best_known_sources(series[:2], latencies[:2]).speed == 0.02


def test_one_source_ahead_of_the_imu_leaves_the_clock_open() -> None:
    """Its stamps are 30 ms early, or the IMU's are 30 ms late; with two that agree it is the IMU."""
    imu = SourceLatency("imu", Kind.ACCEL, True, Latency(LatencyStatus.REFERENCE))
    early = Latency(LatencyStatus.APPLIED, -0.03, 0.003, 0.003)
    for others, expected_s in ((("speed",), 0.03), (("speed", "heading"), 0.0), ((), 0.0)):
        told = [imu, *(SourceLatency(name, Kind.SPEED, False, early) for name in others)]
        assert disputed_clock_sigma_s(told, shift_latencies_to_agreed_clock_and_note(told)[0]) == pytest.approx(
            expected_s
        )
