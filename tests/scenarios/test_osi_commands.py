"""Every command on OSI traces as tools write them: no host named, from zero, 30.3 Hz, no metadata, two hosts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import cos, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from osi3.osi_groundtruth_pb2 import GroundTruth
from osi3.osi_hostvehicledata_pb2 import HostVehicleData

from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_BAD_DATA, EXIT_MISSING_SIGNAL
from cwcli.logs.read.reader import Log
from tests.osi_traces import fill_world, write_messages, write_trace
from tests.scenarios.test_osi import HOST, LEAD, PARKED, WALKER
from tests.scenarios.test_osi_sensors import STEP_NS, detection

N = 120


def bare(path: Path) -> Path:
    return write_trace(path, (HOST, LEAD, PARKED, WALKER))


def view(path: Path) -> Path:
    return write_trace(path, (HOST, LEAD, WALKER), host=3, as_view=True, rate_hz=25.0)


def two_hosts(path: Path) -> Path:
    """The traces of two cars of one simulation in one channel."""
    messages: list[tuple[str, int, Any]] = []
    for k in range(N):
        for host in (3, 8) if k % 3 else (3,):
            world = GroundTruth()
            fill_world(world, (HOST, LEAD), k * STEP_NS / 1e9, stamp_ns=k * STEP_NS, host=host, at_m=(0.0, 0.0))
            messages.append(("ground_truth", k * STEP_NS, world))
    return write_messages(path, messages)


def sensor(path: Path) -> Path:
    return write_messages(path, [("SensorDataOut", k * STEP_NS + 20_000_000, detection(k)) for k in range(N)])


def own_data(path: Path) -> Path:
    """A car that knows where on the globe it is, and nothing of a simulated world: 10 m/s north-east."""
    messages: list[tuple[str, int, Any]] = []
    for k in range(N):
        message = HostVehicleData()
        message.timestamp.seconds, message.timestamp.nanos = divmod(k * STEP_NS, 10**9)
        way_m = 10.0 * k * STEP_NS / 1e9
        place = message.vehicle_localization.geodetic_position
        place.latitude, place.longitude = 48.0 + way_m * sin(0.8) / 111_200.0, 11.0 + way_m * cos(0.8) / 74_600.0
        place.altitude = 500.0
        message.vehicle_motion.velocity.x = 10.0
        messages.append(("host", k * STEP_NS, message))
    return write_messages(path, messages)


TRACES: dict[str, Callable[[Path], Path]] = {
    "bare": bare,
    "view": view,
    "two hosts": two_hosts,
    "sensor": sensor,
    "own data": own_data,
}
COMMANDS = [
    ["info", "TRACE"],
    ["info", "TRACE", "--doctor"],
    ["estimate", "TRACE", "--metrics", "OUT.csv"],
    ["calibrate", "TRACE", "-o", "OUT.toml"],
    *(["predict", "RUN"], ["measure", "RUN"], ["warn", "RUN"], ["control", "RUN"], ["evaluate", "RUN"]),
    ["report", "RUN", "-o", "OUT.html"],
    ["layout", "RUN", "-o", "OUT.json"],
    ["compare", "RUN", "RUN"],
    ["plot", "RUN", "--what", "map", "-o", "OUT.png"],
    *(["export", "RUN", "--format", name, "-o", f"OUT.{name}"] for name in ("csv", "parquet", "tum", "kitti", "osi")),
]
LACKS = {
    "sensor": {"warn", "control"},  # targets have a stage of their own
    "own data": {"warn", "measure", "control"},
}
"""Of nobody else, nothing can be said."""


@pytest.mark.parametrize("name", TRACES)
def test_every_command_works_on_an_osi_trace(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trace, ran = TRACES[name](tmp_path / "trace.mcap"), tmp_path / "run.mcap"
    assert run_command_line(["run", str(trace), "-o", str(ran), "--quiet"]) == 0, capsys.readouterr().err
    for k, command in enumerate(COMMANDS):
        words = {"TRACE": str(trace), "RUN": str(ran)}
        line = [words.get(word, word.replace("OUT", str(tmp_path / f"made{k}"))) for word in command]
        expected = EXIT_MISSING_SIGNAL if command[0] in LACKS.get(name, ()) else 0
        assert run_command_line(line) == expected, (command, capsys.readouterr().err)
        capsys.readouterr()


def test_a_place_on_the_globe_alone_is_a_fix(tmp_path: Path) -> None:
    trace, out = own_data(tmp_path / "trace.mcap"), tmp_path / "out.mcap"
    assert run_command_line(["estimate", str(trace), "-o", str(out), "--quiet"]) == 0
    with Log.open(out) as log:
        states: Mapping[str, Any] = log.columns("/cwcli/ego/state").fields
    np.testing.assert_allclose(states["latitude_deg"][[0, -1]], [48.0, 48.0 + 59.5 * sin(0.8) / 111_200.0], atol=1e-5)
    np.testing.assert_allclose(states["speed_mps"][10:], 10.0, atol=0.05)
    np.testing.assert_allclose(states["heading_rad"][10:], 0.8, atol=0.02)
    assert run_command_line(["export", str(out), "--format", "gpx", "-o", str(tmp_path / "a.gpx"), "--quiet"]) == 0


def test_traces_of_no_place_on_the_globe_are_no_maps(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trace, out = bare(tmp_path / "trace.mcap"), tmp_path / "out.mcap"
    assert run_command_line(["estimate", str(trace), "-o", str(out), "--quiet"]) == 0
    assert run_command_line(["export", str(out), "--format", "gpx", "-o", str(tmp_path / "a.gpx")]) == EXIT_BAD_DATA
    assert "no place on the earth" in capsys.readouterr().err


def test_of_two_hosts_the_one_of_most_messages_is_the_ego(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trace, out = two_hosts(tmp_path / "trace.mcap"), tmp_path / "out.mcap"
    assert run_command_line(["estimate", "--details", str(trace), "-o", str(out)]) == 0
    told = " ".join(capsys.readouterr().err.split())
    assert "several host vehicles, 3 (120 messages), 8 (80 messages): 3 is the ego" in told
    with Log.open(out) as log:
        states: Mapping[str, Any] = log.columns("/cwcli/ego/state").fields
        others: Mapping[str, Any] = log.columns("/cwcli/remote/state").fields
    assert others["id"].values == ("8",)
    x_m, y_m, *_ = HOST.motion(states["stamp_ns"][50] / 1e9)
    np.testing.assert_allclose([states["x_m"][50], states["y_m"][50]], [x_m, y_m], atol=0.02)
