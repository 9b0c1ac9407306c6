"""The sentences of `cwcli compare --messages`: what differs, since when, and what was changed."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from cwcli.cli.options.plain_coercion import MAX_SHOWN_VALUE_CHARACTERS
from cwcli.cli.text import finite_or_none, format_count, format_number, join_names, shorten_and_escape

if TYPE_CHECKING:
    from cwcli.evaluation.message_changes import ChannelChange, LogDifference, WarningChange
    from cwcli.evaluation.setting_changes import SettingChange
    from cwcli.fleet.message_changes import RunDifference

MAX_LISTED_ENTRIES_PER_KIND = 10
"""Settings, warnings and further channels of a log that are listed; chosen by hand."""
MAX_LISTED_LOGS = 20
"""Logs that are listed; chosen by hand, the others are in --json."""


def describe_identical(messages: RunDifference) -> str:
    """The one line about two runs without a difference."""
    return f"identical: every message and every setting of {format_count(messages.n_logs, 'log')} is the same"


def describe_differences(messages: RunDifference, uncompared: Sequence[str]) -> list[str]:
    """The lines about what differs, log by log, and about logs that failed or are in one run only."""
    n_differing = len(messages.differing)
    verb = "differs" if 1 in (n_differing, messages.n_logs) else "differ"
    lines = [f"messages: {n_differing} of {format_count(messages.n_logs, 'log')} {verb}"]
    for name, found in list(messages.differing.items())[:MAX_LISTED_LOGS]:
        lines.append(shorten_and_escape(name))
        lines += [f"  {line}" for line in describe_difference_of_log(found)]
    if n_differing > MAX_LISTED_LOGS:
        lines.append(f"{n_differing - MAX_LISTED_LOGS} more logs differ (--json lists them)")
    lines += [f"{shorten_and_escape(name)} was not compared: {why}" for name, why in messages.unread.items()]
    if uncompared:
        names = join_names([shorten_and_escape(name) for name in uncompared[:MAX_LISTED_ENTRIES_PER_KIND]])
        rest = len(uncompared) - MAX_LISTED_ENTRIES_PER_KIND
        pronoun = "it failed or is" if len(uncompared) == 1 else "they failed or are"
        more = f" and {rest} more" if rest > 0 else ""
        lines.append(f"not compared, as {pronoun} in one run only: {names}{more}")
    return lines


def describe_difference_of_log(found: LogDifference) -> list[str]:
    """The lines about one log: the settings, the first channel, the warnings, the other channels."""
    lines = _first_lines_and_count_of_rest([f"changed: {_describe_setting(each)}" for each in found.settings])
    if found.channels:
        lines.append(f"first difference: {_describe_channel(found.channels[0], found)}")
    elif found.settings:
        lines.append("no message differs")
    lines += _first_lines_and_count_of_rest([_describe_warning(each, found) for each in found.warnings])
    return lines + _first_lines_and_count_of_rest(
        [f"then: {_describe_channel(each, found)}" for each in found.channels[1:]]
    )


def _first_lines_and_count_of_rest(lines: list[str]) -> list[str]:
    """The first lines, and how many more there are."""
    rest = len(lines) - MAX_LISTED_ENTRIES_PER_KIND
    return [*lines[:MAX_LISTED_ENTRIES_PER_KIND], *([f"and {rest} more (--json lists them)"] if rest > 0 else [])]


def _describe_setting(change: SettingChange) -> str:
    values = [
        shorten_and_escape(each, MAX_SHOWN_VALUE_CHARACTERS) or "nothing" for each in (change.before, change.after)
    ]
    return f"{change.stage}: {shorten_and_escape(change.name)} was {values[0]}, is {values[1]}"


def _describe_channel(change: ChannelChange, found: LogDifference) -> str:
    at = f"{shorten_and_escape(change.topic)} at {found.seconds_since_start(change.at_ns):.3f} s"
    index, *texts = _most_different_element(change.before, change.after)
    values = [shorten_and_escape(each, MAX_SHOWN_VALUE_CHARACTERS) or "nothing" for each in texts]
    what = f" {shorten_and_escape(change.field)}{index}" if change.field else ""
    largest = "" if math.isnan(change.largest) else f", at most {format_number(change.largest)} apart"
    verb = "differs" if 1 in (change.n_different, change.n_messages) else "differ"
    count = f"{change.n_different} of {format_count(change.n_messages, 'message')} {verb}"
    return f"{at}:{what} was {values[0]}, is {values[1]} ({count}{largest})"


def _most_different_element(before: str, after: str) -> tuple[str, str, str]:
    """Return index and values of the element in which two lists of numbers differ most: two long lists look alike.

    Other values come back as they are, without an index.
    """
    with suppress(ValueError, TypeError, RecursionError):
        elements = [dict(_iter_indices_and_numbers(json.loads(each))) for each in (before, after)]
        if elements[0].keys() == elements[1].keys() != {""}:
            differences = {index: abs(value - elements[1][index]) for index, value in elements[0].items()}
            index = max(differences, key=lambda each: (differences[each] > 0.0, differences[each]))
            if differences[index] > 0.0:  # not where one is no number (NaN)
                return index, json.dumps(elements[0][index]), json.dumps(elements[1][index])
    return "", before, after


def _iter_indices_and_numbers(value: object, index: str = "") -> Iterator[tuple[str, float]]:
    """Yield index and value of each number in lists of lists; raise `TypeError` for anything else."""
    if isinstance(value, list):
        for k, each in enumerate(value):
            yield from _iter_indices_and_numbers(each, f"{index}[{k}]")
    elif isinstance(value, int | float):
        yield index, value
    else:
        raise TypeError


def _describe_warning(change: WarningChange, found: LogDifference) -> str:
    of = f"{shorten_and_escape(change.rule)} about {shorten_and_escape(change.other_id)}"
    at_s = found.seconds_since_start(change.raised_ns)
    if change.kind != "moved":
        return f"warning {change.kind}: {of} at {at_s:.3f} s"
    return f"warning moved: {of} to {at_s:.3f} s, by {change.moved_s:+.3f} s"


def differences_as_json(messages: RunDifference, *, is_identical: bool) -> dict[str, Any]:
    """The differences for `--json`."""
    return {
        "logs": messages.n_logs,
        "identical": is_identical,
        "unread": dict(messages.unread),
        "differing": [
            {
                "log": name,
                "settings": [
                    {"stage": each.stage, "name": each.name, "before": each.before, "after": each.after}
                    for each in found.settings
                ],
                "channels": [
                    {
                        "topic": each.topic,
                        "field": each.field,
                        "at_ns": each.at_ns,
                        "before": each.before,
                        "after": each.after,
                        "different": each.n_different,
                        "messages": each.n_messages,
                        "largest": finite_or_none(each.largest),
                    }
                    for each in found.channels
                ],
                "warnings": [
                    {
                        "change": each.kind,
                        "rule": each.rule,
                        "other_id": each.other_id,
                        "raised_ns": each.raised_ns,
                        "moved_s": finite_or_none(each.moved_s),
                    }
                    for each in found.warnings
                ],
            }
            for name, found in messages.differing.items()
        ],
    }
