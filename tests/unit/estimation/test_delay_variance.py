"""What sigma holds of delays that are not corrected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from cwcli.estimation.delay_variance import (
    DelaySigmas,
    covariance_from_unknown_delays,
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
from cwcli.estimation.passes import SensorSeries
from cwcli.simulation.drive import simulate_scenario
from cwcli.simulation.scenario import load_scenario
from tests.studies.nees import drive_nees, with_drawn_delays
from tests.unit.estimation.made_drive import as_series

STATE = np.array([[5.0, 7.0, 10.0, np.pi / 2, 2.0, 0.3, 1.0, 0.1]])
"""10 m/s to the north, 2 m/s^2, 0.3 rad/s, 1 m/s^3 and 0.1 rad/s^2."""


def test_a_delay_moves_the_states_as_far_as_the_estimate_takes_it_up() -> None:
    """The fixes make the car lag along its course; of the heading's delay the estimate takes half."""
    series = [
        as_series(Kind.POSITION, np.arange(10.0), np.zeros((10, 2))),
        as_series(Kind.HEADING, np.arange(10.0), np.zeros(10)),
    ]
    series = [replace(s, source=s.kind.name) for s in series]

    def states_of(moved: Sequence[SensorSeries]) -> np.ndarray:
        late_s = [before.latency_s - after.latency_s for before, after in zip(series, moved, strict=True)]
        change = [0.0, -10.0 * late_s[0], 0.0, -0.15 * late_s[1], 0.0, 0.0, 0.0, 0.0]
        return np.asarray(STATE + np.array(change))

    found = covariance_from_unknown_delays(series, np.array([0.05, 0.02]), STATE, states_of, causal=False)[0]
    expected = np.zeros((8, 8))
    expected[1, 1] = (10.0 * 0.05) ** 2
    expected[3, 3] = (0.5 * 0.3 * 0.02) ** 2
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_quantities_of_one_topic_are_late_together_and_no_row_that_is_rejected_counts() -> None:
    series = [
        as_series(Kind.POSITION, np.arange(10.0), np.zeros((10, 2))),
        as_series(Kind.HEADING, np.arange(10.0), np.zeros(10)),
    ]
    series = [replace(s, source="/odometry") for s in series]
    calls = []

    def states_of(moved: Sequence[SensorSeries]) -> np.ndarray:
        calls.append([s.latency_s for s in moved])
        return STATE + np.array([0.0, 300.0, 0.0, 0.001, 0.0, 0.0, 0.0, np.nan])

    found = covariance_from_unknown_delays(series, np.array([0.05, 0.02]), STATE, states_of, causal=False)[0]
    assert calls == [[-0.05, -0.02]]
    expected = np.zeros((8, 8))
    change = np.array([0.0, 10.0 * 0.05, 0.0, 0.001])
    expected[:4, :4] = np.outer(change, change)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    before = np.concatenate((STATE, 0.5 * STATE))  # a state that comes later changes less, and earlier ones count
    for causal, second_m in ((True, 0.5), (False, 0.5)):
        found = covariance_from_unknown_delays(
            series, np.array([0.05, 0.0]), before, lambda _: before + [[0.0, 9.0] + [0.0] * 6] * 2, causal=causal
        )
        np.testing.assert_allclose(found[:, 1, 1], [0.5**2, second_m**2])
    found = covariance_from_unknown_delays(
        series, np.array([0.05, 0.0]), before[::-1], lambda _: before[::-1] + [[0.0, 9.0] + [0.0] * 6] * 2, causal=True
    )
    np.testing.assert_allclose(found[:, 1, 1], [0.25**2, 0.5**2])
    assert not covariance_from_unknown_delays(series, np.zeros(2), STATE, states_of, causal=False).any()
    assert len(calls) == 1


def test_the_heading_of_a_bend_is_as_uncertain_as_its_delay_makes_it_even_far_from_it() -> None:
    """Seed 4008 with its headings 107 ms early had a NEES of 19: the filter holds a bend's error for half a minute."""
    drive = with_drawn_delays(simulate_scenario(load_scenario("curve"), 4008), 4008)
    found = drive_nees(drive)
    assert found["hindsight", "heading"] < 4.0
    assert found["online", "heading"] < 4.0


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


def test_a_delay_that_varies_is_known_less() -> None:
    """The prior of stamps that err by 60 ms is hypot(50, 120) = 130 ms."""
    assert unknown_delay_sigma_s(Latency(LatencyStatus.NOT_OBSERVABLE), 0.06) == pytest.approx(0.13)
    found = Latency(LatencyStatus.APPLIED, 0.3, 0.01, 0.005)
    assert unknown_delay_sigma_s(found, 0.06) == pytest.approx(0.01)


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
    assert DelaySigmas(1.0, 0.1, 0.3).elementwise_max(DelaySigmas(0.5, 0.2, 0.3, 0.4)) == DelaySigmas(
        1.0, 0.2, 0.3, 0.4
    )


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
