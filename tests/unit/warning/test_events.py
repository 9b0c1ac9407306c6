"""One conflict is one warning: persistence, hysteresis, hold-off."""

import numpy as np

from cwcli.warning.events import EventSpan, EventTiming, find_events
from tests.unit.warning.vehicles import stamps

STEP_S = 0.1


def spans(
    armed: str, held: str | None = None, *, persistence_s: float = 0.0, hold_off_s: float = 0.3
) -> list[EventSpan]:
    """Events of masks written as strings, one character per 0.1 s; the log goes on for a second more."""
    up = np.array([c == "x" for c in armed])
    keep = up if held is None else np.array([c == "x" for c in held])
    clock = stamps(np.arange(len(armed) + 10) * STEP_S)
    return find_events(clock[: len(armed)], up, up, keep, timing=EventTiming(clock, persistence_s, hold_off_s))


def test_one_stretch_is_one_event() -> None:
    assert spans("..xxxx....") == [EventSpan(2, 5, 8)]


def test_a_break_shorter_than_the_hold_off_does_not_split_it() -> None:
    assert spans("..xx..xx......") == [EventSpan(2, 7, 10)]


def test_a_longer_break_does() -> None:
    assert spans("..xx....xx......") == [EventSpan(2, 3, 6), EventSpan(8, 9, 12)]


def test_the_weaker_condition_keeps_it_up() -> None:
    assert spans("..x.........x...", "..xxxxxxxxxxx...") == [EventSpan(2, 12, 15)]


def test_the_weaker_condition_alone_raises_nothing() -> None:
    assert spans("................", "..xxxxxxxxxxx...") == []


def test_persistence_waits_and_forgets_after_a_break() -> None:
    assert spans(".xx.xxxx........", persistence_s=0.2) == [EventSpan(6, 7, 10)]


def test_an_event_at_the_end_of_the_log_stays_open() -> None:
    clock = stamps(np.arange(5) * STEP_S)
    up = np.array([False, False, False, True, True])
    assert find_events(clock, up, up, up, timing=EventTiming(clock, 0.0, 0.3)) == [EventSpan(3, 4, None)]


def test_a_gap_in_the_data_longer_than_the_hold_off_ends_it() -> None:
    clock = stamps(np.arange(40) * STEP_S)
    rows = np.array([0, 1, 2, 10, 11])
    up = np.ones(5, dtype=bool)
    found = find_events(clock[rows], up, up, up, timing=EventTiming(clock, 0.0, 0.3))
    assert found == [EventSpan(0, 2, 5), EventSpan(3, 4, 14)]


def test_at_once_needs_no_persistence() -> None:
    clock = stamps(np.arange(20) * STEP_S)
    none = np.zeros(10, dtype=bool)
    once = none.copy()
    once[4] = True
    found = find_events(clock[:10], none, none, none, at_once=once, timing=EventTiming(clock, 0.5, 0.3))
    assert found == [EventSpan(4, 4, 7)]


def test_no_evaluations_give_no_events() -> None:
    none = np.zeros(0, dtype=bool)
    clock = stamps(np.arange(3) * STEP_S)
    assert find_events(clock[:0], none, none, none, timing=EventTiming(clock, 0.1, 0.3)) == []
