"""Files that people have and that are not imported: how each is recognised, and what to do with it. One line each."""

from __future__ import annotations

import re
from collections.abc import Callable

from cwcli.errors import InputError
from cwcli.importing.readers.base import FileHead

AS_GPX, AS_CSV = "export it as GPX", "save it as CSV, with the columns' names and units in the first line"
PCAP_MAGICS = (b"\xd4\xc3\xb2\xa1", b"\xa1\xb2\xc3\xd4", b"\x4d\x3c\xb2\xa1", b"\x0a\x0d\x0d\x0a")
"""First bytes of recordings of network packets (libpcap in both byte orders and with nanoseconds; pcapng)."""
LINE_PROTOCOL_PATTERN = rb"[A-Za-z_][\w.-]*(?:,[\w.-]+=[^\s,=]+)* [\w.-]+=[^\s,=]+(?:,[\w.-]+=[^\s,=]+)* \d{10,19}\s"
"""Pattern of a line of InfluxDB's line protocol: a name with tags, fields, and a time."""
UNREAD_FORMATS: tuple[tuple[str, str, Callable[[FileHead], bool]], ...] = (
    ("a FIT activity", AS_GPX, lambda head: head.data[8:12] == b".FIT"),
    ("a TCX activity", AS_GPX, lambda head: b"<TrainingCenterDatabase" in head.data[:2000]),
    ("KMZ", "unpack it, and import its doc.kml", lambda head: _is_zip_with(head, b"doc.kml")),
    ("an Excel workbook", AS_CSV, lambda head: _is_zip_with(head, b"[Content_Types].xml", b"xl/")),
    ("an old Excel workbook", AS_CSV, lambda head: head.data.startswith(b"\xd0\xcf\x11\xe0")),
    ("an OpenDocument table", AS_CSV, lambda head: _is_zip_with(head, b"mimetypeapplication/vnd.oasis")),
    ("JSON", AS_CSV, lambda head: bool(re.match(rb"\s*(\[\s*)?\{", head.data))),
    ("an MDF measurement", "export it as CSV, Parquet or BLF", lambda head: head.data[:3] in {b"MDF", b"UnF"}),
    ("a MATLAB file", "writetable writes a CSV file", lambda head: head.data.startswith(b"MATLAB ")),
    ("an HDF5 file", AS_CSV, lambda head: head.data.startswith(b"\x89HDF")),
    ("a NumPy array", AS_CSV, lambda head: head.data.startswith(b"\x93NUMPY")),
    (
        "a RINEX file",
        "compute the positions, and import those as NMEA",
        lambda head: b"RINEX VERSION" in head.data[:90],
    ),
    ("compressed by gzip", "unpack it: gunzip FILE", lambda head: head.data.startswith(b"\x1f\x8b")),
    ("compressed by bzip2", "unpack it: bunzip2 FILE", lambda head: head.data.startswith(b"BZh")),
    ("compressed by Zstandard", "unpack it: unzstd FILE", lambda head: head.data.startswith(b"\x28\xb5\x2f\xfd")),
    ("compressed by xz", "unpack it: unxz FILE", lambda head: head.data.startswith(b"\xfd7zXZ\0")),
    (
        "an Arrow or Feather table",
        "save it as Parquet",
        lambda head: head.data.startswith((b"ARROW1", b"FEA1")),
    ),
    ("a PX4 log", "pyulog's ulog2csv writes CSV files", lambda head: head.data.startswith(b"ULog\x01\x12\x35")),
    (
        "an ArduPilot log",
        "write its GPS and IMU messages as CSV (mavlogdump.py --format csv)",
        lambda head: head.data.startswith((b"\xa3\x95", b"FMT, ")),
    ),
    ("a NovAtel log", "convert it to NMEA or CSV", lambda head: bool(re.match(rb"[#%][A-Z]{5,}[AS]?,", head.data))),
    ("a recording of network packets", "export the payload", lambda head: head.data[:4] in PCAP_MAGICS),
    (
        "a table of CAN frames",
        "write it as ASC: can_logconvert FILE trace.asc",
        lambda head: head.data.startswith(b"timestamp,arbitration_id,extended,remote,error,dlc,data"),
    ),
    (
        "candump's output with times from its start or of the line before",
        "record it with candump -L",
        lambda head: bool(re.match(rb"\s*\(\d{1,9}\.\d+\)\s+\S+\s+[0-9A-F]{3,8}\s+\[\d+\]", head.data)),
    ),
    (
        "InfluxDB's line protocol",
        "query it as CSV, pivoted: a column for each field",
        lambda head: bool(re.match(LINE_PROTOCOL_PATTERN, head.data)),
    ),
    (
        "a log already",
        "`cwcli info FILE` shows what it holds; the other commands read it",
        lambda head: head.data.startswith((b"\x89MCAP0\r\n", b"#ROSBAG V", b"SQLite format 3\0")),
    ),
)
"""Each entry is the name of a format that cwcli does not read, what the user can do instead, and whether the beginning
of a file shows that format."""


def _is_zip_with(head: FileHead, *names: bytes) -> bool:
    """Tell whether a zip has one of some members near its start."""
    return head.data.startswith(b"PK\x03\x04") and any(name in head.data[:4000] for name in names)


def refuse_unread_format(head: FileHead) -> None:
    """Raise where a file is of a kind that is known and not read.

    Raises:
        InputError: It is.
    """
    for name, hint, accepts in UNREAD_FORMATS:
        if accepts(head):
            raise InputError(f"it is {name}, which is not imported", where=head.path, hint=hint)
