"""Steering angles, and the roles of the lane's channels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from cwcli.channels.binding import bind_roles
from cwcli.channels.published import EGO_PATH, LANES, OBSERVER, OBSERVER_PATH
from cwcli.signals.canonical import SteerSignal
from cwcli.signals.role import Role
from tests.unit.signals.signal_columns import T0_NS, columns_of, stamp_fields
from tests.unit.signals.signal_columns import build_known_signal as build_signal


@dataclass(frozen=True)
class Channel:
    topic: str
    schema_name: str
    message_encoding: str = "cdr"


@pytest.mark.parametrize("package", ["autoware_vehicle_msgs", "autoware_auto_vehicle_msgs"])
def test_steering_report_has_its_stamp_without_a_header(package: str) -> None:
    fields = {
        "stamp.sec": [T0_NS // 10**9] * 3,
        "stamp.nanosec": [0, 20_000_000, 40_000_000],
        "steering_tire_angle": [0.01, np.nan, -0.02],
    }
    signal, quality = build_signal(Role.EGO_STEER, columns_of(f"{package}/msg/SteeringReport", fields))
    assert isinstance(signal, SteerSignal)
    np.testing.assert_array_equal(signal.steer_rad, [0.01, -0.02])
    np.testing.assert_array_equal(signal.stamp_ns - T0_NS, [0, 40_000_000])
    assert quality.rejected == {"value not a number": 1}


@pytest.mark.parametrize(
    ("role", "schema", "names"),
    [
        (Role.EGO_SPEED, "autoware_vehicle_msgs/msg/VelocityReport", ("longitudinal_velocity", "heading_rate")),
        (Role.EGO_STEER, "ackermann_msgs/msg/AckermannDriveStamped", ("drive.steering_angle",)),
    ],
)
def test_a_channel_without_a_row_is_an_empty_signal(role: Role, schema: str, names: tuple[str, ...]) -> None:
    fields = stamp_fields([]) | {name: np.zeros(0) for name in names}
    signal, quality = build_signal(role, columns_of(schema, fields))
    assert (len(signal.stamp_ns), quality.read, quality.used) == (0, 0, 0)


def test_an_angle_beyond_a_right_angle_is_out_of_range() -> None:
    fields = {"stamp.sec": [T0_NS // 10**9] * 2, "stamp.nanosec": [0, 1], "steering_tire_angle": [0.1, 25.0]}
    _, quality = build_signal(Role.EGO_STEER, columns_of("autoware_vehicle_msgs/msg/SteeringReport", fields))
    assert quality.rejected == {"value out of range": 1}


def test_ackermann_counts_only_when_it_is_named() -> None:
    channel = Channel("/drive", "ackermann_msgs/msg/AckermannDriveStamped")
    assert Role.EGO_STEER not in bind_roles([channel], {}, required=(), optional=(Role.EGO_STEER,))
    named = bind_roles([channel], {"ego_steer": "/drive"}, required=(Role.EGO_STEER,))
    assert named.first_topic_of_role(Role.EGO_STEER) == "/drive"
    columns = columns_of(
        channel.schema_name, stamp_fields([T0_NS, T0_NS + 10**8]) | {"drive.steering_angle": [0.1, 0.2]}
    )
    signal, _ = build_signal(Role.EGO_STEER, columns)
    assert isinstance(signal, SteerSignal)
    np.testing.assert_array_equal(signal.steer_rad, [0.1, 0.2])


def test_lanes_and_observer_are_bound_by_name_and_their_truth_by_its_segment() -> None:
    channels = [
        Channel("/cwcli/lanes", "cwcli.v1.Lanes", "protobuf"),
        Channel("/truth/boundaries", "cwcli.v1.Lanes", "protobuf"),
        Channel("/cwcli/observer", "cwcli.v1.LateralState", "protobuf"),
        Channel("/truth/lateral", "cwcli.v1.LateralState", "protobuf"),
        Channel("/cwcli/observer/path", "cwcli.v1.PredictedPath", "protobuf"),
        Channel("/cwcli/ego/path", "cwcli.v1.PredictedPath", "protobuf"),
    ]
    found = bind_roles(
        channels,
        {},
        required=(LANES.role, OBSERVER.role, Role.LATERAL_TRUTH, OBSERVER_PATH.role, EGO_PATH.role),
    )
    assert {role: found.first_topic_of_role(role) for role in found.by_role} == {
        "lanes": "/cwcli/lanes",
        "observer": "/cwcli/observer",
        "lateral_truth": "/truth/lateral",
        "observer_path": "/cwcli/observer/path",
        "ego_path": "/cwcli/ego/path",
    }
    assert (
        bind_roles(channels, {"lanes": "/truth/boundaries"}, required=(LANES.role,)).first_topic_of_role(LANES.role)
        == "/truth/boundaries"
    )
