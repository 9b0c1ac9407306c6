"""OSI messages as signals: the host, the others, and what simulators leave out. The laws of all inputs hold beside."""

from __future__ import annotations

from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from osi3.osi_groundtruth_pb2 import GroundTruth
from osi3.osi_object_pb2 import MovingObject
from osi3.osi_sensordata_pb2 import SensorData

from cwcli.channels.binding import bind_roles
from cwcli.logs.read.reader import Log
from cwcli.signals.build import build_signal
from cwcli.signals.canonical import PoseSignal, RemoteSignal, SpeedSignal
from cwcli.signals.quality import Quality
from cwcli.signals.role import Role
from tests.osi_traces import Actor, along, fill_world, write_messages, write_trace

PARKED = Actor(1, along(60.0, 5.0, 0.0, 0.0))
CAR = Actor(4, along(0.0, 0.0, 0.0, 15.0, -1.0))
OTHER = Actor(9, along(80.0, 0.0, pi, 10.0))


def read(path: Path, role: Role, **how: Any) -> tuple[Any, Quality]:
    with Log.open(path) as log:
        columns = log.columns(log.channels[0].topic)
    return build_signal(role, columns, **how)


@pytest.mark.parametrize(
    ("actors", "host", "station", "expected", "told"),
    [
        ((PARKED, CAR, OTHER), 9, None, 80.0, ""),
        ((PARKED, CAR, OTHER), None, None, 0.0, "4, the smallest id of a vehicle that moves"),
        ((PARKED, CAR, OTHER), 77, None, 0.0, "4, the smallest id of a vehicle that moves"),
        ((PARKED, CAR, OTHER), 9, "1", 60.0, ""),
        ((PARKED,), None, None, 60.0, "1, the smallest id of a vehicle (none moves)"),
        ((PARKED, Actor(0, CAR.motion, kind=MovingObject.TYPE_PEDESTRIAN), OTHER), None, None, 80.0, "9, the smallest"),
    ],
)
def test_host_is_who_is_named_or_the_first_vehicle_that_drives(
    tmp_path: Path, actors, host, station, expected, told
) -> None:
    path = write_trace(tmp_path / "a.mcap", actors, host=host, duration_s=2.0)
    signal, quality = read(path, Role.EGO_POSITION, ego_station=station)
    assert signal.x_m[0] == expected
    assert told in " ".join(quality.notes)
    assert bool(told) == bool(quality.notes)
    others, _ = read(path, Role.TARGET_TRUTH, ego_station=station) if len(actors) > 1 else (None, None)
    if others is not None:
        assert expected not in others.x_m[: len(actors) - 1]


def test_a_station_that_is_no_object_is_not_replaced_by_another(tmp_path: Path) -> None:
    path = write_trace(tmp_path / "a.mcap", (CAR, OTHER), host=4, duration_s=1.0)
    _, quality = read(path, Role.EGO_POSITION, ego_station="5")
    assert (quality.used, quality.set_aside) == (0, {"without the host vehicle": quality.read})


def test_two_hosts_in_a_channel_are_told_and_one_of_them_is_taken(tmp_path: Path) -> None:
    messages = []
    for k in range(60):
        message = GroundTruth()
        fill_world(message, (CAR, OTHER), k / 20, stamp_ns=k * 50_000_000, host=9 if k % 3 == 0 else 4, at_m=(0.0, 0.0))
        messages.append(("ground_truth", k * 50_000_000, message))
    path = write_messages(tmp_path / "a.mcap", messages)
    signal, quality = read(path, Role.EGO_POSITION)
    assert quality.set_aside == {"of another host vehicle": 20}
    assert (signal.x_m < 40.0).all()
    assert any("4 (40 messages), 9 (20 messages): 4 is the ego" in note for note in quality.notes)


def test_simulated_time_begins_at_zero(tmp_path: Path) -> None:
    for role in (Role.EGO_POSITION, Role.EGO_SPEED, Role.REMOTE):
        signal, quality = read(write_trace(tmp_path / f"{role}.mcap", (CAR, OTHER), duration_s=1.0), role)
        assert signal.stamp_ns.tolist() == [round(k / 30.3 * 1e9) for k in range(31)]
        assert not quality.rejected and not quality.repaired


