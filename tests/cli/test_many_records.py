"""Too many records, names that are too long, large attachments, indexes that lie, and endless pipes."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.writer import Writer

from cwcli.logs.format import record_bytes
from cwcli.logs.format.metadata_table import MAX_METADATA_RECORDS
from cwcli.logs.format.records import (
    MCAP_MAGIC,
    RECORD_PREFIX,
    Channel,
    Footer,
    MetadataIndex,
    Schema,
    Statistics,
    attachment_crc_offset,
    read_opcode_and_content_range,
    read_record,
)
from cwcli.logs.read.reader import Log
from tests.cli.bounded import bounded
from tests.unit.logs_read.lying_logs import hiding, with_summary

T0_NS = 1_700_000_000_000_000_000
N_RECORDS = 1_000_000
HEAD = MCAP_MAGIC + record_bytes.encode_header("", "test")
END = record_bytes.encode_data_end() + record_bytes.encode_footer(0, 0, b"") + MCAP_MAGIC
SCHEMA = record_bytes.encode_record(Schema(1, "a/B", "ros2msg", b"float64 x"))
ATTACHED_BYTES = 500_000_000
MARK = b"first and last"
CALLS_OF_METADATA = 20 * N_RECORDS
"""Most calls of a command over a million metadata records: six for each where the summary lists them."""
CALLS_OF_CHANNELS = 8_000_000
"""Most calls up to the 65,536th channel, about sixty for each; a million would be 60 million."""


def metadata_records() -> bytes:
    return HEAD + record_bytes.encode_metadata("m", {"a": "b"}) * N_RECORDS


def indexed_metadata() -> bytes:
    one = record_bytes.encode_metadata("m", {"a": "b"})
    places = (MetadataIndex(len(HEAD) + k * len(one), len(one), "m") for k in range(N_RECORDS))
    counted = Statistics(0, 0, 0, 0, N_RECORDS, 0, 0, 0, {})
    summary = record_bytes.encode_record(counted) + b"".join(map(record_bytes.encode_record, places))
    return with_summary(metadata_records(), summary)


def channel_records() -> bytes:
    channels = [record_bytes.encode_record(Channel(k + 1, 1, f"/t{k}", "cdr", {})) for k in range(10)]
    return HEAD + SCHEMA + b"".join(channels) * (N_RECORDS // 10)


@pytest.mark.parametrize(
    "data", [lambda: metadata_records() + END, indexed_metadata], ids=["without a summary", "with a summary"]
)
def test_a_million_metadata_records_are_listed_at_once(tmp_path: Path, data: object) -> None:
    assert callable(data)
    (tmp_path / "in.mcap").write_bytes(data())
    for options in ([], ["--recover"]):
        ended = bounded(tmp_path, "info", "in.mcap", *options, most_mb=200, most_calls=CALLS_OF_METADATA)
        assert ended.code == 0
        assert ended.printed.replace("\n", "").replace(" ", "").count(",m") == 99
        assert "and999,900more" in ended.printed.replace("\n", "").replace(" ", "")
    ended = bounded(tmp_path, "info", "in.mcap", "--json", most_mb=300, most_calls=CALLS_OF_METADATA)
    assert json.loads(ended.printed)["metadata"] == ["m"] * N_RECORDS


def test_a_million_channel_records_are_told_at_once(tmp_path: Path) -> None:
    (tmp_path / "in.mcap").write_bytes(channel_records() + END)
    for words in (("info",), ("estimate", "--recover")):  # the others read alike
        ended = bounded(tmp_path, *words, "in.mcap", most_mb=200, most_calls=CALLS_OF_CHANNELS)
        assert ended.code == 3
        assert "it holds more than 65,536 schemas, channels, attachments and parts with metadata" in ended.shown


def test_more_metadata_than_memory_should_hold(tmp_path: Path) -> None:
    one = record_bytes.encode_metadata("", {})
    (tmp_path / "in.mcap").write_bytes(HEAD + one * (MAX_METADATA_RECORDS + 1) + END)
    ended = bounded(tmp_path, "info", "in.mcap", most_mb=200)
    assert ended.code == 3
    assert "it holds more than 2,097,152 metadata records" in ended.shown


def test_name_of_three_megabytes(tmp_path: Path) -> None:
    channel = record_bytes.encode_record(Channel(1, 1, "/" + "n" * 3_000_000, "cdr", {}))
    (tmp_path / "in.mcap").write_bytes(
        with_summary(
            HEAD + SCHEMA + channel,
            SCHEMA + channel + record_bytes.encode_record(Statistics(0, 0, 0, 0, 0, 0, 0, 0, {})),
        )
    )
    ended = bounded(tmp_path, "info", "in.mcap", most_mb=200)
    assert ended.code == 0
    assert "(3,000,001 characters)" in ended.printed.replace("\n", "").replace(" ", "").replace("(3", " (3").replace(
        "1c", "1 c"
    )
    assert len(ended.printed) < 5000
    ended = bounded(tmp_path, "estimate", "in.mcap", most_mb=200)
    assert ended.code == 4
    assert len(ended.shown) < 2000


def test_large_attachment_is_copied_by_range(intersection: Path, tmp_path: Path) -> None:
    """Its data are a hole in the file, so that the test needs no disk."""
    data = intersection.read_bytes()
    footer_at = len(data) - len(MCAP_MAGIC) - len(record_bytes.encode_footer(0, 0, b""))
    _, start, end = read_opcode_and_content_range(memoryview(data), footer_at, len(data))
    summary_at = read_record(Footer, memoryview(data), start, end).summary_start
    fields = struct.pack("<QQ", 1, 1) + b"\1\0\0\0a\1\0\0\0b" + struct.pack("<Q", ATTACHED_BYTES)
    with (tmp_path / "in.mcap").open("wb") as file:
        file.write(data[: summary_at - len(record_bytes.encode_data_end())])
        file.write(RECORD_PREFIX.pack(9, len(fields) + ATTACHED_BYTES + 4) + fields)
        file.write(MARK)
        file.seek(ATTACHED_BYTES - 2 * len(MARK), 1)
        file.write(MARK + bytes(4) + END)
    ended = bounded(tmp_path, "estimate", "in.mcap", "-o", "out.mcap", most_mb=150)
    assert ended.code == 0, ended.shown
    with Log.open(tmp_path / "out.mcap") as log:
        assert [(each.name, each.size) for each in log.attachments] == [("a", ATTACHED_BYTES)]
        end = attachment_crc_offset(log.attachments[0])
        assert log.file[end - len(MARK) : end] == MARK
        assert log.file[end - ATTACHED_BYTES : end - ATTACHED_BYTES + len(MARK)] == MARK


def test_index_that_leaves_a_channel_out_costs_no_message(tmp_path: Path) -> None:
    """The summary's entry of the second chunk does not tell of the channel in it; the Statistics count its messages."""
    whole = tmp_path / "whole.mcap"
    with whole.open("wb") as stream:
        writer = Writer(stream, chunk_size=2000)
        writer.start()
        channels = [writer.register_channel(topic, "json", 0) for topic in ("/fix", "/other")]
        for k in range(200):
            writer.add_message(channels[k % 2], T0_NS + k, b'{"k": %d}' % k, T0_NS + k)
        writer.finish()
    (tmp_path / "in.mcap").write_bytes(hiding(whole.read_bytes(), "/fix"))
    with Log.open(tmp_path / "in.mcap") as log:
        found = log.columns("/fix")
        assert log.faults.counts_by_reason() == {"message indexes that differ from their chunk": 1}
    assert found.log_time_ns.tolist() == [T0_NS + k for k in range(0, 200, 2)]


