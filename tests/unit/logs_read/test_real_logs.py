"""Columns against the official decoders, on every development log."""

from __future__ import annotations

from pathlib import Path

import pytest
from mcap.reader import make_reader

from cwcli.logs.read.frames import is_camera_channel
from cwcli.logs.read.reader import Log
from tests.unit.logs_read.official import SHARED_LOGS, assert_same, read_officially

LOGS = sorted(SHARED_LOGS.glob("*.mcap"))
pytestmark = pytest.mark.skipif(not LOGS, reason="the development logs in ../shared/logs are not there")


@pytest.mark.parametrize("path", LOGS, ids=lambda path: path.stem)
def test_columns_equal_the_official_decoders(path: Path) -> None:
    official = read_officially(path.read_bytes())
    with Log.open(path) as log:
        loaded = log.load_topics({channel.topic: None for channel in log.channels})
        assert set(loaded) == set(official)
        for topic, columns in loaded.items():
            assert_same(columns, official[topic])
        assert log.faults.counts_by_reason() == {}
        assert log.n_messages == sum(len(each.messages) for each in official.values())


@pytest.mark.parametrize("path", LOGS, ids=lambda path: path.stem)
def test_frames_equal_the_official_decoders(path: Path) -> None:
    with Log.open(path) as log:
        cameras = [channel for channel in log.channels if is_camera_channel(channel)]
        official = read_officially(path.read_bytes()) if cameras else {}
        for channel in cameras:
            messages = official[channel.topic].messages
            frames = list(log.frames(channel.topic))
            assert [bytes(frame.data) for frame in frames] == [message.data for message in messages]
            assert [frame.format for frame in frames] == [message.format for message in messages]
            assert [frame.log_time_ns for frame in frames] == official[channel.topic].log_time_ns
            assert [frame.stamp_ns for frame in frames] == [message.timestamp.ToNanoseconds() for message in messages]
            assert [frame.frame_id for frame in frames] == [message.frame_id for message in messages]


@pytest.mark.parametrize("path", LOGS, ids=lambda path: path.stem)
def test_listing_equals_the_official_summary(path: Path) -> None:
    with path.open("rb") as file:
        reader = make_reader(file)
        summary, header = reader.get_summary(), reader.get_header()
        metadata = [(record.name, record.metadata) for record in reader.iter_metadata()]
    assert summary is not None and summary.statistics is not None
    with Log.open(path) as log:
        assert (log.profile, log.library) == (header.profile, header.library)
        assert (log.start_ns, log.end_ns) == (
            summary.statistics.message_start_time,
            summary.statistics.message_end_time,
        )
        assert log.n_chunks == summary.statistics.chunk_count
        assert {each.id: (each.topic, each.message_count) for each in log.channels} == {
            each.id: (each.topic, summary.statistics.channel_message_counts[each.id])
            for each in summary.channels.values()
        }
        assert [(name, dict(values)) for name, values in log.metadata] == metadata
