"""What doubts are found in: the records of the stages and the ego's states, in memory or from an annotated log."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import field
from functools import cached_property
from typing import Any

import numpy as np

from cwcli.channels.published import EGO_STATE
from cwcli.channels.vehicle_state import KINEMATIC_AND_FLAG_FIELDS, VehicleStates, read_vehicle_states
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.pipeline.records import (
    Record,
    RecordedSummary,
    parse_json_entry_or_empty,
    read_recorded_summary,
    read_run_records,
)
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import EGO_ID, StateFlag
from cwcli.text import shorten_and_escape

MAX_TOPIC_CHARACTERS = 60
"""Greatest length of a topic's name in a sentence, in characters; chosen by hand."""


SOURCE_PATTERN = r"\b(?:ego_([a-z]+)|imu(?: ([a-z ]+))?) \(([^()]+)\)"
"""A source in a sentence of the estimator (`cwcli.estimation.contradiction.SourceQuantity`): role, quantity, topic."""


@dataclass(frozen=True)
class DoubtEvidence:
    """What is known of a log.

    Attributes:
        records: Stage -> its metadata record. It may come from anybody: what does not fit is ignored.
        ego: The ego's states, None where there are none.
        start_ns: First log time, from which sentences count the seconds.
        faults: What is wrong with the file itself -> how often.
    """

    records: Mapping[str, Record]
    ego: VehicleStates | None = None
    start_ns: int = 0
    end_ns: int = 0
    faults: Mapping[str, int] = field(default_factory=dict)

    @cached_property
    def estimate_summary(self) -> RecordedSummary:
        """The summary of `estimate`."""
        return self.summary_of_stage("estimate")

    @cached_property
    def ego_sources(self) -> tuple[dict[str, Any], ...]:
        """The diagnostics of the ego's sources (`estimation.summary.format_source_diagnostics_json`)."""
        found = parse_json_entry_or_empty(self.records.get("estimate", {}), "sources", list)
        return tuple(each for each in found if isinstance(each, dict) and each.get("vehicle") == EGO_ID)

    @cached_property
    def is_part(self) -> bool:
        """Whether the log holds only a part of the states that were estimated, as after `cwcli cut`."""
        rows = self.estimate_summary.rows_of_table_columns_or_empty("vehicles", "vehicle", "states")
        n_estimated = next((n for vehicle, n in rows if vehicle == EGO_ID), None)
        return self.ego is not None and isinstance(n_estimated, int) and len(self.ego) < n_estimated

    def has_state_flagged(self, flag: StateFlag) -> bool:
        """Tell whether a state of the ego has a flag."""
        return self.ego is not None and bool((self.ego.flags & np.uint8(flag)).any())

    def summary_of_stage(self, stage: str) -> RecordedSummary:
        """Return the summary in the record of a stage; an empty one without a record."""
        return read_recorded_summary(self.records.get(stage, {}))

    def may_hold_stamp(self, stamp_ns: float) -> bool:
        """Tell whether the log may hold this stamp: it lies between its states, or is not known."""
        if self.ego is None or not len(self.ego) or not math.isfinite(stamp_ns):
            return True
        first_ns, last_ns = int(self.ego.stamp_ns.min()), int(self.ego.stamp_ns.max())
        return first_ns - NS_PER_S <= stamp_ns <= last_ns + NS_PER_S

    def seconds_since_start(self, stamp_ns: float) -> float:
        """Return the seconds from the log's start to a stamp."""
        return (stamp_ns - self.start_ns) / NS_PER_S


def read_evidence(log: Log) -> DoubtEvidence:
    """Read what is known of a log, on disk or in memory.

    Raises:
        InputError: The log is damaged.
        DataError: The ego's states were written by another version.
    """
    ego = None
    if any(channel.topic == EGO_STATE.topic for channel in log.channels):
        columns = log.columns(EGO_STATE.topic, KINEMATIC_AND_FLAG_FIELDS)
        ego = read_vehicle_states(columns, with_covariance=False) if len(columns) else None
    return DoubtEvidence(read_run_records(log), ego, log.start_ns, log.end_ns, log.faults.counts_by_reason())


def name_sources_in_words(sentence: str) -> str:
    """Return a sentence of the estimator with `the speed in /wheel` for `ego_speed (/wheel)`, as a whole sentence."""

    def words(found: re.Match[str]) -> str:
        quantity = found[1] or found[2] or "IMU"
        return f"the {'acceleration' if quantity == 'accel' else quantity} in {found[3]}"

    text = re.sub(SOURCE_PATTERN, words, shorten_and_escape(sentence).rstrip("."))
    return f"{text[:1].upper()}{text[1:]}."


def source_name(entry: Mapping[str, Any]) -> str:
    """Return `/gps/fix position` for the diagnostics of a source."""
    topic = shorten_and_escape(str(entry.get("source", "")), MAX_TOPIC_CHARACTERS)
    return f"{topic} {str(entry.get('quantity', '')).replace('_', ' ')}".strip()
