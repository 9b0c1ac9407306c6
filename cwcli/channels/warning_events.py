"""Warnings read back from `/cwcli/warnings`: each event with the rows in which it stood."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cwcli.signals.columns import Columns, Int64Array, Strings
from cwcli.signals.leaves import texts, whole_numbers
from cwcli.warning.output import HELD, RAISED


@dataclass(frozen=True)
class WarningEvent:
    """One warning.

    Attributes:
        event_id: Its number in the log.
        rule: The rule that warned.
        other_id: The other vehicle, or what else it is about.
        raised_ns, last_ns: First and last evaluation at which it stood.
        rows: Rows of the channel in which it was raised or held, by stamp; the first raised it.
    """

    event_id: int
    rule: str
    other_id: str
    raised_ns: int
    last_ns: int
    rows: Int64Array


def read_warning_events(warnings: Columns) -> list[WarningEvent]:
    """The events of a warnings channel, in order of the time at which they were raised.

    What was raised before the channel begins (somebody has cut the log) is no event of it: nobody knows when it was.
    """
    event_id, has_event = whole_numbers(warnings, "event_id")
    state, has_state = whole_numbers(warnings, "state")
    stamp_ns, has_stamp = whole_numbers(warnings, "stamp_ns")
    stood = has_event & has_state & has_stamp & ((state == RAISED) | (state == HELD))
    rows = np.flatnonzero(stood)
    rows = rows[np.lexsort((state[rows] != RAISED, stamp_ns[rows], event_id[rows]))]
    rules, others = texts(warnings, "rule"), texts(warnings, "other_id")
    found = []
    for part in np.split(rows, np.flatnonzero(np.diff(event_id[rows])) + 1):
        raised = np.flatnonzero(state[part] == RAISED)
        if not len(raised):
            continue
        part = part[raised[0] :]  # noqa: PLW2901
        first, last = int(part[0]), int(part[-1])
        found.append(
            WarningEvent(
                event_id=int(event_id[first]),
                rule=_text(rules, first),
                other_id=_text(others, first),
                raised_ns=int(stamp_ns[first]),
                last_ns=int(stamp_ns[last]),
                rows=part,
            )
        )
    return sorted(found, key=lambda event: (event.raised_ns, event.event_id))


def _text(values: Strings | None, row: int) -> str:
    code = -1 if values is None else int(values.codes[row])
    return str(values.values[code]) if values is not None and code >= 0 else ""
