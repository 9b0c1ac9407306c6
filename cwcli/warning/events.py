"""Find events in masks over evaluations, so that one conflict gives one warning."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import BoolArray, Int64Array, sort_distinct_values
from cwcli.signals.units import NS_PER_S

PERSISTENCE_TOLERANCE_NS = 1_000_000
"""Time in ns by which a condition may hold for less than the persistence time and still counts: stamps are rounded.
Chosen by hand."""


@dataclass(frozen=True)
class EventSpan:
    """One event as evaluation indices.

    Attributes:
        raised: Evaluation at which it was raised.
        last: Last evaluation that held it.
        cleared: Index in `clock_ns` at which it was cleared; None: it was active at the end of the log.
    """

    raised: int
    last: int
    cleared: int | None


class EventTiming(NamedTuple):
    """When events begin and end.

    Attributes:
        clock_ns: Shape (n,): all evaluation times of the host; decides whether the log went on long enough to clear.
        persistence_s: How long an event must be armed before it begins.
        hold_off_s: How long it must be neither held nor raised before it is over.
    """

    clock_ns: Int64Array
    persistence_s: float
    hold_off_s: float


def find_events(
    stamp_ns: Int64Array,
    armed: BoolArray,
    raised: BoolArray,
    held: BoolArray,
    timing: EventTiming,
    *,
    at_once: BoolArray | None = None,
) -> list[EventSpan]:
    """Find the events of one pair.

    An event begins where `raised` holds and `armed` has held without a break for the persistence time (a break of data
    longer than the hold-off is a break). It lasts while `held` or `raised` does. Once both have been false, or nothing
    was evaluated, for the hold-off time it is over; a return before that is the same event.

    Args:
        stamp_ns: Shape (m,), increasing: the evaluations of the pair.
        armed, raised, held: Shape (m,), see `rules.base.Decision`.
        timing: When events begin and end.
        at_once: Shape (m,) or None: where an event begins without persistence.
    """
    clock_ns = timing.clock_ns
    persistence_ns, hold_off_ns = round(timing.persistence_s * NS_PER_S), round(timing.hold_off_s * NS_PER_S)
    ready = np.flatnonzero(
        raised & armed & (_armed_duration_ns(stamp_ns, armed, hold_off_ns) >= persistence_ns - PERSISTENCE_TOLERANCE_NS)
    )
    if at_once is not None:
        ready = sort_distinct_values(np.concatenate([ready, np.flatnonzero(at_once)]))
        raised = raised | at_once
    keep = np.flatnonzero(held | raised)
    spans: list[EventSpan] = []
    free_ns = np.iinfo(np.int64).min
    for index in ready:
        if stamp_ns[index] < free_ns:
            continue
        held_on = keep[np.searchsorted(keep, index) :]
        breaks = np.flatnonzero(np.diff(stamp_ns[held_on]) > hold_off_ns)
        last = int(held_on[breaks[0]]) if len(breaks) else int(held_on[-1])
        free_ns = int(stamp_ns[last]) + hold_off_ns
        over = int(np.searchsorted(clock_ns, free_ns))
        spans.append(EventSpan(int(index), last, over if over < len(clock_ns) else None))
    return spans


def _armed_duration_ns(stamp_ns: Int64Array, armed: BoolArray, max_break_ns: int) -> Int64Array:
    """For how long `armed` has held without a break, ns, (m,); 0 where it has just begun or does not hold."""
    if not len(stamp_ns):
        return np.zeros(0, dtype=np.int64)
    begins = armed.copy()
    begins[1:] &= ~armed[:-1] | (np.diff(stamp_ns) > max_break_ns)
    since = np.maximum.accumulate(np.where(begins, np.arange(len(armed)), 0))
    return np.where(armed, stamp_ns - stamp_ns[since], 0)
