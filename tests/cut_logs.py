"""Cuts of logs, and what the stages make of them: nothing online may depend on a message that came later."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer

from cwcli.channels.published import EGO_PATH, ONLINE_CHANNEL_OF_ROLE, REMOTE_PATH, WARNINGS
from cwcli.errors import CwcliError
from cwcli.estimation.calibration import Calibration
from cwcli.estimation.config import EstimatorConfig
from cwcli.logs.read.reader import Log
from cwcli.logs.write.annotate import annotate_log
from cwcli.pipeline.call import Selection, StageCall
from cwcli.pipeline.execute import SkipRules, run_stages
from cwcli.pipeline.missing import SignalCheck
from cwcli.stages import STAGES
from cwcli.stages.estimate import EstimateConfig
from cwcli.stages.inputs.sources import SourceConfig
from cwcli.stages.predict import PredictConfig
from cwcli.stages.track import TrackConfig
from cwcli.stages.warn import WarnConfig
from cwcli.stages.warn_targets import WarnTargetsConfig
from cwcli.tracking.config import FilterConfig, TrackerConfig

ONLINE_TOPICS = (
    *(channel.topic for channel in ONLINE_CHANNEL_OF_ROLE.values()),
    EGO_PATH.topic,
    REMOTE_PATH.topic,
    WARNINGS.topic,
)
Message = tuple[int, bytes]
Messages = Mapping[str, list[Message]]
"""Topic -> (log time, payload) of each online message, in file order."""


@dataclass(frozen=True)
class Change:
    """A message that a cut changed or took away, though it is older.

    Attributes:
        at_ns: Messages from this log time on were cut off.
        topic, log_time_ns: Of the message.
        words: How it changed.
    """

    at_ns: int
    topic: str
    log_time_ns: int
    words: str


def stages_of(
    calibration: Calibration | None = None, ego_station: str | None = None, *, blind: bool = True
) -> dict[str, Any]:
    """The stages that say something online, with the settings with which they know nothing of what comes.

    Args:
        calibration: Of the sensors; None: the stamps are trusted.
        ego_station: Station of the ego's own messages.
        blind: False: the defaults, with which parameters come from the whole log.
    """
    estimator = EstimatorConfig(latency="none" if calibration is None and blind else "auto")
    tracker = TrackerConfig(FilterConfig(tune=not blind))
    return {
        "estimate": EstimateConfig(SourceConfig(ego_station=ego_station), estimator, calibration=calibration),
        "track": TrackConfig(tracker=tracker, targets="many"),
        "predict": PredictConfig(),
        "warn": WarnConfig(),
        "warn-targets": WarnTargetsConfig(),
    }


def cut_log(source: Path, at_ns: int, target: Path) -> None:
    """Write the messages that were logged before `at_ns`, and every channel, by the official library."""
    with source.open("rb") as stream, target.open("wb") as out:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None
        writer = Writer(out)
        writer.start(profile=reader.get_header().profile, library="")
        schemas = {
            key: writer.register_schema(each.name, each.encoding, each.data) for key, each in summary.schemas.items()
        }
        channels = {
            key: writer.register_channel(
                each.topic, each.message_encoding, schemas.get(each.schema_id, 0), each.metadata
            )
            for key, each in summary.channels.items()
        }
        for _, channel, message in reader.iter_messages():
            if message.log_time >= at_ns:
                break
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time, message.sequence
            )
        writer.finish()


def online_messages(source: Path, stages: Mapping[str, Any], folder: Path) -> dict[str, list[Message]]:
    """What the stages make of a log, online; nothing where it has no signal for them (yet).

    Args:
        source: The log.
        stages: Name -> configuration.
        folder: For the annotated log.
    """
    found: dict[str, list[Message]] = {topic: [] for topic in ONLINE_TOPICS}
    target = folder / "annotated.mcap"
    with Log.open(str(source)) as log:
        calls = {name: StageCall(STAGES[name], config) for name, config in stages.items()}
        station = stages["estimate"].sources.ego_station
        try:
            _, annotated = run_stages(
                log,
                calls,
                Selection(),
                skip=SkipRules(SignalCheck(STAGES, station), True),
                strict=False,
                step=lambda words: None,
            )
        except CwcliError:
            return found
        annotate_log(annotated, (), {}, str(target), replace=True, force=True)
    with target.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages(topics=list(ONLINE_TOPICS)):
            found[channel.topic].append((message.log_time, message.data))
    return found


def first_change(whole: Messages, cut: Messages, at_ns: int) -> Change | None:
    """The first online message before the cut that it changed or took away; None: there is none."""
    changes = []
    for topic, messages in whole.items():
        before, after = [each for each in messages if each[0] < at_ns], cut[topic]
        for k, each in enumerate(before):
            if k >= len(after) or after[k] != each:
                words = "is not there" if k >= len(after) else "is another"
                changes.append(Change(at_ns, topic, each[0], f"message {k} of {len(before)} {words}"))
                break
    return min(changes, key=lambda change: change.log_time_ns, default=None)


def cut_times(source: Path, n: int, rng: np.random.Generator) -> list[int]:
    """`n` moments of a log, by chance, in order."""
    with source.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None and summary.statistics is not None
    begin, end = summary.statistics.message_start_time, summary.statistics.message_end_time
    return sorted(int(begin + part * (end - begin)) for part in rng.random(n))
