"""Bags and databases that are small, and stand for much: makers of each, and what cwcli says of it."""

from __future__ import annotations

import bz2
import hashlib
import shutil
import sqlite3
import struct
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from pathlib import Path

import lz4.frame
import zstandard

RULE = "=" * 80
T0_S = 1_700_000_000
N_DOUBLING = 60


def field(name: str, value: bytes) -> bytes:
    data = name.encode() + b"=" + value
    return struct.pack("<I", len(data)) + data


def record(fields: dict[str, bytes], data: bytes) -> bytes:
    """A record of a bag."""
    header = b"".join(field(name, value) for name, value in fields.items())
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data


def u32(n: int) -> bytes:
    return struct.pack("<I", n)


def connection(number: int, topic: str, kind: str, definition: str, checksum: str = "*") -> bytes:
    described = {
        "topic": topic.encode(),
        "type": kind.encode(),
        "md5sum": checksum.encode(),
        "message_definition": definition.encode(),
    }
    data = b"".join(field(name, value) for name, value in described.items())
    return record({"op": b"\x07", "conn": u32(number), "topic": topic.encode()}, data)


def message(number: int, data: bytes, k: int = 0) -> bytes:
    return record({"op": b"\x02", "conn": u32(number), "time": struct.pack("<II", T0_S + k, 0)}, data)


def chunk(content: bytes, compression: str = "none", size: int | None = None) -> bytes:
    """A chunk; `size` is what it declares, where that is a lie."""
    pack: Callable[[bytes], bytes] = {"none": bytes, "bz2": bz2.compress, "lz4": lz4.frame.compress}[compression]
    declared = len(content) if size is None else size
    return record({"op": b"\x05", "compression": compression.encode(), "size": u32(declared)}, pack(content))


def bag_header(index_pos: int, **more: bytes) -> bytes:
    fields = {"op": b"\x03", "index_pos": struct.pack("<Q", index_pos), "conn_count": u32(0), "chunk_count": u32(0)}
    return record(fields | more, b" " * 100)


def bag(path: Path, chunks: Sequence[bytes], tail: bytes = b"", *, is_indexed: bool = True, **more: bytes) -> Path:
    """A bag of these chunks; its index is what stands behind them."""
    start = 13 + len(bag_header(0, **more))
    index_pos = start + sum(map(len, chunks)) if is_indexed else 0
    path.write_bytes(b"#ROSBAG V2.0\n" + bag_header(index_pos, **more) + b"".join(chunks) + tail)
    return path


def one_topic(definition: str, messages: Iterable[bytes], kind: str = "p/T") -> bytes:
    """What is in a chunk with one topic."""
    sent = b"".join(message(0, data, k) for k, data in enumerate(messages))
    return connection(0, "/t", kind, definition) + sent


def bag_of(definition: str, *messages: bytes) -> Callable[[Path], Path]:
    return lambda folder: bag(folder / "hostile.bag", [chunk(one_topic(definition, messages))])


def definitions(root: str, **parts: str) -> str:
    return "\n".join([root, *(f"{RULE}\nMSG: p/{name}\n{body}" for name, body in parts.items()), ""])


DOUBLING = definitions(
    "E0 a", **{f"E{k}": f"E{k + 1} a\nE{k + 1} b" for k in range(N_DOUBLING)}, **{f"E{N_DOUBLING}": ""}
)
"""Each type holds the next one twice: 2^60 messages without a field."""
NESTED = definitions("A[] a", A="B[] b", B="C[] c", C="")
"""Sequences in sequences of messages without a field."""
FIXED = definitions("A[16777216] a", A="B[16777216] b", B="C[16777216] c", C="")
DEEP = definitions("D0 d", **{f"D{k}": f"D{k + 1} d" for k in range(200)}, D200="int8 x")


def nested_arrays(folder: Path) -> Path:
    """65,000 sequences of 2^32 - 1 messages without a field."""
    data = u32(65_000) + (u32(1) + u32(0xFFFFFFFF)) * 65_000
    return bag(folder / "hostile.bag", [chunk(one_topic(NESTED, [data]), "bz2")])


