"""Annotating damaged logs: refused in one line, or copied as far as they are intact. Never a partial file."""

from __future__ import annotations

import signal
import subprocess
import sys
import tracemalloc
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import ChunkIndex
from mcap.writer import CompressionType, IndexType, Writer

from cwcli.errors import InputError
from cwcli.logs.format.chunks import CHUNK_CRC_OFFSET_BYTES
from cwcli.logs.write.annotate import annotate_log
from tests.unit.logs_write.builders import read_content, source_stub, state_channel, write_log

STATE = "/cwcli/ego/state"
UNLISTED: dict[str, dict[str, Any]] = {
    "no chunk index": {"index_types": IndexType.MESSAGE | IndexType.ATTACHMENT | IndexType.METADATA},
    "no statistics": {"use_statistics": False},
    "no channels in the summary": {"repeat_channels": False, "repeat_schemas": False},
}
"""Message indexes stand behind the chunks, and the summary leaves something out."""
Rows = Mapping[str, list[tuple[str, int, int, int, bytes]]]


def chunk_indexes(path: Path) -> list[ChunkIndex]:
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    return summary.chunk_indexes


def flip(path: Path, at: int) -> None:
    data = bytearray(path.read_bytes())
    data[at] ^= 0x40
    path.write_bytes(data)


def is_part(found: Rows, whole: Rows) -> bool:
    """Whether every found message is one of the whole log's, each at most once."""
    return all(set(rows) <= set(whole[topic]) and len(rows) == len(set(rows)) for topic, rows in found.items())


@pytest.mark.parametrize("options", [{}, {"compression": CompressionType.LZ4}, {"chunked": False}])
def test_cut_at_any_byte(tmp_path: Path, options: dict[str, Any]) -> None:
    source = write_log(tmp_path / "in.mcap", chunk_size=20_000, **options)
    whole, data = read_content(source), source.read_bytes()
    summary_start = int.from_bytes(data[-28:-20], "little")
    cut = tmp_path / "cut.mcap"
    counts = []
    for length in np.linspace(0, len(data) - 1, 60).astype(int).tolist():
        cut.write_bytes(data[:length])
        if length < summary_start:
            with pytest.raises(InputError):
                annotate_log(source_stub(cut), [state_channel()], {}, tmp_path / "out.mcap")
            assert not (tmp_path / "out.mcap").exists()
        if length < 100:
            continue
        annotate_log(source_stub(cut, recover=True), [state_channel()], {}, tmp_path / "out.mcap", force=True)
        content = read_content(tmp_path / "out.mcap")
        assert is_part(content.without(STATE), whole.messages)
        assert len(content.messages[STATE]) == 300
        counts.append(sum(map(len, content.without(STATE).values())))
        (tmp_path / "out.mcap").unlink()
    assert counts == sorted(counts)
    assert counts[-1] == 440
    if options == {"chunked": False}:
        # Loose messages can be read up to the cut: as much is left of them as of the file.
        expected = np.linspace(0, 440, 60)[-len(counts) :]
        assert np.abs(np.array(counts) - expected).max() < 25


def test_cut_chunk_gives_its_first_messages(tmp_path: Path) -> None:
    source = write_log(tmp_path / "in.mcap", chunk_size=1 << 20, compression=CompressionType.NONE)
    data = source.read_bytes()
    (chunk,) = chunk_indexes(source)[:1]
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: chunk.chunk_start_offset + chunk.chunk_length // 2])
    report = annotate_log(source_stub(cut, recover=True), [], {}, tmp_path / "out.mcap")
    content = read_content(tmp_path / "out.mcap")
    imu = content.messages["/imu"]
    assert imu == read_content(source).messages["/imu"][: len(imu)]
    assert report.n_messages_copied == sum(map(len, content.messages.values())) > 50
    assert report.n_bytes_lost > 0


def test_damaged_chunk_is_left_out(tmp_path: Path) -> None:
    source = write_log(tmp_path / "in.mcap")
    whole = read_content(source)
    bad = chunk_indexes(source)[3]
    flip(source, bad.chunk_start_offset + bad.chunk_length - 20)
    report = annotate_log(source_stub(source, recover=True), [state_channel()], {}, tmp_path / "out.mcap")
    content = read_content(tmp_path / "out.mcap")
    assert is_part(content.without(STATE), whole.messages)
    lost = [
        row
        for topic, rows in whole.messages.items()
        for row in rows
        if bad.message_start_time <= row[1] <= bad.message_end_time
    ]
    assert report.n_messages_copied == 440 - len(lost)
    assert report.n_chunks_lost == 1
    assert report.n_bytes_lost >= bad.chunk_length


