"""Files for `cwcli import` that are small, or plain, and stand for much: a maker of each."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

from tests.unit.importing import files
from tests.unit.importing.drive import DRIVE, digits, epoch

Make = Callable[[Path], list[str]]
"""Folder -> the arguments of `cwcli import` behind the command."""
LAT, LON = digits(DRIVE.lat_deg, 7), digits(DRIVE.lon_deg, 7)
TABLE = "time,lat,lon\n" + "".join(f"{t},{a},{b}\n" for t, a, b in zip(epoch(), LAT, LON, strict=True))
GPX = '<?xml version="1.0"?>{}<gpx version="1.1"><trk>{}</trk></gpx>'
MEGABYTE = 1 << 20


def text(name: str, content: str | bytes, *more: str) -> Make:
    """A file with this content, and options."""

    def make(folder: Path) -> list[str]:
        (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
        return [name, *more]

    return make


def repeated(name: str, block: bytes, n: int, head: bytes = b"", tail: bytes = b"") -> Make:
    """A file of many equal blocks, which is not held in memory."""

    def make(folder: Path) -> list[str]:
        with (folder / name).open("wb") as file:
            file.write(head)
            for _ in range(n):
                file.write(block)
            file.write(tail)
        return [name]

    return make


def later(make: Callable[[], Make]) -> Make:
    """What is large is made when it is needed."""

    def made(folder: Path) -> list[str]:
        return make()(folder)

    return made


def entities(n_levels: int) -> str:
    """Each entity holds the one before ten times."""
    declared = "".join('<!ENTITY e{} "{}">'.format(k + 1, f"&e{k};" * 10) for k in range(n_levels))
    return GPX.format(f'<!DOCTYPE gpx [<!ENTITY e0 "lol">{declared}]>', f"<name>&e{n_levels};</name>")


def patched_video(old: bytes, at: int, new: bytes, name: str = "front.mp4") -> Make:
    """The video of the tests with bytes changed so far behind the first place of a name."""

    def make(folder: Path) -> list[str]:
        files.video(folder)
        data = bytearray((folder / "front.mp4").read_bytes())
        place = data.find(old) + at
        data[place : place + len(new)] = new
        (folder / name).write_bytes(data)
        return [name, "--times", "pts"]

    return make


def atoms(depth: int) -> bytes:
    """Atoms inside each other."""
    data = b""
    for _ in range(depth):
        data = struct.pack(">I4s", len(data) + 8, b"moov") + data
    return struct.pack(">I4s4sI", 16, b"ftyp", b"isom", 0) + data


def blf(*objects: bytes) -> bytes:
    """A BLF file (vector informatik's format, as python-can writes it)."""
    return b"LOGG" + struct.pack("<I", 144) + bytes(136) + b"".join(objects)


def container(data: bytes, declared: int | None = None) -> bytes:
    """A container of BLF, compressed by zlib."""
    packed = zlib.compress(data, 9)
    size = 16 + 16 + len(packed)
    head = struct.pack("<4sHHII", b"LOBJ", 16, 1, size, 10)
    return head + struct.pack("<H6xI4x", 2, len(data) if declared is None else declared) + packed + bytes(size % 4)


def with_dbc(make: Make, content: str = files.DBC) -> Make:
    def made(folder: Path) -> list[str]:
        named = make(folder)
        (folder / "car.dbc").write_text(content)
        return [*named, "--dbc", "car.dbc"]

    return made


def candump(folder: Path) -> list[str]:
    files.can_dump(folder)
    return ["candump.log"]


def zipped(members: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> Make:
    def make(folder: Path) -> list[str]:
        with zipfile.ZipFile(folder / "phone.zip", "w", method) as archive:
            for name, content in members.items():
                archive.writestr(name, content)
        return ["phone.zip"]

    return make


def nested_zip(folder: Path) -> list[str]:
    data = bytes(10 * MEGABYTE)
    for k in range(6):
        inner = io.BytesIO()
        with zipfile.ZipFile(inner, "w", zipfile.ZIP_DEFLATED) as archive:
            for n in range(10):
                archive.writestr(f"Location{n if k else ''}.csv", data)
        data = inner.getvalue()
    (folder / "phone.zip").write_bytes(data)
    return ["phone.zip"]


def lying_zip(folder: Path) -> list[str]:
    """A member of 500 MB whose directory says 1 MB."""
    zipped({"Location.csv": bytes(500 * MEGABYTE)})(folder)
    data = (folder / "phone.zip").read_bytes().replace(struct.pack("<I", 500 * MEGABYTE), struct.pack("<I", MEGABYTE))
    (folder / "phone.zip").write_bytes(data)
    return ["phone.zip"]


def parquet(write: Callable[[Path], None]) -> Make:
    def make(folder: Path) -> list[str]:
        write(folder / "a.parquet")
        return ["a.parquet"]

    return make


def _one_value(path: Path) -> None:
    """2 * 10^8 rows of one value: a few kilobytes."""
    import pyarrow as pa
    from pyarrow import parquet as pq

    n = 5_000_000
    column = pa.array([48.0]).take(pa.array([0] * 1)).dictionary_encode()
    block = pa.DictionaryArray.from_arrays(pa.array(memoryview(bytes(4 * n)).cast("i")), column.dictionary)
    table = pa.table({"time": block, "lat": block, "lon": block})
    with pq.ParquetWriter(path, table.schema, compression="zstd") as writer:
        for _ in range(40):
            writer.write_table(table)


def _row_groups(path: Path) -> None:
    import pyarrow as pa
    from pyarrow import parquet as pq

    table = pa.table({"time": [1.0], "lat": [48.0], "lon": [11.0]})
    with pq.ParquetWriter(path, table.schema) as writer:
        for _ in range(20_000):
            writer.write_table(table)


def _columns(path: Path) -> None:
    import pyarrow as pa
    from pyarrow import parquet as pq

    pq.write_table(pa.table({f"c{k}": [1.0] for k in range(20_000)}), path)


def _nested(path: Path) -> None:
    import pyarrow as pa
    from pyarrow import parquet as pq

    kind = pa.float64()
    for _ in range(100):
        kind = pa.struct([("a", kind)])
    pq.write_table(pa.table({"time": pa.array([1.0]), "a": pa.array([None], kind)}), path)


def _long_text(path: Path) -> None:
    import pyarrow as pa
    from pyarrow import parquet as pq

    column = pa.DictionaryArray.from_arrays(pa.array([0] * 20, pa.int32()), pa.array(["x" * (50 * MEGABYTE)]))
    pq.write_table(pa.table({"time": column, "lat": [48.0] * 20}), path, compression="zstd", write_statistics=False)


def _footer(path: Path) -> None:
    path.write_bytes(b"PAR1" + bytes(100) + struct.pack("<I", 0xFFFFFFF0) + b"PAR1")


SENTENCE = b"$GPGGA,221320.000,4808.2,N,01134.5,E,1,09,0.9,475.0,M,45.0,M,,*00\r\n"
SIGNAL = ' SG_ S{k} : 0|8@1+ (1,0) [0|0] "" ESP\n'
FRAMES = "date Tue Nov 14 10:13:20 2023\nbase hex  timestamps absolute\n"
HOSTILE: dict[str, Make] = {
    # XML
    "gpx, a billion laughs": text("a.gpx", entities(9)),
    "gpx, one entity of 1 MB 10,000 times": text(
        "a.gpx", GPX.format('<!DOCTYPE gpx [<!ENTITY e "' + "x" * MEGABYTE + '">]>', f"<name>{'&e;' * 10_000}</name>")
    ),
    "gpx, 100,000 elements inside each other": text("a.gpx", GPX.format("", "<a>" * 100_000)),
    "gpx, an entity of a file": text(
        "a.gpx", GPX.format('<!DOCTYPE gpx [<!ENTITY e SYSTEM "file:///etc/passwd">]>', "<name>&e;</name>")
    ),
    "gpx, an attribute of 30 MB": repeated("a.gpx", b"x" * MEGABYTE, 30, b'<gpx><trk a="', b'"></trk></gpx>'),
    "gpx, a text of 100 MB": repeated("a.gpx", b"x" * MEGABYTE, 100, b"<gpx><trk><name>", b"</name></trk></gpx>"),
    "gpx, 200,000 children of a point": text(
        "a.gpx", GPX.format("", '<trkseg><trkpt lat="1" lon="2">' + "<a/>" * 200_000 + "</trkpt></trkseg>")
    ),
    "gpx, 100,000 tracks": text(
        "a.gpx", "<gpx>" + '<trk><trkseg><trkpt lat="1" lon="2"/></trkseg></trk>' * 100_000 + "</gpx>"
    ),
    "gpx, 100,000 attributes": text("a.gpx", "<gpx><trk " + " ".join(f'a{k}="1"' for k in range(100_000)) + "/></gpx>"),
    "fcd, 100,000 vehicles in a step": text(
        "a.xml",
        '<fcd-export><timestep time="0">'
        + "".join(f'<vehicle id="v{k}" x="1" y="2" angle="0" speed="1"/>' for k in range(100_000))
        + "</timestep></fcd-export>",
    ),
    # separated text
    "csv, a line of 300 MB": repeated("a.csv", b"1," * (MEGABYTE // 2), 300, TABLE.encode()),
    "csv, a cell of 300 MB": repeated("a.csv", b"x" * MEGABYTE, 300, TABLE.encode()),
    "csv, a first line of 100 MB": repeated("a.csv", b"a," * (MEGABYTE // 2), 100),
    "csv, 30,000 columns": text("a.csv", f"{','.join(f'lat{k}' for k in range(30_000))}\n" + "1,\n" * 3),
    "csv, 30,000 columns of one name": text("a.csv", f"{','.join(['lat'] * 30_000)}\n{','.join(['1'] * 30_000)}\n" * 3),
    "csv, a quote of 100 MB": repeated("a.csv", b"x\n" * (MEGABYTE // 2), 100, TABLE.encode() + b'"'),
    "csv, 5 million empty rows": repeated("a.csv", b",,\n" * 1_000_000, 5, TABLE.encode()),
    "csv, numbers of 10,000 digits": text("a.csv", TABLE + f"{'9' * 10_000},{'9' * 10_000},1e{'9' * 1000}\n" * 300),
    "csv, half of UTF-16": text("a.csv", b"\xff\xfe" + TABLE.encode("utf-16-le")[:-1]),
    # NMEA, u-blox
    "nmea, a line of 300 MB": repeated("a.nmea", b"1," * (MEGABYTE // 2), 300, SENTENCE * 9),
    "nmea, 100,000 commas": text("a.nmea", SENTENCE * 9 + b"$GPGGA" + b"," * 100_000 + b"*00\r\n"),
    "ubx, messages of 64 kB inside each other": repeated("a.ubx", b"\xb5\x62\x01\x07\xff\xff" * 100_000, 10),
    "ubx, 20 MB of sync bytes": repeated("a.ubx", b"\xb5\x62" * (MEGABYTE // 2), 20),
    # trajectories and times
    "tum, a line of 1,000,000 numbers": text("a.tum", "1 2 3 4 5 6 7 8\n" * 9 + "1 " * 1_000_000 + "\n"),
    "tum, absurd numbers": text(
        "a.tum", "".join(f"{k}e300 1e308 1e308 0 1e308 1e308 1e308 1e308\n" for k in range(99))
    ),
    "gnsslogger, a line of 50 MB": repeated(
        "a.txt", b"x" * MEGABYTE, 50, b"# Version: v3\n# Fix,Provider,LatitudeDegrees\nFix,GPS,1\n" * 3
    ),
    # CAN
    "dbc, 1,700 messages": with_dbc(
        candump, files.DBC + "".join(f"BO_ {k} M{k}: 8 E\n{SIGNAL.format(k=k)}\n" for k in range(300, 2000))
    ),
    "dbc, 20,000 signals in a message": with_dbc(
        candump, files.DBC + "BO_ 9 M: 8 E\n" + "".join(SIGNAL.format(k=k) for k in range(20_000))
    ),
    "dbc, a signal of 10^9 bits": with_dbc(candump, files.DBC.replace("0|16@1+", "0|1000000000@1+")),
    "dbc, a signal at 10^12": with_dbc(candump, files.DBC.replace("0|16@1+", "1000000000000|16@1+")),
    "dbc, a scale of 10^400": with_dbc(candump, files.DBC.replace("(0.01,0)", f"({'9' * 400},0)")),
    "dbc, 4 MB of brackets": with_dbc(candump, "BO_ 1 A: 8 E\n" + "((((" * MEGABYTE),
    "dbc, 200,000 names of values": with_dbc(
        candump, files.DBC + "VAL_ 256 VehicleSpeed " + "".join(f'{k} "n{k}" ' for k in range(200_000)) + ";\n"
    ),
    "blf, a container of 1 GB": with_dbc(later(lambda: text("a.blf", blf(container(bytes(1000 * MEGABYTE)))))),
    "blf, a container that lies": with_dbc(later(lambda: text("a.blf", blf(container(bytes(500 * MEGABYTE), 100))))),
    "blf, objects of no size": with_dbc(
        text("a.blf", blf(container(struct.pack("<4sHHII", b"LOBJ", 16, 1, 0, 1) * 99)))
    ),
    "blf, an object of 4 GB": with_dbc(text("a.blf", blf(struct.pack("<4sHHII", b"LOBJ", 16, 1, 0xFFFFFFFF, 10)))),
    "asc, a line of 50 MB": with_dbc(
        repeated("a.asc", b"FF " * (MEGABYTE // 3), 50, FRAMES.encode() + b"0.1 1 100 Rx d 8 ")
    ),
    "asc, a frame of 10^9 bytes": with_dbc(text("a.asc", FRAMES + "0.1 1 100 Rx d 1000000000 01 02\n" * 9)),
    "candump, a frame of 10 MB": with_dbc(text("a.log", f"(1.0) can0 100#{'00' * 10 * MEGABYTE}\n")),
    # zip
    "zip, zips inside each other": (nested_zip),
    "zip, 500 MB that say 1 MB": (lying_zip),
    "zip, 100,000 files": later(lambda: zipped({f"a{k}.csv": b"" for k in range(100_000)})),
    "zip, 400 MB of blanks by lzma": (
        later(lambda: zipped({"Location.csv": b" " * (400 * MEGABYTE)}, zipfile.ZIP_LZMA))
    ),
    "zip, 150 MB of commas": (
        later(lambda: zipped({"Location.csv": b"Time (s),Latitude\n" + b",,,,\n" * (30 * MEGABYTE)}))
    ),
    # Parquet
    "parquet, 2 * 10^8 rows of one value": (parquet(_one_value)),
    "parquet, 20,000 groups of a row": (parquet(_row_groups)),
    "parquet, 20,000 columns": (parquet(_columns)),
    "parquet, 100 levels": (parquet(_nested)),
    "parquet, texts of 1 GB": (parquet(_long_text)),
    "parquet, a footer of 4 GB": (parquet(_footer)),
    # video
    "mp4, a picture of 65,535 by 65,535": (patched_video(b"mp4v\x00\x00\x00\x00", 28, b"\xff\xff\xff\xff")),
    "mp4, 2^32 - 1 samples": (patched_video(b"stsz", 12, b"\xff\xff\xff\xff")),
    "mp4, 2^32 - 1 times": (patched_video(b"stts", 8, b"\xff\xff\xff\xff")),
    "mp4, a sample of 4 GB": (patched_video(b"stsz", 16, b"\xff\xff\xff\xff")),
    "mp4, frames of 2^31 seconds": (patched_video(b"stts", 16, b"\x7f\xff\xff\xff")),
    "mp4, 20,000 atoms inside each other": text("a.mp4", atoms(20_000), "--times", "pts"),
    "mp4, atoms without a size": text(
        "a.mp4", atoms(0) + struct.pack(">I4sQ", 1, b"free", 8) * 100_000, "--times", "pts"
    ),
    "mkv, an element of 2^56 bytes": text(
        "a.mkv", b"\x1a\x45\xdf\xa3\x01\xff\xff\xff\xff\xff\xff\xfe" + bytes(MEGABYTE), "--times", "pts"
    ),
    "avi, a header of 4 GB": text(
        "a.avi", b"RIFF\xff\xff\xff\xffAVI LIST\xff\xff\xff\xffhdrl" + b"avih\xff\xff\xff\xff" * 1000, "--times", "pts"
    ),
    # answers
    "toml, 100,000 brackets": (
        lambda folder: [*text("a.csv", TABLE)(folder), "--mapping", *text("m.toml", "a = " + "[" * 100_000)(folder)]
    ),
    "toml, 100,000 parts of a key": (
        lambda folder: [*text("a.csv", TABLE)(folder), "--mapping", *text("m.toml", "a." * 100_000 + "b = 1\n")(folder)]
    ),
    "times, 20,000,000 lines": (
        lambda folder: [
            *patched_video(b"moov", 0, b"moov")(folder)[:1],
            *repeated("t.txt", b"1\n" * 1_000_000, 20)(folder),
        ]
    ),
}
"""Name -> maker."""
