"""Chunks that unpack to far more than they are: refused by what they declare, or where it becomes too much."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import lz4.frame
import pytest
import zstandard

from cwcli.logs.format import record_bytes
from cwcli.logs.format.records import MCAP_MAGIC, RECORD_PREFIX, Channel, Schema
from cwcli.logs.read.reader import Log
from tests.cli.bounded import bounded
from tests.cli.conftest import SAMPLES

GIGABYTE = 1_000_000_000
MEGABYTE = 1_000_000
BLOCK = bytes(MEGABYTE)
T0_NS = 1_700_000_000_000_000_000
FIX = "/gps/fix"
DEFINITION = b"float64 latitude\nfloat64 longitude\nfloat64 altitude\n"


def zstd_of_zeros(n_bytes: int, *, tells_size: bool = True) -> bytes:
    """A frame that unpacks to so many zeros, about 30,000 times smaller."""
    packer = zstandard.ZstdCompressor(level=1).compressobj(size=n_bytes if tells_size else -1)
    return b"".join(packer.compress(BLOCK) for _ in range(n_bytes // MEGABYTE)) + packer.flush()


def lz4_of_zeros(n_bytes: int) -> bytes:
    """As `zstd_of_zeros`, 250 times smaller."""
    packer = lz4.frame.LZ4FrameCompressor()
    begin = packer.begin()
    return begin + b"".join(packer.compress(BLOCK) for _ in range(n_bytes // MEGABYTE)) + packer.flush()


def message(channel_id: int, log_time_ns: int, data: bytes) -> bytes:
    content = struct.pack("<HIQQ", channel_id, 0, log_time_ns, log_time_ns) + data
    return RECORD_PREFIX.pack(5, len(content)) + content


def good_chunk() -> bytes:
    """Fifty fixes in a chunk as it should be."""
    records = b"".join(
        message(1, T0_NS + k * 100_000_000, b"\0\1\0\0" + struct.pack("<3d", 48.0, 11.0, 500.0)) for k in range(50)
    )
    return chunk(records, "", len(records))


def chunk(stored: bytes, compression: str, declared: int) -> bytes:
    return record_bytes.encode_chunk_head(T0_NS, T0_NS + 5 * GIGABYTE, declared, 0, compression, len(stored)) + stored


def log_of(path: Path, *chunks: bytes, is_cut: bool = False) -> None:
    """A log without a summary: a channel of fixes, and chunks."""
    head = MCAP_MAGIC + record_bytes.encode_header("", "test")
    head += record_bytes.encode_record(Schema(1, "sensor_msgs/msg/NavSatFix", "ros2msg", DEFINITION))
    head += record_bytes.encode_record(Channel(1, 1, FIX, "cdr", {}))
    data = head + b"".join(chunks)
    path.write_bytes(
        data if is_cut else data + record_bytes.encode_data_end() + record_bytes.encode_footer(0, 0, b"") + MCAP_MAGIC
    )


BOMBS: dict[str, Callable[[], bytes]] = {
    "zstd that tells 4 GB": lambda: chunk(zstd_of_zeros(4 * GIGABYTE), "zstd", 4 * GIGABYTE),
    "zstd that tells too little": lambda: chunk(zstd_of_zeros(4 * GIGABYTE, tells_size=False), "zstd", 20 * MEGABYTE),
    "zstd whose frame tells more than its chunk": lambda: chunk(zstd_of_zeros(GIGABYTE), "zstd", 20 * MEGABYTE),
    "zstd that tells 1 GB and holds 20 MB": lambda: chunk(
        zstd_of_zeros(20 * MEGABYTE, tells_size=False), "zstd", GIGABYTE
    ),
    "lz4 that tells 2 GB": lambda: chunk(lz4_of_zeros(2 * GIGABYTE), "lz4", 2 * GIGABYTE),
    "lz4 that tells too little": lambda: chunk(lz4_of_zeros(2 * GIGABYTE), "lz4", 20 * MEGABYTE),
}


@pytest.mark.parametrize("name", BOMBS)
def test_bomb_is_refused_and_recover_reads_the_rest(tmp_path: Path, name: str) -> None:
    bomb = BOMBS[name]()
    log_of(tmp_path / "in.mcap", bomb, good_chunk(), bomb, bomb)
    ended = bounded(tmp_path, "estimate", "in.mcap", "-o", "out.mcap", most_mb=400)
    assert ended.code == 3
    assert ended.shown.startswith("error: in.mcap: damaged at byte ")
    assert [path.name for path in tmp_path.iterdir()] == ["in.mcap"]
    ended = bounded(tmp_path, "estimate", "in.mcap", "-o", "out.mcap", "--recover", most_mb=400)
    assert ended.code == 0, ended.shown
    assert "chunks lost: 3" in ended.shown
    with Log.open(tmp_path / "out.mcap") as log:
        assert len(log.columns(FIX)) == 50


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_bomb_that_is_cut(tmp_path: Path, compression: str) -> None:
    stored = zstd_of_zeros(10 * GIGABYTE) if compression == "zstd" else lz4_of_zeros(2 * GIGABYTE)
    bomb = chunk(stored, compression, 10 * GIGABYTE)
    log_of(tmp_path / "in.mcap", good_chunk(), bomb[:-20], is_cut=True)
    ended = bounded(tmp_path, "estimate", "in.mcap", "-o", "out.mcap", "--recover", most_mb=500)
    assert ended.code == 0, ended.shown
    assert "file cut short: 1" in ended.shown
    with Log.open(tmp_path / "out.mcap") as log:
        assert len(log.columns(FIX)) == 50


def test_max_chunk_moves_the_bound(tmp_path: Path) -> None:
    """A message of 300 MB in one chunk: refused with the option that reads it."""
    records = message(1, T0_NS, bytes(300 * MEGABYTE))
    packed = zstandard.ZstdCompressor(level=1).compress(records)
    log_of(tmp_path / "in.mcap", chunk(packed, "zstd", len(records)))
    with Log.open(SAMPLES / "straight.mcap") as log:
        assert log.file.max_chunk_bytes == 256 * MEGABYTE
    ended = bounded(tmp_path, "info", "in.mcap")
    assert ended.code == 3
    assert "a chunk holds 300 MB, more than the 256 MB that are allowed" in ended.shown
    assert "--max-chunk 301 reads it; --recover leaves the chunk out" in ended.shown
    assert bounded(tmp_path, "info", "in.mcap", "--max-chunk", "301", most_mb=700).code == 0
    assert bounded(tmp_path, "info", "in.mcap", "--max-chunk", "0").code == 2
