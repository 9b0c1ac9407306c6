"""OSI traces of made-up worlds, written with ASAM's own protobuf classes; every motion is known in closed form."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import cos, hypot, sin
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set
from osi3.osi_groundtruth_pb2 import GroundTruth
from osi3.osi_object_pb2 import MovingObject
from osi3.osi_sensorview_pb2 import SensorView

Motion = Callable[[float], tuple[float, float, float, float, float]]
"""Seconds -> x, y, yaw, speed along the yaw, acceleration along it."""


@dataclass(frozen=True)
class Actor:
    """A moving object.

    Attributes:
        id: Its id.
        motion: Where it is.
        size_m: Length and width; 0 is left out.
        kind: `MovingObject.Type`.
        rear_m: Rear axle ahead of the centre, None: left out.
    """

    id: int
    motion: Motion
    size_m: tuple[float, float] = (5.0, 2.0)
    kind: int = MovingObject.TYPE_VEHICLE
    rear_m: float | None = -1.4


def along(x_m: float, y_m: float, yaw_rad: float, speed_mps: float, accel_mps2: float = 0.0) -> Motion:
    """A straight way with a constant acceleration, and a stop where that ends."""

    def at(t_s: float) -> tuple[float, float, float, float, float]:
        stop_s = -speed_mps / accel_mps2 if accel_mps2 * speed_mps < 0.0 else float("inf")
        s = min(t_s, stop_s)
        way_m = speed_mps * s + 0.5 * accel_mps2 * s * s
        has_stopped = t_s >= stop_s
        return (
            x_m + way_m * cos(yaw_rad),
            y_m + way_m * sin(yaw_rad),
            yaw_rad,
            0.0 if has_stopped else speed_mps + accel_mps2 * s,
            0.0 if has_stopped else accel_mps2,
        )

    return at


def fill_world(
    world: Any, actors: Sequence[Actor], t_s: float, *, stamp_ns: int, host: int | None, at_m: tuple[float, float]
) -> None:
    """A GroundTruth at a time; the axes of the world begin at `at_m`."""
    world.version.version_major, world.version.version_minor = 3, 5
    world.timestamp.seconds, world.timestamp.nanos = divmod(stamp_ns, 10**9)
    if host is not None:
        world.host_vehicle_id.value = host
    for actor in actors:
        x_m, y_m, yaw_rad, speed_mps, accel_mps2 = actor.motion(t_s)
        made = world.moving_object.add()
        made.id.value, made.type = actor.id, actor.kind
        base = made.base
        base.position.x, base.position.y, base.position.z = x_m + at_m[0], y_m + at_m[1], 0.75
        base.orientation.yaw = yaw_rad
        base.velocity.x, base.velocity.y = speed_mps * cos(yaw_rad), speed_mps * sin(yaw_rad)
        base.acceleration.x, base.acceleration.y = accel_mps2 * cos(yaw_rad), accel_mps2 * sin(yaw_rad)
        base.orientation_rate.yaw = 0.0
        if actor.size_m[0]:
            base.dimension.length, base.dimension.width, base.dimension.height = *actor.size_m, 1.5
        if actor.rear_m is not None:
            made.vehicle_attributes.bbcenter_to_rear.x = actor.rear_m


def write_messages(path: Path, messages: Sequence[tuple[str, int, Any]]) -> Path:
    """A trace of (topic, stamp in ns, message), without the metadata that the format asks for: many tools forget it."""
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD)
        writer.start()
        channels: dict[str, int] = {}
        for topic, stamp_ns, message in messages:
            if topic not in channels:
                described = build_file_descriptor_set(type(message)).SerializeToString()
                schema = writer.register_schema(message.DESCRIPTOR.full_name, "protobuf", described)
                channels[topic] = writer.register_channel(topic, "protobuf", schema)
            data = message.SerializeToString()
            writer.add_message(channels[topic], log_time=stamp_ns, publish_time=stamp_ns, data=data)
        writer.finish()
    return path


def write_trace(
    path: Path,
    actors: Sequence[Actor],
    *,
    duration_s: float = 6.0,
    rate_hz: float = 30.3,
    start_ns: int = 0,
    host: int | None = None,
    at_m: tuple[float, float] = (0.0, 0.0),
    topic: str = "ground_truth",
    as_view: bool = False,
) -> Path:
    """A trace of GroundTruth messages, or of SensorViews with them inside."""
    messages: list[tuple[str, int, Any]] = []
    for k in range(int(duration_s * rate_hz) + 1):
        t_s = k / rate_hz
        stamp_ns = start_ns + round(t_s * 1e9)
        message = SensorView() if as_view else GroundTruth()
        world = message.global_ground_truth if as_view else message
        fill_world(world, actors, t_s, stamp_ns=stamp_ns, host=None if as_view else host, at_m=at_m)
        if as_view:
            message.timestamp.CopyFrom(world.timestamp)
            if host is not None:
                message.host_vehicle_id.value = host
        messages.append((topic, stamp_ns, message))
    return write_messages(path, messages)


def time_to_contact_s(one: Actor, other: Actor, t_s: float) -> float:
    """Of two boxes on one straight way with these velocities: gap over closing speed, NaN where they don't close."""
    x1, y1, yaw, v1, _ = one.motion(t_s)
    x2, y2, yaw2, v2, _ = other.motion(t_s)
    v2 *= cos(yaw2 - yaw)
    gap_m = hypot(x2 - x1, y2 - y1) - 0.5 * (one.size_m[0] + other.size_m[0])
    ahead = cos(yaw) * (x2 - x1) + sin(yaw) * (y2 - y1) > 0.0
    closing_mps = (v1 - v2) if ahead else (v2 - v1)
    return gap_m / closing_mps if closing_mps > 0.0 else float("nan")
