"""When an online state could have been known: by hand."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.estimation import Kind, Latency, LatencyStatus, Measurements, SourceReport
from cwcli.estimation.online_availability import (
    OnlineAvailability,
    available_times_of_states_ns,
    not_overtaken_message_mask,
)

MS = 1_000_000


def rows(kind: Kind, stamps_ms: list[int], delays_ms: list[int], source: str = "") -> Measurements:
    stamp_ns = np.array(stamps_ms, np.int64) * MS
    width = 2 if kind is Kind.POSITION else 1
    log_ns = stamp_ns + np.array(delays_ms, np.int64) * MS
    return Measurements(source or kind.name, kind, stamp_ns, np.zeros((len(stamps_ms), width)), None, log_ns)


def known_ms(measurements: list[Measurements], stamps_ms: list[int], latency_s: float = 0.0) -> list[int]:
    latency = Latency(LatencyStatus.GIVEN, latency_s)
    sources = [SourceReport(m.source, m.kind, latency=latency) for m in measurements if m.kind is Kind.POSITION]
    found = available_times_of_states_ns(measurements, sources, np.array(stamps_ms, np.int64) * MS, max_pause_s=60.0)
    return (found // MS).tolist()


def test_a_state_is_known_when_its_last_message_was_received() -> None:
    fixes = rows(Kind.POSITION, [0, 100, 200], [80, 80, 80])
    speeds = rows(Kind.SPEED, [0, 50, 100, 150, 200], [5, 5, 5, 5, 5])
    assert known_ms([fixes, speeds], [0, 50, 100, 150, 200]) == [80, 80, 180, 180, 280]


def test_no_state_is_known_before_something_tells_that_its_time_has_come() -> None:
    """Between two fixes the state follows from the first, but nobody knows yet that there is one."""
    assert known_ms([rows(Kind.POSITION, [0, 1000], [10, 10])], [0, 500, 1000]) == [10, 1010, 1010]


def test_a_late_source_belongs_to_earlier_states() -> None:
    """Fixes that are 300 ms late: the one stamped 400 is of 100, and the states from 100 on wait for it."""
    fixes = rows(Kind.POSITION, [0, 400], [10, 10])
    speeds = rows(Kind.SPEED, [0, 100, 200, 400], [5, 5, 5, 5])
    assert known_ms([fixes, speeds], [0, 50, 100, 200], latency_s=0.3) == [10, 105, 410, 410]


def test_known_times_never_go_back() -> None:
    """The recorder stalled: the second message came 900 ms after its stamp, later ones in time."""
    assert known_ms([rows(Kind.POSITION, [0, 100, 200], [10, 900, 10])], [0, 100, 200]) == [10, 1000, 1000]


def test_a_stretch_behind_a_long_pause_is_known_with_its_first_position() -> None:
    fixes = rows(Kind.POSITION, [0, 100_500], [10, 10])
    speeds = rows(Kind.SPEED, [0, 100_000, 100_500], [5, 5, 5])
    assert known_ms([fixes, speeds], [0, 100_000, 100_500]) == [10, 100_510, 100_510]


def test_a_message_that_a_newer_one_overtook_is_not_in_time() -> None:
    stamp_ns, log_ns = np.array([0, 100, 200, 300]), np.array([10, 350, 210, 340])
    np.testing.assert_array_equal(not_overtaken_message_mask(stamp_ns, log_ns), [True, False, True, True])


@pytest.mark.parametrize(("after_s", "n_notes"), [(0.3, 0), (2.5, 1)])
def test_states_that_come_seconds_late_are_noted(after_s: float, n_notes: int) -> None:
    stamp_ns = np.arange(10, dtype=np.int64) * 1_000_000_000
    told = OnlineAvailability("/cwcli/ego/online", "this log", stamp_ns, stamp_ns + round(after_s * 1e9))
    assert told.delay_median_p95_and_max_s() == pytest.approx((after_s,) * 3)
    assert len(told.notes_on_late_states) == n_notes
    assert all("up to 2.5 s" in note for note in told.notes_on_late_states)


def test_states_that_come_late_are_counted_and_the_clock_is_doubted_where_most_do() -> None:
    stamp_ns = np.arange(1000, dtype=np.int64) * 100 * MS
    few, most = np.full(1000, 5 * MS), np.full(1000, 1200 * MS)
    few[7:9] = 1800 * MS
    told = [
        OnlineAvailability("/ego", "this log", stamp_ns, stamp_ns + delay_ns).notes_on_late_states
        for delay_ns in (few, most, few * 0)
    ]
    known = "are available more than 1 s after their stamps"
    assert told[0] == [f"/ego: 2 of 1000 states {known} (up to 1.8 s), and so are paths and warnings"]
    ending = "and so are paths and warnings; if the stamps are wrong, use --clock log"
    assert told[1] == [f"/ego: 1000 of 1000 states {known} (up to 1.2 s), {ending}"]
    assert told[2] == []
