"""Frames against the official decoders: order, formats, memory."""

from __future__ import annotations

import base64
import gc
import json
import struct
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf.message_factory import GetMessageClass
from mcap.writer import CompressionType

from cwcli.errors import InputError
from cwcli.logs.encoders.schemas import find_message_schema
from cwcli.logs.format.faults import Faults
from cwcli.logs.read.frames import BAD_BASE64_REASON, MAX_FRAMES_PER_BATCH
from cwcli.logs.read.reader import Log
from tests.unit.logs_read.builders import T0_NS, Declared, Sent, log_bytes, small_log
from tests.unit.logs_read.official import read_officially

HEADER = "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
LINE = "=" * 80 + "\n"
COMPRESSED = f"std_msgs/Header header\nstring format\nuint8[] data\n{LINE}{HEADER}".encode()
RAW = (
    "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\n"
    "uint32 step\nuint8[] data\n"
    f"{LINE}{HEADER}"
).encode()


def declared(name: str) -> Declared:
    """A protobuf camera channel of a standard schema."""
    return Declared("/camera", "protobuf", name, "protobuf", find_message_schema(name).data)


def compressed_cdr(k: int, data: bytes) -> bytes:
    """`sensor_msgs/msg/CompressedImage`."""
    head = struct.pack("<4BiII", 0, 1, 0, 0, 1_700_000_000, k, 4) + b"cam\0"
    return head + struct.pack("<I", 5) + b"jpeg\0" + b"\0" * 3 + struct.pack("<I", len(data)) + data


def foxglove(name: str, k: int, **values: Any) -> bytes:
    """A message of a standard protobuf schema."""
    message = GetMessageClass(find_message_schema(name).descriptor)(frame_id="cam", **values)
    message.timestamp.FromNanoseconds(T0_NS + k)
    return message.SerializeToString()


def write(path: Path, channel: Declared, messages: list[bytes], times: list[int], **options: Any) -> Path:
    path.write_bytes(
        log_bytes([channel], [Sent("/camera", t, each) for t, each in zip(times, messages, strict=True)], **options)
    )
    return path


@pytest.mark.parametrize("chunked", [True, False])
def test_order_with_overlapping_chunks_is_the_official_one(tmp_path: Path, chunked: bool) -> None:
    rng = np.random.default_rng(1)
    times = (T0_NS + np.arange(100) * 10 + rng.integers(0, 300, 100)).tolist()
    messages = [foxglove("foxglove.CompressedImage", k, format="jpeg", data=bytes([k] * 50)) for k in range(100)]
    channel = declared("foxglove.CompressedImage")
    path = write(tmp_path / "log.mcap", channel, messages, times, chunk_size=700, use_chunking=chunked)
    official = read_officially(path.read_bytes(), seeking=chunked)["/camera"]
    with Log.open(path) as log:
        frames = list(log.frames("/camera"))
    assert [frame.log_time_ns for frame in frames] == official.log_time_ns
    assert [bytes(frame.data) for frame in frames] == [message.data for message in official.messages]
    assert [frame.stamp_ns for frame in frames] == [message.timestamp.ToNanoseconds() for message in official.messages]


@pytest.mark.parametrize("spans", [[(300, 310)], [(0, 1), (900, 990)], [(-50, 0)], []])
def test_spans_leave_out_the_chunks_without_them(tmp_path: Path, spans: list[tuple[int, int]]) -> None:
    """All frames of the spans come, in order, and none that is a chunk of a dozen away from them."""
    times = (10 * np.arange(100)).tolist()
    messages = [foxglove("foxglove.CompressedImage", k, format="jpeg", data=bytes([k] * 50)) for k in range(100)]
    channel = declared("foxglove.CompressedImage")
    path = write(tmp_path / "log.mcap", channel, messages, [T0_NS + each for each in times], chunk_size=700)
    with Log.open(path) as log:
        frames = log.frames("/camera", [(T0_NS + start, T0_NS + end) for start, end in spans])
        found = [frame.log_time_ns - T0_NS for frame in frames]
        assert log.faults == Faults()
    assert found == sorted(found)
    assert {each for each in times if any(start <= each < end for start, end in spans)} <= set(found)
    assert all(any(start - 120 < each < end + 120 for start, end in spans) for each in found)


def test_ros_images(tmp_path: Path) -> None:
    channel = Declared("/camera", "cdr", "sensor_msgs/msg/CompressedImage", "ros2msg", COMPRESSED)
    path = write(tmp_path / "a.mcap", channel, [compressed_cdr(5, b"JPEG" * 9)], [T0_NS])
    with Log.open(path) as log:
        frame = next(log.frames("/camera"))
    assert (frame.format, bytes(frame.data), frame.frame_id) == ("jpeg", b"JPEG" * 9, "cam")
    assert (frame.stamp_ns, frame.log_time_ns) == (1_700_000_000_000_000_005, T0_NS)
    raw = struct.pack("<4BiII", 0, 1, 0, 0, 7, 8, 1) + b"\0" * 4
    raw += struct.pack("<III", 2, 3, 6) + b"mono8\0" + b"\0" + b"\0" + struct.pack("<II", 3, 6) + b"pixels"
    channel = Declared("/camera", "cdr", "sensor_msgs/msg/Image", "ros2msg", RAW)
    path = write(tmp_path / "b.mcap", channel, [raw], [T0_NS])
    with Log.open(path) as log:
        frame = next(log.frames("/camera"))
    assert (frame.height, frame.width, frame.encoding, frame.step, bytes(frame.data)) == (2, 3, "mono8", 3, b"pixels")


