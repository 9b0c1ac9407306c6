"""Annotating a log against reading and rewriting it with the official library, in one run.

    python tests/bench/bench_annotate.py                 # two minutes of driving, about 60 MB
    python tests/bench/bench_annotate.py --seconds 600   # the ten-minute log

The log holds JPEG 640x480 at 10 Hz, IMU at 100 Hz, GNSS at 10 Hz and 20 remote cars at 10 Hz. What is added is the ego
state at 100 Hz with its covariance. cwcli's time includes the summary, fsync and the rename; the official writer's does
not wait for the disk. Prints a Markdown table and exits with 1 when annotating is not at least 8 times as fast.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer

from cwcli.input import InputFile
from cwcli.logs.write.annotate import annotate_log
from cwcli.signals.columns import OutputChannel, Strings

LIMIT = 8.0
T0_NS = 1_700_000_000_000_000_000
N_CARS = 20
BSM = {
    "msgCnt": 1, "id": "00000000", "secMark": 0, "lat": 0, "long": 0, "elev": 1200,
    "accuracy": {"semiMajor": 40, "semiMinor": 40, "orientation": 0}, "transmission": "forwardGears",
    "speed": 0, "heading": 0, "angle": 127, "accelSet": {"long": 0, "lat": 0, "vert": -127, "yaw": 0},
    "brakes": {"wheelBrakes": "00000", "traction": "unavailable", "abs": "unavailable"},
    "size": {"width": 200, "length": 500},
}  # fmt: skip


@dataclass(frozen=True)
class Source:
    """What `annotate` needs of a log."""

    file: InputFile
    name: str = "bench"
    recover: bool = False
    added_channels: tuple[OutputChannel, ...] = ()
    added_metadata: Mapping[str, Mapping[str, str]] = field(default_factory=dict)


def jpeg_images(rng: np.random.Generator) -> list[bytes]:
    """Thirty blurred random images of 640 x 480 pixels, about 45 kB each."""
    image = cv2.GaussianBlur(rng.integers(0, 255, (480, 640, 3), dtype=np.uint8), (0, 0), 3)
    image = np.clip((image.astype(float) - 127) * 8 + 127, 0, 255).astype(np.uint8)
    quality = [cv2.IMWRITE_JPEG_QUALITY, 70]
    return [cv2.imencode(".jpg", np.roll(image, 20 * k, axis=1), quality)[1].tobytes() for k in range(30)]


def write_source(path: Path, seconds: int) -> None:
    """The log that is annotated, by the official writer."""
    rng = np.random.default_rng(0)
    images = jpeg_images(rng)
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("", "bench")
        schema = writer.register_schema("bench", "ros2msg", b"float64 x")
        imu, camera, gnss, v2x = (
            writer.register_channel(topic, encoding, schema)
            for topic, encoding in (
                ("/imu", "cdr"),
                ("/camera", "protobuf"),
                ("/gps", "protobuf"),
                ("/v2x/bsm", "json"),
            )
        )
        for k in range(seconds * 100):
            time_ns = T0_NS + k * 10_000_000
            writer.add_message(imu, time_ns, rng.bytes(324), time_ns)
            if k % 10 == 0:
                writer.add_message(camera, time_ns + 1, images[k // 10 % len(images)], time_ns)
                writer.add_message(gnss, time_ns + 2, rng.bytes(140), time_ns)
            for car in range(k % 10 * 2, k % 10 * 2 + 2):
                position = {"lat": int(rng.integers(4e8, 5e8)), "long": int(rng.integers(8e7, 9e7))}
                content = {"coreData": {**BSM, **position, "id": f"{car:08d}", "secMark": k % 6000 * 10}}
                writer.add_message(v2x, time_ns + 3, json.dumps(content).encode(), time_ns)
        writer.finish()


def rewrite(source: Path, target: Path) -> None:
    """Every message through the official reader and writer."""
    with source.open("rb") as stream, target.open("wb") as out:
        writer = Writer(out)
        writer.start("", "bench")
        schemas: dict[int, int] = {}
        channels: dict[int, int] = {}
        for schema, channel, message in make_reader(stream).iter_messages(log_time_order=False):
            if channel.id not in channels:
                assert schema is not None
                if schema.id not in schemas:
                    schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schemas[schema.id], channel.metadata
                )
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time, message.sequence
            )
        writer.finish()


def ego_state(seconds: int) -> OutputChannel:
    n = seconds * 100
    stamp_ns = T0_NS + np.arange(n, dtype=np.int64) * 10_000_000
    seconds_in = np.arange(n) * 0.01
    names = (
        "x_m y_m speed_mps heading_rad accel_mps2 yaw_rate_radps jerk_mps3 yaw_accel_radps2 latitude_deg longitude_deg"
    )
    numbers = {name: np.sin(seconds_in / (10 + k)) for k, name in enumerate(names.split())}
    covariance = np.eye(8).ravel() * (1 + 1e-3 * np.sin(seconds_in / 7)[:, None])
    ids = Strings(np.zeros(n, np.int32), ("ego",))
    fields = {"stamp_ns": stamp_ns, "id": ids, **numbers, "covariance": covariance}
    return OutputChannel("/cwcli/ego/state", "cwcli.v1.VehicleState", stamp_ns, fields)


def seconds_for(run: Callable[[], object], target: Path) -> float:
    """Time of one run that writes a new file."""
    target.unlink(missing_ok=True)
    start = time.perf_counter()
    run()
    return time.perf_counter() - start


def _annotate(source: Path, channel: OutputChannel, target: Path) -> None:
    with InputFile.open(source) as file:
        annotate_log(Source(file), [channel], {}, target)


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=int, default=120)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "in.mcap", Path(folder) / "out.mcap"
        write_source(source, options.seconds)
        channel = ego_state(options.seconds)
        rewriting, annotating = [], []
        for _ in range(options.repeats):
            rewriting.append(seconds_for(lambda: rewrite(source, target), target))
            annotating.append(seconds_for(lambda: _annotate(source, channel, target), target))
        megabytes = source.stat().st_size / 1e6
    ratio = min(rewriting) / min(annotating)
    print(f"| log of {megabytes:.0f} MB, {options.seconds * 320} messages | best of {options.repeats} |\n|---|---|")
    print(f"| read and rewrite, official library | {min(rewriting):.3f} s |")
    print(f"| annotate with {len(channel)} states | {min(annotating):.3f} s |")
    print(f"| ratio | {ratio:.1f} (at least {LIMIT:.0f}) |")
    return 0 if ratio >= LIMIT else 1


if __name__ == "__main__":
    sys.exit(main())
