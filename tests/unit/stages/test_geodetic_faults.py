"""Latitude and longitude that are exchanged, or have the wrong sign, are found out by the other sensors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cwcli.estimation.config import EstimatorConfig
from cwcli.signals.canonical import HeadingSignal, ImuSignal, PositionSignal, Signal, SpeedSignal
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.role import Role
from cwcli.simulation.drive import simulate_scenario
from cwcli.simulation.scenario import load_scenario
from cwcli.stages.estimate import _estimate_ego, _undo_exchanged_or_reversed_coordinates
from cwcli.stages.inputs.sources import SensorSignals

PLACE = LocalMap(48.0, 11.0, 0.0)
CONFIG_AUTO = EstimatorConfig(sensor_model="none")


@cache
def _signals() -> SensorSignals:
    """Four minutes of town at 48 degrees north, 11 degrees east."""
    sensors = simulate_scenario(load_scenario("city", ("sensors.imu.rate_hz=20",)), 1).sensors
    data = {name: (s.stamp_ns, s.log_time_ns, s.values) for name, s in sensors.items()}
    stamp_ns, log_ns, xyz = data["gnss"]
    latitude_deg, longitude_deg, _ = PLACE.wgs84_from_map(xyz[:, 0], xyz[:, 1], 0.0 * xyz[:, 2])
    nothing = np.full(len(stamp_ns), np.nan)
    position = PositionSignal(
        "/fix", stamp_ns, log_ns, latitude_deg, longitude_deg, nothing, np.full((len(stamp_ns), 3), np.nan)
    )
    stamp_ns, log_ns, heading = data["gnss_heading"]
    headings = HeadingSignal("/heading", stamp_ns, log_ns, heading[:, 0], np.full(len(stamp_ns), np.nan))
    stamp_ns, log_ns, speed = data["speed"]
    nothing = np.full(len(stamp_ns), np.nan)
    speeds = SpeedSignal("/speed", stamp_ns, log_ns, speed[:, 0], nothing, nothing, nothing)
    stamp_ns, log_ns, imu = data["imu"]
    unknown = np.full((len(stamp_ns), 3), np.nan)
    imus = ImuSignal("/imu", stamp_ns, log_ns, imu[:, :3], imu[:, 3:], unknown, unknown)
    found: dict[Role, Signal] = {
        Role.EGO_POSITION: position,
        Role.EGO_SPEED: speeds,
        Role.EGO_HEADING: headings,
        Role.IMU: imus,
    }
    return SensorSignals({role: (signal,) for role, signal in found.items()}, (), ())


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("latitude-longitude", lambda s: replace(s, latitude_deg=s.longitude_deg, longitude_deg=s.latitude_deg)),
        ("longitude-sign", lambda s: replace(s, longitude_deg=-s.longitude_deg)),
        ("latitude-sign", lambda s: replace(s, latitude_deg=-s.latitude_deg)),
        (
            "radians",
            lambda s: replace(s, latitude_deg=np.radians(s.latitude_deg), longitude_deg=np.radians(s.longitude_deg)),
        ),
    ],
)
def test_a_fault_of_latitude_and_longitude_is_corrected_and_the_map_with_it(
    name: str, fault: Callable[[PositionSignal], PositionSignal]
) -> None:
    (position,) = _signals().by_role[Role.EGO_POSITION]
    assert isinstance(position, PositionSignal)
    wrong = replace(_signals(), by_role={**_signals().by_role, Role.EGO_POSITION: (fault(position),)})
    sources, found = _undo_exchanged_or_reversed_coordinates(
        wrong, _estimate_ego(wrong, CONFIG_AUTO, 5.0), CONFIG_AUTO, 5.0
    )
    assert [(each.who.source, each.name) for each in found.hindsight.corrections] == [("/fix", name)]
    assert found.hindsight.contradictions == ()
    assert found.local_map is not None
    assert abs(found.local_map.origin_lat_deg - 48.0) < 1e-3
    assert abs(found.local_map.origin_lon_deg - 11.0) < 1e-3
    (moved,) = sources.by_role[Role.EGO_POSITION]
    assert isinstance(moved, PositionSignal)
    np.testing.assert_allclose(moved.latitude_deg, position.latitude_deg, rtol=1e-15)  # radians round the last bit


def test_right_latitudes_and_longitudes_stay_as_they_are() -> None:
    estimated = _estimate_ego(_signals(), CONFIG_AUTO, 5.0)
    assert _undo_exchanged_or_reversed_coordinates(_signals(), estimated, CONFIG_AUTO, 5.0) == (_signals(), estimated)
    assert estimated.hindsight.corrections == ()


def test_a_trusted_topic_keeps_its_exchanged_latitude_and_longitude() -> None:
    (position,) = _signals().by_role[Role.EGO_POSITION]
    assert isinstance(position, PositionSignal)
    fix = replace(position, latitude_deg=position.longitude_deg, longitude_deg=position.latitude_deg)
    wrong = replace(_signals(), by_role={**_signals().by_role, Role.EGO_POSITION: (fix,)})
    config = replace(CONFIG_AUTO, trusted_sources=("/fix",))
    sources, found = _undo_exchanged_or_reversed_coordinates(wrong, _estimate_ego(wrong, config, 5.0), config, 5.0)
    assert sources is wrong
    assert all(each.who.source != "/fix" for each in found.hindsight.corrections)
