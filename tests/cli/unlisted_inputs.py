"""More hostile inputs: kinds that `hostile_inputs` does not have. A maker of each, and the command that meets it."""

from __future__ import annotations

import base64
import bz2
import os
import shutil
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import lz4.frame
import zstandard
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory

from tests.cli.hostile_inputs import (
    FIX_CHANNEL,
    FIX_SCHEMA,
    HEADER,
    MAGIC,
    NET_DESCRIPTION,
    SAMPLE,
    T0_NS,
    Make,
    bagged,
    changed_database,
    file_and,
    fix,
    fixes,
    listing,
    logged,
    mcap_channel,
    mcap_chunk,
    mcap_message,
    mcap_record,
    mcap_schema,
    nested_graphs,
    net,
    patched_database,
    picture,
    png,
    proto,
    recorded,
    run_folder,
    sample,
    sent,
    text,
    times_of,
    u16,
    u64,
    written,
)
from tests.unit.importing import files
from tests.unit.importing.hostile_imports import GPX, SIGNAL
from tests.unit.importing.unforeseen_imports import MULTIPLEXED
from tests.unit.logs_read.hostile_containers import bag_header, chunk, connection, message, one_topic, record, u32

MEGABYTE = 1_000_000


def recovered(make: Make) -> Make:
    """The same with `--recover`."""
    return lambda folder: [*make(folder), "--recover"]


def later(make: Callable[[], Make]) -> Make:
    """What is large is made when it is needed."""

    def made(folder: Path) -> list[str]:
        return make()(folder)

    return made


# --- bags ---


def bag_index(number: int, count: int, entries: bytes = b"") -> bytes:
    return record({"op": b"\4", "ver": u32(1), "conn": u32(number), "count": u32(count)}, entries)


ONE = connection(0, "/t", "p/T", "int8 x") + message(0, b"\1")


def packed_chunk(compression: bytes, size: int, data: bytes) -> bytes:
    """A chunk with data as they are."""
    return record({"op": b"\5", "compression": compression, "size": u32(size)}, data)


def false_chunks(folder: Path) -> list[str]:
    """A bag that is damaged at its begin, and 300,000 places that look like a chunk."""
    head = record({"op": b"\5", "compression": b"none", "size": u32(7)}, b"")
    (folder / "in.bag").write_bytes(b"#ROSBAG V2.0\n" + u32(9) + head * 120_000)
    return ["cut", "in.bag", "--start", "0", "-o", "out.mcap", "--recover"]


def chunk_marks(folder: Path) -> list[str]:
    """A bag of nothing but the mark of a chunk."""
    (folder / "in.bag").write_bytes(b"#ROSBAG V2.0\n" + u32(9) + b"op=\x05" * MEGABYTE)
    return ["cut", "in.bag", "--start", "0", "-o", "out.mcap", "--recover"]


def old_bag(n: int) -> Make:
    """A bag of version 1.2 with this many definitions."""

    def make(folder: Path) -> list[str]:
        records = b"".join(
            record({"op": b"\1", "topic": b"/%d" % k, "type": b"p/T", "md5": b"*", "def": b"int8 x%d" % k}, b"")
            for k in range(n)
        )
        (folder / "in.bag").write_bytes(b"#ROSBAG V1.2\n" + records)
        return ["cut", "in.bag", "--start", "0", "-o", "out.mcap"]

    return make


# --- databases ---


