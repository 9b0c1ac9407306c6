"""A recording contract: what a log must hold, as TOML, and whether it does.

min_duration_s = 60
roles = ["ego_position", "imu"]

[topics."/gps/fix"]
schema = "sensor_msgs/NavSatFix"
min_rate_hz = 9
max_gap_s = 1.0
max_delay_s = 0.5
"""

from __future__ import annotations

import math
import sys
from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

from cwcli.errors import UsageError
from cwcli.input import read_file
from cwcli.lazy_dataclass import dataclass
from cwcli.toml_text import parse_toml

LOG_CONDITION_KEYS = ("min_duration_s", "max_duration_s", "min_messages", "roles", "topics")
"""Keys that a contract may have at its top level; `roles` and `topics` hold lists and tables."""
FIELD_BY_TOPIC_CONDITION = {
    "min_messages": "messages",
    "min_rate_hz": "rate_hz",
    "max_rate_hz": "rate_hz",
    "max_gap_s": "longest_gap_s",
    "max_delay_s": "delay_s",
    "max_drift_ms_per_min": "drift_ms_per_min",
    "max_undecodable": "undecodable",
    "max_out_of_order": "out_of_order",
}
"""Condition on a topic -> the field of `TopicHealth` that it limits; a drift is limited by its magnitude."""
MAX_CONDITION_NUMBER = sys.float_info.max
"""Greatest number that a condition may have: whole numbers of TOML have no bound, the measured values are floats."""


class ConditionVerdict(NamedTuple):
    """One condition: its subject (a topic, or the log), its text, the value found, and whether it holds."""

    about: str
    condition: str
    found: str
    holds: bool


@dataclass(frozen=True)
class RecordingContract:
    """The conditions that a recorded log must meet.

    Attributes:
        limits: Condition on the log -> number.
        roles: Roles for which the log must have a channel.
        topics: Topic -> condition -> number, or its schema.
    """

    limits: Mapping[str, float]
    roles: Sequence[str]
    topics: Mapping[str, Mapping[str, Any]]

    @classmethod
    def read_toml(cls, path: str, known_roles: Collection[str]) -> RecordingContract:
        """Read the contract from a TOML file.

        Raises:
            UsageError: The file can't be read, is not TOML, or holds a condition that does not exist.
        """
        try:
            document = parse_toml(read_file(path).decode())
        except OSError as error:
            raise UsageError(f"can't read the contract: {error.strerror}", where=path) from error
        except ValueError as error:
            raise UsageError(f"the contract is not TOML: {error}", where=path) from error
        _check_known_keys(path, document, LOG_CONDITION_KEYS, "")
        roles, topics = document.pop("roles", []), document.pop("topics", {})
        if not isinstance(roles, list) or not set(map(str, roles)) <= set(known_roles):
            raise UsageError("roles must be a list of roles", where=path, hint=f"roles: {', '.join(known_roles)}")
        if not isinstance(topics, dict) or not all(isinstance(each, dict) for each in topics.values()):
            raise UsageError("topics must be tables", where=path, hint='[topics."/gps/fix"]')
        for topic, conditions in topics.items():
            _check_known_keys(path, conditions, ("schema", *FIELD_BY_TOPIC_CONDITION), f"{topic}: ")
            if not isinstance(conditions.get("schema", ""), str):
                what = f"{topic}: schema = {conditions['schema']!r} is not the name of a type"
                raise UsageError(what, where=path, hint='schema = "sensor_msgs/NavSatFix"')
            _require_numbers_from_zero_on(
                path, {name: each for name, each in conditions.items() if name != "schema"}, f"{topic}: "
            )
        _require_numbers_from_zero_on(path, document, "")
        if not (document or roles or topics):
            raise UsageError("the contract asks for nothing", where=path)
        return cls(document, tuple(map(str, roles)), topics)

    def check_log(
        self,
        *,
        totals: Mapping[str, float],
        roles: Collection[str],
        schemas: Mapping[str, str],
        topics: Mapping[str, Mapping[str, float]],
    ) -> list[ConditionVerdict]:
        """Check every condition on a log.

        Args:
            totals: `duration_s` and `messages` of the log.
            roles: Roles for which the log has a channel.
            schemas: Topic -> its schema, in one spelling.
            topics: Topic -> its statistics, by the names of the fields of `TopicHealth`.
        """
        verdicts = [
            _compare_with_limit("log", name, limit, totals[_condition_name_without_min_or_max(name)])
            for name, limit in self.limits.items()
        ]
        for role in self.roles:
            verdicts.append(
                ConditionVerdict("log", f"role {role}", "filled" if role in roles else "not filled", role in roles)
            )
        for topic, conditions in self.topics.items():
            if topic not in schemas:
                verdicts.append(ConditionVerdict(topic, "is there", "no such topic", holds=False))
                continue
            if not conditions:
                verdicts.append(ConditionVerdict(topic, "is there", "yes", holds=True))
            for name, limit in conditions.items():
                if name == "schema":
                    verdicts.append(
                        ConditionVerdict(topic, f"schema {limit}", schemas[topic] or "none", schemas[topic] == limit)
                    )
                else:
                    verdicts.append(
                        _compare_with_limit(topic, name, limit, topics[topic][FIELD_BY_TOPIC_CONDITION[name]])
                    )
        return verdicts


def _condition_name_without_min_or_max(name: str) -> str:
    """Return what a condition limits: `duration_s` for `min_duration_s`."""
    return name.partition("_")[2]


def _compare_with_limit(about: str, name: str, limit: float, value: float) -> ConditionVerdict:
    """Compare a value with its limit; NaN meets no condition."""
    size = abs(value) if "drift" in name else value
    holds = size >= limit if name.startswith("min_") else size <= limit
    shown = "not known" if math.isnan(value) else f"{value:.4g}"
    return ConditionVerdict(
        about,
        f"{_condition_name_without_min_or_max(name)} {'>=' if name.startswith('min_') else '<='} {limit:g}",
        shown,
        bool(holds),
    )


def _check_known_keys(path: str, table: Mapping[str, Any], names: Sequence[str], about: str) -> None:
    """Raise `UsageError` for a key of the contract that is none of the names."""
    for name in table:
        if name not in names:
            raise UsageError(f"{about}a contract knows no {name}", where=path, hint=f"it knows {', '.join(names)}")


def _require_numbers_from_zero_on(path: str, table: Mapping[str, Any], about: str) -> None:
    """Raise `UsageError` for a value that is no finite number from 0 on."""
    for name, value in table.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= MAX_CONDITION_NUMBER:
            raise UsageError(
                f"{about}{name} = {value!r} is not a number from 0 to {MAX_CONDITION_NUMBER:g}", where=path
            )
