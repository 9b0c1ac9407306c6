"""More files for `cwcli import` that stand for more than they may cost: kinds that `hostile_imports` does not have."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path

import numpy as np

from tests.unit.importing import files
from tests.unit.importing.hostile_imports import (
    GPX,
    MEGABYTE,
    SENTENCE,
    TABLE,
    Make,
    blf,
    candump,
    container,
    later,
    parquet,
    repeated,
    text,
    with_dbc,
    zipped,
)

TERABYTE = 1 << 40


RTKLIB = b"% program : x\n%  GPST   latitude(deg) longitude(deg)  height(m)   Q\n"
VBOX = b"File created on 01/01/2020 at 10:00\n[column names]\nsats time lat long velocity heading height\n[data]\n"


def sparse(name: str, head: bytes, rows: bytes = b"") -> Make:
    """A file that begins like others and goes on with a terabyte of zeros, which take no room on the disk.

    The rows fill what is looked at first.
    """

    def make(folder: Path) -> list[str]:
        with (folder / name).open("wb") as file:
            file.write(head + rows * (300_000 // len(rows) if rows else 0))
            file.truncate(TERABYTE)
        return [name]

    return make


def many_tables(folder: Path) -> list[str]:
    """A zip of 900 tables of a megabyte that no app has."""
    block = b"time,lat,lon\n" + b"1,48,11\n" * (MEGABYTE // 8)
    with zipfile.ZipFile(folder / "phone.zip", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for k in range(900):
            archive.writestr(f"sheet{k}.csv", block)
    return ["phone.zip"]


def huge_jpeg_video(folder: Path) -> list[str]:
    """An AVI of JPEG pictures that say 65,500 by 65,500."""
    import cv2

    writer = cv2.VideoWriter(str(folder / "dash.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 30.0, (64, 48))
    for _ in range(5):
        writer.write(np.zeros((48, 64, 3), np.uint8))
    writer.release()
    data = bytearray((folder / "dash.avi").read_bytes())
    at = data.find(b"\xff\xc0")
    while at >= 0:
        data[at + 5 : at + 9] = struct.pack(">HH", 65_500, 65_500)
        at = data.find(b"\xff\xc0", at + 9)
    (folder / "dash.avi").write_bytes(data)
    return ["dash.avi", "--times", "pts"]


def _one_page(path: Path) -> None:
    """30 million zeros in one page of each of three columns."""
    import pyarrow as pa
    from pyarrow import parquet as pq

    n = 30_000_000
    column = pa.Array.from_buffers(pa.float64(), n, [None, pa.py_buffer(memoryview(bytearray(8 * n)))])
    table = pa.table({"time": column, "lat": column, "lon": column})
    pq.write_table(
        table,
        path,
        compression="zstd",
        use_dictionary=False,
        data_page_size=1 << 30,
        row_group_size=n,
        write_batch_size=n,
        write_statistics=False,
    )


def _lists(path: Path) -> None:
    """Rows of one list of 50 million numbers."""
    import pyarrow as pa
    from pyarrow import parquet as pq

    n = 50_000_000
    values = pa.DictionaryArray.from_arrays(
        pa.Array.from_buffers(pa.int32(), n, [None, pa.py_buffer(bytes(4 * n))]), [1.0]
    )
    lists = pa.ListArray.from_arrays(pa.array([0, n], pa.int32()), values.dictionary_decode().cast(pa.float32()))
    pq.write_table(
        pa.table({"time": [1.0], "lat": lists, "lon": [2.0]}), path, compression="zstd", write_statistics=False
    )


def _metadata(path: Path) -> None:
    """A footer with 60 MB of metadata."""
    import pyarrow as pa
    from pyarrow import parquet as pq

    table = pa.table({"time": [1.0, 2.0], "lat": [48.0, 48.1], "lon": [11.0, 11.1]})
    pq.write_table(table.replace_schema_metadata({f"k{k}": "x" * MEGABYTE for k in range(60)}), path)


def with_options(make: Make, *options: str) -> Make:
    return lambda folder: [*make(folder), *options]


def distinct_extensions() -> Make:
    points = "".join(
        f'<trkpt lat="{48 + k * 1e-6:.6f}" lon="11"><time>2023-11-14T22:{k // 60 % 60:02d}:{k % 60:02d}Z</time>'
        f"<extensions><name{k}>1</name{k}></extensions></trkpt>"
        for k in range(60_000)
    )
    return text("a.gpx", GPX.format("", f"<trkseg>{points}</trkseg>"))


def quarters() -> Make:
    """Local times, each in another quarter of an hour."""
    first = np.datetime64("1971-01-01T00:00:00", "s")
    moments = (first + 900 * np.arange(1_000_000)).astype(str)
    return with_options(
        text("a.csv", "time,lat,lon\n" + "".join(f"{each.replace('T', ' ')},48,11\n" for each in moments)),
        "--timezone",
        "Europe/Berlin",
    )


FRAMES = "date Tue Nov 14 10:13:20 2023\nbase hex  timestamps relative\n"
MULTIPLEXED = files.DBC + (
    'BO_ 512 Mux: 8 E\n SG_ Mode M : 0|32@1+ (1,0) [0|0] "" ESP\n SG_ Speed m0M : 32|16@1+ (1,0) [0|0] "km/h" ESP\n'
    "SG_MUL_VAL_ 512 Speed Mode 0-4294967295;\n"
)
TOKENS = b"\xb5\x62\x77\x77\x00\x00\xee\x00"
UNFORESEEN: dict[str, Make] = {
    # files that go on without end
    "csv, 1 TB of zeros": sparse("a.csv", TABLE.encode(), b"1,48,11\n"),
    "nmea, 1 TB of zeros": sparse("a.nmea", SENTENCE, SENTENCE),
    "ubx, 1 TB of zeros": sparse("a.ubx", b"\xb5\x62\x01\x07\x5c\x00" + bytes(94)),
    "gpx, 1 TB of zeros": sparse("a.gpx", GPX.format("", "").encode()[:-12], b" " * 1000),
    "tum, 1 TB of zeros": sparse("a.tum", b"", b"1 2 3 4 0 0 0 1\n"),
    "gnsslogger, 1 TB of zeros": sparse("a.txt", b"# Version: v3\n# Fix,Provider,LatitudeDegrees\n", b"Fix,GPS,1\n"),
    "asc, 1 TB of zeros": with_dbc(sparse("a.asc", FRAMES.encode(), b"0.1 1 100 Rx d 1 01\n")),
    "candump, 1 TB of zeros": with_dbc(sparse("a.log", b"", b"(1.0) can0 100#00\n")),
    "trc, 1 TB of zeros": with_dbc(
        sparse("a.trc", b";$FILEVERSION=2.1\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n", b"1 0.1 DT 1 0100 Rx - 1 01\n")
    ),
    "candump on the screen, a line of 9 MB": with_dbc(
        text(
            "a.txt", "(1700000000.1) can0 100 [8] 01\n" * 9 + "(1700000000.1) can0 100 [8] " + "00 " * 3_000_000 + "z\n"
        )
    ),
    "zip, 1 TB of zeros": sparse("a.zip", b"PK\x03\x04"),
    "blf, 1 TB of zeros": with_dbc(sparse("a.blf", blf())),
    "mp4, 1 TB of zeros": with_options(
        sparse("a.mp4", struct.pack(">I4s4sI", 16, b"ftyp", b"isom", 0)), "--times", "pts"
    ),
    "parquet, 1 TB of zeros": sparse("a.parquet", b"PAR1"),
    "dbc, 1 TB of zeros": lambda folder: [*candump(folder), *sparse("big.dbc", files.DBC.encode())(folder)],
    "times, 1 TB of zeros": lambda folder: [*_video(folder), *sparse("t.txt", b"", b"1\n2\n")(folder)],
    "mapping, 1 TB of zeros": lambda folder: [
        *text("a.csv", TABLE)(folder),
        "--mapping",
        *sparse("m.toml", b"[answers]\n")(folder),
    ],
    # names
    "csv, a name of 200,000 brackets": text("a.csv", f"time,lat,lon,{'(' * 200_000}\n1,48,11,1\n2,48,11,1\n"),
    "csv, a name of 60,000 slashes": text("a.csv", f"time,lat,lon,{' /' * 60_000} \n1,48,11,1\n2,48,11,1\n"),
    "csv, 3,000 columns of time": text(
        "a.csv", f"lat,lon,{','.join(f'time{k}' for k in range(3000))}\n" + f"48,11,{','.join(['1'] * 3000)}\n" * 40
    ),
    "csv, 300,000 vehicles": later(
        lambda: text("a.csv", "time,id,lat,lon\n" + "".join(f"{k},v{k % 300_000},48,11\n" for k in range(700_000)))
    ),
    "csv, a million quarters of an hour": later(quarters),
    "csv, surrogates without a partner": text(
        "a.csv", b"\xff\xfe" + "time,lat,lon\n".encode("utf-16-le") + b"\x00\xd8" * 50_000
    ),
    "gpx, 60,000 names of extensions": later(distinct_extensions),
    "gpx, 2 MB of namespaces": text(
        "a.gpx", "<gpx " + " ".join(f"xmlns:n{k}='u{k}'" for k in range(100_000)) + "></gpx>"
    ),
    # CAN
    "kml, 4 million places": repeated(
        "a.kml",
        b"<gx:coord>1 2 3</gx:coord>\n" * 10_000,
        400,
        b'<kml xmlns:gx="x"><gx:Track>',
        b"</gx:Track></kml>",
    ),
    "rtklib, a line of 300 MB": repeated("a.pos", b"1 " * 500_000, 300, RTKLIB),
    "vbox, a name 100,000 times": text("a.vbo", VBOX.replace(b"sats", b"a " * 100_000) + b"1 " * 100_007 + b"\n"),
    "rtklib, names of brackets": text("a.pos", RTKLIB[:-1] + b" a((" * 60_000 + b"\n2024/01/01 00:00:00 48 11\n"),
    "kml, times of 15 MB": repeated(
        "a.kml",
        b"<when>" + b"1" * 15_000_000 + b"</when><gx:coord>1 2</gx:coord>",
        8,
        b'<kml xmlns:gx="x"><gx:Track>',
        b"</gx:Track></kml>",
    ),
    "vbox, 500,000 rows of one cell": repeated("a.vbo", b"[data]\n", 500_000, VBOX),
    "dbc, a multiplexer of 2^32 values": with_dbc(candump, MULTIPLEXED),
    "dbc, a multiplexer of itself": with_dbc(
        candump, MULTIPLEXED.replace("Speed Mode 0-4294967295", "Speed Speed 0-1")
    ),
    "dbc, 500,000 words": with_dbc(candump, files.DBC + "a " * 2_000_000),
    "dbc, a text of 10 MB": with_dbc(candump, files.DBC + 'CM_ "' + "\\\\" * 5_000_000 + '";\n'),
    "dbc, 100,000 choices of a table": with_dbc(
        candump, files.DBC + "VAL_TABLE_ T " + "".join(f'{k} "n" ' for k in range(100_000)) + ";\n"
    ),
    "asc, 300,000 lines of blanks": with_dbc(text("a.asc", FRAMES + (" " * 80 + "\n") * 300_000)),
    "blf, containers inside each other": with_dbc(later(lambda: text("a.blf", blf(_matryoshka(300))))),
    "blf, 200,000 objects of unknown kinds": with_dbc(
        later(lambda: text("a.blf", blf(container(struct.pack("<4sHHII", b"LOBJ", 16, 1, 16, 99) * 200_000))))
    ),
    # u-blox and NMEA
    "ubx, 2 million empty messages": repeated("a.ubx", TOKENS * 1000, 2000, b"\xb5\x62\x01\x07\x00\x00\x08\x19"),
    "nmea, 200,000 kinds of sentences": later(
        lambda: text("a.nmea", b"".join(b"$GP%06d,1*00\r\n" % k for k in range(200_000)) + SENTENCE * 200_000)
    ),
    # zip
    "zip, 900 tables of 1 MB": many_tables,
    "zip, a directory of names of 60 kB": later(lambda: zipped({f"{k}{'x' * 60_000}.csv": b"" for k in range(900)})),
    # Parquet
    "parquet, pages of 240 MB": parquet(_one_page),
    "parquet, a list of 50 million": parquet(_lists),
    "parquet, 60 MB of metadata": parquet(_metadata),
    # video
    "avi, pictures of 65,500 by 65,500": huge_jpeg_video,
    # answers
    "toml, 200,000 tables": lambda folder: [
        *text("a.csv", TABLE)(folder),
        "--mapping",
        *text("m.toml", '[[table]]\nname="a"\n' * 150_000)(folder),
    ],
    "times, numbers of 10 MB": lambda folder: [
        *_video(folder),
        *text("t.txt", "1\n2\n3\n" + "9" * (10 * MEGABYTE))(folder),
    ],
}
"""Name -> maker."""


def _video(folder: Path) -> list[str]:
    files.video(folder)
    return ["front.mp4"]


def _matryoshka(depth: int) -> bytes:
    data = b""
    for _ in range(depth):
        data = container(data)
    return data