@pytest.mark.parametrize("compression", CompressionType)
def test_damaged_length_of_a_chunk(tmp_path: Path, compression: CompressionType) -> None:
    """The third chunk claims to reach beyond the file: its records are saved, the summary leads to those behind it."""
    source = write_log(tmp_path / "in.mcap", compression=compression)
    whole = read_content(source)
    chunks = chunk_indexes(source)
    flip(source, chunks[2].chunk_start_offset + 7)
    with pytest.raises(InputError, match="damaged at byte"):
        annotate_log(source_stub(source), [], {}, tmp_path / "out.mcap")
    annotate_log(source_stub(source, recover=True), [state_channel()], {}, tmp_path / "out.mcap")
    assert read_content(tmp_path / "out.mcap").without(STATE) == whole.messages


def declare_size(path: Path, chunk: ChunkIndex, n_bytes: int) -> None:
    """Make a chunk's header say that so many bytes come out of it."""
    data = bytearray(path.read_bytes())
    at = chunk.chunk_start_offset + 9 + 16
    data[at : at + 8] = n_bytes.to_bytes(8, "little")
    path.write_bytes(data)


@pytest.mark.parametrize("compression", CompressionType)
@pytest.mark.parametrize("n_bytes", [1 << 63, (4 << 30) + 1, 1 << 32, 0])
def test_declared_size_of_a_chunk_is_not_believed(tmp_path: Path, compression: CompressionType, n_bytes: int) -> None:
    source = write_log(tmp_path / "in.mcap", compression=compression)
    whole = read_content(source)
    declare_size(source, chunk_indexes(source)[2], n_bytes)
    tracemalloc.start()
    report = annotate_log(source_stub(source, recover=True), [state_channel()], {}, tmp_path / "out.mcap")
    peak_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak_bytes < 10_000_000
    assert report.n_chunks_lost == 1
    assert is_part(read_content(tmp_path / "out.mcap").without(STATE), whole.messages)


@pytest.mark.parametrize("compression", [CompressionType.LZ4, CompressionType.ZSTD])
def test_a_chunk_that_holds_more_than_it_declares_is_not_unpacked(tmp_path: Path, compression: CompressionType) -> None:
    source = tmp_path / "in.mcap"
    with source.open("wb") as stream:
        writer = Writer(stream, compression=compression)
        writer.start()
        channel = writer.register_channel("/zeros", "json", 0)
        writer.add_message(channel, 1, bytes(64 << 20), 1)
        writer.finish()
    declare_size(source, chunk_indexes(source)[0], 1000)
    tracemalloc.start()
    report = annotate_log(source_stub(source, recover=True), [], {}, tmp_path / "out.mcap")
    peak_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert report.n_chunks_lost == 1
    assert peak_bytes < 8 << 20


@pytest.mark.parametrize("options", UNLISTED.values(), ids=UNLISTED)
def test_damaged_chunk_of_a_log_without_an_index_is_not_copied(tmp_path: Path, options: dict[str, Any]) -> None:
    """Nobody has read the chunk: the copy must not be the first to pass it over."""
    bad = chunk_indexes(write_log(tmp_path / "listed.mcap"))[3]
    whole = write_log(tmp_path / "whole.mcap", **options)
    assert annotate_log(source_stub(whole), [], {}, tmp_path / "copy.mcap").n_messages_copied == 440
    source = write_log(tmp_path / "in.mcap", **options)
    flip(source, bad.chunk_start_offset + CHUNK_CRC_OFFSET_BYTES)
    with pytest.raises(InputError, match=f"damaged at byte {bad.chunk_start_offset}: a chunk's CRC is wrong"):
        annotate_log(source_stub(source), [], {}, tmp_path / "out.mcap")
    assert not (tmp_path / "out.mcap").exists()


def test_damaged_message_index_is_written_anew(tmp_path: Path) -> None:
    source = write_log(tmp_path / "in.mcap")
    whole = read_content(source)
    chunk = chunk_indexes(source)[1]
    flip(source, chunk.message_index_offsets[1] + 9 + 6 + 3)
    annotate_log(source_stub(source, recover=True), [state_channel()], {}, tmp_path / "out.mcap")
    assert read_content(tmp_path / "out.mcap").without(STATE) == whole.messages
    index = chunk_indexes(tmp_path / "out.mcap")[1]
    data = (tmp_path / "out.mcap").read_bytes()
    first_time = data[index.message_index_offsets[1] + 15 : index.message_index_offsets[1] + 23]
    assert int.from_bytes(first_time, "little") == index.message_start_time


