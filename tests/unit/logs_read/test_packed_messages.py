"""Messages that are packed one by one: what is unpacked at once is bounded, whatever a chunk of them holds."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore

from cwcli.logs.read.reader import Log

N, SIZE_PX, NOISE = 60, 3000, 100_000
MEGABYTE = 1_000_000
T0_NS = 1_700_000_000_000_000_000


@contextmanager
def at_most(most_bytes: int) -> Iterator[None]:
    tracemalloc.start()
    try:
        yield
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < most_bytes


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One chunk of 60 grey pictures of 9 MB, which are 540 MB unpacked; the log times run backwards."""
    rng = np.random.default_rng(1)
    store: Any = get_typestore(Stores.ROS2_JAZZY)
    kinds = store.types
    path = tmp_path_factory.mktemp("packed") / "log.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=1 << 30, compression=CompressionType.NONE)
        writer.start("ros2")
        kind = "sensor_msgs/msg/Image"
        text, _ = store.generate_msgdef(kind, ros_version=2)
        schema = writer.register_schema(kind, "ros2msg", text.encode())
        channel = writer.register_channel("/camera/image", "cdr", schema)
        for k in range(N):
            stamp = kinds["builtin_interfaces/msg/Time"](sec=k, nanosec=0)
            header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="camera")
            data = np.full(SIZE_PX * SIZE_PX, k, np.uint8)
            data[:NOISE] = rng.integers(0, 256, NOISE)
            image = kinds[kind](header, SIZE_PX, SIZE_PX, "mono8", 0, SIZE_PX, data)
            packed = zstandard.compress(bytes(store.serialize_cdr(image, kind)))
            writer.add_message(channel, T0_NS - k, packed, T0_NS - k)
        writer.finish()
    return path


def test_columns_of_a_chunk_are_unpacked_in_parts(images: Path) -> None:
    with Log.open(images) as log, at_most(100 * MEGABYTE):
        columns = log.columns("/camera/image", fields=("header.stamp.sec", "height"))
    assert columns.n_undecodable == 0
    assert columns.fields["header.stamp.sec"].tolist() == list(range(N))[::-1]  # type: ignore[union-attr]


def test_frames_of_a_chunk_are_unpacked_one_by_one(images: Path) -> None:
    with Log.open(images) as log, at_most(100 * MEGABYTE):
        pixels = [frame.data[-1] for frame in log.frames("/camera/image")]
    assert pixels == list(range(N))[::-1]


@pytest.mark.parametrize("max_ratio", [1e308, float("inf"), 0.0])
def test_any_ratio_bounds_what_may_be_unpacked(images: Path, max_ratio: float) -> None:
    with Log.open(images, max_ratio=max_ratio) as log:
        assert log.channels[0].message_count == N


@pytest.mark.parametrize("max_ratio", [float("nan"), -1.0])
def test_what_is_no_ratio_is_refused(images: Path, max_ratio: float) -> None:
    with pytest.raises(ValueError, match="max_ratio is"):
        Log.open(images, max_ratio=max_ratio)
