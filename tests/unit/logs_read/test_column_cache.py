"""Columns that are asked for twice are decoded once, within bounds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cwcli.logs.read import reader
from cwcli.logs.read.reader import Log
from cwcli.signals.columns import OutputChannel

LOG = Path(__file__).parents[3] / "sample_logs/straight.mcap"
TOPIC = "/cwcli/test/speed"


def a_topic(log: Log) -> str:
    return max(log.channels, key=lambda channel: channel.message_count or 0).topic


def test_a_later_stage_gets_the_same_columns() -> None:
    with Log.open(LOG) as log:
        topic = a_topic(log)
        first = log.columns(topic, ["header.stamp.sec"])
        later = log.with_channels([]).load_topics({topic: ("header.stamp.sec",)})[topic]
        assert later is first
        assert log.columns(topic, []) is not first  # of other fields more or fewer messages may be readable
        assert log.columns(topic) is not log.columns(topic)


def test_long_topics_are_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reader, "MAX_CACHED_ROWS", 10)
    with Log.open(LOG) as log:
        topic = a_topic(log)
        assert log.columns(topic, []) is not log.columns(topic, [])


def test_a_channel_in_memory_is_not_mistaken_for_another() -> None:
    def channel(speed_mps: float) -> OutputChannel:
        return OutputChannel(TOPIC, "cwcli.v1.VehicleState", np.array([1, 2]), {"speed_mps": np.full(2, speed_mps)})

    with Log.open(LOG) as log:
        one = log.with_channels([channel(1.0)])
        other = one.with_channels([channel(2.0)])
        for _ in range(2):
            assert np.asarray(one.columns(TOPIC).fields["speed_mps"]).tolist() == [1.0, 1.0]
            assert np.asarray(other.columns(TOPIC).fields["speed_mps"]).tolist() == [2.0, 2.0]
        assert one.columns(TOPIC) is one.columns(TOPIC)