def test_reversing_is_a_negative_speed_and_a_course_to_the_side_is_a_pedestrians_heading(tmp_path: Path) -> None:
    walker = Actor(2, along(10.0, 0.0, pi / 2, 1.4), size_m=(0.5, 0.6), kind=MovingObject.TYPE_PEDESTRIAN, rear_m=None)
    reversing = Actor(3, along(30.0, 0.0, 0.5, -2.0))
    path = write_trace(tmp_path / "a.mcap", (CAR, walker, reversing), host=4, duration_s=1.0)
    signal, _ = read(path, Role.REMOTE)
    of = {name: signal.station.codes == code for code, name in enumerate(signal.station.values)}
    np.testing.assert_allclose(signal.speed_mps[of["3"]], -2.0)
    np.testing.assert_allclose(signal.heading_rad[of["3"]], 0.5)
    np.testing.assert_allclose(signal.speed_mps[of["2"]], 1.4)
    np.testing.assert_allclose(signal.heading_rad[of["2"]], pi / 2)
    assert (signal.length_m[of["2"]], signal.width_m[of["2"]])[0][0] == 0.5

    def turned_aside(world: GroundTruth) -> None:
        world.moving_object[1].base.orientation.yaw = 0.0  # looks along x, and steps to the left

    signal, _ = read(changed(tmp_path / "b.mcap", (CAR, walker), turned_aside), Role.REMOTE)
    np.testing.assert_allclose(signal.heading_rad, pi / 2)
    np.testing.assert_allclose(signal.speed_mps, 1.4)


def changed(path: Path, actors: tuple[Actor, ...], change: Any, n: int = 40) -> Path:
    messages = []
    for k in range(n):
        message = GroundTruth()
        fill_world(message, actors, k / 20, stamp_ns=k * 50_000_000, host=actors[0].id, at_m=(0.0, 0.0))
        change(message)
        messages.append(("ground_truth", k * 50_000_000, message))
    return write_messages(path, messages)


def test_a_velocity_that_is_left_out_is_none(tmp_path: Path) -> None:
    def without(world: GroundTruth) -> None:
        for each in world.moving_object:
            each.base.ClearField("velocity")
            each.base.ClearField("acceleration")
            each.base.ClearField("dimension")

    path = changed(tmp_path / "a.mcap", (CAR, PARKED), without)
    speed, _ = read(path, Role.EGO_SPEED)
    assert np.isnan(speed.speed_mps).all()
    remote, _ = read(path, Role.REMOTE)
    assert (remote.speed_mps == 0.0).all()  # it stands: that it has none is what it says
    assert np.isnan(remote.length_m).all()


def test_a_yaw_that_is_left_out_is_the_course(tmp_path: Path) -> None:
    north = Actor(4, along(0.0, 0.0, pi / 2, 12.0))

    def without(world: GroundTruth) -> None:
        world.moving_object[0].base.ClearField("orientation")

    path = changed(tmp_path / "a.mcap", (north, PARKED), without)
    pose, _ = read(path, Role.EGO_POSITION)
    np.testing.assert_allclose(pose.yaw_rad, pi / 2)
    speed, _ = read(path, Role.EGO_SPEED)
    np.testing.assert_allclose(speed.speed_mps, 12.0)


def test_objects_without_a_place_and_ids_given_twice_are_left_out_and_told(tmp_path: Path) -> None:
    def spoil(world: GroundTruth) -> None:
        twin = world.moving_object.add()
        twin.CopyFrom(world.moving_object[1])
        twin.base.position.x += 5.0
        lost = world.moving_object.add()
        lost.CopyFrom(world.moving_object[1])
        lost.id.value, lost.base.position.x = 5, float("nan")

    signal, quality = read(changed(tmp_path / "a.mcap", (CAR, OTHER), spoil), Role.REMOTE)
    assert signal.station.values == ("9",)
    assert quality.notes == [
        "40 objects without a usable position left out",
        "40 objects are in their message twice: the first counts",
    ]
    assert signal.x_m is not None
    np.testing.assert_allclose(signal.x_m[0], 80.0)


def test_size_and_place_far_from_the_origin_are_kept(tmp_path: Path) -> None:
    path = write_trace(tmp_path / "a.mcap", (CAR, OTHER), host=4, at_m=(691_000.25, 5_336_000.5), duration_s=1.0)
    pose, _ = read(path, Role.EGO_POSITION)
    assert isinstance(pose, PoseSignal)
    assert (pose.x_m[0], pose.y_m[0], pose.size_m) == (691_000.25, 5_336_000.5, (5.0, 2.0))
    remote, _ = read(path, Role.REMOTE)
    assert isinstance(remote, RemoteSignal)
    assert remote.frame_id == pose.frame_id == "osi"


def test_a_view_names_the_host_that_carries_its_sensor(tmp_path: Path) -> None:
    path = write_trace(tmp_path / "a.mcap", (CAR, OTHER), host=9, as_view=True, duration_s=1.0)
    speed, quality = read(path, Role.EGO_SPEED)
    assert isinstance(speed, SpeedSignal)
    np.testing.assert_allclose(speed.speed_mps, 10.0)
    assert not quality.notes


