"""The emergency electronic brake light: moments worked out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.prediction.rollout import RolloutSettings
from cwcli.signals.vehicle_state import ACCEL
from cwcli.warning.types import VehicleTrack, WarningConfig
from tests.unit.warning.vehicles import evaluate, seconds, straight

CONFIG = WarningConfig(rule="eebl")


def raised_s(host: VehicleTrack, other: VehicleTrack, config: WarningConfig = CONFIG) -> list[float]:
    """When warnings are raised."""
    return seconds(np.asarray(evaluate(host, [other], config).events.columns["raised_ns"]))


def host(speed_mps: float = 25.0) -> VehicleTrack:
    return straight("host", speed_mps=speed_mps, duration_s=4.0)


def lead(accel_mps2: float = -5.0, **changes: float) -> VehicleTrack:
    """80 m ahead, braking from the start."""
    place = {"x_m": 80.0, "speed_mps": 25.0, "accel_mps2": accel_mps2, "duration_s": 4.0} | changes
    return straight("lead", **place)  # type: ignore[arg-type]


def test_a_car_ahead_that_brakes_hard_is_warned_of_after_the_persistence() -> None:
    assert raised_s(host(), lead()) == [0.2]
    assert raised_s(host(), lead(-4.01)) == [0.2]
    assert raised_s(host(), lead(-3.99)) == []


@pytest.mark.parametrize(
    ("changes", "is_warned"),
    [
        ({"y_m": 3.6}, True),  # beside
        ({"y_m": -5.3}, True),
        ({"y_m": 5.5}, False),  # two lanes off
        ({"x_m": -80.0}, False),  # behind
        ({"heading_rad": np.pi, "y_m": 3.6}, False),  # oncoming, in the opposite lane
        ({"heading_rad": np.pi / 2}, False),  # crossing
        ({"heading_rad": np.deg2rad(40.0)}, True),
        ({"x_m": 3.0}, False),  # side by side: no gap along the way
    ],
)
def test_only_who_drives_ahead_the_same_way_counts(changes: dict[str, float], is_warned: bool) -> None:
    assert bool(raised_s(host(), lead(**changes))) == is_warned


def test_what_is_far_enough_does_not_matter() -> None:
    # after 2.5 s at 25 m/s the host is 62.5 m on; the lead stands 62.5 m behind where it began to brake: the gap of
    # x - 4.5 m is left, and 625 / (2 * 2 m/s^2) = 156.25 m of it are needed at the gentle 2 m/s^2
    assert raised_s(host(), lead(x_m=160.0)) == [0.2]
    assert raised_s(host(), lead(x_m=162.0), replace(CONFIG, persistence_s=0.0))[0] > 0.0
    gentle = replace(CONFIG, min_deceleration_mps2=0.0)
    assert raised_s(host(), lead(x_m=162.0), gentle) == [0.2]


def test_who_says_so_is_believed_at_once() -> None:
    coasting = lead(0.0)
    n = len(coasting.stamp_ns)
    for first, expected in ((0, 0.0), (20, 1.0)):
        says = np.arange(n) >= first
        assert raised_s(host(), replace(coasting, says_hard_braking=says)) == [expected]
    assert raised_s(host(), replace(coasting, says_hard_braking=np.zeros(n, np.bool_))) == []


def test_a_host_that_hardly_moves_is_not_warned() -> None:
    assert raised_s(host(1.9), lead(x_m=8.0, speed_mps=2.0)) == []


def on_arc(track: VehicleTrack, radius_m: float, yaw_rate_radps: float) -> VehicleTrack:
    """The same track laid on an arc to the left that begins where the host starts, at heading 0."""
    turned = track.state[:, 0] / radius_m
    state = track.state.copy()
    state[:, 0], state[:, 1] = radius_m * np.sin(turned), radius_m * (1.0 - np.cos(turned))
    state[:, 3], state[:, 5] = turned, yaw_rate_radps
    return replace(track, state=state)


def test_ahead_is_along_the_arc_that_the_host_drives_on() -> None:
    from cwcli.prediction.rollout import roll_out_paths

    radius = 200.0
    tracks = []
    for track in (host(20.0), lead(x_m=100.0, speed_mps=20.0)):
        bent = on_arc(track, radius, 20.0 / radius)
        covariance = np.tile(np.eye(8) * 1e-4, (len(bent.stamp_ns), 1, 1))
        paths = roll_out_paths("ca", bent.state, covariance, settings=RolloutSettings(horizon_s=3.5, step_s=0.1))
        tracks.append(replace(bent, paths=paths))
    own, other = tracks
    # 100 m on, an arc of 200 m has left the straight line by 24 m
    assert other.state[0, 1] == pytest.approx(24.5, abs=0.1)
    assert raised_s(own, other) == [0.2]
    no_yaw = own.state.copy()
    no_yaw[:, 5] = 0.0
    assert raised_s(replace(own, state=no_yaw), other) == []


def test_a_brake_light_far_off_does_not_matter_without_an_acceleration_either() -> None:
    """At 165 m 176 m are left to the host, more than the 156 m that it needs, behind a lead at the hard 4 m/s^2."""
    far = lead(0.0, x_m=165.0)
    state = far.state.copy()
    state[:, ACCEL] = np.nan
    assert raised_s(host(), replace(far, state=state, says_hard_braking=np.ones(len(far.stamp_ns), np.bool_))) == []
