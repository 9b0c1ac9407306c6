"""Metadata records in a row: those that the kernel takes are those that the records' own reader takes."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from cwcli.errors import InputError
from cwcli.logs.format import record_bytes
from cwcli.logs.format.metadata_table import MIN_RECORDS_FOR_KERNEL
from cwcli.logs.format.records import MCAP_MAGIC, RECORD_PREFIX, Channel, MetadataIndex, Opcode, Statistics
from cwcli.logs.read.reader import Log
from cwcli.logs.write.annotate import annotate_log

N = 6 * MIN_RECORDS_FOR_KERNEL
HEAD = MCAP_MAGIC + record_bytes.encode_header("", "test") + record_bytes.encode_record(Channel(1, 0, "/t", "json", {}))
END = record_bytes.encode_data_end() + record_bytes.encode_footer(0, 0, b"") + MCAP_MAGIC
CONTENTS = [(f"nämé {k}" if k % 7 else "run", {"k": str(k), "ü": "é" * k} if k % 3 else {}) for k in range(N)]
RECORDS = [record_bytes.encode_metadata(*each) for each in CONTENTS]


def written(path: Path, records: list[bytes]) -> Path:
    path.write_bytes(HEAD + b"".join(records) + END)
    return path


def read(path: Path, *, recover: bool = False) -> list[tuple[str, dict[str, str]]]:
    with Log.open(path, recover=recover) as log:
        return [(name, dict(values)) for name, values in log.metadata]


def test_every_record_of_a_row_is_read(tmp_path: Path) -> None:
    path = written(tmp_path / "in.mcap", RECORDS)
    assert read(path) == CONTENTS
    with Log.open(path) as log:
        assert log.metadata_names == tuple(name for name, _ in CONTENTS)
        assert log.metadata_with_prefix("run") == tuple(each for each in CONTENTS if each[0] == "run")


def test_other_records_in_a_row_are_not_metadata(tmp_path: Path) -> None:
    """A message between them, of a channel that nobody has defined."""
    message = RECORD_PREFIX.pack(5, 22) + bytes(22)
    path = written(tmp_path / "in.mcap", [each for record in RECORDS for each in (message, record)])
    with Log.open(path) as log:
        assert log.n_messages == N
        assert list(log.metadata) == CONTENTS
    rows = [*RECORDS[: 3 * MIN_RECORDS_FOR_KERNEL], message * 3, *RECORDS[3 * MIN_RECORDS_FOR_KERNEL :]]
    with Log.open(written(tmp_path / "in.mcap", rows)) as log:
        assert log.n_messages == 3
        assert list(log.metadata) == CONTENTS


BROKEN = {
    "a name that is longer than its record": struct.pack("<I", 99) + b"ab" + struct.pack("<I", 0),
    "a map that is longer than its record": struct.pack("<I", 1) + b"a" + struct.pack("<I", 9),
    "half an entry": struct.pack("<I", 1) + b"a" + struct.pack("<II", 5, 1) + b"k",
    "a name that is not UTF-8": struct.pack("<I", 1) + b"\xff" + struct.pack("<I", 0),
    "a value that is not UTF-8": struct.pack("<I", 0) + struct.pack("<III", 9, 0, 1) + b"\xff",
}


@pytest.mark.parametrize("content", BROKEN.values(), ids=BROKEN.keys())
def test_a_damaged_one_is_told_or_left_out(tmp_path: Path, content: bytes) -> None:
    k = 4 * MIN_RECORDS_FOR_KERNEL
    bad = RECORD_PREFIX.pack(Opcode.METADATA, len(content)) + content
    path = written(tmp_path / "in.mcap", [*RECORDS[:k], bad, *RECORDS[k:]])
    at = len(HEAD) + sum(map(len, RECORDS[:k]))
    with pytest.raises(InputError, match=f"damaged at byte {at}: "):
        Log.open(path)
    with Log.open(path, recover=True) as log:
        assert list(log.metadata) == CONTENTS
        assert log.faults.counts_by_reason() == {"bytes lost": len(bad)}


def with_summary(path: Path, places: list[MetadataIndex]) -> Path:
    data = HEAD + b"".join(RECORDS) + record_bytes.encode_data_end()
    summary = record_bytes.encode_record(Statistics(0, 0, 1, 0, len(places), 0, 0, 0, {}))
    summary += record_bytes.encode_record(Channel(1, 0, "/t", "json", {}))
    summary += b"".join(map(record_bytes.encode_record, places))
    path.write_bytes(data + summary + record_bytes.encode_footer(len(data), 0, summary) + MCAP_MAGIC)
    return path


def places() -> list[MetadataIndex]:
    offsets = [len(HEAD) + sum(map(len, RECORDS[:k])) for k in range(N)]
    return [MetadataIndex(at, len(one), name) for at, one, (name, _) in zip(offsets, RECORDS, CONTENTS, strict=True)]


def test_a_summary_in_any_order_lists_them_in_file_order(tmp_path: Path) -> None:
    assert read(with_summary(tmp_path / "in.mcap", places())) == CONTENTS
    assert read(with_summary(tmp_path / "in.mcap", places()[::-1])) == CONTENTS


@pytest.mark.parametrize("place", [(len(HEAD), 20), (1 << 63, 1), ((1 << 64) - 1, (1 << 64) - 1)])
def test_a_summary_that_points_elsewhere_is_damaged(tmp_path: Path, place: tuple[int, int]) -> None:
    listed = [
        *places()[: 2 * MIN_RECORDS_FOR_KERNEL],
        MetadataIndex(*place, "x"),
        *places()[2 * MIN_RECORDS_FOR_KERNEL :],
    ]
    path = with_summary(tmp_path / "in.mcap", listed)
    with pytest.raises(InputError, match="the summary's indexes overlap, or point outside the file"):
        Log.open(path)
    assert read(path, recover=True) == CONTENTS


def test_rows_are_copied_without_those_that_are_replaced(tmp_path: Path) -> None:
    path = written(tmp_path / "in.mcap", RECORDS)
    with Log.open(path) as log:
        annotate_log(log, [], {"run": {"new": "1"}}, tmp_path / "out.mcap", replace=True)
    assert read(tmp_path / "out.mcap") == [*(each for each in CONTENTS if each[0] != "run"), ("run", {"new": "1"})]
    with Log.open(path) as log:
        annotate_log(log, [], {}, tmp_path / "whole.mcap")
    assert read(tmp_path / "whole.mcap") == CONTENTS
    assert b"".join(RECORDS) in (tmp_path / "whole.mcap").read_bytes()
