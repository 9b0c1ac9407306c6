"""Chunks that are allowed each, and unpack to too much, or to too many messages, together."""

from __future__ import annotations

from pathlib import Path

import pytest
import zstandard

from cwcli.logs.read.reader import Log
from tests.cli.bounded import bounded
from tests.cli.test_hostile_chunks import FIX, MEGABYTE, T0_NS, chunk, good_chunk, log_of, message


def packed(records: bytes) -> bytes:
    return chunk(zstandard.compress(records), "zstd", len(records))


def test_chunks_together_are_bounded_by_the_size_of_the_log(tmp_path: Path) -> None:
    """Five of 60 MB in 10 kB: four are within one of 256 MB."""
    large = packed(message(1, T0_NS, bytes(60 * MEGABYTE)))
    log_of(tmp_path / "in.mcap", good_chunk(), *[large] * 5)
    ended = bounded(tmp_path, "estimate", "in.mcap", "-o", "out.mcap", most_mb=400)
    assert ended.code == 3
    assert "the chunks up to here hold more than 257 MB: one of 256 MB, and 64 times the file" in ended.shown
    assert "a larger --max-ratio reads it; --recover leaves such chunks out" in ended.shown
    assert [path.name for path in tmp_path.iterdir()] == ["in.mcap"]
    ended = bounded(tmp_path, "estimate", "in.mcap", "-o", "out.mcap", "--recover", most_mb=400)
    assert ended.code == 0, ended.shown
    assert "chunks lost: 1" in ended.shown
    ended = bounded(tmp_path, "estimate", "in.mcap", "-o", "out.mcap", "--max-ratio", "30000", "--force", most_mb=400)
    assert ended.code == 0, ended.shown
    assert "chunks lost" not in ended.shown


@pytest.mark.parametrize("n_chunks", [pytest.param(1, marks=pytest.mark.long), 8])
def test_messages_are_bounded_by_the_size_of_the_log(tmp_path: Path, n_chunks: int) -> None:
    """A million of 31 bytes, which compress to 4 kB. Each that is looked at costs 11 calls, and 26 with `--recover`."""
    many = packed(message(1, T0_NS, b"") * (1_000_000 // n_chunks))
    log_of(tmp_path / "in.mcap", good_chunk(), *[many] * n_chunks)
    for command in (["info", "in.mcap"], ["estimate", "in.mcap", "-o", "out.mcap"]):
        ended = bounded(tmp_path, *command, most_mb=400, most_calls=8_000_000)
        assert ended.code == 3
        assert "messages and more are in a file of" in ended.shown
        assert "a larger --max-ratio reads it" in ended.shown
    ended = bounded(tmp_path, "estimate", "in.mcap", "-o", "out.mcap", "--recover", most_mb=500, most_calls=18_000_000)
    assert ended.code == 0, ended.shown
    assert "chunks lost" in ended.shown
    with Log.open(tmp_path / "in.mcap", recover=True) as log:
        assert 50 <= len(log.columns(FIX)) < 600_000


def test_bound_is_that_of_each_part(tmp_path: Path) -> None:
    large = packed(message(1, T0_NS, bytes(60 * MEGABYTE)))
    log_of(tmp_path / "a.mcap", good_chunk())
    log_of(tmp_path / "b.mcap", *[large] * 5)
    ended = bounded(tmp_path, "info", "a.mcap", "b.mcap", "--as-one", most_mb=400)
    assert ended.code == 3
    assert "b.mcap: damaged at byte" in ended.shown
    assert bounded(tmp_path, "info", "a.mcap", "b.mcap", "--as-one", "--max-ratio", "30000", most_mb=400).code == 0