def overflow_circle(data: bytearray) -> None:
    """Each page that carries on a long value points to itself."""
    size = int.from_bytes(data[16:18], "big") or 65536
    for start in range(size, len(data), size):
        following = int.from_bytes(data[start : start + 4], "big")
        if following == start // size + 2 and not any(data[start + 4 : start + 64]):
            data[start : start + 4] = (start // size + 1).to_bytes(4, "big")


def header_of(at: int, value: bytes) -> Callable[[bytearray], None]:
    def change(data: bytearray) -> None:
        data[at : at + len(value)] = value

    return change


def free_list(data: bytearray) -> None:
    """The list of free pages begins at a page in use, and has 2^31 of them."""
    data[32:40] = (2).to_bytes(4, "big") + b"\x7f\xff\xff\xff"


BIG = "update messages set data = zeroblob(3000000) where id = 2"


def beside(suffix: str, content: bytes | None = None, target: str | None = None, *, keep: str | None = None) -> Make:
    """A database with a file, a link, or a pipe beside it; `keep` is a file that must stay."""

    def make(folder: Path) -> list[str]:
        command = changed_database()(folder)
        place = folder / f"in.db3{suffix}"
        if keep is not None:
            (folder / keep).write_text("precious")
        if target is not None:
            place.symlink_to(target)
        elif content is None:
            os.mkfifo(place)
        else:
            place.write_bytes(content)
        return command

    return make


JOURNAL_MAGIC = b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7"


def journal_of_another(folder: Path) -> list[str]:
    """A rollback journal that names a file as its master, which SQLite removes when it has undone the changes."""
    command = changed_database()(folder)
    data = (folder / "in.db3").read_bytes()
    size = int.from_bytes(data[16:18], "big") or 65536
    precious = folder / "precious.txt"
    precious.write_text("nothing that a log may remove")
    name = str(precious).encode()
    page, nonce = data[:size], 7
    checksum = (nonce + sum(page[k] for k in range(size - 200, 0, -200))) & 0xFFFFFFFF
    head = JOURNAL_MAGIC + struct.pack(">IIIII", 1, nonce, len(data) // size, 512, size)
    master = struct.pack(">I", 0x40000000 // size + 1) + name
    master += struct.pack(">II", len(name), sum(name)) + JOURNAL_MAGIC
    body = struct.pack(">I", 1) + page + struct.pack(">I", checksum)
    padded = head.ljust(512, b"\0") + body
    (folder / "in.db3-journal").write_bytes(padded + master)
    return command


WAL = struct.pack(">8I", 0x377F0682, 3007000, 4096, 0, 1, 2, 3, 4)


# --- MCAP ---


def with_summary(*summary: bytes, data: bytes = b"") -> Make:
    """A log with one fix and a summary of these records."""

    def make(folder: Path) -> list[str]:
        body = FIX_SCHEMA + FIX_CHANNEL + mcap_message(1, T0_NS, fix(T0_NS)) + data
        end = mcap_record(15, u32(0))
        at = len(MAGIC + HEADER + body + end)
        footer = mcap_record(2, u64(at) + u64(0) + u32(0)) + MAGIC
        parts = MAGIC, HEADER, body, end, FIX_SCHEMA, FIX_CHANNEL, *summary, footer
        return ["cut", written(folder, "in.mcap", *parts), "--start", "0", "-o", "out.mcap"]

    return make


def statistics(n: int) -> bytes:
    counts = b"".join(u16(k) + u64(n) for k in range(1, 5000))
    return mcap_record(11, u64(n) + u16(9) + u32(9) * 4 + u64(0) + u64(n) + u32(len(counts)) + counts)


def attachment_index(offset: int, length: int) -> bytes:
    times = u64(T0_NS) * 2
    return mcap_record(10, u64(offset) + u64(length) + times + u64(1 << 62) + text("../../escaped") + text("a/b"))


def chunk_index(offset: int, length: int, size: int = 100) -> bytes:
    body = u64(T0_NS) + u64(T0_NS) + u64(offset) + u64(length) + u32(0) + u64(0) + text("zstd") + u64(size) + u64(size)
    return mcap_record(8, body)


def with_schema(encoding: str, data: bytes, payload: bytes = b"\0" * 64, message_encoding: str = "cdr") -> Make:
    """A channel of some schema with twenty messages."""
    return logged(
        mcap_schema(1, "p/msg/T", encoding, data),
        mcap_channel(1, 1, "/t", message_encoding),
        *(mcap_message(1, T0_NS + k, payload) for k in range(20)),
    )


def read_fields(make: Make, field: str = "/t:a") -> Make:
    """`cwcli find` over a field of the log."""
    return lambda folder: ["find", make(folder)[1], f"{field} > 1"]


def descriptor(*fields: bytes, name: bytes = b"T") -> bytes:
    """A set of one file of protobuf with one message type."""
    kind = proto(1, name) + b"".join(proto(2, each) for each in fields)
    return proto(1, proto(1, b"a.proto") + proto(4, kind) + proto(12, b"proto3"))


def proto_field(name: bytes, number: int, kind: int, type_name: bytes = b"") -> bytes:
    more = proto(6, type_name) if type_name else b""
    return proto(1, name) + proto(3, number) + proto(4, 1) + proto(5, kind) + more


def protobuf(schema: bytes, payload: bytes) -> Make:
    return read_fields(
        logged(
            mcap_schema(1, "T", "protobuf", schema),
            mcap_channel(1, 1, "/t", "protobuf"),
            *(mcap_message(1, T0_NS + k, payload) for k in range(20)),
        )
    )


def holding_itself(depth: int) -> bytes:
    data = b""
    for _ in range(depth):
        data = proto(1, data)
    return data


# --- pictures ---


def png_of(*parts: tuple[bytes, bytes]) -> bytes:
    """A PNG of 64 by 48 with parts in front of its data."""
    data = png(64, 48, 64 * 48 * 3 + 48)
    at = data.index(b"IDAT") - 4
    made = (struct.pack(">I", len(d)) + kind + d + struct.pack(">I", zlib.crc32(kind + d)) for kind, d in parts)
    return data[:at] + b"".join(made) + data[at:]


def webp(width: int, height: int, frames: int) -> bytes:
    """A WebP that moves: its canvas and frames of no picture."""
    size = struct.pack("<I", width - 1)[:3] + struct.pack("<I", height - 1)[:3]
    body = b"VP8X" + u32(10) + b"\x02\0\0\0" + size + b"ANIM" + u32(6) + bytes(6)
    frame = bytes(6) + size + b"\1\0\0\0" + b"VP8L" + u32(6) + b"\x2f" + bytes(5)
    body += (b"ANMF" + u32(len(frame)) + frame) * frames
    return b"RIFF" + u32(len(body) + 4) + b"WEBP" + body


def lossless(width: int, height: int) -> bytes:
    """A WebP whose picture is one colour: a few bytes for any size."""
    bits = f"{width - 1:014b}"[::-1] + f"{height - 1:014b}"[::-1] + "0" + "000" + "0" + "0" + "0" + "1000" * 5 * 4
    data = b"\x2f" + int(bits[::-1], 2).to_bytes(len(bits) // 8 + 1, "little")
    data += b"\0" * (len(data) % 2)
    return b"RIFF" + u32(len(data) + 12) + b"WEBPVP8L" + u32(len(data)) + data


def frames_of(datas: Iterable[bytes], kind: str) -> Iterator[tuple[int, object]]:
    for k, data in enumerate(datas):
        stamp = {"sec": T0_NS // 10**9, "nsec": k}
        content = {"timestamp": stamp, "frame_id": "c", "format": kind, "data": base64.b64encode(data).decode()}
        yield T0_NS + k * 40_000_000, content


def raw_images(**fields: object) -> Iterator[tuple[int, object]]:
    for k in range(20):
        stamp = {"sec": T0_NS // 10**9, "nsec": k}
        yield T0_NS + k * 40_000_000, {"timestamp": stamp, "frame_id": "c", "data": "AAAA", **fields}


def exp_golomb(n: int) -> str:
    digits = f"{n + 1:b}"
    return "0" * (len(digits) - 1) + digits


def sps(width_px: int, height_px: int) -> bytes:
    """A sequence parameter set of H.264's baseline."""
    bits = f"{66:08b}{0:08b}{51:08b}" + "".join(map(exp_golomb, (0, 0, 2, 1))) + "0"
    bits += exp_golomb(width_px // 16 - 1) + exp_golomb(height_px // 16 - 1) + "1" + "0" + "0" + "0" + "1"
    bits += "0" * (-len(bits) % 8)
    return b"\0\0\0\1\x67" + int(bits, 2).to_bytes(len(bits) // 8, "big")


PPS_AND_SLICE = b"\0\0\0\1\x68\xce\x3c\x80\0\0\0\1\x65\x88\x84\0\x10\xff\xff"


def vp9(width_px: int, height_px: int) -> bytes:
    bits = "10" + "00" + "0" + "0" + "1" + "0" + f"{0x498342:024b}" + "001" + "0"
    bits += f"{width_px - 1:016b}{height_px - 1:016b}" + "0" * 68
    return int(bits, 2).to_bytes(len(bits) // 8, "big")


# --- annotated logs ---


def forged(command: list[str], change: Callable[[str, int, Any], Iterable[Any]], settings: str | None = None) -> Make:
    """An annotated log whose messages are changed: topic, number, message -> what stands for it."""

    def make(folder: Path) -> list[str]:
        from cwcli.cli.main import run_command_line

        plain = folder / "plain.mcap"
        assert run_command_line(["run", str(SAMPLE), "-o", str(plain), "--quiet"]) == 0
        with plain.open("rb") as source, (folder / "in.mcap").open("wb") as target:
            reader, factory = make_reader(source), DecoderFactory()
            writer = Writer(target)
            writer.start()
            channels: dict[int, int] = {}
            counts: dict[str, int] = {}
            for schema, channel, sent_message in reader.iter_messages():
                if channel.id not in channels:
                    assert schema is not None
                    number = writer.register_schema(schema.name, schema.encoding, schema.data)
                    channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, number)
                k = counts[channel.topic] = counts.get(channel.topic, -1) + 1
                datas: Iterable[bytes] = [sent_message.data]
                if channel.topic.startswith("/cwcli/"):
                    kind = factory.decoder_for("protobuf", schema)
                    assert kind is not None
                    datas = [each.SerializeToString() for each in change(channel.topic, k, kind(sent_message.data))]
                for data in datas:
                    writer.add_message(channels[channel.id], sent_message.log_time, data, sent_message.publish_time)
            for record_ in reader.iter_metadata():
                said = dict(record_.metadata)
                writer.add_metadata(record_.name, dict.fromkeys(said, settings) if settings is not None else said)
            writer.finish()
        plain.unlink()
        return command

    return make


def set_all(message_: Any, value: float) -> None:
    """Every number of a message, and of those in it, becomes this one."""
    for field, inner in message_.ListFields():
        if field.message_type is not None:
            for each in [inner] if hasattr(inner, "ListFields") else inner:
                set_all(each, value)
        elif field.cpp_type in (field.CPPTYPE_DOUBLE, field.CPPTYPE_FLOAT):
            if isinstance(inner, float):
                setattr(message_, field.name, value)
            else:
                inner[:] = [value] * len(inner)


def numbers_of(value: float) -> Callable[[str, int, Any], Iterable[Any]]:
    def change(topic: str, k: int, message_: Any) -> Iterable[Any]:
        set_all(message_, value)
        yield message_

    return change


def warned_often(topic: str, k: int, message_: Any) -> Iterable[Any]:
    """Each warning 2,000 times, each with another name."""
    for n in range(2000 if topic == "/cwcli/warnings" else 1):
        for field, value in message_.ListFields():
            if isinstance(value, str) and topic == "/cwcli/warnings":
                setattr(message_, field.name, f"<b>\x1b[31m{k}.{n}")
        yield message_


def long_paths(topic: str, k: int, message_: Any) -> Iterable[Any]:
    """Paths of 20,000 steps: their lists are repeated."""
    for field, value in message_.ListFields() if topic.endswith("/path") else []:
        if not isinstance(value, (str, bytes, int, float)) and not hasattr(value, "ListFields") and len(value):
            for _ in range(9):
                getattr(message_, field.name).extend(list(value))
    yield message_


# --- folders of runs ---


def many_logs(out: Path, manifest: dict[str, Any]) -> None:
    """A manifest of 2,000 logs of which one is there."""
    manifest["logs"] = [{**manifest["logs"][0], "id": f"log{k}"} for k in range(2000)]


def same_ids(out: Path, manifest: dict[str, Any]) -> None:
    manifest["logs"] = [manifest["logs"][0]] * 500


def no_numbers(out: Path, manifest: dict[str, Any]) -> None:
    for each in (manifest, *manifest["logs"]):
        for key, value in each.items():
            if isinstance(value, int | float):
                each[key] = (float("nan"), float("-inf"), 1e308)[len(key) % 3]


def manifest_device(out: Path, manifest: dict[str, Any]) -> None:
    (out / "manifest.json").unlink()
    (out / "manifest.json").symlink_to("/dev/zero")


def long_table_name(out: Path, manifest: dict[str, Any]) -> None:
    manifest["tables"] = ["n" * 300]


def tables_replaced(write: Callable[[Path], None]) -> Callable[[Path, dict[str, Any]], None]:
    """Every table of the run becomes another one."""

    def change(out: Path, manifest: dict[str, Any]) -> None:
        for path in out.rglob("*.parquet"):
            write(path)

    return change


def pages_of_lies(path: Path) -> None:
    """A table whose footer says 2^62 rows."""
    data = bytearray(path.read_bytes())
    n = struct.unpack("<I", data[-8:-4])[0]
    footer = data[-8 - n : -8]
    at = footer.find(b"\x16")
    footer[at + 1 : at + 2] = b"\xfe\xff\xff\xff\xff\xff\xff\xff\x7f"
    path.write_bytes(bytes(data[: -8 - n] + footer + struct.pack("<I", len(footer)) + b"PAR1"))


def table_device(path: Path) -> None:
    path.unlink()
    path.symlink_to("/dev/zero")


def table_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def nested_table(path: Path) -> None:
    """Columns of lists in lists, and of times, where numbers are expected."""
    import pyarrow as pa
    from pyarrow import parquet as pq

    names = pq.read_schema(path).names
    kind: Any = pa.float64()
    for _ in range(60):
        kind = pa.list_(kind)
    pq.write_table(pa.table({name: pa.nulls(3, kind) for name in names}), path)


def many_groups(path: Path, n: int = 1000) -> None:
    """A table of this many groups of a row."""
    import pyarrow as pa
    from pyarrow import parquet as pq

    table = pa.table({name: pa.array(["x"]) for name in pq.read_schema(path).names})
    with pq.ParquetWriter(path, table.schema) as writer:
        for _ in range(n):
            writer.write_table(table)


def pipe_beside(path: Path) -> None:
    """A pipe beside a table, which no manifest names."""
    os.mkfifo(path.with_name("more.parquet"))


def packed_often(data: bytes, n: int) -> bytes:
    for _ in range(n):
        data = zstandard.compress(data)
    return data


def described_by(content: Callable[[], str]) -> Make:
    """A log beside a DBC file."""
    return later(lambda: sample("info", "log.mcap", "--dbc", "c.dbc", c_dbc=content()))


def ubx(kind: int, number: int, payload: bytes) -> bytes:
    body = bytes([kind, number]) + struct.pack("<H", len(payload)) + payload
    a = b = 0
    for octet in body:
        a = (a + octet) & 255
        b = (b + a) & 255
    return b"\xb5\x62" + body + bytes([a, b])


def shards(change: Callable[[Path], None], name: str = "*.parquet") -> Make:
    """Two shards of a run, of which one has files changed, and their merge."""

    def make(folder: Path) -> list[str]:
        from cwcli.cli.main import run_command_line

        for k in range(2):
            shutil.copy(SAMPLE, folder / f"log{k}.mcap")
        logs = [str(folder / f"log{k}.mcap") for k in range(2)]
        for k in (1, 2):
            run = ["run", *logs, "--shard", f"{k}/2", "-d", str(folder / f"s{k}"), "--jobs", "1", "--quiet"]
            assert run_command_line(run) == 0
        for path in (folder / "s2").rglob(name):
            change(path)
        return ["merge", "s1", "s2", "-d", "out"]

    return make


SCENE = "duration_s = 10\n[vehicles.host]\nspeed_mps = 9\n"


def simulated(toml: str) -> Make:
    return sample("simulate", "s.toml", "-o", "out.mcap", s_toml=toml)


def mapped(toml: str) -> Make:
    def make(folder: Path) -> list[str]:
        (folder / "a.csv").write_text(times_of(*(f"{1.7e9 + k}" for k in range(60))))
        (folder / "m.toml").write_text(toml)
        return ["import", "a.csv", "--mapping", "m.toml", "-o", "out.mcap"]

    return make


def described(description: str) -> Make:
    """A good net with another description."""

    def make(folder: Path) -> list[str]:
        command = net(b"")(folder)
        (folder / "net.toml").write_text(description)
        return command

    return make


def xml(name: str, content: str | bytes, *options: str) -> Make:
    return file_and(name, content, *options)


def metadata_replaced(change: Callable[[Path], None]) -> Make:
    def make(folder: Path) -> list[str]:
        command = recorded(listing("drive_0.mcap"))(folder)
        change(folder / "drive" / "metadata.yaml")
        return command

    return make


# --- files that stand for more than they store: holes, and what is compressed as a whole ---


def packed_whole(name: str, head: bytes, block: bytes, *command: str) -> Make:
    """A file of 240 MB of one block, compressed to some 20 kB."""

    def make(folder: Path) -> list[str]:
        with (folder / name).open("wb") as file, zstandard.ZstdCompressor().stream_writer(file) as packer:
            packer.write(head)
            for _ in range(240_000_000 // len(block)):
                packer.write(block)
        return [*command, "-o", "out.mcap", "--recover"]

    return make


def with_hole(make: Make, name: str, n_bytes: int) -> Make:
    """The same with a hole at the end of a file, which is made where it is not there."""

    def made(folder: Path) -> list[str]:
        command = make(folder)
        (folder / name).touch()
        os.truncate(folder / name, n_bytes)
        return command

    return made


def names_beside_logs(folder: Path) -> list[str]:
    """A recording of 90,000 parts that are not there, beside 3,000 others."""
    command = recorded(listing(*(f"d_{k}.mcap" for k in range(90_000))))(folder)
    for k in range(3000):
        (folder / "drive" / f"e_{k}.mcap").touch()
    return command


def described_channels(n: int, topic: str = "", metadata: bytes = b"", last: bytes = b"", schema: int = 0) -> bytes:
    """A chunk of this many channels with a message each."""
    return mcap_chunk(
        b"".join(
            mcap_channel(k, schema, f"/t{k}{topic}", "json", metadata) + mcap_message(k, T0_NS, b"{}")
            for k in range(1, n + 1)
        )
        + last
    )


def large_schemas() -> Make:
    """A chunk of 250 MB of schemas."""
    schemas = (mcap_schema(k, f"p/msg/T{k}", "ros2msg", b"int8 x\n#" + bytes(3_900_000)) for k in range(1, 66))
    return logged(mcap_chunk(b"".join(schemas) + FIX_CHANNEL))


ONE_BYTE = connection(0, "/t", "p/T", "int8 x") + message(0, b"\1") * 20_000
BAG_HEAD = b"#ROSBAG V2.0\n" + bag_header(4117)
CUT_BAG = "cut", "in.bag.zst", "--start", "0"

UNLISTED: dict[str, Make] = {
    # what is compressed as a whole, and holes
    "bag.zst, 240 MB of messages of a byte": packed_whole("in.bag.zst", BAG_HEAD, ONE_BYTE, *CUT_BAG),
    "bag.zst, 240 MB of records of nothing": packed_whole(
        "in.bag.zst", BAG_HEAD, record({"op": b"\x20"}, b"") * 20_000, *CUT_BAG
    ),
    **{
        f"mcap.zst, 240 MB of messages of nothing, {command[0]}": packed_whole(
            "in.mcap.zst",
            MAGIC + HEADER + FIX_SCHEMA + FIX_CHANNEL,
            mcap_message(1, T0_NS, b"") * 20_000,
            *command,
        )
        for command in (["estimate", "in.mcap.zst"], ["join", "in.mcap.zst", "in.mcap.zst"])
    },
    "bag, 10 GB of hole": with_hole(recovered(bagged(chunk(ONE))), "in.bag", 10_000_000_000),
    "mcap, 20 GB of hole": with_hole(recovered(logged(FIX_SCHEMA, FIX_CHANNEL)), "in.mcap", 20_000_000_000),
    "db3, a WAL of 30 GB of hole": with_hole(beside("-wal", WAL), "in.db3-wal", 30_000_000_000),
    # definitions
    "yaml, 90,000 names beside 3,000 logs": names_beside_logs,
    "mcap, 65 schemas of 4 MB": later(large_schemas),
    "mcap, 60 channels of 300,000 entries of metadata": later(
        lambda: logged(described_channels(60, metadata=b"".join(text(f"{k:05x}") + text("") for k in range(300_000))))
    ),
    "mcap, 60,000 channels, on the screen": later(
        lambda: logged(described_channels(60_000, "x" * 900), command="info")
    ),
    "mcap, 60 channels whose names are 300,000 words each": later(
        lambda: logged(
            mcap_schema(1, "p/msg/T", "ros2msg", b"float32 speed"),
            described_channels(60, "ab9" * 333_000, schema=1).replace(b"json", b"cdr_"),
            command="info",
        )
    ),
    "mcap, 60,000 channels of long names with fields, on the screen": later(
        lambda: logged(
            mcap_schema(1, "p/msg/T", "ros2msg", b"float64 speed\nbool warning"),
            described_channels(60_000, "xY9" * 300, schema=1),
            command="info",
        )
    ),
    "mcap, 3,000 channels of 2,000 fields, on the screen": later(
        lambda: logged(
            mcap_schema(1, "p/msg/T", "ros2msg", b"".join(b"float64 speed%d\n" % k for k in range(2000))),
            described_channels(3000, schema=1),
            command="info",
        )
    ),
    "mcap, 1,000 channels of a schema of 3 MB, on the screen": later(
        lambda: logged(
            mcap_schema(1, "p/msg/T", "ros2msg", b"int8 x\n" + b"# y\n" * 700_000),
            described_channels(1000, schema=1),
            command="info",
        )
    ),
    "mcap, 60 topics in a chunk of 250 MB, on the screen": later(
        lambda: logged(described_channels(60, last=mcap_message(60, T0_NS, bytes(250_000_000))), command="info")
    ),
    # bags
    "bag, an index of 2^32 entries": bagged(chunk(ONE), tail=bag_index(0, 0xFFFFFFFF)),
    "bag, an index of a megabyte of lies": bagged(chunk(ONE), tail=bag_index(0, 83_333, b"\xff" * 999_996)),
    "bag, an index that says 4 GB": bagged(chunk(ONE), tail=bag_index(0, 1)[:-4] + u32(0xFFFFFFFF)),
    "bag, a chunk whose size has 8 bytes": bagged(
        record({"op": b"\5", "compression": b"bz2", "size": u64(1 << 63)}, b"")
    ),
    "bag, 200,000 chunks of nothing": later(lambda: bagged(*[packed_chunk(b"none", 0, b"")] * 200_000)),
    "bag, 100,000 streams of nothing in a chunk": bagged(packed_chunk(b"bz2", 9, bz2.compress(b"") * 100_000)),
    "bag, 100,000 frames of nothing in a chunk": bagged(packed_chunk(b"lz4", 9, lz4.frame.compress(b"") * 100_000)),
    "bag, 50,000 chunks of compressed nothing": later(
        lambda: bagged(*[packed_chunk(b"bz2", 0, bz2.compress(b""))] * 50_000)
    ),
    "bag, records of unknown kinds": later(
        lambda: bagged(chunk(b"".join(record({"op": bytes([k % 256])}, b"") for k in range(100_000)), "bz2"))
    ),
    "bag, a header of 200,000 fields": bagged(chunk(record({f"f{k}": b"" for k in range(200_000)}, b""), "bz2")),
    "bag, a topic of 100 MB": later(lambda: bagged(chunk(connection(0, "t" * 100 * MEGABYTE, "p/T", "int8 x"), "bz2"))),
    "bag, a definition of 100 MB": later(
        lambda: bagged(chunk(connection(0, "/t", "p/T", "# c\n" * 25 * MEGABYTE), "bz2"))
    ),
    "bag, a definition of 200,000 constants": bagged(
        chunk(connection(0, "/t", "p/T", "".join(f"int8 X{k}=1\n" for k in range(200_000))), "bz2")
    ),
    "bag, a constant of 5,000 digits": bagged(chunk(one_topic(f"int64 X={'9' * 5000}\nint8 x", [b"\1"]))),
    "bag, a definition of 100,000 rules": bagged(
        chunk(one_topic("int8 x\n" + ("=" * 80 + "\nMSG: p/A\n") * 100_000, [b"\1"]), "bz2")
    ),
    "bag, a message of 4 GB": bagged(chunk(ONE + message(0, b"")[:-4] + u32(0xFFFFFFF0))),
    "bag, 60,000 connections that only its index has": later(
        lambda: bagged(chunk(ONE), tail=b"".join(connection(k, f"/t{k}", "p/T", "int8 x") for k in range(1, 60_000)))
    ),
    "bag, 3,000 types whose checksums lie": later(
        lambda: bagged(chunk(b"".join(connection(k, "/t", f"p/T{k}", "int8 x", "0" * 32) for k in range(3000))))
    ),
    "bag, 120,000 places that look like a chunk": false_chunks,
    "bag, a million marks of chunks": chunk_marks,
    "bag 1.2, 30,000 definitions": old_bag(30_000),
    "bag, a sequence of 2^31 texts": bagged(chunk(one_topic("string[] s", [u32(1 << 31)]))),
    "bag, times that go back 200,000 times": later(
        lambda: bagged(
            chunk(
                connection(0, "/t", "p/T", "int8 x") + b"".join(message(0, b"\1", 200_000 - k) for k in range(200_000)),
                "bz2",
            )
        )
    ),
    # databases
    "db3, pages of 64 kB that are not there": patched_database(header_of(16, b"\0\1")),
    "db3, pages of one byte": patched_database(header_of(16, b"\0\3")),
    "db3, a reserve of 255 bytes": patched_database(header_of(20, b"\xff")),
    "db3, an encoding of 2^31": patched_database(header_of(56, b"\x7f\xff\xff\xff")),
    "db3, a free list of 2^31 pages": patched_database(free_list),
    "db3, a long value in a circle": patched_database(overflow_circle, BIG),
    "db3, messages without rows' numbers": changed_database(
        "create table m2 (id integer primary key, topic_id integer, timestamp integer, data blob) without rowid",
        "insert into m2 select id, topic_id, timestamp, data from messages",
        "drop table messages",
        "alter table m2 rename to messages",
    ),
    "db3, triggers and an index of a function": changed_database(
        "create trigger t after insert on messages begin delete from topics; end",
        "create index huge on messages(abs(length(data)))",
    ),
    "db3, a collation that nobody has": changed_database(
        "pragma writable_schema = on",
        "update sqlite_master set sql = replace(sql, 'name TEXT NOT NULL', 'name TEXT NOT NULL COLLATE evil')",
    ),
    "db3, an order by a collation": changed_database(
        "create table t2 (id integer, name text collate nocase unique, type text, serialization_format text, "
        "offered_qos_profiles text, type_description_hash text)",
        "drop table topics",
        "alter table t2 rename to topics",
    ),
    "db3, a table of 90 columns more": changed_database(
        *(f"alter table messages add column c{k} text default '{'x' * 900}'" for k in range(90))
    ),
    "db3, 20,000 tables": changed_database(
        "pragma synchronous = off", *(f"create table a{k} (b)" for k in range(20_000))
    ),
    "db3, texts of topics of 50 MB": changed_database("update topics set name = hex(zeroblob(25000000))"),
    "db3, topics of nothing": changed_database("update topics set type = x'00ff', serialization_format = x'636472'"),
    "db3, definitions of 15 MB": changed_database(
        "update message_definitions set encoded_message_definition = replace(hex(zeroblob(600000)), '00', 'int8 a' || "
        "char(10))"
    ),
    "db3, definitions of IDL of brackets": changed_database(
        "update message_definitions set encoding = 'ros2idl', encoded_message_definition = "
        "'module a { struct S {' || replace(hex(zeroblob(100000)), '00', 'sequence<') || '};'"
    ),
    "db3, a WAL of wrong salts": beside("-wal", WAL + (struct.pack(">6I", 2, 9, 9, 9, 0, 0) + bytes(4096)) * 5),
    "db3, a WAL of 30 MB of pages of one byte": beside("-wal", WAL[:8] + struct.pack(">I", 1) + bytes(30_000_000)),
    "db3, a WAL that is a device": beside("-wal", target="/dev/zero"),
    "db3, a WAL that is a pipe": beside("-wal"),
    "db3, a WAL that is a link to itself": beside("-wal", target="in.db3-wal"),
    "db3, a WAL that is another file": beside("-wal", target="/etc/passwd"),
    "db3, a journal of 2^31 records": beside(
        "-journal", (JOURNAL_MAGIC + struct.pack(">IIIII", 0xFFFFFFFF, 1, 2**31, 512, 4096)).ljust(9000, b"\1")
    ),
    "db3, a journal that names another file": journal_of_another,
    # recordings
    "yaml, its file is a device": metadata_replaced(table_device),
    "yaml, an object of Python": recorded(
        "a: !!python/object/apply:os.system ['touch owned']\n" + listing("drive_0.mcap")
    ),
    "yaml, 300,000 keys": recorded("".join(f"k{k}: 1\n" for k in range(300_000))),
    "yaml, merges of merges": recorded(
        "a0: &a0 {x: 1}\n" + "".join(f"a{k + 1}: &a{k + 1} {{<<: [*a{k},*a{k}]}}\n" for k in range(40))
    ),
    "yaml, a text of 15 MB": recorded(f'a: "{"x" * 15_000_000}"\n'),
    "yaml, names of nothing": recorded(listing("''", "'.'", "'..'", "'drive_0.mcap/'", "~", "null", "1.5", "[a]")),
    # MCAP
    "mcap, a summary of chunks over each other": with_summary(*(chunk_index(8 + k % 50, 60) for k in range(20_000))),
    "mcap, a summary of chunks beyond the file": with_summary(*(chunk_index(1 << 62, 1 << 62) for _ in range(2000))),
    "mcap, statistics of 2^64 messages": with_summary(statistics((1 << 64) - 1)),
    "mcap, 5,000 indexes of attachments that lie": with_summary(*[attachment_index(8, 1 << 62)] * 5000),
    "mcap, an attachment of 2^62 bytes": with_summary(
        data=mcap_record(9, u64(0) * 2 + text("../../x") + text("a/b") + u64(1 << 62) + bytes(99))
    ),
    "mcap, an attachment whose name climbs": with_summary(
        data=mcap_record(9, u64(0) * 2 + text("../../escaped") + text("a/b") + u64(3) + b"abc" + u32(0))
    ),
    "mcap, a metadata record of 500,000 entries": with_summary(
        data=mcap_record(12, text("m") + text(b"".join(text(f"{k}") + text("") for k in range(500_000))))
    ),
    "mcap, 30,000 attachments of nothing": with_summary(
        data=mcap_record(9, u64(0) * 2 + text("a") + text("b") + u64(0) + u32(0)) * 30_000
    ),
    "mcap, chunks of unknown compression": logged(*[mcap_chunk(b"x", "br" + "x" * 5000)] * 2000),
    "mcap, a chunk of 400,000 frames to skip": logged(
        mcap_chunk(b"", size=100, stored=b"\x50\x2a\x4d\x18\0\0\0\0" * 400_000)
    ),
    "mcap, a chunk of 300,000 frames of nothing": logged(
        mcap_chunk(b"", size=100, stored=zstandard.compress(b"") * 300_000)
    ),
    "mcap, 50,000 chunks of nothing": logged(*[mcap_chunk(b"")] * 50_000),
    "mcap, a chunk of lz4 whose frames are 100,000": logged(
        mcap_chunk(b"", "lz4", size=100, stored=lz4.frame.compress(b"") * 100_000)
    ),
    "mcap.zst, a million frames to skip": lambda folder: (
        (folder / "in.mcap.zst").write_bytes(zstandard.compress(MAGIC) + b"\x50\x2a\x4d\x18\0\0\0\0" * 1_000_000),
        ["estimate", "in.mcap.zst", "-o", "out.mcap"],
    )[1],
    "mcap.zst, zst inside of zst, 2,000 times": lambda folder: (
        (folder / "in.mcap.zst").write_bytes(packed_often(SAMPLE.read_bytes(), 2000)),
        ["estimate", "in.mcap.zst", "-o", "out.mcap"],
    )[1],
    "mcap, a schema of 50 MB of comments": later(
        lambda: read_fields(with_schema("ros2msg", b"# c\n" * 12_500_000 + b"float64 a\n"))
    ),
    "mcap, a schema of 5 MB of fields": later(
        lambda: read_fields(with_schema("ros2msg", b"".join(b"int8 a%d\n" % k for k in range(400_000))))
    ),
    "mcap, a schema of JSON of 30 MB": later(
        lambda: read_fields(with_schema("jsonschema", b'{"a":' + b"[" * 30_000_000, b'{"a":1}', "json"))
    ),
    "mcap, a schema of IDL of 5 MB": later(
        lambda: read_fields(with_schema("ros2idl", b"module a { " * 400_000 + b"struct S { double a; };"))
    ),
    "mcap, definitions that repeat a type 50,000 times": later(
        lambda: read_fields(with_schema("ros2msg", b"A a\n" + (b"=" * 80 + b"\nMSG: p/A\nfloat64 a\n") * 50_000))
    ),
    "mcap, protobuf that holds itself 100,000 times": protobuf(
        descriptor(proto_field(b"a", 1, 11, b".T")), holding_itself(3000)
    ),
    "mcap, protobuf of groups": protobuf(descriptor(proto_field(b"a", 1, 1)), b"\x13" * 50_000),
    "mcap, protobuf of 20,000 fields": later(
        lambda: protobuf(descriptor(*(proto_field(b"a%d" % k, k + 1, 1) for k in range(20_000))), b"")
    ),
    "mcap, protobuf of 2 million numbers": protobuf(
        descriptor(proto(1, b"a") + proto(3, 1) + proto(4, 3) + proto(5, 13)), proto(1, b"\1" * 2_000_000)
    ),
    "mcap, protobuf, varints of no end": protobuf(descriptor(proto_field(b"a", 1, 1)), b"\xff" * 500_000),
    "mcap, protobuf, a field number of 2^29": protobuf(
        descriptor(*(proto_field(b"a", 536870911, 1) for _ in range(300))), b"\0" * 100
    ),
    "mcap, protobuf, names of escapes": protobuf(descriptor(proto_field("\u202e<b>\x1b".encode(), 1, 1)), b""),
    "mcap, JSON, keys that always differ": sent(
        "/t", "x", ((T0_NS + k, {f"k{k}_{n}": n for n in range(50)}) for k in range(4000)), "find", "/t:k1_1 > 1"
    ),
    "mcap, JSON, a list in lists": sent(
        "/fix", "foxglove.LocationFix", ((T0_NS + k, b"[" * 400 + b"]" * 400) for k in range(900))
    ),
    "mcap, JSON, kinds that change": sent(
        "/fix",
        "foxglove.LocationFix",
        ((T0_NS + k, fix(T0_NS + k, (48.0, "x", None, [1], {"a": 1}, True)[k % 6])) for k in range(6000)),
    ),
    "mcap, JSON, half a pair of surrogates": sent(
        "/fix", "foxglove.LocationFix", ((T0_NS + k, fix(T0_NS + k, frame_id="\ud800\udfff\ud800")) for k in range(600))
    ),
    "mcap, 3,000 channels of fixes": later(
        lambda: logged(
            FIX_SCHEMA,
            *(mcap_channel(k, 1, f"/fix{k}", "json") for k in range(1, 3000)),
            *(mcap_message(k, T0_NS + k, fix(T0_NS + k)) for k in range(1, 3000)),
        )
    ),
    "mcap, 100,000 fixes that go back": sent(
        "/fix", "foxglove.LocationFix", fixes(T0_NS - k * 10**7 for k in range(60_000))
    ),
    "mcap, 100,000 fixes of one time": sent("/fix", "foxglove.LocationFix", fixes([T0_NS] * 60_000)),
    # pictures
    "mcap, a PNG of 50,000 texts": sent(
        "/camera", "foxglove.CompressedImage", picture(png_of(*[(b"tEXt", b"a\0b")] * 50_000), "png"), "lanes"
    ),
    "mcap, a PNG with a text of 500 MB": later(
        lambda: sent(
            "/camera",
            "foxglove.CompressedImage",
            picture(png_of((b"zTXt", b"a\0\0" + zlib.compress(bytes(500 * MEGABYTE), 9))), "png"),
            "lanes",
        )
    ),
    "mcap, a PNG with a profile of 200 MB": later(
        lambda: sent(
            "/camera",
            "foxglove.CompressedImage",
            picture(png_of((b"iCCP", b"a\0\0" + zlib.compress(bytes(200 * MEGABYTE), 9))), "png"),
            "lanes",
        )
    ),
    "mcap, a PNG that moves": sent(
        "/camera",
        "foxglove.CompressedImage",
        picture(
            png_of(
                (b"acTL", struct.pack(">II", 1 << 31, 0)),
                (b"fcTL", struct.pack(">IIIIIHHBB", 0, 64, 48, 0, 0, 1, 9, 0, 0)),
            ),
            "png",
        ),
        "lanes",
    ),
    "mcap, a WebP of 16,383 by 16,383": sent(
        "/camera", "foxglove.CompressedImage", picture(lossless(16_383, 16_383), "webp"), "lanes"
    ),
    "mcap, a WebP of 7,000 by 7,000, often": sent(
        "/camera", "foxglove.CompressedImage", frames_of([lossless(7000, 7000)] * 200, "webp"), "lanes"
    ),
    "mcap, a WebP of 20,000 frames": sent(
        "/camera", "foxglove.CompressedImage", picture(webp(6000, 6000, 20_000), "webp"), "lanes"
    ),
    "mcap, a PNG of 7,000 by 7,000, often": later(
        lambda: sent(
            "/camera", "foxglove.CompressedImage", frames_of([png(7000, 7000, 21_001 * 7000)] * 60, "png"), "lanes"
        )
    ),
    "mcap, a raw image of 2^32 by 2^32": sent(
        "/camera", "foxglove.RawImage", raw_images(width=2**32 - 1, height=2**32 - 1, step=0, encoding="rgb8"), "lanes"
    ),
    "mcap, a raw image of no width": sent(
        "/camera", "foxglove.RawImage", raw_images(width=-1, height=1e300, step=True, encoding="mono8"), "lanes"
    ),
    "mcap, video, sizes that change 2,000 times": sent(
        "/camera",
        "foxglove.CompressedVideo",
        frames_of((sps(64 + 16 * (k % 60), 64) + PPS_AND_SLICE for k in range(2000)), "h264"),
        "lanes",
    ),
    "mcap, video of 16,384 by 16,384": sent(
        "/camera", "foxglove.CompressedVideo", frames_of([sps(16_384, 16_384) + PPS_AND_SLICE] * 40, "h264"), "lanes"
    ),
    "mcap, video, 4,000 by 3,000": sent(
        "/camera", "foxglove.CompressedVideo", frames_of([sps(4096, 3072) + PPS_AND_SLICE] * 300, "h264"), "lanes"
    ),
    "mcap, video of parameters alone": sent(
        "/camera", "foxglove.CompressedVideo", frames_of([sps(640, 480) * 20_000] * 10, "h264"), "lanes"
    ),
    "mcap, VP9, sizes that change 2,000 times": sent(
        "/camera", "foxglove.CompressedVideo", frames_of((vp9(64 + k, 64) for k in range(2000)), "vp9"), "lanes"
    ),
    "mcap, VP9 of 65,536 by 65,536": sent(
        "/camera", "foxglove.CompressedVideo", frames_of([vp9(65_536, 65_536)] * 40, "vp9"), "lanes"
    ),
    # annotated logs
    "annotated, no numbers, on a page": forged(["report", "in.mcap", "-o", "out.html"], numbers_of(float("nan"))),
    "annotated, no numbers, scored": forged(["evaluate", "in.mcap"], numbers_of(float("nan"))),
    "annotated, numbers without end, on a page": forged(["report", "in.mcap", "-o", "out.html"], numbers_of(1e308)),
    "annotated, numbers without end, scored": forged(["evaluate", "in.mcap"], numbers_of(float("inf"))),
    "annotated, numbers without end, found": forged(["find", "in.mcap", "all"], numbers_of(1e308)),
    "annotated, numbers without end, as OSI": forged(
        ["export", "in.mcap", "--format", "osi", "-o", "out.mcap"], numbers_of(-1e308)
    ),
    "annotated, no numbers, as ROS": forged(
        ["export", "in.mcap", "--format", "ros2", "-o", "out.mcap"], numbers_of(float("nan"))
    ),
    "annotated, 100,000 warnings, on a page": forged(["report", "in.mcap", "-o", "out.html"], warned_often),
    "annotated, 100,000 warnings, scored": forged(["evaluate", "in.mcap"], warned_often),
    "annotated, 100,000 warnings, found": forged(["find", "in.mcap", "all"], warned_often),
    "annotated, long paths, on a page": forged(["report", "in.mcap", "-o", "out.html"], long_paths),
    "annotated, settings of brackets": forged(
        ["report", "in.mcap", "-o", "out.html"], lambda topic, k, each: [each], "[" * 100_000
    ),
    "annotated, settings of other kinds": forged(
        ["report", "in.mcap", "-o", "out.html"], lambda topic, k, each: [each], '{"a": [1e999, "\\ud800", null]}'
    ),
    "annotated, settings of brackets, compared": forged(
        ["compare", "in.mcap", "in.mcap", "--messages"], lambda topic, k, each: [each], "{" * 100_000
    ),
    # folders of runs
    "manifest, 2,000 logs": run_folder(many_logs, "report", "run", "-o", "out.html"),
    "manifest, 2,000 logs, compared": run_folder(many_logs, "compare", "run", "run"),
    "manifest, 500 logs of one name": run_folder(same_ids, "report", "run", "-o", "out.html"),
    "manifest, 500 logs of one name, found": run_folder(same_ids, "find", "run", "all"),
    "manifest, no numbers": run_folder(no_numbers, "report", "run", "-o", "out.html"),
    "manifest, a device": run_folder(manifest_device, "report", "run", "-o", "out.html"),
    "manifest, a device, compared": run_folder(manifest_device, "compare", "run", "run"),
    "manifest, a table name of 300 letters": run_folder(
        long_table_name, "run", "log0.mcap", "log1.mcap", "-d", "run", "--jobs", "1"
    ),
    "run, tables whose rows are 2^62": run_folder(tables_replaced(pages_of_lies), "report", "run", "-o", "out.html"),
    "run, tables whose rows are 2^62, compared": run_folder(tables_replaced(pages_of_lies), "compare", "run", "run"),
    "run, tables that are devices": run_folder(tables_replaced(table_device), "report", "run", "-o", "out.html"),
    "run, tables of lists of lists": run_folder(tables_replaced(nested_table), "report", "run", "-o", "out.html"),
    "run, tables of lists of lists, compared": run_folder(tables_replaced(nested_table), "compare", "run", "run"),
    "run, tables of lists of lists, scored": run_folder(tables_replaced(nested_table), "evaluate", "run"),
    "run, tables of lists of lists, found": run_folder(tables_replaced(nested_table), "find", "run", "all"),
    "run, tables of 1,000 groups, compared": run_folder(tables_replaced(many_groups), "compare", "run", "run"),
    "run, tables of 1,000 groups": run_folder(tables_replaced(many_groups), "report", "run", "-o", "out.html"),
    "run, tables that are devices, compared": run_folder(tables_replaced(table_device), "compare", "run", "run"),
    "run, tables that are pipes": run_folder(tables_replaced(table_pipe), "report", "run", "-o", "out.html"),
    "merge, tables that are devices": shards(table_device),
    "merge, tables that are pipes": shards(table_pipe),
    "merge, tables of lists of lists": shards(nested_table),
    "merge, tables of 5,000 groups": shards(lambda path: many_groups(path, 5000)),
    "merge, tables of 1,000 groups": shards(many_groups),
    "merge, a pipe that is no table": shards(pipe_beside, "metrics.parquet"),
    "merge, tables whose rows are 2^62": shards(pages_of_lies),
    "merge, a manifest that is a device": shards(table_device, "manifest.json"),
    "merge, a manifest that is a pipe": shards(table_pipe, "manifest.json"),
    "merge, logs that are devices": shards(table_device, "annotated.mcap"),
    # settings and scenarios
    "scenario, a bend of 10^308": simulated(
        SCENE + "lateral = [{ from_s = 0, to_s = 9, curvature_1pm = 1e308 }]\n[sensors.gnss]\n"
    ),
    "scenario, 100,000 bends": simulated(
        SCENE
        + "lateral = ["
        + ",".join(f"{{ from_s = {k}e-4, curvature_1pm = 0 }}" for k in range(100_000))
        + "]\n[sensors.gnss]\n"
    ),
    "scenario, noise without end": simulated(SCENE + "[sensors.gnss]\nsigma_m = inf\nrate_hz = nan\n"),
    "scenario, a start of 10^300": simulated(
        SCENE.replace("speed_mps", "x_m = 1e300\ny_m = -1e300\nspeed_mps") + "[sensors.gnss]\n"
    ),
    "scenario, a speed of 10^200": simulated(SCENE.replace("= 9\n", "= 1e200\n") + "[sensors.gnss]\n[sensors.imu]\n"),
    "scenario, values of other kinds": simulated("duration_s = [1]\nvehicles = 3\nsensors = 'x'\n"),
    "config, a stage of other kinds": sample(
        "run", "log.mcap", "-o", "out.mcap", "--config", "c.toml", c_toml="run = 3\nestimate = [1]\n[warn]\nrule = {}\n"
    ),
    "calibration, other kinds": sample(
        "estimate",
        "log.mcap",
        "-o",
        "out.mcap",
        "--calibration",
        "c.toml",
        c_toml="format = 1\nspeed = 3\nimu = [[]]\n",
    ),
    "calibration, a format of 10^999": sample(
        "estimate", "log.mcap", "-o", "out.mcap", "--calibration", "c.toml", c_toml=f"format = {'9' * 999}\n"
    ),
    "config, an integer of 5,000 digits": sample(
        "run", "log.mcap", "-o", "out.mcap", "--config", "c.toml", c_toml=f"[estimate]\nseed = {'9' * 5000}\n"
    ),
    "config, UTF-16": sample(
        "run", "log.mcap", "-o", "out.mcap", "--config", "c.toml", c_toml="[run]\n".encode("utf-16")
    ),
    "clause, a million speeds": sample(
        "conform", "c.toml", "--seeds", "1", "--jobs", "1", c_toml="title = 'x'\n[[trials]]\n" * 20_000
    ),
    "vehicle, other kinds": sample(
        "observe", "log.mcap", "-o", "out.mcap", "--vehicle", "c.toml", c_toml="wheelbase_m = [1]\nmass_kg = {}\n"
    ),
    "find, a time of 10^308": sample("find", "log.mcap", "ego.speed_mps > 1 for 1e308 s"),
    "find, a number of 1,900 digits": sample("find", "log.mcap", f"ego.speed_mps > {'9' * 1900}"),
    "find, an index of 10^18": sample("find", "log.mcap", "/imu/data:orientation_covariance[999999999999999999] > 1"),
    "gate, a number of 1,900 digits": sample("evaluate", "log.mcap", "--gate", f"ego.position_rmse_m < {'9' * 1900}"),
    "map, a factor of 1,900 digits": sample("info", "log.mcap", "--map", f"ego_speed=/vehicle/velocity:a*{'9' * 1900}"),
    # tables
    "csv, a million columns": later(lambda: file_and("a.csv", f"{','.join(f'a{k}' for k in range(1_000_000))}\n" * 3)),
    "csv, UTF-32": file_and("a.csv", times_of(*(f"{k}" for k in range(99))).encode("utf-32")),
    "csv, UTF-16 without a mark": file_and("a.csv", times_of(*(f"{k}" for k in range(9999))).encode("utf-16-be")),
    "csv, three marks of UTF-8": file_and("a.csv", "\ufeff" * 3 + times_of(*(f"{1.7e9 + k}" for k in range(99)))),
    "csv, quotes alone": file_and("a.csv", "time,lat,lon\n" + '"' * 3_000_001),
    "csv, ends of lines of every kind": file_and(
        "a.csv",
        "".join(
            f"{line}{end}"
            for line, end in zip(
                times_of(*(f"{1.7e9 + k}" for k in range(9000))).split("\n"),
                ["\r", "\n", "\r\n", "\n\r", "\x0b", "\x85", "\u2028"] * 9999,
                strict=False,
            )
        ),
    ),
    "csv, digits of other scripts": file_and("a.csv", times_of(*("\u0661\u0667" + "\u0660" * 8 for _ in range(999)))),
    "csv, numbers with lines below": file_and("a.csv", times_of(*(f"1_700_000_{k:03}" for k in range(999)))),
    "csv, exponents of 10^9": file_and("a.csv", times_of(*(f"1e{'9' * 9}{k}" for k in range(20_000)))),
    "csv, a terminal of control signs": file_and("a.csv", "time,la\x1b[31mt,l\u202eon,x\x07\n" + "1,2,3,4\n" * 99),
    "csv, 20,000 dates of 20,000 kinds": file_and(
        "a.csv", times_of(*(f"{k % 28 + 1}.{k % 12 + 1}.{k} {k % 24}h{k % 60}m" for k in range(20_000)))
    ),
    "csv, a zone that climbs": file_and(
        "a.csv", times_of(*(f"2024-01-01 00:00:{k:02}" for k in range(60))), "--timezone", "../../etc/passwd"
    ),
    "mapping, columns of other kinds": mapped("[answers]\ntimezone = 3\n[[table]]\nname = []\ncolumns = {}\n"),
    "mapping, factors without end": mapped("[columns]\nspeed = 'lat*1e999'\n[answers]\n"),
    "gpx, UTF-16": xml("a.gpx", GPX.format("", "<trkseg/>").replace("1.0", "1.0", 1).encode("utf-16")),
    "gpx, 50 MB of comments": later(lambda: xml("a.gpx", GPX.format("", "<!-- " + "x" * 50_000_000 + "-->"))),
    "gpx, a million instructions": later(lambda: xml("a.gpx", GPX.format("", "<?a b?>" * 1_000_000))),
    "gpx, a section of 50 MB": later(
        lambda: xml("a.gpx", GPX.format("", "<name><![CDATA[" + "]" * 50_000_000 + "]]></name>"))
    ),
    "gpx, 300,000 declared attributes": later(
        lambda: xml(
            "a.gpx",
            GPX.format(
                "<!DOCTYPE gpx [" + "".join(f'<!ATTLIST trk a{k} CDATA "x">' for k in range(100_000)) + "]>",
                "<trk/>" * 2000,
            ),
        )
    ),
    "kml, 100,000 folders inside each other": xml("a.kml", "<kml>" + "<Folder>" * 100_000),
    "kml, a line of 20 MB": later(
        lambda: xml(
            "a.kml",
            "<kml><Placemark><LineString><coordinates>"
            + "11,48,0 " * 2_500_000
            + "</coordinates></LineString></Placemark></kml>",
        )
    ),
    "kml, a network link": xml(
        "a.kml", "<kml><NetworkLink><Link><href>http://127.0.0.1:9/x</href></Link></NetworkLink></kml>"
    ),
    "nmea, 200,000 parts of one sentence": later(
        lambda: file_and("a.nmea", "$GPGSV,99,%d,99,1,2,3,4*00\r\n" * 200_000)
    ),
    "nmea, checksums of other digits": file_and(
        "a.nmea", "$GPGGA,221320.000,4808.2,N,01134.5,E,1,09,0.9,475.0,M,45.0,M,,*\u0661\u0662\r\n" * 5000
    ),
    "ubx, 100,000 kinds of messages": later(
        lambda: file_and("a.ubx", b"".join(ubx(k % 256, k // 256 % 256, b"") for k in range(100_000)))
    ),
    "ubx, counts that lie": file_and("a.ubx", ubx(2, 0x15, b"\xff" * 16) * 9000 + ubx(0x10, 2, b"\xff" * 8) * 9000),
    "tum, numbers of 200,000 digits": file_and("a.tum", f"1 1 1 1 0 0 0 {'1' * 200_000}x\n" * 3),
    "csv, a name of 130,000 digits": file_and("a.csv", f"{'1' * 130_000}x,lat,lon\n" + "1.7e9,48,11\n" * 9),
    "kml, a place of 200,000 digits": file_and(
        "a.kml",
        "<kml xmlns:gx='http://www.google.com/kml/ext/2.2'><Placemark><gx:Track>"
        + f"<when>2024-01-01T00:00:00Z</when><gx:coord>11 48 {'1' * 200_000}x</gx:coord>" * 3
        + "</gx:Track></Placemark></kml>",
    ),
    "tum, a cloud of NaN": file_and("a.tum", "nan nan nan nan nan nan nan nan\n" * 60_000),
    # DBC files of a log
    "dbc of a log, a multiplexer of 2^32 values": described_by(lambda: MULTIPLEXED),
    "dbc of a log, 20,000 signals": described_by(
        lambda: files.DBC + "BO_ 9 M: 8 E\n" + "".join(SIGNAL.format(k=k) for k in range(20_000))
    ),
    "dbc of a log, a text of 10 MB": described_by(lambda: files.DBC + 'CM_ "' + "\\\\" * 5_000_000 + '";\n'),
    "dbc of a log, a signal of 10^9 bits": described_by(lambda: files.DBC.replace("0|16@1+", "0|1000000000@1+")),
    "dbc of a log, a signal at 10^12": described_by(
        lambda: files.DBC.replace("0|16@1+", f"{'0' * 99}{10**12} | 16 @1+")
    ),
    "dbc of a log, a message of 10^9 bytes": described_by(lambda: files.DBC.replace("Motion: 8", "Motion: 1000000000")),
    "dbc of a log, 15 MB of digits": described_by(lambda: files.DBC + "9" * 15_000_000),
    "dbc of a log, 200,000 values": described_by(
        lambda: files.DBC + "VAL_ 256 Motion " + "".join(f'{k} "n{k}" ' for k in range(200_000)) + ";\n"
    ),
    "yaml, its file is a pipe": metadata_replaced(table_pipe),
    # nets
    "net, a graph whose nodes are a circle": net(
        proto(1, proto(1, b"a") + proto(2, b"b") + proto(4, b"Relu"))
        + proto(1, proto(1, b"b") + proto(2, b"a") + proto(4, b"Relu"))
    ),
    "net, 200,000 nodes": later(lambda: net(proto(1, proto(1, b"x") + proto(2, b"x") + proto(4, b"Relu")) * 200_000)),
    "net, a description of 10^9": described(NET_DESCRIPTION.replace("64, 48", "1000000000, 1000000000")),
    "net, a description of nothing": described(NET_DESCRIPTION.replace("64, 48", "0, -1").replace("0.0", "inf")),
    "net, a million lanes": described(NET_DESCRIPTION.replace("lanes = [1]", f"lanes = [{'1,' * 1_000_000}]")),
    "net, functions of functions": net(nested_graphs(90)),
}
"""Name -> maker."""
