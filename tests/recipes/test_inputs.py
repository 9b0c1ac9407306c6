"""The recipes of a message type and of a sensor quantity, on a bundled log with one more channel."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from cwcli.logs.read.reader import Log
from tests.recipes.conftest import Built
from tests.recipes.house import SAMPLES

INTERSECTION = SAMPLES / "intersection.mcap"
SPEED = "/vehicle/velocity"
N = 201


def log_with(path: Path, topic: str, schema: str, message: Callable[[int], dict[str, Any]], without: str = "") -> Path:
    """The intersection with one more channel of JSON, a message with each speed, and perhaps without another."""
    channels: dict[int, int] = {}
    with INTERSECTION.open("rb") as source, path.open("wb") as target:
        writer = Writer(target)
        writer.start()
        own = writer.register_channel(topic, "json", writer.register_schema(schema, "jsonschema", b"{}"))
        k = 0
        for kind, channel, record in make_reader(source).iter_messages():
            if channel.topic == SPEED:
                sec, nanosec = divmod(record.log_time, 10**9)
                header = {"header": {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": "base_link"}}
                data = json.dumps(header | message(k)).encode()
                writer.add_message(own, record.log_time, data, record.publish_time)
                k += 1
            if channel.topic == without:
                continue
            if channel.id not in channels:
                assert kind is not None
                number = writer.register_schema(kind.name, kind.encoding, kind.data)
                channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, number)
            writer.add_message(channels[channel.id], record.log_time, record.data, record.publish_time)
        writer.finish()
    return path


def roles(document: dict[str, Any], topic: str) -> list[str]:
    return next(each["roles"] for each in document["channels"] if each["topic"] == topic)


def test_a_message_type_fills_its_role_and_stands_in_the_docs(built: Built, tmp_path: Path) -> None:
    house = built("A message type")
    with Log.open(INTERSECTION) as whole:
        speed_mps = np.asarray(whole.columns(SPEED).fields["longitudinal_velocity"])
    log = log_with(
        tmp_path / "d.mcap",
        "/can/steering",
        "dbw_mkz_msgs/msg/SteeringReport",
        lambda k: {"speed": float(speed_mps[k])},
        without=SPEED,
    )
    assert roles(json.loads(house.run("info", log, "--json")), "/can/steering") == ["ego_speed"]
    told = json.loads(house.run("run", log, "-o", "out.mcap", "--json"))
    inputs = {(each["topic"], each["role"]): each for each in told["stages"]["estimate"]["inputs"]}
    assert inputs["/can/steering", "ego_speed"]["used"] == N
    (house.folder / "p.toml").write_text('topic = ["ego_speed=/can/steering"]\n')
    assert "ego_speed=/can/steering" in house.run("config", "p.toml")
    assert "`dbw_mkz_msgs/SteeringReport`" in house.write_docs()
    house.obeys_its_laws()


def test_a_sensor_quantity_has_a_role_and_its_words_and_stands_in_the_docs(built: Built, tmp_path: Path) -> None:
    house = built("A sensor quantity")
    message: Callable[[int], dict[str, Any]] = lambda k: {"fluid_pressure": 1e4 * k, "variance": 0.0}  # noqa: E731
    log = log_with(tmp_path / "d.mcap", "/brake/pressure", "sensor_msgs/msg/FluidPressure", message)
    assert roles(json.loads(house.run("info", log, "--json")), "/brake/pressure") == ["ego_brake"]
    assert "ego_brake" in house.run("info", log)
    (house.folder / "p.toml").write_text('topic = ["ego_brake=/brake/pressure"]\n')
    assert "ego_brake=/brake/pressure" in house.run("config", "p.toml")
    house.run("run", log, "-o", "out.mcap", "--topic", "ego_brake=/brake/pressure")
    code = f"""
from cwcli.logs.read.reader import Log
from cwcli.signals.role import Role
from cwcli.stages.inputs.sources import SourceConfig, read_sensor_signals
for name in ({str(log)!r}, {str(INTERSECTION)!r}):
    with Log.open(name) as log:
        try:
            sources = read_sensor_signals(log, SourceConfig(), command="run", required=(Role.EGO_BRAKE,), optional=())
        except Exception as error:
            print(error)
        else:
            (signal,), (count,) = sources.by_role[Role.EGO_BRAKE], sources.input_message_counts()
            print(count.used, count.role, signal.pressure_mpa.max())
"""
    used, missed = house.python("-c", code).splitlines()
    number, role, largest_mpa = used.split()
    assert (int(number), role) == (N, "ego_brake")
    assert float(largest_mpa) == pytest.approx(2.0)
    assert "no channel holds the ego brake pressure (needed by `cwcli run`)" in missed
    assert "| ego_brake | `sensor_msgs/FluidPressure` |" in house.write_docs()
    house.obeys_its_laws()
