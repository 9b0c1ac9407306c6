"""The metadata records `cwcli.run.<stage>`, read back: how a log was annotated."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from cwcli.logs.log import Log

PREFIX = "cwcli.run."


def run_records(log: Log) -> dict[str, Mapping[str, str]]:
    """Stage -> its record, the last one of each."""
    return {name.removeprefix(PREFIX): entries for name, entries in log.metadata if name.startswith(PREFIX)}


def json_entry(record: Mapping[str, str], key: str, kind: type) -> Any:
    """An entry that holds JSON of a kind (`dict` or `list`); an empty one where it is missing, broken or another."""
    try:
        value = json.loads(record.get(key, ""))
    except (ValueError, RecursionError):
        return kind()
    return value if isinstance(value, kind) else kind()


def number(entries: Mapping[str, Any], key: str) -> float:
    """A number of a JSON object; NaN where there is none."""
    value = entries.get(key)
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else float("nan")
