"""What was set otherwise in another run: version, options, and the constants and the car that were read from files."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.pipeline.records import (
    VEHICLE_RECORD_KEY,
    Record,
    parse_json_entry_or_empty,
    read_configuration,
    read_run_records,
)
from cwcli.toml_text import parse_toml

CALIBRATION_KEY = "calibration"
"""Entry of a run's record that holds the calibration file, and the name under which its constants are listed."""
CONFIGURATION_KEYS_COMPARED_AS_WHOLE = ("topics",)
"""Entries of a configuration that are compared as a whole."""
COMPARED_KEYS_OF_CALIBRATED_CONSTANT = ("status", "value", "sigma", "spread")
"""Entries of a constant in a calibration file that the stages use; the others are information."""


@dataclass(frozen=True)
class SettingChange:
    """A setting of a stage that differs between two runs.

    Attributes:
        name: `version`, or the dotted name in its configuration, `estimator.gate_probability`, in the calibration file,
            `calibration./imu.yaw_rate.bias.value`, or in the file of the car, `vehicle.mass_kg`.
        before, after: Its values as JSON; "" where a run has none.
    """

    stage: str
    name: str
    before: str
    after: str


def compare_settings(before: Log, after: Log) -> Iterator[SettingChange]:
    """Yield the settings that differ, stage by stage; a constant that several stages read is of the first of them."""
    early, late = read_run_records(before), read_run_records(after)
    named: set[tuple[str, str, str]] = set()
    for stage in dict.fromkeys((*early, *late)):
        records = early.get(stage, {}), late.get(stage, {})
        with_constants = all(CALIBRATION_KEY in record for record in records)
        settings = [_read_settings(record, with_constants=with_constants) for record in records]
        for change in iter_changed_values(settings[0], settings[1]):
            if change not in named:
                yield SettingChange(stage, *change)
            if change[0].startswith(CALIBRATION_KEY):
                named.add(change)


def iter_changed_values(
    before: Mapping[str, Any], after: Mapping[str, Any], prefix: str = ""
) -> Iterator[tuple[str, str, str]]:
    """Yield dotted name and both values as JSON of the entries that differ; an object is entered if both have one."""
    for name in dict.fromkeys((*before, *after)):
        was, now = before.get(name), after.get(name)
        if was == now and (name in before) == (name in after):
            continue
        if isinstance(was, dict) and isinstance(now, dict) and name not in CONFIGURATION_KEYS_COMPARED_AS_WHOLE:
            yield from iter_changed_values(was, now, f"{prefix}{name}.")
        else:
            texts = [
                json.dumps(each[name], sort_keys=True, default=str) if name in each else "" for each in (before, after)
            ]
            yield f"{prefix}{name}", texts[0], texts[1]


def _read_settings(record: Record, *, with_constants: bool) -> dict[str, Any]:
    """Return the version, the configuration, and what was read from files for a stage.

    Args:
        record: Of the stage; empty if it did not run.
        with_constants: Give each constant of the calibration, else only whether there was one.
    """
    if not record:
        return {}
    found = {"version": record.get("version", ""), **read_configuration(record)}
    if CALIBRATION_KEY in record:
        text = record[CALIBRATION_KEY]
        found[CALIBRATION_KEY] = _calibration_entries_or_text(text) if with_constants else "constants from a file"
    if VEHICLE_RECORD_KEY in record:
        found[VEHICLE_RECORD_KEY] = parse_json_entry_or_empty(record, VEHICLE_RECORD_KEY, dict)
    return found


def _calibration_entries_or_text(text: str) -> Any:
    """Return what the stages use of a calibration file; its text if it is no TOML."""
    try:
        return _keep_entries_that_stages_use(parse_toml(text))
    except ValueError:
        return text


def _keep_entries_that_stages_use(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries of a table that the stages use, and those of the tables in it."""
    return {
        name: _keep_entries_that_stages_use(value) if isinstance(value, dict) else value
        for name, value in table.items()
        if isinstance(value, dict) or name in COMPARED_KEYS_OF_CALIBRATED_CONSTANT
    }