def test_damaged_time_of_a_chunk_is_written_anew(tmp_path: Path) -> None:
    source = write_log(tmp_path / "in.mcap")
    chunks = chunk_indexes(source)
    flip(source, chunks[1].chunk_start_offset + 9 + 15)
    annotate_log(source_stub(source, recover=True), [], {}, tmp_path / "out.mcap")
    assert chunk_indexes(tmp_path / "out.mcap")[1].message_end_time == chunks[1].message_end_time


@pytest.mark.parametrize("recover", [True, False])
def test_damaged_summary_is_not_believed(tmp_path: Path, recover: bool) -> None:
    """The data section is whole, so nothing is lost either way."""
    source = write_log(tmp_path / "in.mcap")
    whole = read_content(source)
    start = int.from_bytes(source.read_bytes()[-28:-20], "little")
    flip(source, start + 30)
    annotate_log(source_stub(source, recover=recover), [state_channel()], {}, tmp_path / "out.mcap")
    assert read_content(tmp_path / "out.mcap").without(STATE) == whole.messages


def test_damaged_attachment_is_left_out(tmp_path: Path) -> None:
    source = write_log(tmp_path / "in.mcap")
    flip(source, source.read_bytes().index(b"hello"))
    report = annotate_log(source_stub(source, recover=True), [], {}, tmp_path / "out.mcap")
    assert read_content(tmp_path / "out.mcap").attachments == []
    assert report.n_messages_copied == 440


@pytest.mark.parametrize(
    "content", [b"", b"not an mcap file", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n\x01" + b"\xff" * 7 + b"\x7f"]
)
@pytest.mark.parametrize("recover", [True, False])
def test_no_log_at_all(tmp_path: Path, content: bytes, recover: bool) -> None:
    source = tmp_path / "in.mcap"
    source.write_bytes(content)
    if recover and content.startswith(b"\x89MCAP0"):
        annotate_log(source_stub(source, recover=True), [], {}, tmp_path / "out.mcap")
        assert read_content(tmp_path / "out.mcap").messages == {}
        return
    with pytest.raises(InputError) as caught:
        annotate_log(source_stub(source, recover=recover), [], {}, tmp_path / "out.mcap")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out.mcap").exists()


def test_random_flips_never_crash(tmp_path: Path) -> None:
    """Whatever bit flips, the answer is an `InputError` or a file that the official reader reads in full."""
    source = write_log(tmp_path / "in.mcap", chunk_size=20_000)
    data, whole = source.read_bytes(), read_content(source).messages
    rng = np.random.default_rng(3)
    damaged = tmp_path / "bad.mcap"
    for at in rng.integers(0, len(data), 150).tolist():
        damaged.write_bytes(data)
        flip(damaged, at)
        try:
            annotate_log(
                source_stub(damaged, recover=True), [state_channel(n=5)], {}, tmp_path / "out.mcap", force=True
            )
        except InputError:
            assert at < 8
            continue
        found = read_content(tmp_path / "out.mcap").without(STATE)
        assert sum(map(len, found.values())) > 0
        assert {row[4] for rows in found.values() for row in rows} <= {
            row[4] for rows in whole.values() for row in rows
        }


def test_killed_annotation_leaves_no_file(tmp_path: Path) -> None:
    source = write_log(tmp_path / "in.mcap")
    code = (
        "import os, signal, sys\n"
        "import cwcli.logs.write.record_writer as record_writer\n"
        "from pathlib import Path\n"
        "from cwcli.logs.write.annotate import annotate_log\n"
        "from tests.unit.logs_write.builders import source_stub, state_channel\n"
        "record_writer.RecordWriter.write_summary_and_footer = lambda self: os.kill(os.getpid(), signal.SIGKILL)\n"
        "annotate_log(source_stub(Path(sys.argv[1])), [state_channel()], {}, sys.argv[2])\n"
    )
    target = tmp_path / "out.mcap"
    run = subprocess.run(
        [sys.executable, "-c", code, str(source), str(target)], cwd=Path(__file__).parents[3], timeout=600, check=False
    )
    assert run.returncode == -signal.SIGKILL
    assert not target.exists()


def test_to_standard_output(tmp_path: Path) -> None:
    source = write_log(tmp_path / "in.mcap")
    code = (
        "import sys\n"
        "from pathlib import Path\n"
        "from cwcli.logs.write.annotate import annotate_log\n"
        "from tests.unit.logs_write.builders import source_stub, state_channel\n"
        "annotate_log(source_stub(Path(sys.argv[1])), [state_channel()], {}, '-')\n"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, str(source)],
        cwd=Path(__file__).parents[3],
        timeout=600,
        check=True,
        capture_output=True,
    )
    annotate_log(source_stub(source), [state_channel()], {}, tmp_path / "out.mcap")
    assert run.stdout == (tmp_path / "out.mcap").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.mcap", "out.mcap"]
