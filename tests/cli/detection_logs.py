"""Logs with detections, written by the official writer: what a sensor on the ego of a bundled drive would have seen."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer

from cwcli.logs.read.reader import Log

MS = 1_000_000
T0_NS = 1_700_000_000_000_000_000
DELAY_NS = 5 * MS
LIDAR, RADAR = "/lidar/objects", "/radar/objects"
RADAR_MOUNT_M = 3.6
SCHEMA = "cwcli.Detections"
TRUTH = "/simulation/vehicles"


def stamp(stamp_ns: int) -> dict[str, int]:
    return {"sec": int(stamp_ns) // 10**9, "nsec": int(stamp_ns) % 10**9}


def scan(stamp_ns: int, detections: Sequence[Any], frame: str = "") -> dict[str, Any]:
    return {"timestamp": stamp(stamp_ns), "frame_id": frame, "detections": list(detections)}


def add_scans(writer: Writer, topic: str, scans: Iterable[tuple[int, dict[str, Any]]]) -> None:
    """Add a channel of JSON detections; each scan comes with its log time."""
    schema = writer.register_schema(SCHEMA, "jsonschema", b"{}")
    channel = writer.register_channel(topic, "json", schema)
    for log_time_ns, message in scans:
        writer.add_message(channel, log_time_ns, json.dumps(message).encode(), log_time_ns)


def write_scans(path: Path, channels: dict[str, list[tuple[int, dict[str, Any]]]]) -> Path:
    """A log of nothing but JSON detections."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        for topic, scans in channels.items():
            add_scans(writer, topic, scans)
        writer.finish()
    return path


def at_rate(scans: Iterable[Sequence[Any]], *, period_ns: int = 100 * MS, frame: str = "") -> list[Any]:
    """Scans at a steady rate, each logged 5 ms after its stamp."""
    out = []
    for k, detections in enumerate(scans):
        at = T0_NS + k * period_ns
        out.append((at + DELAY_NS, scan(at, detections, frame)))
    return out


def with_detections(source: Path, target: Path, seed: int = 1, *, is_empty: bool = False) -> Path:
    """A bundled drive with a lidar and a radar on its ego that see the other vehicle.

    The lidar stands at the origin of the car, the radar 3.6 m ahead of it. The range rate is that of the moving sensor.
    With `is_empty` every scan is empty.
    """
    rng = np.random.default_rng(seed)
    with Log.open(source) as log:
        loaded = log.load_topics({"/truth/ego": None, TRUTH: None})
    columns = ("stamp_ns", "x_m", "y_m", "speed_mps", "heading_rad", "yaw_rate_radps")
    ego, other = (
        np.column_stack([np.asarray(loaded[topic].fields[name]) for name in columns]) for topic in ("/truth/ego", TRUTH)
    )
    stamps = np.asarray(loaded["/truth/ego"].fields["stamp_ns"]).astype(np.int64)
    assert np.array_equal(stamps, np.asarray(loaded[TRUTH].fields["stamp_ns"]).astype(np.int64))
    lidar, radar = [], []
    for k, stamp_ns in enumerate(stamps.tolist()):
        _, x, y, v, h, w = ego[k]
        _, ox, oy, ov, oh, _ = other[k]
        turn = np.array([[np.cos(h), np.sin(h)], [-np.sin(h), np.cos(h)]])
        place = turn @ (ox - x, oy - y)
        if k % 2 == 0:
            seen = place + 0.15 * rng.standard_normal(2)
            lidar.append((stamp_ns + DELAY_NS, scan(stamp_ns, [{"x_m": seen[0], "y_m": seen[1]}])))
            continue
        place = place - (RADAR_MOUNT_M, 0.0)
        velocity = turn @ (ov * np.cos(oh), ov * np.sin(oh)) - (v, w * RADAR_MOUNT_M)
        reach = np.hypot(*place)
        exact = (reach, np.arctan2(place[1], place[0]), place @ velocity / reach)
        seen = exact + rng.standard_normal(3) * (0.25, 0.01, 0.12)
        names = ("range_m", "azimuth_rad", "range_rate_mps")
        radar.append((stamp_ns + DELAY_NS, scan(stamp_ns, [dict(zip(names, seen, strict=True))])))
    if is_empty:
        lidar, radar = ([(at, {**message, "detections": []}) for at, message in scans] for scans in (lidar, radar))
    with source.open("rb") as stream, target.open("wb") as out:
        writer = Writer(out)
        writer.start()
        known: dict[int, int] = {}
        for schema, channel, message in make_reader(stream).iter_messages():
            if channel.id not in known:
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data) if schema else 0
                known[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, schema_id)
            writer.add_message(known[channel.id], message.log_time, message.data, message.publish_time)
        add_scans(writer, LIDAR, lidar)
        add_scans(writer, RADAR, radar)
        writer.finish()
    return target


def summary(done: Any) -> Any:
    assert done.returncode == 0, done.stderr.decode()
    return json.loads(done.stdout)["stages"]["track"]


def rejected(told: Any) -> dict[str, dict[str, int]]:
    """Topic -> reason -> count, of the detections themselves."""
    return {entry["topic"]: entry["rejected"] for entry in told["inputs"] if entry["role"] == "each detection"}


def counted(told: Any) -> bool:
    return all(e["read"] == e["used"] + sum(e["rejected"].values()) for e in told["inputs"])


def targets_of(path: Path) -> list[tuple[int, bytes]]:
    """Every message of the targets' channels, by the official reader with CRC validation."""
    reader = make_reader(io.BytesIO(path.read_bytes()), validate_crcs=True)
    return [(m.log_time, m.data) for _, _, m in reader.iter_messages(topics=["/cwcli/targets"])]
