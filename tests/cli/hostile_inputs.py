"""Hostile inputs of every kind of file that a command reads: a maker of each, and the command that meets it.

Those that stand for more than they may cost in bags, databases and files for `cwcli import` have makers of their own
(`hostile_containers`, `hostile_imports`, `unforeseen_imports`); here are attacks on times, numbers, names, links,
references, recursion and the pairs of all with all.
"""

from __future__ import annotations

import json
import shutil
import sqlite3
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import zstandard
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import StoragePlugin

from tests.cli.conftest import ROOT
from tests.cli.detection_logs import SCHEMA, scan
from tests.protobuf_bytes import encode_varint
from tests.unit.importing import files
from tests.unit.importing.hostile_imports import GPX, blf
from tests.unit.logs_read.hostile_containers import bag, chunk, connection, message, u32
from tests.unit.logs_read.test_bags import recording

Make = Callable[[Path], list[str]]
"""Folder -> a command of cwcli; it writes nothing but `out.mcap` and what belongs to it."""
SAMPLE = ROOT / "sample_logs" / "intersection.mcap"
T0_NS = 1_700_000_000_000_000_000
MAGIC = b"\x89MCAP0\r\n"
ZSTD_2_GB = b"\x28\xb5\x2f\xfd\x00\xa8"
"""The head of a frame of zstd with a window of 2 GB."""
EVIL = "\x1b[31m\x1b]0;x\x07<script>alert(1)</script>\u202e../../etc/passwd\r\n'; DROP TABLE messages; --"
"""A name that moves the cursor, runs in a page, reorders the line, climbs folders and ends a statement of SQL."""


def u16(n: int) -> bytes:
    return struct.pack("<H", n)


def u64(n: int) -> bytes:
    return struct.pack("<Q", n)


def text(value: str | bytes) -> bytes:
    """A text of MCAP."""
    data = value.encode() if isinstance(value, str) else value
    return u32(len(data)) + data


def mcap_record(opcode: int, body: bytes) -> bytes:
    return bytes([opcode]) + u64(len(body)) + body


HEADER = mcap_record(1, text("") + text(""))
FOOTER = mcap_record(2, u64(0) + u64(0) + u32(0)) + MAGIC


def mcap_schema(number: int, name: str, encoding: str, data: bytes) -> bytes:
    return mcap_record(3, u16(number) + text(name) + text(encoding) + text(data))


def mcap_channel(number: int, schema: int, topic: str, encoding: str, metadata: bytes = b"") -> bytes:
    return mcap_record(4, u16(number) + u16(schema) + text(topic) + text(encoding) + text(metadata))


def mcap_message(channel: int, time_ns: int, data: bytes) -> bytes:
    return mcap_record(5, u16(channel) + u32(0) + u64(time_ns) + u64(time_ns) + data)


def mcap_chunk(
    content: bytes, compression: str = "zstd", size: int | None = None, stored: bytes | None = None
) -> bytes:
    data = stored if stored is not None else zstandard.compress(content) if compression == "zstd" else content
    head = u64(T0_NS) + u64(T0_NS) + u64(len(content) if size is None else size) + u32(0) + text(compression)
    return mcap_record(6, head + u64(len(data)) + data)


FIX_SCHEMA = mcap_schema(1, "foxglove.LocationFix", "jsonschema", b"{}")
FIX_CHANNEL = mcap_channel(1, 1, "/fix", "json")


