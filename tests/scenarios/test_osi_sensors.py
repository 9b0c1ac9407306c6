"""OSI traces in which the host has sensors of its own: detections become targets, its own data the ego."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
from osi3.osi_groundtruth_pb2 import GroundTruth
from osi3.osi_hostvehicledata_pb2 import HostVehicleData
from osi3.osi_sensordata_pb2 import SensorData

from cwcli.cli.main import run_command_line
from cwcli.logs.read.reader import Log
from cwcli.pipeline.records import read_input_counts, read_run_records
from tests.osi_traces import Actor, along, fill_world, write_messages

HOST = Actor(3, along(0.0, 0.0, pi / 2, 10.0), size_m=(4.4, 1.9), rear_m=-1.3)
OTHER = Actor(8, along(2.0, 30.0, pi / 2, 8.0))
STEP_NS = 50_000_000


def detection(k: int) -> SensorData:
    """A sensor 3.5 m ahead of the rear axle that sees the other's centre; its message comes 20 ms later."""
    t_s = k * STEP_NS / 1e9
    message = SensorData()
    message.timestamp.seconds, message.timestamp.nanos = divmod(k * STEP_NS + 20_000_000, 10**9)
    measured = message.last_measurement_time
    measured.seconds, measured.nanos = divmod(k * STEP_NS, 10**9)
    message.mounting_position.position.x = 3.5
    fill_world(
        message.sensor_view.add().global_ground_truth, (HOST, OTHER), t_s, stamp_ns=k * STEP_NS, host=3, at_m=(0.0, 0.0)
    )
    (x1, y1, *_), (x2, y2, *_) = HOST.motion(t_s), OTHER.motion(t_s)
    seen = message.moving_object.add()
    seen.base.position.x, seen.base.position.y = (y2 - y1) + 1.3 - 3.5, -(x2 - x1)  # the car drives north
    seen.base_rmse.position.x = seen.base_rmse.position.y = 0.05
    return message


def own(k: int) -> HostVehicleData:
    message = HostVehicleData()
    message.timestamp.seconds, message.timestamp.nanos = divmod(k * STEP_NS, 10**9)
    x_m, y_m, yaw_rad, speed_mps, _ = HOST.motion(k * STEP_NS / 1e9)
    place = message.vehicle_localization
    place.position.x, place.position.y, place.orientation.yaw = x_m, y_m, yaw_rad
    message.vehicle_motion.velocity.x = speed_mps
    return message


def test_detections_become_targets_about_the_middle_of_the_car(tmp_path: Path) -> None:
    messages: list[tuple[str, int, Any]] = [
        ("SensorDataOut", k * STEP_NS + 20_000_000, detection(k)) for k in range(120)
    ]
    trace, out = write_messages(tmp_path / "trace.mcap", messages), tmp_path / "out.mcap"
    assert run_command_line(["run", str(trace), "--stage", "estimate,track,measure", "-o", str(out), "--quiet"]) == 0
    with Log.open(out) as log:
        targets: Mapping[str, Any] = log.columns("/cwcli/targets").fields
        ego: Mapping[str, Any] = log.columns("/cwcli/ego/state").fields
    late = targets["stamp_ns"] > 3_000_000_000
    t_s = targets["stamp_ns"][late] / 1e9
    expected = np.array([OTHER.motion(t)[:2] for t in t_s])
    assert late.sum() > 30
    np.testing.assert_allclose(np.column_stack([targets["x_m"], targets["y_m"]])[late], expected, atol=0.1)
    assert ego["length_m"][0] == 4.4


def test_the_hosts_own_data_come_before_the_truth(tmp_path: Path) -> None:
    messages: list[tuple[str, int, Any]] = []
    for k in range(120):
        world = GroundTruth()
        fill_world(world, (HOST, OTHER), k * STEP_NS / 1e9, stamp_ns=k * STEP_NS, host=3, at_m=(0.0, 0.0))
        messages += [("/world", k * STEP_NS, world), ("/host", k * STEP_NS, own(k))]
    trace, out = write_messages(tmp_path / "trace.mcap", messages), tmp_path / "out.mcap"
    assert run_command_line(["estimate", str(trace), "-o", str(out), "--quiet"]) == 0
    with Log.open(out) as log:
        used = {str(each["role"]): each["topic"] for each in read_input_counts(read_run_records(log)["estimate"])}
        states: Mapping[str, Any] = log.columns("/cwcli/ego/state").fields
        others: Mapping[str, Any] = log.columns("/cwcli/remote/state").fields
    middle = len(states["stamp_ns"]) // 2
    x_m, y_m, *_ = HOST.motion(states["stamp_ns"][middle] / 1e9)
    np.testing.assert_allclose((states["x_m"][middle], states["y_m"][middle]), (x_m, y_m), atol=0.1)
    assert others["id"].values == ("8",)
    assert used == {"ego_position": "/host", "ego_speed": "/host", "remote": "/world", "truth": "/world"}
