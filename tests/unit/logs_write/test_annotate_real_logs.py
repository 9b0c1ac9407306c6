"""Annotating logs that other libraries wrote (foxglove-sdk, mcap-ros2-support): those in ../shared/logs."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader

from cwcli.logs.write.annotate import annotate_log
from cwcli.signals.columns import OutputChannel
from tests.unit.logs_write.builders import source_stub, state_channel

LOGS = sorted((Path(__file__).parents[4] / "shared" / "logs").glob("*.mcap"))
STATE = "/cwcli/ego/state"

pytestmark = pytest.mark.skipif(not LOGS, reason="the development logs in ../shared/logs are not there")


def digests(path: Path) -> dict[str, tuple[int, str]]:
    """Topic -> number and hash of its messages in file order, read from front to back with every CRC checked."""
    hashes: dict[str, tuple[int, hashlib._Hash]] = {}
    with path.open("rb") as stream:
        for schema, channel, message in NonSeekingReader(stream, validate_crcs=True).iter_messages(
            log_time_order=False
        ):
            count, digest = hashes.get(channel.topic, (0, hashlib.sha256()))
            about = f"{schema} {channel.message_encoding} {channel.metadata} " if count == 0 else ""
            digest.update(
                f"{about}{message.log_time} {message.publish_time} {message.sequence} ".encode() + message.data
            )
            hashes[channel.topic] = (count + 1, digest)
    return {topic: (count, digest.hexdigest()) for topic, (count, digest) in hashes.items()}


def chunk_hashes(path: Path) -> list[str]:
    with path.open("rb") as stream:
        records = StreamReader(stream, emit_chunks=True).records
        return [hashlib.sha256(record.data).hexdigest() for record in records if isinstance(record, Chunk)]


@pytest.mark.parametrize("source", LOGS, ids=lambda path: path.name)
def test_real_log_is_untouched(tmp_path: Path, source: Path) -> None:
    with source.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None and summary.statistics is not None
    span = (summary.statistics.message_start_time, summary.statistics.message_end_time)
    template = state_channel(n=500)
    times = np.linspace(*span, 500).astype(np.int64)
    channel = OutputChannel(STATE, template.schema_name, times, template.fields)
    target = tmp_path / "out.mcap"
    annotate_log(source_stub(source), [channel], {"cwcli.run.estimate": {"a": "b"}}, target)
    before, after = digests(source), digests(target)
    assert after.pop(STATE)[0] == 500
    assert after == before
    kept = set(chunk_hashes(source))
    assert [each for each in chunk_hashes(target) if each in kept] == chunk_hashes(source)
    with target.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert sum(1 for _ in reader.iter_messages()) == 500 + summary.statistics.message_count
        names = [record.name for record in reader.iter_metadata()]
    assert names == ["provenance", "cwcli.run.estimate"]
