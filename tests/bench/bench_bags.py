"""Times the conversion of a bag or a database beside that of `rosbags-convert`: `python -m tests.bench.bench_bags`.

The bag is made: a minute of a car's sensors over and over, as many times as the size asks for. `small` holds short
messages alone (IMU at 400 Hz, wheel speed at 100 Hz, poses at 50 Hz, fixes at 10 Hz), `camera` also images of 60
kB at 15 Hz. `--database` converts it to a rosbag2 database first, which is then read. What is compared is processor
time, of the whole command.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

T0_S = 1_700_000_000
MINUTE_S = 60
IMAGE_BYTES = 60_000
RATES_HZ = {"imu": 400, "speed": 100, "poses": 50, "fix": 10, "image": 15}
MEGABYTE = 1_000_000


def minute_messages(kind: str) -> list[tuple[str, str, float, Any]]:
    """Topic, type, time in the minute in s, and message, by time."""
    types = get_typestore(Stores.ROS1_NOETIC).types
    rng = np.random.default_rng(1)

    def header(t: float) -> Any:
        stamp = types["builtin_interfaces/msg/Time"](sec=T0_S + int(t), nanosec=int(t % 1 * 1e9))
        return types["std_msgs/msg/Header"](seq=0, stamp=stamp, frame_id="base_link")

    def vector() -> Any:
        x, y, z = rng.normal(size=3).tolist()
        return types["geometry_msgs/msg/Vector3"](x=x, y=y, z=z)

    def turn() -> Any:
        return types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)

    def imu(t: float) -> Any:
        zeros = np.zeros(9)
        return types["sensor_msgs/msg/Imu"](header(t), turn(), zeros, vector(), zeros, vector(), zeros)

    def speed(t: float) -> Any:
        twist = types["geometry_msgs/msg/Twist"](vector(), vector())
        return types["geometry_msgs/msg/TwistStamped"](header(t), twist)

    def poses(t: float) -> Any:
        each = types["geometry_msgs/msg/Pose"](types["geometry_msgs/msg/Point"](x=0.1, y=0.2, z=0.3), turn())
        return types["geometry_msgs/msg/PoseArray"](header(t), [each] * 3)

    def fix(t: float) -> Any:
        status = types["sensor_msgs/msg/NavSatStatus"](status=0, service=1)
        return types["sensor_msgs/msg/NavSatFix"](header(t), status, 48.0, 11.0, 500.0, np.zeros(9), 0)

    def image(t: float) -> Any:
        data = rng.integers(256, size=IMAGE_BYTES, dtype=np.uint8)
        return types["sensor_msgs/msg/CompressedImage"](header(t), "jpeg", data)

    made = {
        "imu": ("sensor_msgs/msg/Imu", imu),
        "speed": ("geometry_msgs/msg/TwistStamped", speed),
        "poses": ("geometry_msgs/msg/PoseArray", poses),
        "fix": ("sensor_msgs/msg/NavSatFix", fix),
        "image": ("sensor_msgs/msg/CompressedImage", image),
    }
    messages: list[tuple[str, str, float, Any]] = []
    for topic, (name, make) in made.items():
        if topic != "image" or kind == "camera":
            times = np.arange(MINUTE_S * RATES_HZ[topic]) / RATES_HZ[topic]
            messages += [(f"/{topic}", name, t, make(t)) for t in times.tolist()]
    return sorted(messages, key=lambda each: each[2])


def make_bag(path: Path, kind: str, n_bytes: int) -> None:
    """Write a bag of at least so many bytes."""
    store = get_typestore(Stores.ROS1_NOETIC)
    messages = [(topic, name, t, store.serialize_ros1(each, name)) for topic, name, t, each in minute_messages(kind)]
    n_minutes = max(1, round(n_bytes / sum(len(each) + 70 for *_, each in messages)))
    with Writer(path) as writer:
        kinds = {topic: name for topic, name, *_ in messages}
        connections = {topic: writer.add_connection(topic, name, typestore=store) for topic, name in kinds.items()}
        for minute in range(n_minutes):
            for topic, _, t, data in messages:
                writer.write(connections[topic], int((T0_S + minute * MINUTE_S + t) * 1e9), data)


def measure(command: list[str]) -> tuple[float, float]:
    """The processor time of a command and of its processes in s, and the most memory of one of them in MB."""
    code = (
        "import json, resource, subprocess, sys\n"
        "subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL)\n"
        "used = resource.getrusage(resource.RUSAGE_CHILDREN)\n"
        "print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1000)"
    )
    done = subprocess.run([sys.executable, "-c", code, *command], check=True, capture_output=True, text=True)
    cpu_s, memory_mb = map(float, done.stdout.split())
    return cpu_s, memory_mb


def main() -> None:
    """Make the bags and measure."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--mb", type=float, default=1000.0, help="size of each bag")
    parser.add_argument("--kind", choices=("small", "camera"), action="append")
    parser.add_argument("--database", action="store_true", help="read a database of the same messages")
    given = parser.parse_args()
    program = Path(sys.executable).with_name("rosbags-convert")
    for kind in given.kind or ("small", "camera"):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            bag = folder / "drive.bag"
            make_bag(bag, kind, int(given.mb * MEGABYTE))
            if given.database:
                subprocess.run([str(program), "--src", str(bag), "--dst", str(folder / "drive")], check=True)
                bag.unlink()
                bag = folder / "drive"
            size = f"{sum(each.stat().st_size for each in (bag, *bag.rglob('*'))) / MEGABYTE:.0f} MB"
            target = str(folder / "official")
            official_s, official_mb = measure([str(program), "--src", str(bag), "--dst", target, "--dst-storage=mcap"])
            shutil.rmtree(target)
            own_s, own_mb = measure([sys.executable, "-m", "cwcli", "info", "--quiet", str(bag)])
            print(
                f"{kind}, {size}: {own_s:.1f} s and {own_mb:.0f} MB; rosbags-convert {official_s:.1f} s and "
                f"{official_mb:.0f} MB; {own_s / official_s:.2f} of its time",
                flush=True,
            )


if __name__ == "__main__":
    main()
