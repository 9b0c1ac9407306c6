"""Fields that the user has mapped to a role: the grammar, units, times, and what does not fit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from cwcli.errors import UsageError
from cwcli.signals.mapping import merge_mapping_options, parse_field_mappings
from cwcli.signals.quality import Quality
from cwcli.signals.role import Role
from tests.unit.signals.signal_columns import T0_NS, build_mapped, columns_of, stamp_fields


def built(role: Role, text: str, fields: dict, **more) -> tuple[Any, Quality]:
    return build_mapped(role, columns_of("my_msgs/msg/Status", fields, **more), parse_field_mappings(role, text)[0])


@pytest.mark.parametrize(
    ("text", "expected_mps"),
    [
        ("/s:v", 36.0),
        ("/s:v*kmh", 10.0),
        ("/s:v/3.6", 10.0),
        ("/s:-v*0.5", -18.0),
        ("/s:v*1e-3+1.5", 1.536),
        ("/s:v*kmh-3.6kmh", 9.0),
        ("/s:v*2/4*.5", 9.0),
        ("s:v*mph", 36.0 * 0.44704),
    ],
)
def test_scale_offset_unit_and_sign(text: str, expected_mps: float) -> None:
    signal, quality = built(Role.EGO_SPEED, text, {"v": [36.0, 36.0], **stamp_fields([T0_NS, T0_NS + 1])})
    np.testing.assert_allclose(signal.speed_mps, [expected_mps] * 2)
    assert not quality.rejected and not quality.repaired


@pytest.mark.parametrize(
    "text",
    [
        *("/s:", "/s:v*", "/s:v**2", "/s:v*0", "/s:v/0", "/s:__import__('os')", "/s:v+w", "/s:2*v", "/s:v*kmh*", ":v"),
        *(
            "/s:v*deg",
            "/s:v*1e999",
            "/s:v@",
            "/s:v@t*min",
            "/s:v,w,x",
            "/s:v[x]",
            "/s:v[-1]",
            "/s:v[12345]",
            "/s:v kmh",
        ),
    ],
)
def test_what_is_no_mapping_is_refused(text: str) -> None:
    with pytest.raises(UsageError):
        parse_field_mappings(Role.EGO_SPEED, text)


@pytest.mark.parametrize("option", ["ego_speed", "ego_speed=/s", "remote=/s:v", "speed=/s:v"])
def test_option_that_maps_nothing_is_refused(option: str) -> None:
    with pytest.raises(UsageError):
        merge_mapping_options([option], [])


def test_compass_heading_becomes_one_from_east() -> None:
    signal, _ = built(Role.EGO_HEADING, "/c:-yaw*deg+90deg", {"yaw": [0.0, 90.0, 350.0]})
    np.testing.assert_allclose(signal.heading_rad, [math.pi / 2, 0.0, math.radians(100.0)], atol=1e-12)


def test_two_quantities_and_a_time_in_microseconds() -> None:
    micro = T0_NS // 1000 + np.array([0, 100_000])
    fields = {"lat": [481_000_000, 481_000_100], "lon": [115_000_000, 115_000_000], "t_us": micro}
    signal, quality = built(Role.EGO_POSITION, "/g:lat*1e-7,lon*1e-7@t_us*us", fields)
    np.testing.assert_allclose(signal.latitude_deg, [48.1, 48.10001], atol=1e-9)
    assert signal.stamp_ns.tolist() == (micro * 1000).tolist()
    assert not quality.rejected and not quality.repaired


def test_time_in_seconds_and_one_of_two_fields() -> None:
    seconds, _ = built(Role.EGO_SPEED, "/s:v@t", {"v": [1.0], "t": [T0_NS / 1e9]})
    pair, _ = built(Role.EGO_SPEED, "/s:v@at", {"v": [1.0], "at.sec": [T0_NS // 10**9], "at.nanosec": [5]})
    assert abs(int(seconds.stamp_ns[0]) - T0_NS) < 1000
    assert pair.stamp_ns.tolist() == [T0_NS + 5]


def test_without_a_time_the_log_times_count_and_are_no_repair() -> None:
    signal, quality = built(Role.EGO_SPEED, "/s:v", {"v": [1.0, 2.0]})
    assert signal.stamp_ns.tolist() == [T0_NS, T0_NS + 10**8]
    assert not quality.rejected and not quality.repaired


def test_element_of_a_sequence() -> None:
    signal, quality = built(Role.EGO_SPEED, "/s:data[1]", {"data": [[1.0, 2.0], [3.0], [5.0, 6.0]]})
    assert signal.speed_mps.tolist() == [2.0, 6.0]
    assert quality.rejected == {"value not a number": 1}


@pytest.mark.parametrize("text", ["/s:w", "/s:name", "/s:v[0]", "/s:data", "/s:v@w"])
def test_field_that_is_no_number_is_refused(text: str) -> None:
    fields = {"v": [1.0, 2.0], "name": ["a", "b"], "data": [[1.0], [2.0]]}
    with pytest.raises(UsageError, match="--map ego_speed="):
        built(Role.EGO_SPEED, text, fields)


def test_imu_takes_six() -> None:
    fields = {name: [float(k)] * 2 for k, name in enumerate(("ax", "ay", "az", "gx", "gy", "gz"), start=1)}
    signal, _ = built(Role.IMU, "/i:ax*g,ay*g,az*g,gx*degps,gy*degps,-gz*degps", fields)
    np.testing.assert_allclose(signal.accel_mps2[0], 9.80665 * np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(signal.gyro_radps[0], np.radians([4.0, 5.0, -6.0]))
    with pytest.raises(UsageError):
        parse_field_mappings(Role.IMU, "/i:ax,ay,az")


def test_absurd_values_are_counted() -> None:
    signal, quality = built(Role.EGO_SPEED, "/s:v", {"v": [1.0, np.nan, np.inf, 1e6]})
    assert signal.speed_mps.tolist() == [1.0]
    assert quality.rejected == {"value not a number": 2, "value out of range": 1}