def bomb(compression: str, n_bytes: int, size: int | None = None) -> Callable[[Path], Path]:
    """A chunk of zeros, which declares what it is, or `size`."""

    def make(folder: Path) -> Path:
        return bag(folder / "hostile.bag", [chunk(bytes(n_bytes), compression, size)])

    return make


def many_bombs(folder: Path) -> Path:
    """Twenty chunks of 60 MB, each within the bound of one chunk."""
    each = chunk(message(0, bytes(60_000_000)), "lz4")
    return bag(folder / "hostile.bag", [each] * 20)


def busy(folder: Path) -> Path:
    """A thousand messages that each hold 65,000 messages without a field."""
    content = one_topic(definitions("E[] e", E="F f", F=""), [u32(32_000)] * 3000)
    return bag(folder / "hostile.bag", [chunk(content, "bz2")])


def many_connections(folder: Path) -> Path:
    content = b"".join(connection(k, f"/t{k}", "p/T", "int8 x") for k in range(70_000))
    return bag(folder / "hostile.bag", [chunk(content, "bz2")])


def many_definitions(folder: Path) -> Path:
    """2,000 definitions of 500 fields, all different."""
    body = "\n".join(f"float64 f{k}" for k in range(500))
    content = b"".join(connection(k, f"/t{k}", "p/T", f"{body}\nint8 x{k}") for k in range(2000))
    return bag(folder / "hostile.bag", [chunk(content, "bz2")])


def header_of_4_gb(folder: Path) -> Path:
    path = folder / "hostile.bag"
    path.write_bytes(b"#ROSBAG V2.0\n" + u32(0xFFFFFFFF) + bytes(1000))
    return path


def encrypted(folder: Path) -> Path:
    return bag(folder / "hostile.bag", [chunk(b"x" * 100)], encryptor=b"rosbag/AesCbcEncryptor")


HOSTILE_BAGS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "a text array of 10^9": (bag_of("string[1000000000] s", b""), "can't be used"),
    "a text array of 10^7": (bag_of("string[10000000] s", u32(0)), "can't be converted"),
    "2^32 - 1 empty messages": (bag_of(definitions("Empty[] e", Empty=""), u32(0xFFFFFFFF)), "can't be converted"),
    "nested empty arrays": (nested_arrays, "can't be converted"),
    "fixed empty arrays": (bag_of(FIXED, b"", b""), "can't be converted"),
    "60 types that double": (bag_of(DOUBLING, b"", b""), "can't be converted"),
    "200 types inside each other": (bag_of(DEEP, b"x"), "can't be used"),
    "a type that holds itself": (bag_of(definitions("A a", A="B b", B="A a"), b""), "can't be used"),
    "a definition of 20 MB": (bag_of("float64 x\n" * 2_000_000, b""), "can't be used|too long"),
    "a length of 5000 digits": (bag_of(f"int8[{'9' * 5000}] x", b""), "can't be used"),
    "code as a type": (bag_of("__import__('os').system('touch\x20owned') x", b""), "can't be used"),
    "code as a name": (bag_of("int8 x);__import__('os').system('touch\x20owned')#", b"\1"), "converted|used|$"),
    "bz2 of 300 MB": (bomb("bz2", 300_000_000), "chunks of more than 256 MB"),
    "bz2 of 300 MB that lies": (bomb("bz2", 300_000_000, 1000), "more than the 1,000 bytes"),
    "lz4 of 300 MB": (bomb("lz4", 300_000_000), "chunks of more than 256 MB"),
    "lz4 of 300 MB that lies": (bomb("lz4", 300_000_000, 1000), "more than the 1,000 bytes"),
    "lz4 that declares 4 GB": (bomb("lz4", 1000, 0xFFFFFFFF), "chunks of more than 256 MB"),
    "20 chunks of 60 MB": (many_bombs, "the whole file may unpack to"),
    "3,000 messages of 64,000": (busy, "processor time"),
    "70,000 connections": (many_connections, "more topics than"),
    "2,000 definitions": (many_definitions, "processor time|memory|$"),
    "a header of 4 GB": (header_of_4_gb, "damaged"),
    "encrypted": (encrypted, "is encrypted"),
}
"""Name -> its maker, and a pattern of what is said of it: an error, or a fault that is counted."""


