"""The horizon that braking needs, by hand: T = 1.1 s + v / 8 m/s^2, at most 3.7 s, for what drives ahead."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cwcli.prediction.rollout import RolloutSettings, roll_out_paths
from cwcli.warning.types import VehicleTrack, WarningConfig
from tests.unit.warning.vehicles import evaluate, seconds, straight

STEP_S = 0.05
"""Time between evaluations, s: a moment between two of them shows at the second."""


def first_warning_s(host: VehicleTrack, other: VehicleTrack, config: WarningConfig | None = None) -> float | None:
    raised = seconds(np.asarray(evaluate(host, [other], config).events.columns["raised_stamp_ns"]))
    return raised[0] if raised else None


@pytest.mark.parametrize(
    ("own_mps", "their_mps", "horizon_s"),
    [
        (10.0, 0.0, 2.5),  # 1.1 + 10 / 8 = 2.35 is less than the rule's own
        (13.6, 0.0, 2.8),
        (18.4, 0.0, 3.4),
        (27.8, 0.0, 3.7),  # 1.1 + 27.8 / 8 = 4.575 is more than the longest
        (25.0, 10.6, 2.9),  # the closing speed counts
        (30.0, 20.0, 2.5),
    ],
)
def test_the_horizon_grows_with_the_closing_speed(own_mps: float, their_mps: float, horizon_s: float) -> None:
    closing_mps = own_mps - their_mps
    gap_m = 6.0 * closing_mps
    host = straight("host", speed_mps=own_mps, duration_s=6.0)
    other = straight("car", x_m=gap_m + 4.5, speed_mps=their_mps, duration_s=6.0, horizon_s=3.5)
    first_s = first_warning_s(host, other)
    assert first_s is not None
    assert 0.0 <= first_s - (6.0 - horizon_s) <= STEP_S + 1e-6


def test_it_can_be_turned_off() -> None:
    host, car = straight("host", speed_mps=25.0), straight("car", x_m=154.5, speed_mps=0.0)
    assert first_warning_s(host, car, WarningConfig(max_horizon_s=0.0)) == 3.55  # 150 - 25 t < 62.5 after 3.5 s
    assert first_warning_s(host, car) == pytest.approx(6.0 - 3.7, abs=STEP_S + 1e-6)


@pytest.mark.parametrize("rule", ["song2016", "ttc", "path-ttc"])
def test_the_rules_of_papers_keep_their_horizon(rule: str) -> None:
    host, car = straight("host", speed_mps=25.0), straight("car", x_m=154.5, speed_mps=0.0)
    first_s = [first_warning_s(host, car, WarningConfig(rule=rule, max_horizon_s=longest)) for longest in (0.0, 3.7)]
    assert first_s[0] == first_s[1]


def test_a_vehicle_that_stands_is_warned_of_before_gentle_braking_is_too_late() -> None:
    """UN R152 at 10 km/h: 1.1 + 2.8 / 8 = 1.45 s, where gentle braking alone would wait to 2.8 / 4 = 0.7 s."""
    host, car = straight("host", speed_mps=2.8, sigma_m=0.001), straight("car", x_m=4.5 + 14.0, speed_mps=0.0)
    assert first_warning_s(host, car) == pytest.approx(5.0 - 1.45, abs=STEP_S + 1e-6)
    off_s = first_warning_s(host, car, WarningConfig(max_horizon_s=0.0))
    assert off_s == pytest.approx(5.0 - 0.7, abs=2 * STEP_S)


@pytest.mark.parametrize(
    "other",
    [
        straight("oncoming", x_m=275.0, speed_mps=20.0, heading_rad=math.pi, horizon_s=3.5),
        straight("crossing", x_m=100.0, y_m=-100.0, speed_mps=20.0, heading_rad=0.5 * math.pi, horizon_s=3.5),
    ],
    ids=lambda track: track.id,
)
def test_only_what_drives_ahead_or_stands_is_looked_at_farther(other: VehicleTrack) -> None:
    host = straight("host", speed_mps=20.0)
    usual = first_warning_s(host, other, WarningConfig(max_horizon_s=0.0))
    assert usual is not None
    assert first_warning_s(host, other) == usual


def test_a_path_that_turns_is_not_prolonged_straight_on() -> None:
    """A car is parked on the tangent that continues the path of a host that turns away."""
    host = straight("host", speed_mps=25.0)
    state = host.state.copy()
    yaw_rate, time_s = 0.2, np.arange(len(state)) * 0.05
    state[:, 3], state[:, 5] = yaw_rate * time_s, yaw_rate
    state[:, 0], state[:, 1] = 25.0 / yaw_rate * np.sin(state[:, 3]), 25.0 / yaw_rate * (1.0 - np.cos(state[:, 3]))
    paths = roll_out_paths("ctrv", state, None, settings=RolloutSettings())
    certain = np.full_like(host.paths.paths_of_rows(np.arange(len(state))).position_covariance_m2, 1e-6)
    turning = replace(host, state=state, paths=replace(paths, position_covariance_m2=certain))
    end = turning.paths.paths_of_rows(np.array([0]))
    x_m, y_m, heading = end.x_m[0, -1], end.y_m[0, -1], end.heading_rad[0, -1]
    parked = straight("parked", x_m=x_m + 30.0 * math.cos(heading), y_m=y_m + 30.0 * math.sin(heading), speed_mps=0.0)
    short = replace(parked, stamp_ns=parked.stamp_ns[:8], log_time_ns=parked.log_time_ns[:8], state=parked.state[:8])
    assert first_warning_s(turning, replace(short, paths=parked.paths)) is None


def test_a_lead_that_brakes_is_not_warned_of_before_four_seconds_at_the_present_speeds() -> None:
    """ISO 15623: 25 m/s, 40 m, 3 m/s^2; contact after sqrt(80 / 3) s, where the closing speed has become 15.5 m/s.

    Braking needs 1.1 + 15.5 / 8 = 3.04 s, but (40 - 1.5 t^2) / (3 t) = 4 at t = 2.532 s.
    """
    host = straight("host", speed_mps=25.0, duration_s=5.0)
    lead = straight("lead", x_m=44.5, speed_mps=25.0, accel_mps2=-3.0, duration_s=5.0, horizon_s=3.5)
    first_s = first_warning_s(host, lead)
    assert first_s is not None
    assert 2.532 <= first_s <= 2.532 + STEP_S