def test_a_host_is_known_by_every_digit_of_its_id(tmp_path: Path) -> None:
    host = 2**53 + 1  # next to it 2^53 is a float64, it is none
    data = SensorData()
    view = data.sensor_view.add()
    view.host_vehicle_id.value = host
    actors = (PARKED, CAR, Actor(host, OTHER.motion), Actor(2**53, PARKED.motion))
    fill_world(view.global_ground_truth, actors, 0.0, stamp_ns=0, host=None, at_m=(0.0, 0.0))
    signal, quality = read(write_messages(tmp_path / "a.mcap", [("sensor_data", 0, data)]), Role.EGO_SPEED)
    np.testing.assert_allclose(signal.speed_mps, [10.0])
    assert not quality.notes


def test_a_ground_truth_fills_every_role_whatever_its_topic_is_called(tmp_path: Path) -> None:
    for topic in ("ground_truth", "/osi/world", "/truth"):
        with Log.open(write_trace(tmp_path / "a.mcap", (CAR, OTHER), topic=topic, duration_s=1.0)) as log:
            bound = bind_roles(log.channels, {}, required=(Role.EGO_POSITION, Role.EGO_SPEED, Role.REMOTE, Role.TRUTH))
            assert {bindings[0].topic for bindings in bound.by_role.values()} == {topic}


def test_what_stands_still_and_where_the_world_lies_is_told_and_not_used(tmp_path: Path) -> None:
    def add(world: GroundTruth) -> None:
        world.proj_string = "+proj=utm +zone=32"
        for number in (100, 101, 102):
            still = world.stationary_object.add()
            still.id.value = number
            still.base.position.x = 20.0

    path = changed(tmp_path / "a.mcap", (CAR, OTHER), add)
    signal, quality = read(path, Role.REMOTE)
    assert signal.station.values == ("9",)
    assert quality.notes == [
        "3 stationary objects (in 40 messages) are left out: road users are moving objects",
        "the map projection (proj_string) is not used: positions stay in the simulated plane",
    ]


def test_detections_of_what_stands_still_are_counted(tmp_path: Path) -> None:
    message = SensorData()
    message.timestamp.seconds = 1
    message.moving_object.add().base.position.x = 10.0
    for x_m in (0.0, 5.0):
        message.stationary_object.add().base.position.x = x_m
    write_messages(tmp_path / "a.mcap", [("sensor", 10**9, message)])
    signal, quality = read(tmp_path / "a.mcap", Role.DETECTIONS)
    assert len(signal.values) == 1
    assert "2 detections of stationary objects are left out: road users are moving objects" in quality.notes


@pytest.mark.parametrize(
    ("path", "value", "told"),
    [
        ("base.orientation_rate.yaw", 1e300, "yaw rate out of range, left out"),
        ("base.orientation_rate.yaw", -float("inf"), "yaw rate out of range, left out"),
        ("base.orientation.yaw", 1e300, "yaw out of range, left out"),
        ("base.velocity.x", 1e12, "velocity out of range, left out"),
        ("base.acceleration.y", -1e12, "acceleration out of range, left out"),
        ("base.dimension.length", 1e9, "size out of range, left out"),
        ("vehicle_attributes.bbcenter_to_rear.x", 1e200, "rear axle out of range, left out"),
    ],
)
@pytest.mark.parametrize("is_of_host", [True, False])
def test_values_that_no_road_user_has_are_left_out_and_counted(tmp_path: Path, path, value, told, is_of_host) -> None:
    """In the roles of the object that has them, and in no other."""
    messages: list[tuple[str, int, Any]] = []
    for k in range(20):
        world = GroundTruth()
        fill_world(world, (CAR, OTHER), k / 10, stamp_ns=k * 10**8, host=CAR.id, at_m=(0.0, 0.0))
        *parts, leaf = path.split(".")
        holder = world.moving_object[0 if is_of_host else 1]
        for part in parts:
            holder = getattr(holder, part)
        if k >= 15:
            setattr(holder, leaf, value)
        messages.append(("/world", k * 10**8, world))
    trace = write_messages(tmp_path / "a.mcap", messages)
    for role in (Role.EGO_POSITION, Role.EGO_SPEED, Role.TRUTH, Role.REMOTE, Role.TARGET_TRUTH):
        signal, quality = read(trace, role)
        is_concerned = is_of_host == (role in (Role.EGO_POSITION, Role.EGO_SPEED, Role.TRUTH))
        assert quality.repaired == ({told: 5} if is_concerned else {}), role
        for name in ("yaw_rate_radps", "speed_mps", "accel_mps2", "yaw_rad", "heading_rad", "length_m", "vx_mps"):
            found = getattr(signal, name, None)
            if found is not None:
                assert not np.any(np.abs(found) > 1e3), name