def fix(time_ns: int, latitude: object = 48.0, longitude: object = 11.0, **more: object) -> bytes:
    stamp = {"sec": time_ns // 10**9, "nsec": time_ns % 10**9}
    return json.dumps(
        {"timestamp": stamp, "latitude": latitude, "longitude": longitude, "altitude": 0, **more}
    ).encode()


def written(folder: Path, name: str, *parts: bytes) -> str:
    (folder / name).write_bytes(b"".join(parts))
    return name


def logged(*parts: bytes, command: str = "estimate", options: Iterable[str] = ()) -> Make:
    """A log of these records in front of a footer without a summary."""

    def make(folder: Path) -> list[str]:
        name = written(folder, "in.mcap", MAGIC, HEADER, *parts, FOOTER)
        output = ["-o", "out.mcap"] if command not in {"info", "find"} else []
        return [command, name, *output, *options]

    return make


def sent(
    topic: str, schema: str, messages: Iterable[tuple[int, object]], command: str = "estimate", *options: str
) -> Make:
    """A log of the official writer with one topic of JSON."""

    def make(folder: Path) -> list[str]:
        with (folder / "in.mcap").open("wb") as stream:
            writer = Writer(stream, compression=CompressionType.ZSTD)
            writer.start()
            channel = writer.register_channel(topic, "json", writer.register_schema(schema, "jsonschema", b"{}"))
            for time_ns, content in messages:
                data = content if isinstance(content, bytes) else json.dumps(content).encode()
                writer.add_message(channel, time_ns, data, time_ns)
            writer.finish()
        output = ["-o", "out.mcap"] if command not in {"info", "find", "evaluate"} else []
        return [command, "in.mcap", *output, *options]

    return make


def sample(*command: str, **contents: bytes | str) -> Make:
    """A command with `log.mcap`, a bundled log, beside files of these contents; `_` in a name is a dot."""

    def make(folder: Path) -> list[str]:
        shutil.copy(SAMPLE, folder / "log.mcap")
        for name, content in contents.items():
            data = content.encode() if isinstance(content, str) else content
            (folder / name.replace("_", ".")).write_bytes(data)
        return list(command)

    return make


def file_and(name: str, content: str | bytes, *options: str) -> Make:
    """`cwcli import` of a file."""

    def make(folder: Path) -> list[str]:
        (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
        return ["import", name, "-o", "out.mcap", *options]

    return make


# --- logs of MCAP ---


def same_chunk_indexed_often(folder: Path) -> list[str]:
    """A chunk of 4 MB of messages that 100,000 entries of the summary name."""
    content = FIX_SCHEMA + FIX_CHANNEL + mcap_message(1, T0_NS, bytes(4_000_000))
    one = mcap_chunk(content)
    start = len(MAGIC + HEADER)
    index = u64(T0_NS) + u64(T0_NS) + u64(start) + u64(len(one)) + u32(0) + u64(0) + text("zstd")
    index += u64(len(one) - 9 - 40) + u64(len(content))
    end = mcap_record(15, u32(0))
    at = start + len(one) + len(end)
    summary = FIX_SCHEMA + FIX_CHANNEL + mcap_record(8, index) * 100_000
    footer = mcap_record(2, u64(at) + u64(0) + u32(0)) + MAGIC
    return ["estimate", written(folder, "in.mcap", MAGIC, HEADER, one, end, summary, footer), "-o", "out.mcap"]


def same_message_indexed_often(folder: Path) -> list[str]:
    """A message index of a million entries for one message of 100 kB."""
    big = fix(T0_NS, frame_id="x" * 100_000)
    content = FIX_SCHEMA + FIX_CHANNEL + mcap_message(1, T0_NS, big)
    one = mcap_chunk(content)
    at = len(FIX_SCHEMA) + len(FIX_CHANNEL)
    entries = (u64(T0_NS) + u64(at)) * 500_000
    index = mcap_record(7, u16(1) + u32(len(entries)) + entries)
    start = len(MAGIC + HEADER)
    offsets = u16(1) + u64(start + len(one))
    chunk_index = u64(T0_NS) + u64(T0_NS) + u64(start) + u64(len(one)) + u32(len(offsets)) + offsets
    chunk_index += u64(len(index)) + text("zstd") + u64(len(one) - 9 - 40) + u64(len(content))
    end = mcap_record(15, u32(0))
    footer = mcap_record(2, u64(start + len(one) + len(index) + len(end)) + u64(0) + u32(0)) + MAGIC
    parts = (MAGIC, HEADER, one, index, end, FIX_SCHEMA, FIX_CHANNEL, mcap_record(8, chunk_index), footer)
    return ["estimate", written(folder, "in.mcap", *parts), "-o", "out.mcap"]


def wide_window(folder: Path) -> list[str]:
    """A chunk of zstd that asks for a window of 2 GB."""
    return logged(mcap_chunk(bytes(1000), stored=ZSTD_2_GB + b"\x09\0\0x"))(folder)


def wide_window_file(folder: Path) -> list[str]:
    """A whole log compressed by zstd whose frame asks for a window of 2 GB and holds zeros by run."""
    blocks = b"".join(struct.pack("<I", (131072 << 3) | 2)[:3] + b"\0" for _ in range(200_000))
    (folder / "in.mcap.zst").write_bytes(ZSTD_2_GB + blocks)
    return ["estimate", "in.mcap.zst", "-o", "out.mcap"]


def zeros_behind_magic(folder: Path) -> list[str]:
    """A log compressed by zstd: a magic and 40 GB of zeros in 5 MB."""
    head = b"\x28\xb5\x2f\xfd\x00\x58" + struct.pack("<I", len(MAGIC) << 3)[:3] + MAGIC
    run = struct.pack("<I", (131072 << 3) | 2)[:3] + b"\0"
    (folder / "in.mcap.zst").write_bytes(head + run * 1_000_000)
    return ["estimate", "in.mcap.zst", "-o", "out.mcap"]


def summary_in_itself(folder: Path) -> list[str]:
    """A footer whose summary begins at the magic, so that data is summary, too."""
    body = FIX_SCHEMA + FIX_CHANNEL + mcap_message(1, T0_NS, fix(T0_NS))
    footer = mcap_record(2, u64(len(MAGIC)) + u64(len(MAGIC)) + u32(0)) + MAGIC
    return ["estimate", written(folder, "in.mcap", MAGIC, HEADER, body, footer), "-o", "out.mcap"]


def detections(n: int, n_scans: int) -> Iterable[tuple[int, object]]:
    """Scans of this many vehicles, 30 cm apart."""
    for k in range(n_scans):
        time_ns = T0_NS + k * 100_000_000
        places = [{"x": 5.0 + j % 200 * 0.3, "y": j // 200 * 0.3, "length": 4.0, "width": 2.0} for j in range(n)]
        yield time_ns, scan(time_ns, places)


def transforms(n: int, *, in_circle: bool) -> Iterable[tuple[int, object]]:
    for k in range(n):
        parent = f"f{k}" if k or not in_circle else f"f{n}"
        yield (
            T0_NS + k,
            {
                "timestamp": {"sec": T0_NS // 10**9, "nsec": k},
                "parent_frame_id": parent,
                "child_frame_id": f"f{k + 1}",
                "translation": {"x": 1.0, "y": 0.0, "z": 0.0},
                "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
            },
        )


def stations(n: int) -> Iterable[tuple[int, object]]:
    for k in range(n):
        core = {
            "msgCnt": k % 128, "id": f"{k:08x}", "secMark": k // 10 % 60_000, "lat": 510000000 + k, "long": 137000000,
            "elev": 1000, "speed": 556, "heading": 0,
        }  # fmt: skip
        yield T0_NS + k * 10_000_000, {"coreData": core}


def picture(data: bytes, kind: str) -> Iterable[tuple[int, object]]:
    import base64

    for k in range(3):
        stamp = {"sec": T0_NS // 10**9, "nsec": k}
        yield (
            T0_NS + k * 100_000_000,
            {"timestamp": stamp, "frame_id": "c", "format": kind, "data": base64.b64encode(data).decode()},
        )


def png(width: int, height: int, n_bytes: int) -> bytes:
    """A PNG of this size with so many bytes of zeros."""

    def part(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + part(b"IHDR", head)
        + part(b"IDAT", zlib.compress(bytes(n_bytes), 9))
        + part(b"IEND", b"")
    )


def progressive_jpeg(side_px: int, n_scans: int) -> bytes:
    """A grey picture whose scans each say of all blocks at once that nothing comes: some 70 bytes each."""

    def part(marker: int, data: bytes) -> bytes:
        return b"\xff" + bytes([marker]) + struct.pack(">H", len(data) + 2) + data

    n_blocks = (side_px // 8) ** 2
    one_code = bytes([1] + [0] * 15)
    head = b"\xff\xd8" + part(0xDB, b"\0" + b"\1" * 64)
    head += part(0xC2, struct.pack(">BHHB", 8, side_px, side_px, 1) + b"\1\x11\0")
    head += part(0xC4, b"\0" + one_code + b"\0") + part(0xC4, b"\x10" + one_code + b"\xe0")
    brightness = part(0xDA, b"\1\1\0\0\0\0") + bytes(n_blocks // 8)
    bits = ("0" + "1" * 14) * (n_blocks // 32767) + "0" + "0" * 14
    bits += "1" * (-len(bits) % 8)
    data = int(bits, 2).to_bytes(len(bits) // 8, "big").replace(b"\xff", b"\xff\0")
    return head + brightness + (part(0xDA, b"\1\1\0\1\x3f\0") + data) * n_scans + b"\xff\xd9"


def fixes(times: Iterable[int], **more: object) -> Iterable[tuple[int, object]]:
    for k, time_ns in enumerate(times):
        yield time_ns, fix(time_ns, 48.0 + 1e-6 * k, **more)


def years_apart() -> Iterable[int]:
    """Ten fixes a year, for 200 years."""
    return (T0_NS + year * 31_557_600 * 10**9 + k * 100_000_000 for year in range(200) for k in range(10))


def nested_json(depth: int) -> bytes:
    return b'{"a":' * depth + b"1" + b"}" * depth


# --- folders of recordings ---


def recorded(metadata: str, *links: tuple[str, str]) -> Make:
    def make(folder: Path) -> list[str]:
        place = folder / "drive"
        place.mkdir()
        (place / "metadata.yaml").write_text(metadata)
        shutil.copy(SAMPLE, place / "drive_0.mcap")
        for name, target in links:
            (place / name).symlink_to(target)
        return ["estimate", "drive", "-o", "out.mcap"]

    return make


def listing(*names: str) -> str:
    parts = "\n".join(f"    - {name}" for name in names)
    return f"rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n  relative_file_paths:\n{parts}\n"


# --- special files ---


def circle(command: list[str], name: str) -> Make:
    def make(folder: Path) -> list[str]:
        shutil.copy(SAMPLE, folder / "log.mcap")
        (folder / name).symlink_to("b")
        (folder / "b").symlink_to(name)
        return command

    return make


def device(command: list[str], name: str, target: str) -> Make:
    def make(folder: Path) -> list[str]:
        shutil.copy(SAMPLE, folder / "log.mcap")
        (folder / name).symlink_to(target)
        return command

    return make


# --- databases ---


def changed_database(*statements: str, name: str = "in.db3") -> Make:
    def make(folder: Path) -> list[str]:
        base = next(recording(folder / "drive", StoragePlugin.SQLITE3).glob("*.db3"))
        base.rename(folder / name)
        shutil.rmtree(folder / "drive")
        with sqlite3.connect(folder / name) as database:
            for each in statements:
                database.execute(each)
        database.close()
        return ["cut", name, "--start", "0", "-o", "out.mcap"]

    return make


def patched_database(change: Callable[[bytearray], None], *statements: str) -> Make:
    def make(folder: Path) -> list[str]:
        command = changed_database(*statements)(folder)
        data = bytearray((folder / "in.db3").read_bytes())
        change(data)
        (folder / "in.db3").write_bytes(data)
        return command

    return make


def page_cycle(data: bytearray) -> None:
    """Each inner page of the database points back to page 2."""
    size = int.from_bytes(data[16:18], "big") or 65536
    for start in range(0, len(data), size):
        head = start + (100 if start == 0 else 0)
        if data[head] in (2, 5):
            data[head + 8 : head + 12] = (2).to_bytes(4, "big")
    for start in range(size, len(data), size):
        if data[start] == 13:
            data[start] = 5
            data[start + 8 : start + 12] = (start // size + 1).to_bytes(4, "big")


def huge_page_count(data: bytearray) -> None:
    data[28:32] = b"\x7f\xff\xff\xff"
    data[36:40] = b"\x7f\xff\xff\xff"


# --- bags ---


def bagged(*chunks: bytes, tail: bytes = b"") -> Make:
    def make(folder: Path) -> list[str]:
        bag(folder / "in.bag", chunks, tail)
        return ["cut", "in.bag", "--start", "0", "-o", "out.mcap"]

    return make


# --- tables, zips, nets ---


def overlapping_zip(folder: Path) -> list[str]:
    """600 members that are all the same bytes of the file, which unpack to 20 MB each."""
    raw = b"time,latitude,longitude\n" + b"1,48,11\n" * 2_500_000
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    data = packer.compress(raw) + packer.flush()
    crc = zlib.crc32(raw)
    name = b"Location.csv"
    local = (
        struct.pack("<4sHHHHHIIIHH", b"PK\3\4", 20, 0, 8, 0, 0, crc, len(data), len(raw), len(name), 0) + name + data
    )
    central = b""
    for k in range(600):
        each = f"Location{k}.csv".encode() if k else name
        central += struct.pack(
            "<4sHHHHHHIIIHHHHHII", b"PK\1\2", 20, 20, 0, 8, 0, 0, crc, len(data), len(raw), len(each), 0, 0, 0, 0, 0, 0
        ) + each  # fmt: skip
    end = struct.pack("<4sHHHHIIH", b"PK\5\6", 0, 0, 600, 600, len(central), len(local), 0)
    (folder / "phone.zip").write_bytes(local + central + end)
    return ["import", "phone.zip", "-o", "out.mcap"]


def climbing_zip(folder: Path) -> list[str]:
    """Members above the folder, absolute ones, a link and two of one name."""
    made = files.sensor_logger(folder)[0]
    with zipfile.ZipFile(made) as source, zipfile.ZipFile(folder / "evil.zip", "w") as archive:
        table = source.read("Location.csv")
        link = zipfile.ZipInfo("Gyroscope.csv")
        link.external_attr = 0o120777 << 16
        archive.writestr(link, "/etc/passwd")
        for name in ("../../escaped/Location.csv", "/tmp/escaped/Location.csv", "Location.csv", EVIL):
            archive.writestr(name, table)
    made.unlink()
    return ["import", "evil.zip", "-o", "out.mcap"]


def zip64(folder: Path) -> list[str]:
    """A directory of 2^63 members at 2^62."""
    end64 = struct.pack("<4sQHHIIQQQQ", b"PK\6\6", 44, 45, 45, 0, 0, 1 << 63, 1 << 63, 1 << 62, 1 << 62)
    locator = struct.pack("<4sIQI", b"PK\6\7", 0, 4, 1)
    end = struct.pack("<4sHHHHIIH", b"PK\5\6", 0, 0, 0xFFFF, 0xFFFF, 0xFFFFFFFF, 0xFFFFFFFF, 0)
    (folder / "phone.zip").write_bytes(b"PK\3\4" + end64 + locator + end)
    return ["import", "phone.zip", "-o", "out.mcap"]


def parquet_of(**columns: Any) -> Make:
    def make(folder: Path) -> list[str]:
        import pyarrow as pa
        from pyarrow import parquet as pq

        pq.write_table(pa.table({name: column() for name, column in columns.items()}), folder / "a.parquet")
        return ["import", "a.parquet", "-o", "out.mcap"]

    return make


def parquet_footer(footer: bytes) -> Make:
    return file_and("a.parquet", b"PAR1" + footer + struct.pack("<I", len(footer)) + b"PAR1")


def proto(number: int, value: bytes | int) -> bytes:
    """A field of protobuf."""
    if isinstance(value, int):
        return encode_varint(number << 3) + encode_varint(value)
    return encode_varint(number << 3 | 2) + encode_varint(len(value)) + value


def onnx_model(graph: bytes) -> bytes:
    return proto(1, 8) + proto(7, graph) + proto(8, proto(1, b"") + proto(2, 13))


def onnx_tensor(dims: Iterable[int], **more: bytes) -> bytes:
    shape = b"".join(proto(1, each) for each in dims)
    return shape + proto(2, 1) + proto(8, b"w") + b"".join(more.values())


def nested_graphs(depth: int) -> bytes:
    graph = b""
    for _ in range(depth):
        graph = proto(1, proto(4, b"If") + proto(5, proto(1, b"then_branch") + proto(6, graph) + proto(20, 5)))
    return graph


def tiled_graph() -> bytes:
    """A graph that repeats its picture 20,000 times in both directions."""

    def declared(name: bytes, *dims: int) -> bytes:
        shape = b"".join(proto(1, proto(1, each)) for each in dims)
        return proto(1, name) + proto(2, proto(1, proto(1, 1) + proto(2, shape)))

    repeats = proto(1, 4) + proto(2, 7) + proto(8, b"r") + proto(9, struct.pack("<4q", 1, 1, 20_000, 20_000))
    node = proto(1, b"x") + proto(1, b"r") + proto(2, b"y") + proto(4, b"Tile")
    return proto(1, node) + proto(5, repeats) + proto(11, declared(b"x", 1, 3, 48, 64)) + proto(12, declared(b"y"))


EXTERNAL = proto(13, proto(1, b"location") + proto(2, b"../../../../etc/passwd")) + proto(14, 1)


NET_DESCRIPTION = """kind = "segmentation"
size = [64, 48]
colour = "rgb"
mean = [0.0, 0.0, 0.0]
std = [1.0, 1.0, 1.0]
classes = 2
lanes = [1]
activation = "none"
"""


def net(graph: bytes) -> Make:
    def make(folder: Path) -> list[str]:
        write = sent("/camera", "foxglove.CompressedImage", picture(png(64, 48, 10_000), "png"), "lanes")
        (folder / "net.onnx").write_bytes(onnx_model(graph))
        (folder / "net.toml").write_text(NET_DESCRIPTION)
        return [*write(folder), "--method", "onnx", "--model", "net.onnx", "--topic", "image=/camera"]

    return make


# --- folders of runs ---


def run_folder(change: Callable[[Path, dict[str, Any]], None], *command: str) -> Make:
    """The output of a run of two short logs, whose manifest is changed."""

    def make(folder: Path) -> list[str]:
        from cwcli.cli.main import run_command_line

        for k in range(2):
            shutil.copy(SAMPLE, folder / f"log{k}.mcap")
        out = folder / "run"
        code = run_command_line(
            ["run", str(folder / "log0.mcap"), str(folder / "log1.mcap"), "-d", str(out), "--jobs", "1", "--quiet"]
        )
        assert code == 0
        path = out / "manifest.json"
        manifest = json.loads(path.read_text())
        change(out, manifest)
        if path.exists() and not path.stat().st_size > 5_000_000:
            path.write_text(json.dumps(manifest))
        return list(command)

    return make


def climbing_ids(out: Path, manifest: dict[str, Any]) -> None:
    """Logs whose names in the folder lead out of it."""
    for k, entry in enumerate(manifest["logs"]):
        entry["id"] = ("../../../../etc", "/etc")[k]
        entry["outputs"] = ["/etc/passwd", "../../secret"]


def hostile_words(out: Path, manifest: dict[str, Any]) -> None:
    """Every text of the entries is hostile."""
    for entry in manifest["logs"]:
        entry["source"] = EVIL
        entry["status"] = "failed"
        entry["error"] = dict.fromkeys(("what", "where", "hint"), EVIL) | {"exit_code": 1e999, "found": [EVIL] * 9}


def deep_manifest(out: Path, manifest: dict[str, Any]) -> None:
    (out / "manifest.json").write_bytes(b'{"logs":' + b"[" * 3_000_000 + b"]" * 3_000_000 + b"}")


def wrong_kinds(out: Path, manifest: dict[str, Any]) -> None:
    """Numbers where texts are expected, texts for lists, and numbers beyond 64 bits."""
    manifest["tables"] = {"a": 1}
    manifest["pipeline"] = [[]]
    for entry in manifest["logs"]:
        entry.update(inputs=9, stages="estimate", left_out=[1], digest={"sentences": 10**40}, bytes="x", tables=[[]])


def links_instead_of_logs(out: Path, manifest: dict[str, Any]) -> None:
    for path in out.glob("logs/*/annotated.mcap"):
        path.unlink()
        path.symlink_to("/dev/zero")


def arrow_bomb(out: Path, manifest: dict[str, Any]) -> None:
    """A table of the run whose column of 10^9 zeros is a megabyte."""
    import pyarrow as pa
    from pyarrow import parquet as pq

    n = 10_000_000
    column = pa.DictionaryArray.from_arrays(pa.array(memoryview(bytes(4 * n)).cast("i")), pa.array(["x" * 1000]))
    table = pa.table({"log": column, "stage": column, "metric": column, "value": column})
    with pq.ParquetWriter(out / "metrics.parquet", table.schema, compression="zstd") as writer:
        for _ in range(10):
            writer.write_table(table)


def folder_like_a_log(folder: Path) -> list[str]:
    """A folder with the name of a log."""
    (folder / "d.mcap").mkdir()
    return ["info", "d.mcap"]


def folder_in_itself(folder: Path) -> list[str]:
    """A folder with a link to itself."""
    (folder / "d").mkdir()
    (folder / "d" / "d").symlink_to("../d")
    shutil.copy(SAMPLE, folder / "d")
    return ["find", "d", "all"]


def fleet_link(folder: Path) -> list[str]:
    """An output folder in which a log's folder is a link to elsewhere."""
    shutil.copy(SAMPLE, folder / "log.mcap")
    (folder / "elsewhere").mkdir()
    (folder / "elsewhere" / "annotated.mcap").write_text("precious")
    (folder / "out" / "logs").mkdir(parents=True)
    (folder / "out" / "logs" / "log").symlink_to(folder / "elsewhere")
    return ["run", "log.mcap", "-d", "out", "--jobs", "1"]


NMEA = b"$GPGGA,%06d.000,4808.2,N,01134.5,E,1,09,0.9,475.0,M,45.0,M,,*"


def checked(body: bytes) -> bytes:
    value = 0
    for each in body[1:-1]:
        value ^= each
    return body + b"%02X\r\n" % value


def backward_days() -> bytes:
    """A sentence a day for 300 years: the time of day falls every time."""
    return b"".join(checked(NMEA % (235959 - k % 2 * 235958)) for k in range(110_000))


def ubx_weeks() -> bytes:
    """Solutions whose date leaps between 1980 and 2079 in turns."""
    out = b""
    for k in range(20_000):
        payload = struct.pack(
            "<IHBBBBBBIiBBBBii", k * 100, 1980 + k * 37 % 100, 1, 1, 0, 0, 0, 7, 1, 0, 3, 1, 0, 9, 0, 0
        )
        payload = payload.ljust(92, b"\0")
        head = b"\x01\x07" + struct.pack("<H", len(payload))
        a = b = 0
        for byte in head + payload:
            a = (a + byte) & 255
            b = (b + a) & 255
        out += b"\xb5\x62" + head + payload + bytes([a, b])
    return out


def times_of(*rows: str) -> str:
    return "time,lat,lon\n" + "".join(f"{each},48.1,11.5\n" for each in rows)


def topics_sharing_a_chunk(folder: Path) -> list[str]:
    """The doctor meets 1,000 topics whose messages lie in one chunk of 200 MB."""
    ids = range(1, 1001)
    channels = (mcap_channel(each, 0, f"/{each}", "json") for each in ids)
    messages = b"".join(mcap_message(each, T0_NS, b'{"a":"' + b" " * 200_000 + b'"}') for each in ids)
    return logged(*channels, mcap_chunk(messages), command="info", options=["--doctor"])(folder)


def topics_of_a_large_schema(folder: Path) -> list[str]:
    """The doctor meets 128 topics of one protobuf schema of 20,000 types."""
    schemas = FileDescriptorSet()
    file = schemas.file.add(name="a.proto", syntax="proto3")
    for name in ("A", *(f"M{k}" for k in range(20_000))):
        file.message_type.add(name=name).field.add(name="x", number=1, type="TYPE_DOUBLE", label="LABEL_OPTIONAL")
    ids = range(1, 129)
    channels = (mcap_channel(each, 1, f"/{each}", "protobuf") for each in ids)
    messages = b"".join(mcap_message(each, T0_NS, b"") for each in ids)
    schema = mcap_schema(1, "A", "protobuf", schemas.SerializeToString())
    return logged(schema, *channels, mcap_chunk(messages), command="info", options=["--doctor"])(folder)


ATTACKS: dict[str, Make] = {
    # MCAP
    "mcap, one chunk in 100,000 entries of the summary": same_chunk_indexed_often,
    "mcap, one message in 500,000 entries of an index": same_message_indexed_often,
    "mcap, a summary that begins at the magic": summary_in_itself,
    "mcap, 5,000 channels of one id": logged(
        FIX_SCHEMA,
        *(mcap_channel(1, 1, f"/{k}", "json") + mcap_message(1, T0_NS + k, fix(T0_NS + k)) for k in range(5000)),
    ),
    "mcap, schemas of one id that differ": logged(
        *(mcap_schema(1, f"s{k}", "ros2msg", b"float64 x") + FIX_CHANNEL for k in range(3000)),
        mcap_message(1, T0_NS, b"{}"),
    ),
    "mcap, chunks inside each other": logged(mcap_chunk(mcap_chunk(mcap_chunk(FIX_SCHEMA + FIX_CHANNEL)))),
    "mcap, a window of 2 GB in a chunk": wide_window,
    "mcap.zst, a window of 2 GB": wide_window_file,
    "mcap.zst, 130 GB of zeros in 4 MB": zeros_behind_magic,
    "mcap, a channel with 500,000 entries of metadata": logged(
        FIX_SCHEMA, mcap_channel(1, 1, "/fix", "json", b"".join(text(f"{k}") + text("") for k in range(500_000)))
    ),
    "mcap, 200 years between fixes": sent("/fix", "foxglove.LocationFix", fixes(years_apart())),
    "mcap, times at both ends of 64 bits": sent("/fix", "foxglove.LocationFix", fixes([0, (1 << 64) - 1] * 500)),
    "mcap, positions that are no numbers": sent(
        "/fix",
        "foxglove.LocationFix",
        (
            (
                T0_NS + k * 10**8,
                fix(T0_NS + k * 10**8).replace(b"48.0", (b"NaN", b"Infinity", b"1e999", b"-1e308", b"91")[k % 5]),
            )
            for k in range(2000)
        ),
    ),
    "mcap, a number of a million digits": sent(
        "/fix", "foxglove.LocationFix", ((T0_NS + k, fix(T0_NS).replace(b"48.0", b"4" * 1_000_000)) for k in range(20))
    ),
    "mcap, a key 100,000 times": sent(
        "/fix",
        "foxglove.LocationFix",
        ((T0_NS + k, b'{"latitude":1' + b',"latitude":2' * 100_000 + b"}") for k in range(20)),
    ),
    "mcap, JSON of 20,000 levels": sent(
        "/fix", "foxglove.LocationFix", ((T0_NS + k, nested_json(20_000)) for k in range(9))
    ),
    "mcap, 20,000 detections in a scan": sent("/objects", SCHEMA, detections(20_000, 3), "track"),
    "mcap, 2,000 detections in each of 20 scans": sent("/objects", SCHEMA, detections(2000, 20), "track"),
    "mcap, 20,000 transforms in a chain": sent(
        "/tf", "foxglove.FrameTransform", transforms(20_000, in_circle=False), "info"
    ),
    "mcap, 20,000 transforms in a circle": sent(
        "/tf", "foxglove.FrameTransform", transforms(20_000, in_circle=True), "info", "--doctor"
    ),
    "mcap, 1,000 topics share a chunk of 200 MB": topics_sharing_a_chunk,
    "mcap, 128 topics of a schema of 20,000 types": topics_of_a_large_schema,
    "mcap, 30,000 stations of one message": sent("/bsm", "BasicSafetyMessage", stations(30_000), "estimate"),
    "mcap, a PNG of 60,000 by 60,000": sent(
        "/camera", "foxglove.CompressedImage", picture(png(60_000, 60_000, 1000), "png"), "lanes"
    ),
    "mcap, a PNG that says 64 by 48 and holds 1 GB": sent(
        "/camera", "foxglove.CompressedImage", picture(png(64, 48, 1_000_000_000), "png"), "lanes"
    ),
    "mcap, a PNG of 11,000 by 9,000": sent(
        "/camera", "foxglove.CompressedImage", picture(png(11_000, 9_000, 297_009_000), "png"), "lanes"
    ),
    "mcap, a JPEG of 5,000 scans": sent(
        "/camera", "foxglove.CompressedImage", picture(progressive_jpeg(6400, 5000), "jpeg"), "lanes"
    ),
    # options and expressions
    "topics, a pattern of 40 stars": lambda folder: [
        *sent("/" + "a" * 5000, "x", [(T0_NS, {})], "cut")(folder),
        "--topics",
        "/" + "*a" * 40 + "b",
    ],
    "find, 50,000 brackets": sample("find", "log.mcap", "(" * 50_000 + "ego.speed_mps > 1" + ")" * 50_000),
    "find, 50,000 times not": sample("find", "log.mcap", "not " * 25_000 + "ego.speed_mps > 1"),
    "find, 130 conditions": sample("find", "log.mcap", " or ".join(["gnss-outage"] * 130)),
    "gate, a power of powers": sample("evaluate", "log.mcap", "--gate", "ego.position_rmse_m < 9**9**9**9"),
    "gate, 30,000 brackets": sample(
        "evaluate", "log.mcap", "--gate", "(" * 30_000 + "ego.position_rmse_m" + ")" * 30_000 + "< 1"
    ),
    "map, 40,000 parts of a field": sample("info", "log.mcap", "--map", "ego_speed=/gps/fix:" + "a." * 40_000 + "b"),
    "map, brackets of a slow pattern": sample(
        "info", "log.mcap", "--map", "ego_speed=/gps/fix:x*" + "(" * 9000 + "1e" * 9000
    ),
    # settings
    "config, 300,000 stages": sample(
        "run",
        "log.mcap",
        "-o",
        "out.mcap",
        "--config",
        "c.toml",
        c_toml="[run]\nstages = [" + '"estimate",' * 300_000 + "]\n",
    ),
    "config, a key with escapes": sample(
        "run", "log.mcap", "-o", "out.mcap", "--config", "c.toml", c_toml='"\\u001b[31m<b>\\u202e" = 1\n'
    ),
    "config, a date for a number": sample(
        "run", "log.mcap", "-o", "out.mcap", "--config", "c.toml", c_toml="[estimate]\nseed = 9999-12-31T23:59:60Z\n"
    ),
    "calibration, numbers without end": sample(
        "estimate",
        "log.mcap",
        "-o",
        "out.mcap",
        "--calibration",
        "c.toml",
        c_toml="format = 1\n[speed]\nscale = inf\nbias = nan\n[imu]\nyaw_deg = 1e308\n",
    ),
    "vehicle, no wheelbase": sample(
        "lanes",
        "log.mcap",
        "-o",
        "out.mcap",
        "--config",
        "c.toml",
        c_toml="[vehicle]\nwheelbase_m = -0.0\nmass_kg = inf\n",
    ),
    "expect, 5,000 topics with escapes": sample(
        "info",
        "log.mcap",
        "--expect",
        "c.toml",
        c_toml="".join(f'[topics."/\\u001b[31m{k}\\u202e<b>"]\nmin_rate_hz = 1\n' for k in range(5000)),
    ),
    "expect, patterns of stars": sample(
        "info", "log.mcap", "--expect", "c.toml", c_toml=f'[topics."{"*a" * 200}"]\nmin_rate_hz = 1\n'
    ),
    "scenario, 10^12 seconds": sample(
        "simulate",
        "s.toml",
        "-o",
        "out.mcap",
        s_toml="duration_s = 1e12\n[vehicles.host]\nspeed_mps = 1\n[sensors.gnss]\n",
    ),
    "scenario, a rate of 10^12": sample(
        "simulate",
        "s.toml",
        "-o",
        "out.mcap",
        s_toml="duration_s = 100\n[vehicles.host]\nspeed_mps = 1\n[sensors.imu]\nrate_hz = 1e12\n",
    ),
    "scenario, 20,000 vehicles": sample(
        "simulate",
        "s.toml",
        "-o",
        "out.mcap",
        s_toml="duration_s = 100\n[vehicles.host]\nspeed_mps = 1\n[v2x]\n[sensors.gnss]\n"
        + "".join(f"[vehicles.v{k}]\nspeed_mps = 1\nx_m = {k}\n" for k in range(20_000)),
    ),
    "scenario, a name of escapes": sample(
        "simulate",
        "s.toml",
        "-o",
        "out.mcap",
        s_toml='duration_s = 1\n[vehicles.host]\nspeed_mps = 1\n[vehicles."\\u001b[31m<b>\\u202e"]\nspeed_mps = nan\n',
    ),
    # recordings
    "yaml, files above the folder": recorded(listing("../../../../etc/passwd", "/etc/passwd", "drive_0.mcap")),
    "yaml, a name of escapes": recorded(listing('"\\e[31m\\u202e\\r<b>.mcap"', "drive_0.mcap")),
    "yaml, a file 50,000 times": recorded(listing(*["drive_0.mcap"] * 50_000)),
    "yaml, links to a device and to themselves": recorded(
        listing("z.mcap", "loop.mcap", "drive_0.mcap"), ("z.mcap", "/dev/zero"), ("loop.mcap", "loop.mcap")
    ),
    "yaml, anchors of anchors": recorded(
        "a0: &a0 [x,x]\n" + "".join(f"a{k + 1}: &a{k + 1} [*a{k},*a{k},*a{k}]\n" for k in range(60))
    ),
    # links, pipes and devices
    "log, a link to itself": circle(["info", "a.mcap"], "a.mcap"),
    "log, a folder that ends in .mcap": folder_like_a_log,
    "config, an endless device": device(
        ["run", "log.mcap", "-o", "out.mcap", "--config", "c.toml"], "c.toml", "/dev/zero"
    ),
    "dbc, an endless device": device(["info", "log.mcap", "--dbc", "c.dbc"], "c.dbc", "/dev/urandom"),
    "import, an endless device": device(["import", "a.csv", "-o", "out.mcap"], "a.csv", "/dev/urandom"),
    "import, a link to itself": circle(["import", "a.csv", "-o", "out.mcap"], "a.csv"),
    "expect, an endless device": device(["info", "log.mcap", "--expect", "c.toml"], "c.toml", "/dev/zero"),
    "run, a log's folder that is a link": fleet_link,
    "find, a folder of links in a circle": folder_in_itself,
    # databases
    "db3, names that are SQL": changed_database(
        "update topics set name = '/x''; drop table messages; --' where id = 1",
        "update topics set type = '<b>' || char(27)",
    ),
    "db3, a name of an address": changed_database(name="in?mode=rwc&vfs=unix-none#.db3"),
    "db3, times at both ends": changed_database(
        "update messages set timestamp = case id % 2 when 0 then -9223372036854775808 else 9223372036854775807 end"
    ),
    "db3, texts and numbers for bytes": changed_database(
        "update messages set data = case id % 4 when 0 then 7 when 1 then 'x' when 2 then 1e308 else zeroblob(0) end",
        "update messages set timestamp = 'never' where id % 3 = 0",
    ),
    "db3, pages in a circle": patched_database(page_cycle),
    "db3, 2^31 pages": patched_database(huge_page_count),
    "db3, a blob of 900 MB": changed_database("update messages set data = zeroblob(900000000) where id = 2"),
    "db3, topics of one id": changed_database(
        "create table t2 as select * from topics",
        "drop table topics",
        "alter table t2 rename to topics",
        "insert into topics select * from topics",
        "insert into topics select * from topics",
    ),
    # bags
    "bag, times beyond 32 bits of nanoseconds": bagged(
        chunk(
            connection(0, "/t", "p/T", "int8 x")
            + message(0, b"\1").replace(b"time=" + bytes(8), b"time=" + b"\xff" * 8)
        )
    ),
    "bag, names of escapes": bagged(chunk(connection(0, EVIL, "p/T", "int8 x") + message(0, b"\1"))),
    "bag, a million connections of one id": bagged(
        chunk(b"".join(connection(0, f"/t{k % 7}", "p/T", "int8 x") for k in range(200_000)) + message(0, b"\1"), "bz2")
    ),
    "bag, chunks inside each other": bagged(chunk(chunk(chunk(connection(0, "/t", "p/T", "int8 x"))))),
    # tables
    "csv, times of year 292,277": file_and("a.csv", times_of(*(f"{9223372036854775000 + k}" for k in range(100)))),
    "csv, a formula as a name": file_and(
        "a.csv", "time,lat,lon,=cmd|'/c calc'!A1,@SUM(1)\n" + "".join(f"{1.7e9 + k},48.1,11.5,1,2\n" for k in range(50))
    ),
    "csv, times 200 years apart": file_and("a.csv", times_of(*(f"{1.7e9 + k * 3.1e8}" for k in range(20)))),
    "csv, nothing but signs of NaN": file_and("a.csv", times_of(*["nan", "inf", "-inf", "1e999"] * 9000)),
    "csv, null bytes": file_and("a.csv", times_of(*(f"{1.7e9 + k}\0" for k in range(100)))),
    "csv, EXIF of dates": file_and(
        "a.csv", times_of(*(f"{k % 40:02}/{k % 17:02}/{k:04} 2{k % 7}:{k % 70:02}" for k in range(30_000)))
    ),
    "nmea, a day back in each of 110,000 sentences": file_and("a.nmea", backward_days()),
    "ubx, leaps of decades": file_and("a.ubx", ubx_weeks()),
    "gpx, places that are no numbers": file_and(
        "a.gpx",
        GPX.format(
            "",
            "<trkseg>"
            + "".join(
                f'<trkpt lat="{v}" lon="{v}"><time>{t}</time></trkpt>'
                for v in ("nan", "inf", "1e999", "-91", "0x10", "٤٨", "")
                for t in ("9999-12-31T23:59:60Z", "0000-00-00T00:00:00Z", "2023-01-01T00:00:00+99:99", "x" * 9999)
            )
            + "</trkseg>",
        ),
    ),
    "gpx, an encoding that lies": file_and("a.gpx", '<?xml version="1.0" encoding="UTF-7"?><gpx>+ADw-trk+AD4-</gpx>'),
    "gpx, entities of parameters": file_and(
        "a.gpx",
        '<?xml version="1.0"?><!DOCTYPE gpx [<!ENTITY % a SYSTEM "http://127.0.0.1:9/x"> %a; '
        "<!ENTITY % b \"<!ENTITY c '%a;'>\"> %b;]>"
        "<gpx>&c;</gpx>",
    ),
    "kml, laughs": file_and("a.kml", '<!DOCTYPE kml [<!ENTITY a "&b;&b;"><!ENTITY b "&a;">]><kml>&a;</kml>'),
    "json, 10^6 brackets": file_and("a.json", "[" * 1_000_000),
    "notebook, 10^6 brackets": file_and("map.ipynb", '{"cells": ' + "[" * 1_000_000),
    "zip, 600 members that are the same bytes": overlapping_zip,
    "zip, members above the folder": climbing_zip,
    "zip, 2^63 members": zip64,
    "zip, a megabyte of comment that is a zip": file_and("phone.zip", b"PK\3\4" + b"PK\5\6" * 200_000),
    "parquet, a footer of 10^6 brackets": parquet_footer(b"\x19\x1c" * 500_000),
    "parquet, a footer that lists 2^31 columns": parquet_footer(
        b"\x15\x02\x19\xfc\xff\xff\xff\xff\x07" + b"\x00" * 100
    ),
    "parquet, times of years beyond 10,000": parquet_of(
        time=lambda: __import__("pyarrow").array([2**47 + k for k in range(99)], __import__("pyarrow").timestamp("s")),
        lat=lambda: __import__("pyarrow").array([48.0] * 99),
        lon=lambda: __import__("pyarrow").array([11.0] * 99),
    ),
    # traces and nets
    "blf, times of 10^19 ns": lambda folder: [
        "import",
        written(
            folder, "a.blf", blf(struct.pack("<4sHHIIIHHQ", b"LOBJ", 32, 1, 48, 1, 2, 0, 0, 2**64 - 1) + bytes(16)) * 3
        ),
        "--dbc",
        str(files.can_blf(folder)[1].name),
        "-o",
        "out.mcap",
    ],
    "dbc, names of escapes": lambda folder: [
        "import",
        files.can_dump(folder)[0].name,
        "--dbc",
        written(
            folder,
            "evil.dbc",
            (files.DBC + f'BO_ 9 M: 8 E\n SG_ x : 0|8@1+ (nan,inf) [0|0] "{EVIL[:20]}" E\n').encode(),
        ),
        "-o",
        "out.mcap",
    ],
    "net, graphs of 20,000 levels": net(nested_graphs(20_000)),
    "net, weights of 2^62": net(proto(5, onnx_tensor([1 << 31, 1 << 31]))),
    "net, weights in another file": net(proto(5, onnx_tensor([1], external=EXTERNAL))),
    "net, an output of 10^13 values": net(tiled_graph()),
    # folders of runs
    "manifest, names that climb": run_folder(climbing_ids, "report", "run", "-o", "out.html"),
    "manifest, names that climb, found": run_folder(climbing_ids, "find", "run", "all"),
    "manifest, names that climb, scored": run_folder(climbing_ids, "evaluate", "run"),
    "manifest, hostile words on a page": run_folder(hostile_words, "report", "run", "-o", "out.html"),
    "manifest, hostile words compared": run_folder(hostile_words, "compare", "run", "run"),
    "manifest, 3 million brackets": run_folder(deep_manifest, "report", "run", "-o", "out.html"),
    "manifest, 3 million brackets, found": run_folder(deep_manifest, "find", "run", "all"),
    "manifest, 3 million brackets, run again": run_folder(
        deep_manifest, "run", "log0.mcap", "log1.mcap", "-d", "run", "--jobs", "1"
    ),
    "manifest, other kinds of values": run_folder(wrong_kinds, "report", "run", "-o", "out.html"),
    "manifest, other kinds of values, scored": run_folder(wrong_kinds, "evaluate", "run"),
    "manifest, other kinds of values, compared": run_folder(wrong_kinds, "compare", "run", "run"),
    "run, links to a device for logs": run_folder(links_instead_of_logs, "report", "run", "-o", "out.html"),
    "run, links to a device, found": run_folder(links_instead_of_logs, "find", "run", "all"),
    "metrics, 10^8 rows of text": run_folder(arrow_bomb, "compare", "run", "run"),
    "metrics, 10^8 rows of text on a page": run_folder(arrow_bomb, "report", "run", "-o", "out.html"),
    "metrics, 10^8 rows of text, scored": run_folder(arrow_bomb, "evaluate", "run"),
}
"""Name -> maker."""
