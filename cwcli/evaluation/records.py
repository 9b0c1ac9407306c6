"""How `estimate` and `warn` were configured, from their records: so that a log is judged as it was made."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, get_args

from cwcli.pipeline.records import Record, configuration_of, number, whole
from cwcli.stages.inputs.sources import SourceConfig
from cwcli.warning.types import Use, WarningConfig

OLD_THRESHOLDS = {"ttc": ("<", "conflict_ttc_s"), "drac": (">", "conflict_drac_mps2")}
"""Where earlier versions recorded the threshold of a conflict by these measures."""


def sources_of(record: Record) -> SourceConfig:
    """Which channels `estimate` read, and how."""
    given = configuration_of(record).get("sources")
    given = given if isinstance(given, dict) else {}
    topics, station = given.get("topics"), given.get("ego_station")
    return SourceConfig(
        topics={str(role): str(topic) for role, topic in topics.items()} if isinstance(topics, dict) else {},
        clock="log" if given.get("clock") == "log" else "stamp",
        ego_station=station if isinstance(station, str) else None,
        start_ns=whole(given.get("start_ns")),
        end_ns=whole(given.get("end_ns")),
    )


def warn_record(records: Mapping[str, Record]) -> tuple[Record, bool]:
    """The record of the warnings of collisions, and whether they are of tracked targets."""
    of_targets = "warn" not in records and "warn-targets" in records
    record = records.get("warn-targets" if of_targets else "warn", {})
    return record, of_targets or configuration_of(record).get("source") == "targets"  # so in older logs


def rule_of(record: Record) -> WarningConfig:
    """The thresholds of `warn`."""
    given = configuration_of(record).get("rule")
    given = given if isinstance(given, dict) else {}
    fitting: dict[str, Any] = {}
    for entry in fields(WarningConfig):
        value = given.get(entry.name)
        if isinstance(entry.default, str):
            is_fit = isinstance(value, str) and (entry.name != "use" or value in get_args(Use))
        else:
            is_fit = isinstance(value, int | float) and not isinstance(value, bool) and 0.0 <= value < math.inf
        if is_fit:
            fitting[entry.name] = value
    sign, key = OLD_THRESHOLDS.get(fitting.get("conflict", ""), ("", ""))
    if math.isfinite(number(given, key)):
        fitting["conflict"] += f" {sign} {number(given, key)!r}"
    return WarningConfig(**fitting)
