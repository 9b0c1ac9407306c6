"""One log and the same in parts, written by the official library."""

from __future__ import annotations

import json
import random
from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from cwcli.logs.read.reader import Log

T0_NS = 1_700_000_000_000_000_000
PERIOD_NS = 10_000_000
TOPICS = ("/a", "/b", "/c")
Message = tuple[str, int, bytes]


def messages(n: int) -> list[Message]:
    """Topic, log time and payload of `n` messages, 10 ms apart; the third topic is said once, at the beginning."""
    made = [("/c", T0_NS, json.dumps({"value": -1}).encode())]
    made += [(TOPICS[k % 2], T0_NS + k * PERIOD_NS, json.dumps({"value": k}).encode()) for k in range(1, n)]
    return made


def write_log(
    path: Path, content: Sequence[Message], topics: Sequence[str] = TOPICS, profile: str = "", **options: Any
) -> Path:
    """A log with these channels, in this order, and these messages."""
    stream = BytesIO()
    writer = Writer(stream, chunk_size=400, **{"compression": CompressionType.ZSTD, **options})
    writer.start(profile=profile, library="test")
    ids = {}
    for topic in topics:
        schema = writer.register_schema(f"Schema{topic[1:]}", "jsonschema", b"{}")
        ids[topic] = writer.register_channel(topic, "json", schema, {"of": topic})
    for k, (topic, log_time_ns, data) in enumerate(content):
        writer.add_message(ids[topic], log_time_ns, data, log_time_ns, k)
    writer.finish()
    path.write_bytes(stream.getvalue())
    return path


def cut(content: Sequence[Message], folder: Path, n: int, *, ids: str = "same", **options: Any) -> list[Path]:
    """The messages in `n` files; the ids of their channels are the same, shuffled, or given at their first message."""
    size = -(-len(content) // n)
    paths = []
    for k in range(n):
        part = content[k * size : (k + 1) * size]
        topics = list(TOPICS)
        if ids == "shuffled":
            random.Random(k).shuffle(topics)
        elif ids == "first used":
            topics = list(dict.fromkeys(topic for topic, _, _ in part))
        paths.append(write_log(folder / f"drive_{k}.mcap", part, topics, **options))
    return paths


def write_metadata(folder: Path, paths: Sequence[Path], counts: Sequence[int], **more: Any) -> None:
    """A metadata.yaml as rosbag2 (Jazzy) writes it."""
    files = [{"path": path.name, "message_count": n} for path, n in zip(paths, counts, strict=True)]
    information = {
        "version": 9,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": 1},
        "starting_time": {"nanoseconds_since_epoch": T0_NS},
        "message_count": sum(counts),
        "topics_with_message_count": [],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [path.name for path in paths],
        "files": files,
        **more,
    }
    (folder / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": information}))


def seen(log: Log) -> dict[str, tuple[list[int], list[float]]]:
    """Topic -> log times and values of its messages."""
    columns = log.load_topics(dict.fromkeys(sorted({each.topic for each in log.channels})))
    return {
        topic: (each.log_time_ns.tolist(), np.asarray(each.fields["value"]).tolist()) for topic, each in columns.items()
    }


def official(path: Path) -> Iterator[tuple[str, str, int, bytes]]:
    """Topic, schema, log time and payload of each message, as the official library reads them."""
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            yield channel.topic, schema.name if schema else "", message.log_time, message.data
