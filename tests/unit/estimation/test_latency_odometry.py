"""The delay of fixes against the way by wheel speed and yaw rate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.estimation.latency import Latency, LatencyStatus
from cwcli.estimation.latency_odometry import (
    find_delay_against_odometry,
    latency_from_odometry,
    refine_position_latencies,
)
from cwcli.estimation.measurements import Kind
from cwcli.estimation.passes import SensorSeries
from tests.unit.estimation.made_drive import as_series, made_drive


def sources(
    *, noise_m: float = 0.0, slow_m: float = 0.0, scale: float = 1.0, bias_radps: float = 0.0, seed: int = 0
) -> tuple[SensorSeries, SensorSeries, SensorSeries]:
    """Fixes ten times a second, speed and yaw rate of four minutes."""
    time_s, values = made_drive(240.0)
    rng = np.random.default_rng(seed)
    fixes = values[Kind.POSITION][::2] + noise_m * rng.standard_normal((len(time_s[::2]), 2))
    kept = np.exp(-0.1 / 15.0)
    slow = np.zeros(2)
    for k in range(len(fixes)):
        slow = kept * slow + slow_m * np.sqrt(1.0 - kept**2) * rng.standard_normal(2)
        fixes[k] += slow
    return (
        as_series(Kind.POSITION, time_s[::2], fixes),
        as_series(Kind.SPEED, time_s, scale * values[Kind.SPEED]),
        as_series(Kind.YAW_RATE, time_s, values[Kind.YAW_RATE] + bias_radps),
    )


@pytest.mark.parametrize("delay_s", [-0.1, 0.0, 0.08, 0.45])
@pytest.mark.parametrize(("scale", "bias_radps"), [(1.0, 0.0), (0.9, 0.0), (1.1, 0.002)])
def test_exact_fixes_show_their_delay_whatever_the_scale_of_the_wheels(
    delay_s: float, scale: float, bias_radps: float
) -> None:
    fixes, speed, yaw_rate = sources(scale=scale, bias_radps=bias_radps)
    evidence = find_delay_against_odometry(replace(fixes, time_s=fixes.time_s + delay_s), speed, yaw_rate)
    assert evidence is not None
    assert evidence.likeliest_latency_s == pytest.approx(delay_s, abs=0.01)


def test_the_sigma_holds_slow_errors_of_fixes() -> None:
    """The errors of 20 drives with 0.5 m of white and 1 m of slow error are about as large as their sigma."""
    ratio = []
    for seed in range(20):
        evidence = find_delay_against_odometry(*sources(noise_m=0.5, slow_m=1.0, seed=seed))
        assert evidence is not None
        ratio.append(evidence.likeliest_latency_s / evidence.block_scatter_sigma_s)
    assert 0.4 < np.sqrt(np.mean(np.square(ratio))) < 1.6
    assert max(np.abs(ratio)) < 4.0


def test_a_clear_delay_is_applied_and_an_unclear_one_is_not() -> None:
    fixes, speed, yaw_rate = sources(noise_m=0.5, slow_m=1.0, seed=3)
    for delay_s, status in ((0.0, LatencyStatus.NOT_SIGNIFICANT), (0.3, LatencyStatus.APPLIED)):
        evidence = find_delay_against_odometry(replace(fixes, time_s=fixes.time_s + delay_s), speed, yaw_rate)
        assert evidence is not None
        assert latency_from_odometry(evidence, 0.0).status is status
        assert latency_from_odometry(evidence, 0.2).status is LatencyStatus.NOT_SIGNIFICANT  # odometry of unknown delay


def test_what_the_search_leaves_open_is_refined_on_the_clock_of_its_reference() -> None:
    """The wheel speed is 0.1 s late itself, as was found; the fixes are 0.3 s late."""
    fixes, speed, yaw_rate = sources(noise_m=0.3)
    series = [
        replace(fixes, time_s=fixes.time_s + 0.3),
        replace(speed, time_s=speed.time_s + 0.1),
        yaw_rate,
    ]
    wheel = Latency(LatencyStatus.APPLIED, 0.1, 0.005, 0.004)
    imu = Latency(LatencyStatus.REFERENCE)
    unknown = Latency(LatencyStatus.NOT_OBSERVABLE, bound_s=0.057)
    found, *others = refine_position_latencies(series, [unknown, wheel, imu])
    assert found.status is LatencyStatus.APPLIED
    assert found.found_s == pytest.approx(0.3, abs=0.02)
    assert others == [wheel, imu]
    known = Latency(LatencyStatus.APPLIED, 0.29, 0.01, 0.01)
    assert refine_position_latencies(series, [known, wheel, imu]) == [known, wheel, imu]
    assert refine_position_latencies([series[0], yaw_rate], [unknown, imu]) == [unknown, imu]


def test_too_short_or_broken_odometry_tells_nothing() -> None:
    fixes, speed, yaw_rate = sources()
    is_early = fixes.time_s < 100.0
    assert find_delay_against_odometry(fixes.select_rows(is_early), speed, yaw_rate) is None
    gaps = speed.select_rows(speed.time_s % 10.0 > 1.0)
    assert find_delay_against_odometry(fixes, gaps, yaw_rate) is None
