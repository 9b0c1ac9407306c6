"""Small logs, written by the official writer."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
from mcap.writer import CompressionType, IndexType, Writer

T0_NS = 1_700_000_000_000_000_000
NAVSAT = b"""std_msgs/Header header
float64 latitude
float64[3] variance
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
"""


@dataclass(frozen=True)
class Sent:
    """A message to be written."""

    topic: str
    log_time_ns: int
    data: bytes
    publish_time_ns: int = 0


@dataclass(frozen=True)
class Declared:
    """A channel to be written."""

    topic: str
    message_encoding: str
    schema_name: str = ""
    schema_encoding: str = ""
    schema: bytes = b""


FIX = Declared("/fix", "cdr", "test_msgs/msg/Fix", "ros2msg", NAVSAT)
NOTES = Declared("/notes", "json", "Notes", "jsonschema", b"{}")


def log_bytes(
    channels: Sequence[Declared],
    messages: Sequence[Sent],
    *,
    compression: CompressionType = CompressionType.ZSTD,
    chunk_size: int = 600,
    **options: Any,
) -> bytes:
    """A log with these messages in this order."""
    stream = BytesIO()
    writer = Writer(stream, compression=compression, chunk_size=chunk_size, **options)
    writer.start(profile="test", library="tests")
    ids: dict[str, list[int]] = {}
    for channel in channels:
        schema_id = 0
        if channel.schema_encoding:
            schema_id = writer.register_schema(channel.schema_name, channel.schema_encoding, channel.schema)
        ids.setdefault(channel.topic, []).append(
            writer.register_channel(channel.topic, channel.message_encoding, schema_id)
        )
    for k, message in enumerate(messages):
        choices = ids[message.topic]
        writer.add_message(
            choices[k % len(choices)],
            message.log_time_ns,
            message.data,
            message.publish_time_ns or message.log_time_ns,
            sequence=k,
        )
    writer.add_metadata("note", {"made by": "a test"})
    writer.finish()
    return stream.getvalue()


def fix_message(k: int, frame_id: str = "gps") -> bytes:
    """The k-th message of `FIX`."""
    text = frame_id.encode() + b"\0"
    head = struct.pack("<4BiII", 0, 1, 0, 0, 1_700_000_000 + k, 1000 * k, len(text)) + text
    return head + b"\0" * (-(len(head) - 4) % 8) + struct.pack("<4d", 48.0 + k, 0.1, 0.2, 0.3 + k)


def small_log(n: int = 60, **options: Any) -> bytes:
    """Two topics, several chunks, times in order."""
    rng = np.random.default_rng(5)
    messages = []
    for k in range(n):
        ns = T0_NS + k * 1_000_000
        messages.append(Sent("/fix", ns, fix_message(k, "gps" * (k % 3 + 1))))
        note = {"k": k, "text": f"number {k}", "noise": rng.normal(), "list": [k, k + 0.5]}
        messages.append(Sent("/notes", ns + 500_000, json.dumps(note).encode()))
    return log_bytes([FIX, NOTES], messages, **options)


LAYOUTS: dict[str, dict[str, Any]] = {
    "zstd": {},
    "lz4": {"compression": CompressionType.LZ4},
    "uncompressed": {"compression": CompressionType.NONE},
    "unchunked": {"use_chunking": False},
    "no statistics": {"use_statistics": False},
    "no summary offsets": {"use_summary_offsets": False},
    "no repeated channels": {"repeat_channels": False, "repeat_schemas": False},
    "no message index": {"index_types": IndexType.ALL & ~IndexType.MESSAGE},
    "no chunk index": {"index_types": IndexType.ALL & ~IndexType.CHUNK},
    "no index": {"index_types": IndexType.NONE},
    "no CRC": {"enable_crcs": False},
    "unchunked with a CRC": {"use_chunking": False, "enable_data_crcs": True},
    "no summary": {
        "use_statistics": False,
        "repeat_channels": False,
        "repeat_schemas": False,
        "index_types": IndexType.NONE,
        "use_summary_offsets": False,
    },
}
"""What the format lets a writer leave out."""