def test_statistics_that_count_other_messages_are_a_fault(tmp_path: Path) -> None:
    content = struct.pack("<HIQQ", 1, 0, 5, 5) + b"\0\1\0\0" + bytes(8)
    channel = record_bytes.encode_record(Channel(1, 1, "/x", "cdr", {}))
    counted = Statistics(3, 1, 1, 0, 0, 0, 5, 5, {1: 3})
    data = HEAD + SCHEMA + channel + (RECORD_PREFIX.pack(5, len(content)) + content) * 2
    (tmp_path / "in.mcap").write_bytes(with_summary(data, SCHEMA + channel + record_bytes.encode_record(counted)))
    with Log.open(tmp_path / "in.mcap") as log:
        assert len(log.columns("/x")) == 2
        assert log.faults.counts_by_reason() == {"channels with a wrong message count in the summary": 1}


def test_statistics_without_counts_are_no_fault(tmp_path: Path) -> None:
    """An empty map says that nobody has counted."""
    content = struct.pack("<HIQQ", 1, 0, 5, 5) + b"\0\1\0\0" + bytes(8)
    channel = record_bytes.encode_record(Channel(1, 1, "/x", "cdr", {}))
    counted = Statistics(2, 1, 1, 0, 0, 0, 5, 5, {})
    data = HEAD + SCHEMA + channel + (RECORD_PREFIX.pack(5, len(content)) + content) * 2
    (tmp_path / "in.mcap").write_bytes(with_summary(data, SCHEMA + channel + record_bytes.encode_record(counted)))
    with Log.open(tmp_path / "in.mcap") as log:
        assert log.channels[0].message_count is None
        assert len(log.columns("/x")) == 2
        assert log.faults.counts_by_reason() == {}


def test_endless_zeros_are_no_log(tmp_path: Path) -> None:
    ended = bounded(tmp_path, "info", "/dev/zero", most_mb=200)
    assert ended.code == 3
    assert ended.shown == "error: /dev/zero: it is not an MCAP file\n"


def test_endless_pipe_that_begins_as_a_log(tmp_path: Path) -> None:
    endless = (
        "import sys\nsys.stdout.buffer.write(b'\\x89MCAP0\\r\\n')\nwhile True: sys.stdout.buffer.write(bytes(1 << 16))"
    )
    with subprocess.Popen([sys.executable, "-c", endless], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as source:
        ended = bounded(tmp_path, "info", "-", "--max-input", "0.05", most_mb=200, stdin=source.stdout)
        source.kill()
    assert ended.code == 3
    assert "error: <stdin>: more than 0.05 GB were received" in ended.shown
