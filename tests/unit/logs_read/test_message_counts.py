"""However a log is read, what is read is what its statistics count, or a counted fault."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import zstandard
from mcap.writer import Writer

from cwcli.errors import InputError
from cwcli.logs.read.reader import Log
from tests.cli.hostile_inputs import (
    FIX_CHANNEL,
    FIX_SCHEMA,
    HEADER,
    MAGIC,
    mcap_message,
    mcap_record,
    mcap_schema,
    u64,
)
from tests.unit.logs_read.builders import T0_NS
from tests.unit.logs_read.lying_logs import counting_one_more, hiding

N = 100
IMAGE = {"timestamp": {"sec": 5, "nsec": 0}, "format": "jpeg", "data": base64.b64encode(b"JPEG").decode()}
TRANSFORM = {
    "parent_frame_id": "base_link",
    "child_frame_id": "camera",
    "translation": dict.fromkeys("xyz", 1),
    "rotation": {**dict.fromkeys("xyz", 0), "w": 1},
}
MESSAGES = {
    "/camera": ("foxglove.CompressedImage", IMAGE),
    "/numbers": ("Numbers", {"k": 1}),
    "/tf": ("foxglove.FrameTransform", TRANSFORM),
}
READINGS: dict[str, tuple[str, Callable[[Log], Iterator[object]]]] = {
    "columns": ("/numbers", lambda log: iter(log.columns("/numbers").log_time_ns)),
    "a window": (
        "/numbers",
        lambda log: iter(log.load_topics({"/numbers": None}, logged=(0, 1 << 62))["/numbers"].sequence),
    ),
    "trees": ("/numbers", lambda log: log.iter_message_trees("/numbers")),
    "frames": ("/camera", lambda log: log.frames("/camera")),
    "transforms": ("/tf", lambda log: log.transforms("/tf")),
}
IN_PART = {"a window", "transforms"}
"""Their number of messages is none that a summary counts."""


def log_bytes() -> bytes:
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=2000)
    writer.start()
    channels = {}
    for topic, (schema, _) in MESSAGES.items():
        schema_id = writer.register_schema(schema, "jsonschema", b'{"type": "object"}')
        channels[topic] = writer.register_channel(topic, "json", schema_id)
    for k in range(N):
        for topic, (_, content) in MESSAGES.items():
            writer.add_message(channels[topic], T0_NS + k, json.dumps(content).encode(), T0_NS + k, sequence=k)
    writer.finish()
    return stream.getvalue()


@pytest.mark.parametrize(("topic", "read"), READINGS.values(), ids=READINGS.keys())
def test_a_chunk_that_hides_a_channel_is_read(
    tmp_path: Path, topic: str, read: Callable[[Log], Iterator[object]]
) -> None:
    (tmp_path / "in.mcap").write_bytes(hiding(log_bytes(), topic))
    with Log.open(tmp_path / "in.mcap") as log:
        assert len([*read(log)]) == N
        assert log.faults.counts_by_reason() == {"message indexes that differ from their chunk": 1}


@pytest.mark.parametrize("reading", READINGS)
def test_a_miscounted_channel_is_a_fault(tmp_path: Path, reading: str) -> None:
    topic, read = READINGS[reading]
    (tmp_path / "in.mcap").write_bytes(counting_one_more(log_bytes(), topic))
    with Log.open(tmp_path / "in.mcap") as log:
        assert len([*read(log)]) == N
        expected = {} if reading in IN_PART else {"channels with a wrong message count in the summary": 1}
        assert log.faults.counts_by_reason() == expected


@pytest.mark.parametrize(("topic", "read"), READINGS.values(), ids=READINGS.keys())
def test_an_honest_log_has_no_fault(tmp_path: Path, topic: str, read: Callable[[Log], Iterator[object]]) -> None:
    (tmp_path / "in.mcap").write_bytes(log_bytes())
    with Log.open(tmp_path / "in.mcap") as log:
        assert len([*read(log)]) == N
        assert log.faults.counts_by_reason() == {}


def test_who_takes_the_first_frame_alone_is_told_nothing(tmp_path: Path) -> None:
    (tmp_path / "in.mcap").write_bytes(log_bytes())
    with Log.open(tmp_path / "in.mcap") as log:
        assert bytes(next(log.frames("/camera")).data) == b"JPEG"
        assert log.faults.counts_by_reason() == {}


@pytest.mark.parametrize(("period_ns", "is_read"), [(5_000_000, True), (0, False)])
def test_periodic_messages_of_a_log_compressed_whole_are_read(tmp_path: Path, period_ns: int, is_read: bool) -> None:
    """20,000 that take 6 bytes each are read, where the bound of a chunk is that of 2,000; equal ones are not."""
    stream = io.BytesIO()
    writer = Writer(stream, use_chunking=False)
    writer.start()
    channel = writer.register_channel("/t", "json", writer.register_schema("Numbers", "jsonschema", b"{}"))
    for k in range(20_000):
        stamp_ns = T0_NS + k * period_ns
        writer.add_message(channel, stamp_ns, b'{"k": 1}', stamp_ns, sequence=k if period_ns else 0)
    writer.finish()
    packed = zstandard.ZstdCompressor(level=19).compress(stream.getvalue())
    assert len(packed) < (150_000 if period_ns else 5_000)
    (tmp_path / "log.mcap.zst").write_bytes(packed)
    with Log.open(tmp_path / "log.mcap.zst", max_chunk_bytes=1_000_000) as log:
        if is_read:
            assert len(log.columns("/t")) == 20_000
        else:
            with pytest.raises(InputError, match="messages and more are in a file of"):
                log.columns("/t")


@pytest.mark.parametrize("n_times", [1, 3])
def test_definitions_are_bounded_by_a_quarter_of_a_chunk(tmp_path: Path, n_times: int) -> None:
    """60 kB of schemas, once or repeated in the summary: refused at 200 kB a chunk, read at 300 kB."""
    schemas = b"".join(mcap_schema(k, f"T{k}", "jsonschema", b" " * 19_990) for k in range(1, 4)) * n_times
    body = MAGIC + HEADER + FIX_SCHEMA + FIX_CHANNEL + mcap_message(1, T0_NS, b"{}") + mcap_record(15, bytes(4))
    footer = mcap_record(2, u64(len(body)) + u64(0) + bytes(4)) + MAGIC
    (tmp_path / "log.mcap").write_bytes(body + FIX_SCHEMA + FIX_CHANNEL + schemas + footer)
    with pytest.raises(InputError, match=r"more than 0\.05 MB, a quarter of --max-chunk"):
        Log.open(tmp_path / "log.mcap", max_chunk_bytes=200_000)
    with Log.open(tmp_path / "log.mcap", max_chunk_bytes=300_000) as log:
        assert [each.topic for each in log.channels] == ["/fix"]
