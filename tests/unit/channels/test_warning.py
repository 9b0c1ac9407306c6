"""Warnings read back: one reader for the scores and for the report."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from cwcli.channels.warning import WarningEvent, read_warnings, warning_events_with_known_start
from cwcli.signals.columns import Columns, Strings

RAISED, HELD, CLEARED = 1, 2, 3


def channel(*rows: tuple[int, int, int, str, str]) -> Columns:
    """Rows of (stamp, event, state, rule, other)."""
    stamps, events, states = (np.array([row[k] for row in rows], np.int64) for k in range(3))
    names = sorted({name for row in rows for name in row[3:]})
    rules, others = (
        Strings(np.array([names.index(str(row[k])) for row in rows], np.int32), tuple(names)) for k in (3, 4)
    )
    fields: dict[str, Any] = {
        "stamp_ns": stamps,
        "event_id": events,
        "state": states,
        "rule": rules,
        "other_id": others,
    }
    return Columns(
        "/cwcli/warnings", "cwcli.v1.Warning", "protobuf", stamps, stamps, np.zeros(len(rows), np.uint32), fields
    )


def events_of(columns: Columns) -> list[WarningEvent]:
    return warning_events_with_known_start(read_warnings(columns))


def test_events_of_several_rules_in_order_of_time() -> None:
    found = events_of(
        channel(
            (30, 2, RAISED, "cwcli", "b"),
            (10, 3, RAISED, "ttc", "a"),
            (20, 3, HELD, "ttc", "a"),
            (40, 3, CLEARED, "ttc", "a"),
            (50, 2, HELD, "cwcli", "b"),
            (40, 2, HELD, "cwcli", "b"),
        )
    )
    assert [(event.event_id, event.rule, event.other_id, event.raised_ns, event.last_ns) for event in found] == [
        (3, "ttc", "a", 10, 20),
        (2, "cwcli", "b", 30, 50),
    ]
    assert [event.rows.tolist() for event in found] == [[1, 2], [0, 5, 4]]


def test_what_was_raised_before_the_channel_begins_is_no_event() -> None:
    assert events_of(channel((10, 1, HELD, "cwcli", "a"), (20, 1, CLEARED, "cwcli", "a"))) == []


def test_a_channel_without_messages_or_without_the_fields() -> None:
    nothing = np.zeros(0, np.int64)
    assert events_of(Columns("/w", "x", "json", nothing, nothing, nothing.astype(np.uint32), {})) == []
    one = np.ones(1, np.int64)
    assert events_of(Columns("/w", "x", "json", one, one, one.astype(np.uint32), {"event_id": one})) == []


def test_a_warning_is_read_at_the_time_when_it_was_known_and_an_older_one_at_its_stamp() -> None:
    columns = channel((10, 1, RAISED, "cwcli", "a"), (20, 1, HELD, "cwcli", "a"), (30, 2, RAISED, "cwcli", "b"))
    known = {**columns.fields, "known_ns": np.array([15, 25, 0], np.int64)}
    found = events_of(replace(columns, fields=known))
    assert [(event.raised_ns, event.last_ns) for event in found] == [(15, 25), (30, 30)]
