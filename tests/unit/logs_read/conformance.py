"""The files of the MCAP conformance suite, made anew from its definition by an encoder of these tests.

Six contents, each in every sensible combination of features: 416 files. What they are is defined by the suite's
generator (foxglove/mcap, tests/conformance, MIT): which records, in which order, and three bytes behind the fields of a
record where the feature `pad` is on. `SHA256` holds a hash of each content's files as they are published.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import combinations

MAGIC = b"\x89MCAP0\r\n"
PADDING = b"\x01\xff\xff"
FEATURES = {
    "ch": "chunks",
    "mx": "message indexes",
    "st": "statistics",
    "rsh": "schemas repeated",
    "rch": "channels repeated",
    "ax": "attachment indexes",
    "mdx": "metadata indexes",
    "chx": "chunk indexes",
    "sum": "summary offsets",
    "pad": "bytes behind the fields",
}
IN_SUMMARY = frozenset({"st", "rsh", "rch", "ax", "mdx", "chx"})
"""What a summary offset can point to."""
IN_CHUNKS = frozenset({"mx", "chx"})
OF_MESSAGES = ("ch", "mx", "st", "rsh", "rch", "chx", "sum", "pad")


@dataclass(frozen=True)
class Content:
    """What a file of the suite holds.

    Attributes:
        features: That make a difference to it.
        messages: Sequence, log time, publish time of each; all have the payload 1, 2, 3.
        has_schema: Their channel has one.
        has_attachment, has_metadata: One of each.
    """

    features: tuple[str, ...]
    messages: tuple[tuple[int, int, int], ...] = ()
    has_schema: bool = False
    has_attachment: bool = False
    has_metadata: bool = False


CONTENTS = {
    "NoData": Content(("st", "sum", "pad")),
    "OneAttachment": Content(("st", "ax", "sum", "pad"), has_attachment=True),
    "OneMetadata": Content(("st", "mdx", "sum", "pad"), has_metadata=True),
    "OneSchemalessMessage": Content(tuple(each for each in OF_MESSAGES if each != "rsh"), ((10, 2, 1),)),
    "OneMessage": Content(OF_MESSAGES, ((10, 2, 1),), has_schema=True),
    "TenMessages": Content(
        OF_MESSAGES, tuple((k, t, t) for k, t in enumerate((0, 2, 1, 3, 3, 5, 4, 7, 8, 9))), has_schema=True
    ),
}
PAYLOAD = b"\1\2\3"


def variants(content: Content) -> Iterator[frozenset[str]]:
    """The combinations of features that make sense."""
    for n in range(len(content.features) + 1):
        for chosen in map(frozenset, combinations(content.features, n)):
            is_chunked = "ch" in chosen or not chosen & IN_CHUNKS
            has_summary = "sum" not in chosen or chosen & IN_SUMMARY
            if is_chunked and has_summary:
                yield chosen


def every_file() -> Iterator[tuple[str, Content, bytes]]:
    """Name, as the suite gives it, content and bytes of each file."""
    for name, content in CONTENTS.items():
        for chosen in variants(content):
            yield "-".join((name, *sorted(chosen, key=_ORDER.index))), content, encoded(content, chosen)


_ORDER = ("ch", "chx", "ax", "mdx", "mx", "pad", "rch", "rsh", "st", "sum")

SHA256 = {
    "NoData": "b44e4fcaa02a347a846c3a73cdacedb2760f052849d42770cc524df905e912b0",
    "OneAttachment": "40a833056836d43242de4c6f1ade432318b9dd99bbdd7288af67e6e8ec66d2e1",
    "OneMetadata": "2cace83e09dc6c7273cb209c5753020726da2d56b8f49ab229261d8c15ab36cd",
    "OneSchemalessMessage": "cc98bcbc33f2d30118337060fce1ded94dab10c48c966172fb9fca39222d7b3a",
    "OneMessage": "aef6afb96b3307499b965743343a956c8b299a130d3197fa946573038d0a842c",
    "TenMessages": "5409ef83eaebca38cac56f6c84896368ce077675b162719b22c6784a53a0578c",
}
"""Of the lines `NAME SHA256` of a content's published files, in order of their names."""


@dataclass
class _File:
    is_padded: bool
    data: bytearray = field(default_factory=bytearray)

    def record(self, opcode: int, *fields: bytes, padded: bool = True) -> bytes:
        content = b"".join(fields) + (PADDING if padded and self.is_padded else b"")
        return struct.pack("<BQ", opcode, len(content)) + content


