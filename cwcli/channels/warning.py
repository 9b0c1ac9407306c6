"""`cwcli.v1.Warning`: every evaluation of a standing warning, and its text for a viewer's log panel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from cwcli.channels.output import make_output_channel
from cwcli.channels.published import WARNING_LOG, WARNINGS
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import (
    Columns,
    Field,
    Int64Array,
    OutputChannel,
    Strings,
    absent_strings,
    concat_strings,
    repeat_string,
)
from cwcli.signals.leaf_fields import read_integers, read_numbers, read_texts
from cwcli.warning.rows import HELD, RAISED, WarningRows

LOG_LEVEL_INFO, LOG_LEVEL_WARNING = 2, 3
"""The levels of log messages: values of `foxglove.Log.Level`."""
WARNING_FIELDS = tuple(field.name for field in fields(WarningRows) if field.name != "log_time_ns")
"""Fields of the message, which have the names of the rows' columns."""
WARNING_FIELDS_FOR_EVENTS = tuple(name for name in WARNING_FIELDS if name not in ("host_id", "message"))
"""Fields from which events are collected: all but the host's id and the text."""


@dataclass(frozen=True)
class WarningEvent:
    """One warning.

    Attributes:
        event_id: Its number in the log.
        other_id: The other vehicle, or what else it is about.
        raised_ns, last_ns: Times at which its first and its last evaluation could have been known.
        rows: Rows of the channel in which it was raised or held, in order of stamps; the first raised it.
    """

    event_id: int
    rule: str
    other_id: str
    raised_ns: int
    last_ns: int
    rows: Int64Array


def make_warning_and_log_channels(parts: Sequence[WarningRows]) -> tuple[OutputChannel, OutputChannel]:
    """Make the channel of the warnings of all rules, and a log channel of those raised or cleared."""
    log_time_ns = np.concatenate([part.log_time_ns for part in parts])
    joined: dict[str, Field] = {
        name: concat_strings(columns) if isinstance(columns[0], Strings) else np.concatenate(columns)
        for name in WARNING_FIELDS
        if (columns := [getattr(part, name) for part in parts])
    }
    warnings = make_output_channel(WARNINGS, log_time_ns, joined)
    state, message = np.asarray(warnings.fields["state"]), warnings.fields["message"]
    rows = np.flatnonzero(state != HELD)  # a held warning says nothing new
    assert isinstance(message, Strings)
    words: dict[str, Field] = {
        "timestamp": np.asarray(warnings.fields["known_ns"])[rows],
        "level": np.where(state[rows] == RAISED, LOG_LEVEL_WARNING, LOG_LEVEL_INFO),
        "message": message.select_rows(rows),
        "name": repeat_string("cwcli.warn", len(rows)),
    }
    return warnings, make_output_channel(WARNING_LOG, warnings.log_time_ns[rows], words)


def read_warnings(columns: Columns) -> WarningRows:
    """Read the warnings of a channel, in log-time order; unknown values are NaN, absent, or without a state.

    Args:
        columns: The channel; for events its fields `WARNING_FIELDS_FOR_EVENTS` are enough.
    """
    absent = absent_strings(len(columns))
    stamp_ns = read_integers(columns, "stamp_ns")[0]
    known_ns = read_integers(columns, "known_ns")[0]
    return WarningRows(
        log_time_ns=columns.log_time_ns,
        stamp_ns=stamp_ns,
        known_ns=np.where(known_ns > 0, known_ns, stamp_ns),  # older versions wrote stamps only
        rule=read_texts(columns, "rule") or absent,
        event_id=read_integers(columns, "event_id")[0],
        state=read_integers(columns, "state")[0].astype(np.int32),
        host_id=read_texts(columns, "host_id") or absent,
        other_id=read_texts(columns, "other_id") or absent,
        time_to_event_s=read_numbers(columns, "time_to_event_s"),
        predicted_distance_m=read_numbers(columns, "predicted_distance_m"),
        ttc_s=read_numbers(columns, "ttc_s"),
        probability=read_numbers(columns, "probability"),
        alert_probability=read_numbers(columns, "alert_probability"),
        message=read_texts(columns, "message") or absent,
    )


def warning_events_with_known_start(warnings: WarningRows) -> list[WarningEvent]:
    """Collect the events of a channel, in order of the time at which they were raised.

    A warning that was raised before the channel begins (the log was cut) is no event, because its time is unknown.
    """
    event_id, state, stamp_ns, known_ns = warnings.event_id, warnings.state, warnings.stamp_ns, warnings.known_ns
    rows = np.flatnonzero((state == RAISED) | (state == HELD))
    rows = rows[np.lexsort((state[rows] != RAISED, stamp_ns[rows], event_id[rows]))]
    found = []
    for part in np.split(rows, np.flatnonzero(np.diff(event_id[rows])) + 1):
        raised = np.flatnonzero(state[part] == RAISED)
        if not len(raised):
            continue
        own = part[raised[0] :]
        first, last = int(own[0]), int(own[-1])
        found.append(
            WarningEvent(
                event_id=int(event_id[first]),
                rule=warnings.rule.text_of_row(first),
                other_id=warnings.other_id.text_of_row(first),
                raised_ns=int(known_ns[first]),
                last_ns=int(known_ns[last]),
                rows=own,
            )
        )
    return sorted(found, key=lambda event: (event.raised_ns, event.event_id))