@pytest.mark.parametrize("whole", [[False], [False, True, True], [True, False, True, False]])
def test_a_ros_image_cut_to_nothing_leaves_the_others_their_own_data(tmp_path: Path, whole: list[bool]) -> None:
    channel = Declared("/camera", "cdr", "sensor_msgs/msg/CompressedImage", "ros2msg", COMPRESSED)
    messages = [compressed_cdr(k, b"%d" % k) if is_whole else b"\0\1\0\0" for k, is_whole in enumerate(whole)]
    path = write(tmp_path / "log.mcap", channel, messages, [T0_NS + k for k in range(len(whole))])
    with Log.open(path) as log:
        found = [(frame.log_time_ns - T0_NS, bytes(frame.data)) for frame in log.frames("/camera")]
        assert sum(log.faults.undecodable["/camera"].values()) == whole.count(False)
    assert found == [(k, b"%d" % k) for k, is_whole in enumerate(whole) if is_whole]


def test_raw_protobuf_image(tmp_path: Path) -> None:
    message = foxglove("foxglove.RawImage", 3, width=2, height=1, encoding="rgb8", step=6, data=b"abcdef")
    path = write(tmp_path / "log.mcap", declared("foxglove.RawImage"), [message], [T0_NS])
    with Log.open(path) as log:
        frame = next(log.frames("/camera"))
    assert (frame.width, frame.height, frame.encoding, frame.step, bytes(frame.data)) == (2, 1, "rgb8", 6, b"abcdef")


def test_json_image_is_base64_and_bad_ones_are_counted(tmp_path: Path) -> None:
    def message(data: str) -> bytes:
        stamp = {"sec": 1, "nsec": 2}
        return json.dumps({"timestamp": stamp, "frame_id": "cam", "format": "png", "data": data}).encode()

    good = base64.b64encode(b"PNG" * 20).decode()
    texts = [message(good), message(good.replace("/", "\\/")), message("no base64!"), b'{"data": 5}', b"broken"]
    channel = Declared("/camera", "json", "foxglove.CompressedImage", "jsonschema", b"{}")
    path = write(tmp_path / "log.mcap", channel, texts, [T0_NS + k for k in range(5)])
    with Log.open(path) as log:
        frames = list(log.frames("/camera"))
        assert [bytes(frame.data) for frame in frames] == [b"PNG" * 20, b"PNG" * 20, b""]
        assert [frame.stamp_ns for frame in frames] == [1_000_000_002, 1_000_000_002, None]
        assert log.faults.undecodable["/camera"][BAD_BASE64_REASON] == 1
        assert sum(log.faults.undecodable["/camera"].values()) == 2


def test_memory_does_not_grow_with_the_number_of_frames(tmp_path: Path) -> None:
    channel = declared("foxglove.CompressedImage")
    rng = np.random.default_rng(2)

    def peak(n: int) -> int:
        messages = [foxglove("foxglove.CompressedImage", k, format="jpeg", data=rng.bytes(20_000)) for k in range(n)]
        times = [T0_NS + k for k in range(n)]
        path = write(tmp_path / f"{n}.mcap", channel, messages, times, chunk_size=100_000)
        del messages
        with Log.open(path) as log:
            gc.collect()
            tracemalloc.start()
            count = sum(1 for _ in log.frames("/camera"))
            high = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
        assert count == n
        return high

    peak(20)
    # 24 MB of images in chunks of 100 kB: some are decompressed ahead, as many as the threads manage.
    assert peak(1200) < 20 * 100_000


def test_stopping_early_leaves_no_thread_behind(tmp_path: Path) -> None:
    import threading

    messages = [foxglove("foxglove.CompressedImage", k, data=bytes(200_000)) for k in range(60)]
    channel = declared("foxglove.CompressedImage")
    path = write(tmp_path / "log.mcap", channel, messages, [T0_NS + k for k in range(60)], chunk_size=400_000)
    before = threading.active_count()
    with Log.open(path) as log:
        frames = log.frames("/camera")
        next(frames)
        frames.close()  # type: ignore[attr-defined]
    assert threading.active_count() == before


def test_frame_outlives_the_log(tmp_path: Path) -> None:
    message = foxglove("foxglove.CompressedImage", 0, data=b"xyz")
    channel = declared("foxglove.CompressedImage")
    path = write(tmp_path / "log.mcap", channel, [message], [T0_NS], compression=CompressionType.NONE)
    with Log.open(path) as log:
        frame = next(log.frames("/camera"))
    assert bytes(frame.data) == b"xyz"


def test_topic_without_frames_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(small_log())
    with Log.open(path) as log, pytest.raises(InputError, match="holds no camera frames"):
        log.frames("/fix")


def test_a_look_at_the_first_frame_does_not_forget_what_a_whole_reading_counted(tmp_path: Path) -> None:
    def message(data: str) -> bytes:
        return json.dumps({"timestamp": {"sec": 1, "nsec": 2}, "frame_id": "cam", "data": data}).encode()

    n_good = MAX_FRAMES_PER_BATCH  # so that the damage lies behind what a look at the first frame decodes
    texts = [message("AAAA")] * n_good + [message("no base64!"), message("nor this!"), b"broken"]
    channel = Declared("/camera", "json", "foxglove.CompressedImage", "jsonschema", b"{}")
    path = write(tmp_path / "log.mcap", channel, texts, [T0_NS + k for k in range(len(texts))])
    with Log.open(path) as log:
        assert len(list(log.frames("/camera"))) == n_good
        counted = {topic: dict(reasons) for topic, reasons in log.faults.undecodable.items()}
        assert counted["/camera"][BAD_BASE64_REASON] == 2
        assert sum(counted["/camera"].values()) == 3
        next(log.frames("/camera"))
        assert log.faults.undecodable == counted
        list(log.frames("/camera"))
        assert log.faults.undecodable == counted