def encoded(content: Content, features: frozenset[str]) -> bytes:
    """One file."""
    file = _File("pad" in features)
    data = file.data
    data += MAGIC + file.record(0x01, _text(""), _text(""))
    is_chunked = "ch" in features
    schema = (_u("H", 1), _text("Example"), _text("c"), _sized(b"\4\5\6"))
    metadata = _texts({"foo": "bar"})
    encoding, entries_of_channel = ("a", metadata) if content.has_schema else ("text", _texts({}))
    channel = (_u("HH", 1, int(content.has_schema)), _text("example"), _text(encoding), entries_of_channel)
    summary: dict[int, bytes] = {}
    records = bytearray()
    places: list[tuple[int, int]] = []
    padded = not is_chunked
    if content.has_schema:
        records += file.record(0x03, *schema, padded=padded)
    if content.messages:
        records += file.record(0x04, *channel, padded=padded)
    for sequence, log_time, publish_time in content.messages:
        places.append((log_time, len(records)))
        records += file.record(0x05, _u("HIQQ", 1, sequence, log_time, publish_time), PAYLOAD, padded=False)
    span = _span(places)
    if is_chunked and content.messages:
        summary[0x08] = _chunk(file, records, places, features)
    else:
        data += records
    if content.has_attachment:
        start = len(data)
        name, media_type = "myFile", "application/octet-stream"
        fields = _u("QQ", 2, 1) + _text(name) + _text(media_type) + _u("Q", len(PAYLOAD)) + PAYLOAD
        data += file.record(0x09, fields, _u("I", zlib.crc32(fields)))
        place = _u("QQQQQ", start, len(data) - start, 2, 1, len(PAYLOAD))
        summary[0x0A] = file.record(0x0A, place, _text(name), _text(media_type))
    if content.has_metadata:
        start = len(data)
        data += file.record(0x0C, _text("myMetadata"), metadata)
        summary[0x0D] = file.record(0x0D, _u("QQ", start, len(data) - start), _text("myMetadata"))
    data += file.record(0x0F, _u("I", zlib.crc32(data)), padded=False)
    n = len(content.messages)
    counts = _sized(_u("HQ", 1, n) if n else b"")
    numbers = (n, int(content.has_schema), int(n > 0), int(content.has_attachment), int(content.has_metadata))
    summary[0x0B] = file.record(0x0B, _u("QHIIIIQQ", *numbers, int(is_chunked and n > 0), *span), counts)
    summary[0x03] = file.record(0x03, *schema) if content.has_schema else b""
    summary[0x04] = file.record(0x04, *channel) if content.messages else b""
    _end(
        file,
        {opcode: summary.get(opcode, b"") for opcode, feature in _SUMMARY.items() if feature in features},
        features,
    )
    return bytes(data)


def _span(places: list[tuple[int, int]]) -> tuple[int, int]:
    times = [log_time for log_time, _ in places]
    return min(times, default=0), max(times, default=0)


def _chunk(file: _File, records: bytearray, places: list[tuple[int, int]], features: frozenset[str]) -> bytes:
    """Write a chunk; returns its index record."""
    data, span = file.data, _span(places)
    start = len(data)
    head = _u("QQQI", *span, len(records), zlib.crc32(records)) + _text("")
    data += file.record(0x06, head, _u("Q", len(records)), bytes(records), padded=False)
    length = len(data) - start
    offsets = b""
    if "mx" in features:
        offsets = _u("HQ", 1, len(data))
        data += file.record(0x07, _u("H", 1), _sized(b"".join(_u("QQ", *place) for place in places)))
    return file.record(
        0x08,
        _u("QQQQ", *span, start, length),
        _sized(offsets),
        _u("Q", len(data) - start - length),
        _text(""),
        _u("QQ", len(records), len(records)),
    )


_SUMMARY = {0x03: "rsh", 0x04: "rch", 0x0B: "st", 0x08: "chx", 0x0A: "ax", 0x0D: "mdx"}
"""Opcode -> feature, in the order of the summary."""


def _end(file: _File, groups: Mapping[int, bytes], features: frozenset[str]) -> None:
    """The summary, the footer and the magic."""
    data, start = file.data, len(file.data)
    offsets = []
    for opcode, group in groups.items():
        if group:
            offsets.append(file.record(0x0E, _u("BQQ", opcode, len(data), len(group))))
            data += group
    offset_start = len(data) if "sum" in features else 0
    if "sum" in features:
        data += b"".join(offsets)
    head = struct.pack("<BQ", 0x02, 20) + _u("QQ", start if len(data) > start else 0, offset_start)
    data += head + _u("I", zlib.crc32(data[start:] + head)) + MAGIC


def _u(layout: str, *numbers: int) -> bytes:
    return struct.pack(f"<{layout}", *numbers)


def _sized(data: bytes) -> bytes:
    return _u("I", len(data)) + data


def _text(text: str) -> bytes:
    return _sized(text.encode())


def _texts(texts: Mapping[str, str]) -> bytes:
    return _sized(b"".join(_text(key) + _text(value) for key, value in texts.items()))
