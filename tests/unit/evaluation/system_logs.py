"""Logs in which the ego meets many others, and in which another system warns: the messages by the official writers."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import Writer
from mcap_ros2.writer import Writer as Ros2Writer

from cwcli.channels.published import EGO_STATE, REMOTE_STATE
from cwcli.channels.vehicle_state import VehicleStates, make_vehicle_state_channel
from cwcli.logs.read.reader import Log
from cwcli.signals.columns import OutputChannel, encode_strings
from tests.unit.evaluation.small_logs import T0_NS

STEP_NS = 50_000_000
SPEED_MPS = 10.0
EVERY_S = 10.0
"""Between two meetings."""
CONFLICT_S = 2.5 / (SPEED_MPS * 2.0**0.5)
"""From when the centres are 2.5 m apart to when they would meet, at right angles at 10 m/s each."""


def meetings_s(n: int) -> list[float]:
    """When the ego meets each of n others, seconds from the start."""
    return [EVERY_S * (k + 1) for k in range(n)]


def states_of_meetings(n: int) -> list[OutputChannel]:
    """The ego goes east at 10 m/s; in its way it meets one car after the other, each going north at 10 m/s."""
    end_s = EVERY_S * (n + 1)
    stamp_ns = T0_NS + STEP_NS * np.arange(round(end_s * 1e9) // STEP_NS + 1)
    time_s = (stamp_ns - T0_NS) / 1e9
    ego = np.zeros((len(stamp_ns), 8))
    ego[:, 0], ego[:, 2] = SPEED_MPS * time_s, SPEED_MPS
    rows: list[tuple[int, str, Any]] = []
    for k, meeting_s in enumerate(meetings_s(n)):
        for at_ns, at_s in zip(stamp_ns.tolist(), time_s.tolist(), strict=True):
            if abs(at_s - meeting_s) <= 5.0:
                state = np.zeros(8)
                state[[0, 1, 2, 3]] = SPEED_MPS * meeting_s, SPEED_MPS * (at_s - meeting_s), SPEED_MPS, np.pi / 2
                rows.append((at_ns, str(k + 1), state))
    rows.sort(key=lambda row: row[0])
    covariance = np.eye(8)
    own = VehicleStates.from_ego_states(stamp_ns, ego, np.tile(covariance, (len(ego), 1, 1)))
    others = replace(
        VehicleStates.from_ego_states(
            np.array([row[0] for row in rows], np.int64),
            np.array([row[2] for row in rows]),
            np.tile(covariance, (len(rows), 1, 1)),
        ),
        ids=encode_strings([row[1] for row in rows]),
    )
    return [make_vehicle_state_channel(EGO_STATE, own, None), make_vehicle_state_channel(REMOTE_STATE, others, None)]


def at_ns(seconds: float) -> int:
    return T0_NS + round(seconds * 1e9)


def is_up(spans_s: Sequence[tuple[float, float]], seconds: float) -> bool:
    return any(first - 1e-9 <= seconds < last - 1e-9 for first, last in spans_s)


def ticks(end_s: float, rate_hz: float = 50.0) -> list[float]:
    return [k / rate_hz for k in range(round(end_s * rate_hz))]


def bool_log(path: Path, spans_s: Sequence[tuple[float, float]], end_s: float, rate_hz: float = 50.0) -> Path:
    """`/adas/fcw`, a std_msgs/Bool as ROS 2 writes it."""
    messages = [(at, {"data": is_up(spans_s, at)}) for at in ticks(end_s, rate_hz)]
    return ros_log(path, "std_msgs/msg/Bool", "bool data", messages)


def ros_log(
    path: Path, schema: str, definition: str, messages: Iterable[tuple[float, Any]], topic: str = "/adas/fcw"
) -> Path:
    with path.open("wb") as stream:
        writer = Ros2Writer(stream)
        registered = writer.register_msgdef(schema, definition)
        for at, message in messages:
            writer.write_message(topic, registered, message, log_time=at_ns(at), publish_time=at_ns(at))
        writer.finish()
    return path


def json_log(path: Path, messages: Iterable[tuple[float, Any]], topic: str = "/adas/fcw", schema: str = "Any") -> Path:
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel(topic, "json", writer.register_schema(schema, "jsonschema", b"{}"))
        for at, message in messages:
            data = message if isinstance(message, bytes) else json.dumps(message).encode()
            writer.add_message(channel, at_ns(at), data, at_ns(at))
        writer.finish()
    return path


def with_meetings(path: Path, n: int) -> Log:
    """The log with the states of n meetings in memory."""
    return Log.open(path).with_channels(states_of_meetings(n))
