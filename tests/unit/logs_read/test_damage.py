"""Damaged files: a clear error, or a counted repair; never anything else."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType

from cwcli.errors import CwcliError, InputError
from cwcli.logs.format import record_bytes
from cwcli.logs.format.records import (
    MCAP_MAGIC,
    ChunkIndex,
    Opcode,
    read_chunk,
    read_opcode_and_content_range,
    read_record,
)
from cwcli.logs.read.reader import Log
from cwcli.signals.columns import Columns
from tests.unit.logs_read.builders import LAYOUTS, small_log

Tries = Callable[[int, int], int]
N = 60
COMPRESSIONS = {name: LAYOUTS[name] for name in ("zstd", "lz4", "uncompressed", "unchunked")}


def read_all(path: Path, *, recover: bool = False) -> tuple[dict[str, Columns], Log]:
    """Every topic."""
    with Log.open(path, recover=recover) as log:
        return log.load_topics({channel.topic: None for channel in log.channels}), log


def latitudes(loaded: dict[str, Columns]) -> list[float]:
    """The numbers of the messages on /fix, as far as they are there."""
    return np.asarray(loaded["/fix"].fields["latitude"]).tolist() if "/fix" in loaded else []


def records(data: bytes) -> Iterator[tuple[int, int, int, int]]:
    """Opcode, offset, content start and end of every top-level record."""
    view, at = memoryview(data), 8
    while at < len(data) - 8:
        opcode, start, end = read_opcode_and_content_range(view, at, len(data))
        yield opcode, at, start, end
        at = end


def flipped(data: bytes, at: int) -> bytes:
    """The file with one byte changed."""
    return data[:at] + bytes([data[at] ^ 0x5A]) + data[at + 1 :]


@pytest.mark.parametrize("name", COMPRESSIONS)
def test_cut_anywhere_is_an_error_and_recover_reads_what_is_there(tmp_path: Path, name: str, tries: Tries) -> None:
    data = small_log(N, **COMPRESSIONS[name])
    path = tmp_path / "log.mcap"
    path.write_bytes(data)
    whole, _ = read_all(path)
    complete = latitudes(whole)
    seen = 0
    for cut in [*range(0, 200, 7), *range(200, len(data), tries(293, 97)), len(data) - 1]:
        path.write_bytes(data[:cut])
        with pytest.raises(InputError) as caught:
            read_all(path)
        assert "\n" not in str(caught.value)
        try:
            loaded, log = read_all(path, recover=True)
        except InputError as error:
            assert "\n" not in str(error)
            assert seen == 0  # once there was something, more of the file can't give nothing
            continue
        found = latitudes(loaded)
        assert found == complete[: len(found)]
        assert len(found) >= seen
        seen = len(found)
        assert log.faults.truncated
    assert seen == N


@pytest.mark.parametrize("name", LAYOUTS)
@pytest.mark.parametrize("recover", [False, True])
def test_flipped_bytes_give_a_known_error_or_intact_messages(
    tmp_path: Path, name: str, recover: bool, tries: Tries
) -> None:
    data = small_log(N, **LAYOUTS[name])
    path = tmp_path / "log.mcap"
    path.write_bytes(data)
    expected = set(latitudes(read_all(path)[0]))
    has_crc = name not in ("no CRC", "unchunked")
    rng = np.random.default_rng(11)
    for at in rng.integers(0, len(data), tries(25, 70)).tolist():
        path.write_bytes(flipped(data, at))
        try:
            loaded, log = read_all(path, recover=recover)
        except CwcliError as error:
            assert "\n" not in str(error)
            continue
        found = latitudes(loaded)
        if has_crc and not log.faults.data_crc_mismatch:
            assert set(found) <= expected
        if has_crc and len(found) < N and name not in ("no statistics", "no summary"):
            assert recover and log.faults.counts_by_reason(), at


@pytest.mark.parametrize("name", ["zstd", "lz4", "uncompressed"])
def test_flipped_byte_in_a_chunk_costs_that_chunk_alone(tmp_path: Path, name: str) -> None:
    data = small_log(N, **COMPRESSIONS[name])
    chunks = [
        read_chunk(memoryview(data), start, end) for opcode, _, start, end in records(data) if opcode == Opcode.CHUNK
    ]
    path = tmp_path / "log.mcap"
    path.write_bytes(flipped(data, chunks[1].data_start + chunks[1].data_length // 2))
    with pytest.raises(InputError, match="chunk") as caught:
        read_all(path)
    assert "byte" in str(caught.value)
    assert "--recover" in caught.value.hint
    loaded, log = read_all(path, recover=True)
    lost = 2 * N - sum(map(len, loaded.values()))
    assert 0 < lost < 2 * N / 3
    assert log.faults.chunks_lost == 1
    assert log.faults.messages_lost == lost
    assert log.faults.bytes_lost == chunks[1].length


def test_flipped_byte_in_an_unchunked_file_fails_the_crc_of_all_messages(tmp_path: Path) -> None:
    data = small_log(N, **LAYOUTS["unchunked with a CRC"])
    start = next(start for opcode, _, start, _ in records(data) if opcode == Opcode.MESSAGE)
    path = tmp_path / "log.mcap"
    path.write_bytes(flipped(data, start + 60))
    with pytest.raises(InputError, match="CRC of its messages"):
        read_all(path)
    loaded, log = read_all(path, recover=True)
    assert [len(columns) for columns in loaded.values()] == [N, N]
    assert log.faults.counts_by_reason() == {"CRC of all messages wrong": 1}


def test_flipped_crc_alone_is_a_crc_mismatch(tmp_path: Path) -> None:
    data = small_log(N)
    first = next(start for opcode, _, start, _ in records(data) if opcode == Opcode.CHUNK)
    path = tmp_path / "log.mcap"
    path.write_bytes(flipped(data, first + 24))
    with pytest.raises(InputError, match="CRC"):
        read_all(path)
    assert read_all(path, recover=True)[1].faults.crc_mismatches == 1


def test_flipped_byte_in_a_message_index_is_counted_and_harms_nobody(tmp_path: Path) -> None:
    data = small_log(N)
    path = tmp_path / "log.mcap"
    path.write_bytes(data)
    expected = latitudes(read_all(path)[0])
    offsets = [start for opcode, _, start, _ in records(data) if opcode == Opcode.MESSAGE_INDEX]
    for shift in (0, 3, 8, 14):  # channel, length, a time, an offset
        path.write_bytes(flipped(data, offsets[0] + shift))
        loaded, log = read_all(path)
        assert latitudes(loaded) == expected
        assert log.faults.counts_by_reason() == {"message indexes that differ from their chunk": 1}


def test_index_entry_that_points_outside_the_chunk_is_counted(tmp_path: Path) -> None:
    data = bytearray(small_log(N))
    start = next(start for opcode, _, start, _ in records(bytes(data)) if opcode == Opcode.MESSAGE_INDEX)
    struct.pack_into("<Q", data, start + 6 + 8, 1 << 62)
    path = tmp_path / "log.mcap"
    path.write_bytes(bytes(data))
    loaded, log = read_all(path)
    assert len(loaded["/fix"]) == N
    assert log.faults.broken_indexes == 1


def test_chunk_index_that_points_outside_the_file_is_an_error(tmp_path: Path) -> None:
    data = bytearray(small_log(N, enable_crcs=False))
    path = tmp_path / "log.mcap"
    for field_at in (16, 24):  # chunk start, chunk length
        broken = bytearray(data)
        start = next(start for opcode, _, start, _ in records(bytes(data)) if opcode == Opcode.CHUNK_INDEX)
        struct.pack_into("<Q", broken, start + field_at, 1 << 62)
        path.write_bytes(bytes(broken))
        with pytest.raises(InputError, match="outside the file") as caught:
            read_all(path)
        assert "--recover" in caught.value.hint
        loaded, log = read_all(path, recover=True)
        assert len(loaded["/fix"]) == N
        assert log.faults.summary_damaged


def test_flipped_byte_in_the_summary_is_an_error_and_recover_reads_everything(tmp_path: Path) -> None:
    data = small_log(N)
    summary_start = struct.unpack_from("<Q", data, len(data) - 8 - 20)[0]
    path = tmp_path / "log.mcap"
    for at in range(summary_start, len(data) - 37, 53):
        path.write_bytes(flipped(data, at))
        with pytest.raises(InputError, match="summary"):
            read_all(path)
        loaded, log = read_all(path, recover=True)
        assert [len(columns) for columns in loaded.values()] == [N, N]
        assert log.faults.counts_by_reason() == {"summary damaged": 1}


HUGE = 1 << 63


def huge_record_length(data: bytearray) -> None:
    at = next(at for opcode, at, _, _ in records(bytes(data)) if opcode == Opcode.CHUNK)
    struct.pack_into("<Q", data, at + 1, HUGE)


def huge_chunk_size(data: bytearray) -> None:
    start = next(start for opcode, _, start, _ in records(bytes(data)) if opcode == Opcode.CHUNK)
    struct.pack_into("<Q", data, start + 16, HUGE)
    for opcode, _, index_start, end in list(records(bytes(data))):
        if opcode == Opcode.CHUNK_INDEX:
            index = read_record(ChunkIndex, memoryview(bytes(data)), index_start, end)
            if index.chunk_start == start - 9:
                struct.pack_into("<Q", data, end - 8, HUGE)


def huge_stored_size(data: bytearray) -> None:
    start = next(start for opcode, _, start, _ in records(bytes(data)) if opcode == Opcode.CHUNK)
    chunk = read_chunk(memoryview(bytes(data)), start, len(data))
    struct.pack_into("<Q", data, chunk.data_start - 8, HUGE)


def huge_message_count(data: bytearray) -> None:
    for opcode, _, start, _ in list(records(bytes(data))):
        if opcode == 0x0B:
            struct.pack_into("<Q", data, start, HUGE)


@pytest.mark.parametrize("damage", [huge_record_length, huge_chunk_size, huge_stored_size])
@pytest.mark.parametrize("layout", ["zstd", "lz4", "uncompressed"])
def test_declared_size_of_two_to_the_63_is_not_allocated(tmp_path: Path, damage: Any, layout: str) -> None:
    data = bytearray(small_log(N, enable_crcs=False, **COMPRESSIONS[layout]))
    damage(data)
    path = tmp_path / "log.mcap"
    path.write_bytes(bytes(data))
    with pytest.raises(InputError):
        read_all(path)
    loaded, log = read_all(path, recover=True)
    assert 0 < len(loaded["/fix"]) <= N
    assert log.faults.counts_by_reason()


def test_huge_counts_in_the_statistics_are_not_allocated(tmp_path: Path) -> None:
    data = bytearray(small_log(N, enable_crcs=False))
    for opcode, _, start, _ in list(records(bytes(data))):
        if opcode == 0x0B:
            struct.pack_into("<Q", data, start + 46 + 2, HUGE)  # messages of the first channel
    path = tmp_path / "log.mcap"
    path.write_bytes(bytes(data))
    loaded, _ = read_all(path)
    assert len(loaded["/fix"]) == N


def test_record_in_a_chunk_of_two_to_the_63_bytes_is_an_error(tmp_path: Path) -> None:
    data = bytearray(small_log(N, compression=CompressionType.NONE, enable_crcs=False))
    chunk = next(
        read_chunk(memoryview(bytes(data)), start, end)
        for opcode, _, start, end in records(bytes(data))
        if opcode == Opcode.CHUNK
    )
    at = chunk.data_start
    while data[at] != Opcode.MESSAGE:
        at += 9 + struct.unpack_from("<Q", data, at + 1)[0]
    struct.pack_into("<Q", data, at + 1, HUGE)
    path = tmp_path / "log.mcap"
    path.write_bytes(bytes(data))
    with pytest.raises(InputError, match="record"):
        read_all(path)
    loaded, _ = read_all(path, recover=True)
    assert 0 < len(loaded["/fix"]) < N


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"", "empty"),
        (b"\x89MCAP0\r\n", "header is damaged"),
        (b"nothing of the kind", "not an MCAP file"),
        (b"SQLite format 3\0", "SQLite can't read it: file is not a database"),
        (b"\x89MCAP0\r\n" * 2, "header is damaged"),
    ],
)
def test_no_log_at_all(tmp_path: Path, content: bytes, what: str) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(content)
    with pytest.raises(InputError, match=what):
        Log.open(path)
    with pytest.raises(InputError):
        Log.open(path, recover=True)


def test_missing_file_and_directory(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        Log.open(tmp_path / "nothing.mcap")
    with pytest.raises(InputError, match="the folder holds no log"):
        Log.open(tmp_path)


def test_unknown_compression_is_named(tmp_path: Path) -> None:
    data = small_log(N, enable_crcs=False).replace(b"\x04\0\0\0zstd", b"\x04\0\0\0snap")
    path = tmp_path / "log.mcap"
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"'snap' is unknown \(known: zstd, lz4\)"):
        read_all(path)
    with pytest.raises(InputError, match="nothing"):
        read_all(path, recover=True)


def test_message_index_that_is_missing_costs_no_message_where_no_summary_counts(tmp_path: Path) -> None:
    data = small_log(N)
    indexes = [(at, end) for opcode, at, _, end in records(data) if opcode == Opcode.MESSAGE_INDEX]
    end = next(end for opcode, _, _, end in records(data) if opcode == Opcode.DATA_END)
    footer = record_bytes.encode_footer(0, 0, b"") + MCAP_MAGIC
    path = tmp_path / "log.mcap"
    for start, stop in indexes[1:4]:
        path.write_bytes(data[:start] + data[stop:end] + footer)
        for topic in ("/fix", "/notes"):
            with Log.open(path) as log:
                assert len(log.columns(topic)) == N


@pytest.mark.parametrize("opcode", [Opcode.DATA_END, Opcode.FOOTER])
def test_end_record_amid_the_data_is_damage(tmp_path: Path, opcode: int) -> None:
    """One damaged byte: a message index behind the second chunk has become the end of the data, or of the file."""
    data = small_log(N)
    at = [at for kind, at, _, _ in records(data) if kind == Opcode.MESSAGE_INDEX][2]
    end = next(end for kind, _, _, end in records(data) if kind == Opcode.DATA_END)
    path = tmp_path / "log.mcap"
    path.write_bytes(
        data[:at] + bytes([opcode]) + data[at + 1 : end] + record_bytes.encode_footer(0, 0, b"") + MCAP_MAGIC
    )
    with pytest.raises(InputError, match=f"damaged at byte {at}"):
        read_all(path)
    assert latitudes(read_all(path, recover=True)[0]) == [48.0 + k for k in range(N)]


def test_chunk_that_declares_no_content_is_damage(tmp_path: Path) -> None:
    data = small_log(N)
    start = [start for kind, _, start, _ in records(data) if kind == Opcode.CHUNK][1]
    end = next(end for kind, _, _, end in records(data) if kind == Opcode.DATA_END)
    path = tmp_path / "log.mcap"
    changed = data[: start + 16] + bytes(8) + data[start + 24 : end]
    path.write_bytes(changed + record_bytes.encode_footer(0, 0, b"") + MCAP_MAGIC)
    with pytest.raises(InputError, match="instead of the declared 0"):
        read_all(path)
    loaded, log = read_all(path, recover=True)
    assert 0 < len(loaded["/fix"]) < N
    assert log.faults.chunks_lost == 1
