"""Logs with JSON messages in a file and channels in memory, and the headline metrics of them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mcap.writer import Writer

from cwcli.evaluation.evaluate_log import evaluate_log
from cwcli.logs.read.reader import Log
from cwcli.metrics.pooling import metric_rows_by_name
from cwcli.signals.columns import OutputChannel

T0_NS = 1_700_000_000_000_000_000
Records = Mapping[str, Mapping[str, str]]


def log_of(path: Path, channels: list[OutputChannel], records: Records | None = None, /, **json_topics: Any) -> Log:
    """A log with channels in memory, on top of a file with JSON messages: topic -> (stamp, message)s."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("Any", "jsonschema", b"{}")
        for topic, messages in {"/clock": [(T0_NS, {}), (T0_NS + 5 * 10**9, {})], **json_topics}.items():
            channel = writer.register_channel(topic, "json", schema)
            for stamp_ns, message in messages:
                writer.add_message(channel, stamp_ns, json.dumps(message).encode(), stamp_ns)
        writer.finish()
    return Log.open(path).with_channels(channels, records)


def values(log: Log, **settings: Any) -> dict[str, float]:
    return {name: row.value for name, row in metric_rows_by_name(evaluate_log(log, **settings)).items()}
