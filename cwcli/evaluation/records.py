"""Read the configuration of `estimate` and `warn` from their records, so that the evaluation uses the same."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, get_args

from cwcli.pipeline.records import Record, read_configuration, to_int_or_none
from cwcli.stages.inputs.sources import SourceConfig
from cwcli.warning.types import RemoteStateUse, WarningConfig


def source_config_from_record(record: Record) -> SourceConfig:
    """Return the configuration of the channels that `estimate` read."""
    recorded = read_configuration(record).get("sources")
    recorded = recorded if isinstance(recorded, dict) else {}
    topics, station = recorded.get("topics"), recorded.get("ego_station")
    return SourceConfig(
        topics={str(role): str(topic) for role, topic in topics.items()} if isinstance(topics, dict) else {},
        clock="log" if recorded.get("clock") == "log" else "stamp",
        ego_station=station if isinstance(station, str) else None,
        start_ns=to_int_or_none(recorded.get("start_ns")),
        end_ns=to_int_or_none(recorded.get("end_ns")),
    )


def find_collision_warning_record_and_is_of_targets(records: Mapping[str, Record]) -> tuple[Record, bool]:
    """Return the record of the collision warnings, and whether they concern tracked targets."""
    of_targets = "warn" not in records and "warn-targets" in records
    return records.get("warn-targets" if of_targets else "warn", {}), of_targets


def warning_config_from_record(record: Record) -> WarningConfig:
    """Return the configuration of `warn` with its thresholds; the defaults for what is missing or does not fit."""
    recorded = read_configuration(record).get("rule")
    recorded = recorded if isinstance(recorded, dict) else {}
    fitting: dict[str, Any] = {}
    for entry in fields(WarningConfig):
        value = recorded.get(entry.name)
        if isinstance(entry.default, str):
            is_fit = isinstance(value, str) and (entry.name != "use" or value in get_args(RemoteStateUse))
        else:
            is_fit = isinstance(value, int | float) and not isinstance(value, bool) and 0.0 <= value < math.inf
        if is_fit:
            fitting[entry.name] = value
    return WarningConfig(**fitting)
