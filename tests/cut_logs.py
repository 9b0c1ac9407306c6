"""Cuts of logs, and what the stages make of them: nothing online may depend on a message that came later."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer

from cwcli.logs.read.reader import Log
from cwcli.logs.write.annotate import annotate
from cwcli.pipeline.call import Selection, StageCall
from cwcli.pipeline.execute import run_stages
from cwcli.pipeline.missing import SignalsFor
from cwcli.stages import STAGES

ONLINE_TOPICS = (
    "/cwcli/ego/online",
    "/cwcli/remote/online",
    "/cwcli/targets/online",
    "/cwcli/ego/path",
    "/cwcli/remote/path",
    "/cwcli/warnings",
)
Message = tuple[int, bytes]


@dataclass(frozen=True)
class Cut:
    """A cut and what it changed.

    Attributes:
        at_ns: Messages from this log time on were cut off.
        topic: Of the first message that changed.
        log_time_ns: Of that message.
        words: How it changed.
    """

    at_ns: int
    topic: str
    log_time_ns: int
    words: str


def cut_log(source: Path, at_ns: int, target: Path) -> None:
    """Write the messages that were logged before `at_ns`, and every channel, by the official library."""
    with source.open("rb") as stream, target.open("wb") as out:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None
        writer = Writer(out)
        header = reader.get_header()
        writer.start(profile=header.profile, library="")
        schemas = {
            key: writer.register_schema(schema.name, schema.encoding, schema.data)
            for key, schema in summary.schemas.items()
        }
        channels = {
            key: writer.register_channel(
                each.topic, each.message_encoding, schemas.get(each.schema_id, 0), each.metadata
            )
            for key, each in summary.channels.items()
        }
        for _, channel, message in reader.iter_messages(end_time=at_ns):
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time, message.sequence
            )
        writer.finish()


def online_messages(
    source: Path, configs: Mapping[str, Any], topics: Mapping[str, str], folder: Path
) -> dict[str, list[Message]]:
    """Topic -> (log time, payload) of each online message that the stages make of a log, in file order."""
    target = folder / "annotated.mcap"
    with Log.open(str(source)) as log:
        stages = {name: StageCall(STAGES[name], config) for name, config in configs.items()}
        ego_station = configs["estimate"].sources.ego_station if "estimate" in configs else None
        _, annotated = run_stages(
            log,
            stages,
            Selection(topics=topics),
            missing=SignalsFor(STAGES, ego_station),
            lenient=True,
            strict=False,
            step=lambda words: None,
        )
        annotate(annotated, (), {}, str(target), replace=True, force=True)
    found: dict[str, list[Message]] = {topic: [] for topic in ONLINE_TOPICS}
    with target.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages(topics=list(ONLINE_TOPICS)):
            found[channel.topic].append((message.log_time, message.data))
    return found


def first_change(whole: Mapping[str, list[Message]], cut: Mapping[str, list[Message]], at_ns: int) -> Cut | None:
    """The first message before the cut that it changed or took away; None: there is none."""
    changes = []
    for topic, messages in whole.items():
        before = [each for each in messages if each[0] < at_ns]
        after = cut.get(topic, [])
        for k, each in enumerate(before):
            if k >= len(after) or after[k] != each:
                words = (
                    "is not there"
                    if k >= len(after)
                    else "has another log time"
                    if after[k][1] == each[1]
                    else "is another"
                )
                changes.append(Cut(at_ns, topic, each[0], f"message {k} of {len(before)} {words}"))
                break
    return min(changes, key=lambda change: change.log_time_ns, default=None)


def cut_times(source: Path, n: int, rng: np.random.Generator) -> list[int]:
    """`n` moments of a log, by chance, in order."""
    with source.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None and summary.statistics is not None
    begin, end = summary.statistics.message_start_time, summary.statistics.message_end_time
    return sorted(int(begin + part * (end - begin)) for part in rng.random(n))
