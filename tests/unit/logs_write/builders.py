"""Logs that the official writer made, what the official reader says of a log, and channels to add."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import numpy as np
from mcap.reader import NonSeekingReader, make_reader
from mcap.writer import CompressionType, IndexType, Writer

from cwcli.input import InputFile
from cwcli.logs.read.reader import Log
from cwcli.signals.columns import OutputChannel, Strings

T0_NS = 1_700_000_000_000_000_000
MILLISECOND = 1_000_000
N_IMU = 400


@dataclass(frozen=True)
class _SourceStub:
    """What `annotate` needs of a log."""

    path: Path
    recover: bool = False
    added_channels: Sequence[OutputChannel] = ()
    added_metadata: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return self.path.name

    @cached_property
    def file(self) -> InputFile:
        return InputFile.open(self.path, self.name)


def source_stub(path: Path, *, recover: bool = False, **added: Any) -> Log:
    """A file as a log that `annotate_log` can read, without reading it before."""
    return cast(Log, _SourceStub(path, recover, **added))


def write_log(
    path: Path,
    *,
    compression: CompressionType = CompressionType.ZSTD,
    chunk_size: int = 4000,
    chunked: bool = True,
    index_types: IndexType = IndexType.ALL,
    profile: str = "test-drive",
    **options: bool,
) -> Path:
    """Two channels at 100 Hz and 10 Hz over four seconds, one without messages, an attachment and a metadata record."""
    rng = np.random.default_rng(7)
    with path.open("wb") as stream:
        writer = Writer(
            stream,
            compression=compression,
            chunk_size=chunk_size,
            use_chunking=chunked,
            index_types=index_types,
            **options,
        )
        writer.start(profile, "test")
        imu_schema = writer.register_schema("sensor_msgs/msg/Imu", "ros2msg", b"float64 x")
        imu = writer.register_channel("/imu", "cdr", imu_schema, {"qos": "best effort"})
        plain = writer.register_channel("/plain", "json", 0)
        writer.register_channel("/silent", "cdr", imu_schema)
        for k in range(N_IMU):
            time_ns = T0_NS + 10 * k * MILLISECOND
            writer.add_message(imu, time_ns, rng.bytes(int(rng.integers(0, 200))), time_ns - 5, k)
            if k % 10 == 0:
                writer.add_message(plain, time_ns + 1, b'{"k": %d}' % k, time_ns, k)
            if k == 200:
                writer.add_attachment(1, 2, "notes.txt", "text/plain", b"hello")
                writer.add_metadata("provenance", {"source": "here"})
        writer.finish()
    return path


def state_channel(topic: str = "/cwcli/ego/state", n: int = 300, name: str = "ego") -> OutputChannel:
    """A state every 20 ms, from 100 ms before the first message of `write_log` to behind its last."""
    log_time_ns = T0_NS + (np.arange(n, dtype=np.int64) * 20 - 100) * MILLISECOND
    return OutputChannel(
        topic,
        "cwcli.v1.VehicleState",
        log_time_ns,
        {
            "stamp_ns": log_time_ns,
            "id": Strings(np.zeros(n, np.int32), (name,)),
            "x_m": np.arange(n) * 0.5,
            "covariance": np.tile(np.arange(64.0), (n, 1)),
        },
    )


@dataclass(frozen=True)
class Content:
    """All that the official reader finds, with every CRC checked.

    Attributes:
        messages: Topic -> (schema name, log time, publish time, sequence, data) in the reader's order.
        in_file_order: Topics and log times as they lie in the file.
    """

    messages: dict[str, list[tuple[str, int, int, int, bytes]]]
    attachments: list[tuple[Any, ...]]
    metadata: list[tuple[str, dict[str, str]]]
    profile: str
    in_file_order: list[tuple[str, int]]

    def without(self, *topics: str) -> dict[str, list[tuple[str, int, int, int, bytes]]]:
        return {topic: rows for topic, rows in self.messages.items() if topic not in topics}


def read_content(path: Path) -> Content:
    """Read a log in full with the official readers, by index and from front to back, which must agree."""
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        messages: dict[str, list[tuple[str, int, int, int, bytes]]] = {}
        for schema, channel, message in reader.iter_messages():
            row = (
                schema.name if schema else "",
                message.log_time,
                message.publish_time,
                message.sequence,
                message.data,
            )
            messages.setdefault(channel.topic, []).append(row)
        attachments = [(a.name, a.media_type, a.log_time, a.create_time, a.data) for a in reader.iter_attachments()]
        metadata = [(each.name, each.metadata) for each in reader.iter_metadata()]
        summary = reader.get_summary()
        profile = reader.get_header().profile
    with path.open("rb") as stream:
        linear = list(NonSeekingReader(stream, validate_crcs=True).iter_messages(log_time_order=False))
    counts = {topic: len(rows) for topic, rows in messages.items()}
    by_topic: dict[str, int] = {}
    for _, channel, _ in linear:
        by_topic[channel.topic] = by_topic.get(channel.topic, 0) + 1
    assert by_topic == counts
    if summary is not None and summary.statistics is not None:
        check_summary(summary, messages, len(attachments), len(metadata))
    return Content(messages, attachments, metadata, profile, [(c.topic, m.log_time) for _, c, m in linear])


def check_summary(
    summary: Any, messages: dict[str, list[tuple[str, int, int, int, bytes]]], n_attachments: int, n_metadata: int
) -> None:
    """The statistics say what is there."""
    statistics = summary.statistics
    counted = {summary.channels[i].topic: n for i, n in statistics.channel_message_counts.items() if n}
    assert counted == {topic: len(rows) for topic, rows in messages.items()}
    assert statistics.message_count == sum(counted.values())
    assert statistics.channel_count == len(summary.channels)
    assert statistics.schema_count == len(summary.schemas)
    assert (statistics.attachment_count, statistics.metadata_count) == (n_attachments, n_metadata)
    assert statistics.chunk_count == len(summary.chunk_indexes)
    times = [row[1] for rows in messages.values() for row in rows]
    if times:
        assert (statistics.message_start_time, statistics.message_end_time) == (min(times), max(times))