def database(folder: Path, base: Path, *statements: str, values: Sequence[bytes] = ()) -> Path:
    """A copy of a database after these statements; the last one takes the values."""
    path = Path(shutil.copy(base, folder / "hostile.db3"))
    with closing(sqlite3.connect(path, isolation_level=None)) as connected:
        for k, each in enumerate(statements):
            connected.execute(each, values if k == len(statements) - 1 else ())
    return path


ENDLESS = "WITH RECURSIVE k(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM k)"
RENAME = "ALTER TABLE messages RENAME TO m"
WRITABLE = "PRAGMA writable_schema = ON"
HOSTILE_DATABASES: dict[str, tuple[tuple[str, ...], bytes | None, str]] = {
    "an endless view as messages": (
        (
            RENAME,
            f"CREATE VIEW messages AS {ENDLESS} SELECT n AS id, 1 AS topic_id, n AS timestamp, x'00' AS data FROM k",
        ),
        None,
        "it has no table of messages",
    ),
    "an endless view as topics": (
        ("DROP TABLE topics", f"CREATE VIEW topics AS {ENDLESS} SELECT n AS id, 'a' AS name FROM k"),
        None,
        "it has no table of topics",
    ),
    "an endless view as definitions": (
        (
            "DROP TABLE message_definitions",
            f"CREATE VIEW message_definitions AS {ENDLESS} SELECT n AS id, 'a' AS topic_type, 'ros2msg' AS encoding, "
            "'x' AS encoded_message_definition FROM k",
        ),
        None,
        "$",
    ),
    "a computed column of data": (
        (
            RENAME,
            "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, "
            "data BLOB AS (zeroblob(200000000)))",
            "INSERT INTO messages (topic_id, timestamp) SELECT topic_id, timestamp FROM m",
        ),
        None,
        "does not store data",
    ),
    "a computed column of topics": (
        (
            "DROP TABLE topics",
            "CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT AS (hex(zeroblob(100000000))), "
            "type TEXT, serialization_format TEXT)",
            "INSERT INTO topics (type) VALUES ('a')",
        ),
        None,
        "does not store name",
    ),
    "a virtual table": (
        (
            RENAME,
            WRITABLE,
            "INSERT INTO sqlite_master VALUES ('table', 'messages', 'messages', 0, "
            "'CREATE VIRTUAL TABLE messages USING fts5(topic_id, timestamp, data)')",
        ),
        None,
        "can't read it",
    ),
    "a message of 4 GB in zstd": (("UPDATE messages SET data = ? WHERE id = 1",), b"zstd 4 GB", "can't be unpacked"),
    "100 messages of 50 MB in zstd": (("UPDATE messages SET data = ?",), b"zstd 50 MB", "unpack to more than"),
    "ids beyond numbers": (("UPDATE messages SET topic_id = 1e300",), None, "can't read it"),
    "a schema of 5 MB": ((f"CREATE TABLE wide (a TEXT DEFAULT '{'x' * 5_000_000}')",), None, "can't read it|$"),
    "70,000 topics": (
        (
            "DROP TABLE topics",
            "CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)",
            f"{ENDLESS} INSERT INTO topics SELECT n, '/t' || n, 'std_msgs/msg/Empty', 'cdr' FROM k LIMIT 70000",
        ),
        None,
        "more than 65535 topics",
    ),
}
"""Name -> statements, what the last one takes, and a pattern of what is said of it."""


def packed(what: bytes | None) -> Sequence[bytes]:
    """The values of the last statement."""
    if what is None:
        return ()
    n_blocks = 4096 if what == b"zstd 4 GB" else 50
    compressor = zstandard.ZstdCompressor().compressobj(size=n_blocks << 20)
    block = bytes(1 << 20)
    return (b"".join(compressor.compress(block) for _ in range(n_blocks)) + compressor.flush(),)


def hash_of(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
