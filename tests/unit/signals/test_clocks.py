"""Clocks: each fault of a stamp by itself, with its repair and its count."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.signals.clocks import (
    CLOCK_JUMP_REASON,
    DUPLICATE_REASON,
    NO_STAMP_REASON,
    OUT_OF_ORDER_REASON,
    REPEATED_STAMP_REASON,
    REPEATED_STAMP_SPACED_REASON,
    Timeline,
    earliest_known_times_ns,
    find_stamp_gaps,
    first_and_last_log_time_without_strays,
    lines_on_channels_with_other_clock,
    repair_and_order_times,
    repaired_stamps_and_moved_mask,
)
from cwcli.signals.columns import Int64Array
from cwcli.signals.quality import Quality, RowLedger
from tests.unit.signals.signal_columns import T0_NS, columns_of

MS = 1_000_000
HOUR_NS = 3_600_000_000_000
DELAY_NS = 80 * MS


def settled(
    stamp_ns: Int64Array,
    *,
    log_ns: Int64Array | None = None,
    values: Int64Array | None = None,
    has_stamp: np.ndarray | None = None,
    sender: Int64Array | None = None,
    clock: str = "stamp",
) -> tuple[Timeline, Quality]:
    n_rows = len(stamp_ns)
    values = np.arange(n_rows) if values is None else values
    log_ns = steady(n_rows) + DELAY_NS if log_ns is None else log_ns
    ledger = RowLedger(columns_of("X", {"v": values.astype(float)}, log_time_ns=log_ns), "imu")
    given = np.ones(n_rows, dtype=bool) if has_stamp is None else has_stamp.astype(bool)
    timeline = repair_and_order_times(ledger, stamp_ns, given, clock, [values.astype(float)], sender=sender)  # type: ignore[arg-type]
    quality = ledger.quality
    assert quality.read == quality.used + sum(quality.rejected.values()) + sum(quality.set_aside.values())
    return timeline, quality


def steady(n_rows: int) -> Int64Array:
    """Stamps 100 ms apart."""
    return T0_NS + 100 * MS * np.arange(n_rows, dtype=np.int64)


def test_settle_good_stamps_stay_and_nothing_is_counted() -> None:
    timeline, quality = settled(steady(10))
    np.testing.assert_array_equal(timeline.stamp_ns, steady(10))
    assert not quality.rejected and not quality.repaired
    assert quality.delay_s == pytest.approx(0.08, abs=1e-9)


def test_settle_log_clock_takes_the_log_time() -> None:
    timeline, _ = settled(steady(10) - HOUR_NS, clock="log")
    np.testing.assert_array_equal(timeline.stamp_ns, steady(10) + DELAY_NS)


def test_settle_stamps_never_filled_take_the_log_time() -> None:
    timeline, quality = settled(np.zeros(5, dtype=np.int64), has_stamp=np.zeros(5))
    np.testing.assert_array_equal(timeline.stamp_ns, steady(5) + DELAY_NS)
    assert quality.repaired == {NO_STAMP_REASON: 5}


def test_settle_one_stamp_missing_takes_log_time_less_the_usual_delay() -> None:
    given = np.ones(5)
    given[2] = 0
    stamps = steady(5)
    stamps[2] = 0
    timeline, quality = settled(stamps, has_stamp=given)
    np.testing.assert_array_equal(timeline.stamp_ns, steady(5))
    assert quality.repaired == {NO_STAMP_REASON: 1}


@pytest.mark.parametrize(
    ("rows", "shift_ns"),
    [
        pytest.param(slice(4, 5), HOUR_NS, id="one-row-an-hour-ahead"),
        pytest.param(slice(4, 5), -2 * HOUR_NS, id="one-row-two-hours-back"),
        pytest.param(slice(0, 3), -HOUR_NS, id="the-first-rows"),
        pytest.param(slice(12, 20), HOUR_NS, id="from-the-middle-to-the-end"),
        pytest.param(slice(6, 9), 400 * 24 * HOUR_NS, id="another-year"),
    ],
)
def test_settle_jump_by_hours_is_moved_back(rows: slice, shift_ns: int) -> None:
    stamps = steady(20)
    stamps[rows] += shift_ns
    timeline, quality = settled(stamps)
    np.testing.assert_array_equal(timeline.stamp_ns, steady(20))
    assert quality.repaired == {CLOCK_JUMP_REASON: len(range(20)[rows])}


def test_settle_two_different_jumps_are_both_moved_back() -> None:
    stamps = steady(30)
    stamps[5:9] += HOUR_NS
    stamps[9:12] -= 3 * HOUR_NS
    timeline, quality = settled(stamps)
    np.testing.assert_array_equal(timeline.stamp_ns, steady(30))
    assert quality.repaired == {CLOCK_JUMP_REASON: 7}


def test_settle_jump_of_the_log_time_leaves_the_stamps_alone() -> None:
    log_ns = steady(20) + DELAY_NS
    log_ns[10:] += HOUR_NS
    timeline, quality = settled(steady(20), log_ns=log_ns)
    np.testing.assert_array_equal(timeline.stamp_ns, steady(20))
    assert not quality.rejected and not quality.repaired


def test_settle_channel_that_pauses_for_an_hour_is_not_a_jump() -> None:
    stamps = steady(20)
    stamps[10:] += HOUR_NS
    timeline, quality = settled(stamps, log_ns=stamps + DELAY_NS)
    np.testing.assert_array_equal(timeline.stamp_ns, stamps)
    assert not quality.rejected and not quality.repaired
    assert len(quality.gaps) == 1
    assert quality.gaps[0].duration_s == pytest.approx(3600.1, abs=1e-6)


def test_settle_recorder_that_stalls_ten_seconds_is_not_a_jump() -> None:
    log_ns = steady(200) + DELAY_NS
    log_ns[50:150] = np.maximum(log_ns[50:150], log_ns[150])
    timeline, quality = settled(steady(200), log_ns=log_ns)
    np.testing.assert_array_equal(timeline.stamp_ns, steady(200))
    assert not quality.rejected and not quality.repaired


def test_settle_rows_out_of_order_are_sorted() -> None:
    stamps = steady(6)
    stamps[[2, 3]] = stamps[[3, 2]]
    timeline, quality = settled(stamps)
    np.testing.assert_array_equal(timeline.stamp_ns, steady(6))
    assert timeline.rows.tolist() == [0, 1, 3, 2, 4, 5]
    assert quality.repaired == {OUT_OF_ORDER_REASON: 1}


def test_settle_same_message_twice_is_dropped() -> None:
    timeline, quality = settled(steady(5)[[0, 1, 1, 2, 3]], values=np.array([0, 1, 1, 2, 3]))
    assert timeline.rows.tolist() == [0, 1, 3, 4]
    assert quality.rejected == {DUPLICATE_REASON: 1}


def test_settle_same_message_again_later_is_dropped() -> None:
    timeline, quality = settled(steady(5)[[0, 1, 2, 1, 3]], values=np.array([0, 1, 2, 1, 3]))
    assert timeline.rows.tolist() == [0, 1, 2, 4]
    assert quality.rejected == {DUPLICATE_REASON: 1}


def test_settle_clock_of_one_second_is_spaced_by_log_time() -> None:
    stamps = steady(30) // (1000 * MS) * (1000 * MS)
    timeline, quality = settled(stamps)
    np.testing.assert_array_equal(timeline.stamp_ns, steady(30))
    assert quality.repaired == {REPEATED_STAMP_SPACED_REASON: 27}


def test_settle_same_stamp_and_log_time_with_other_values_keeps_the_first() -> None:
    stamps = steady(4)[[0, 1, 1, 2]]
    timeline, quality = settled(stamps, log_ns=stamps + DELAY_NS)
    assert timeline.rows.tolist() == [0, 1, 3]
    assert quality.rejected == {REPEATED_STAMP_REASON: 1}


def test_settle_each_sender_has_a_clock_of_its_own() -> None:
    stamps = np.repeat(steady(10), 2)
    stamps[1::2] += np.where(np.arange(10) >= 5, HOUR_NS, 0)
    timeline, quality = settled(stamps, log_ns=np.repeat(steady(10), 2) + DELAY_NS, sender=np.tile([0, 1], 10))
    np.testing.assert_array_equal(timeline.stamp_ns, np.repeat(steady(10), 2))
    assert quality.repaired == {CLOCK_JUMP_REASON: 5}


def test_settle_leaves_rejected_rows_out() -> None:
    ledger = RowLedger(columns_of("X", {"v": np.zeros(4)}), "imu")
    ledger.reject(np.array([False, True, False, False]), "bad")
    timeline = repair_and_order_times(ledger, steady(4), np.ones(4, dtype=bool), "stamp", [np.arange(4.0)])
    assert timeline.rows.tolist() == [0, 2, 3]
    assert (ledger.quality.read, ledger.quality.used) == (4, 3)


def test_settle_nothing_is_nothing() -> None:
    timeline, quality = settled(np.zeros(0, dtype=np.int64), log_ns=np.zeros(0, dtype=np.int64))
    assert len(timeline.rows) == 0
    assert np.isnan(quality.delay_s)


@pytest.mark.parametrize("seed", range(5))
def test_settle_leaves_stamps_strictly_increasing_whatever_happens(seed: int) -> None:
    rng = np.random.default_rng(seed)
    stamps = steady(300)
    for _ in range(20):
        row, kind = rng.integers(300), rng.integers(4)
        if kind == 0:
            stamps[row:] += rng.integers(-5, 5) * HOUR_NS
        elif kind == 1:
            stamps[row] = stamps[row - 1]
        elif kind == 2:
            stamps[row] = rng.integers(0, 2**62)
        else:
            stamps[row] -= 150 * MS
    timeline, quality = settled(stamps)
    assert np.all(np.diff(timeline.stamp_ns) > 0)
    assert quality.used == len(timeline.rows) > 200


def test_repair_jumps_keeps_the_spacing_inside_a_stretch() -> None:
    stamps = steady(20) + np.random.default_rng(3).integers(-20, 20, 20) * MS
    jumped = stamps.copy()
    jumped[8:13] += HOUR_NS
    repaired, moved = repaired_stamps_and_moved_mask(jumped, steady(20) + DELAY_NS)
    np.testing.assert_array_equal(np.flatnonzero(moved), np.arange(8, 13))
    np.testing.assert_array_equal(np.diff(repaired[8:13]), np.diff(stamps[8:13]))
    assert np.abs(repaired - stamps).max() < 50 * MS


def test_find_gaps_of_a_channel_that_dies_halfway() -> None:
    gaps = find_stamp_gaps(steady(100), start_ns=T0_NS, end_ns=T0_NS + 20_000 * MS)
    assert [(gap.start_ns - T0_NS, gap.end_ns - T0_NS) for gap in gaps] == [(9900 * MS, 20_000 * MS)]


def test_find_gaps_of_a_channel_that_starts_late_and_pauses() -> None:
    stamps = np.concatenate([steady(10), steady(10) + 3000 * MS])
    gaps = find_stamp_gaps(stamps, start_ns=T0_NS - 5000 * MS)
    assert [gap.duration_s for gap in gaps] == pytest.approx([5.0, 2.1], abs=1e-9)


def test_find_gaps_of_an_empty_channel_is_the_whole_log() -> None:
    assert [gap.duration_s for gap in find_stamp_gaps(steady(0), start_ns=0, end_ns=10**9)] == [1.0]


def test_find_gaps_of_log_times_that_need_all_64_bits() -> None:
    """A log time is an unsigned number of 64 bits: a signed one ends half way."""
    last_ns = 2**64 - 1
    log_ns = np.array([0, MS, last_ns], np.uint64)
    gaps = find_stamp_gaps(log_ns, start_ns=0, end_ns=last_ns, min_gap_s=1.0)
    assert [(gap.start_ns, gap.end_ns) for gap in gaps] == [(MS, last_ns)]
    (gap,) = find_stamp_gaps(steady(100), start_ns=T0_NS, end_ns=last_ns, min_gap_s=1.0)
    assert (gap.start_ns, gap.end_ns) == (int(steady(100)[-1]), last_ns)


def test_find_gaps_does_not_call_the_usual_interval_a_gap() -> None:
    assert find_stamp_gaps(T0_NS + 2_000 * MS * np.arange(10)) == ()


def test_disagreeing_clocks_names_the_one_that_counts_from_boot() -> None:
    qualities = [Quality("/gps/fix", "ego_position", delay_s=0.08), Quality("/v2x/bsm", "remote", delay_s=0.3)]
    assert lines_on_channels_with_other_clock(qualities) == ()
    lines = lines_on_channels_with_other_clock([*qualities, Quality("/imu", "imu", delay_s=1.5e9)])
    assert len(lines) == 1
    assert lines[0].startswith("/imu: stamps are -1499999999.")


def test_usual_log_times_leave_out_one_message_far_before_and_one_far_behind() -> None:
    # 400 messages in two channels, 20 s; at most 4 strays at either end
    log_ns = steady(200)
    early, late = np.array([1, 2, 3, 4]), np.array([T0_NS + 400 * 24 * HOUR_NS])
    assert first_and_last_log_time_without_strays(
        [np.concatenate([early, log_ns]), np.concatenate([log_ns + 5 * MS, late])]
    ) == (
        log_ns[0],
        log_ns[-1] + 5 * MS,
    )


def test_usual_log_times_keep_what_is_more_than_a_few_messages() -> None:
    log_ns = steady(200)
    early = np.arange(1, 4)  # more than one in a hundred
    assert first_and_last_log_time_without_strays([np.concatenate([early, log_ns])]) == (1, log_ns[-1])


@pytest.mark.parametrize(("apart_s", "is_stray"), [(29.9, False), (30.1, True)])
def test_usual_log_times_stray_is_farther_than_a_clock_may_step(apart_s: float, is_stray: bool) -> None:
    log_ns = steady(200)
    early_ns = int(log_ns[0]) - round(apart_s * 1e9)
    assert first_and_last_log_time_without_strays([np.append(early_ns, log_ns)])[0] == (
        log_ns[0] if is_stray else early_ns
    )


@pytest.mark.parametrize(("pause_s", "is_stray"), [(3.0, True), (5.0, False)])
def test_usual_log_times_stray_is_farther_than_ten_pauses_of_the_rest(pause_s: float, is_stray: bool) -> None:
    # 40 s before a log in which nothing comes for 3 s (a stray: more than 30 s) or 5 s (no stray: less than 50 s)
    log_ns = steady(200)
    log_ns[100:] += round(pause_s * 1e9)
    early_ns = int(log_ns[0]) - 40_000 * MS
    assert first_and_last_log_time_without_strays([np.append(early_ns, log_ns)])[0] == (
        log_ns[0] if is_stray else early_ns
    )


def test_usual_log_times_keep_a_message_every_five_minutes() -> None:
    log_ns = T0_NS + np.arange(500, dtype=np.int64) * HOUR_NS // 12
    assert first_and_last_log_time_without_strays([log_ns]) == (log_ns[0], log_ns[-1])


def test_usual_log_times_are_unsigned() -> None:
    log_ns = steady(200)
    beyond = np.array([2**63 + 5], dtype=np.uint64).view(np.int64)  # negative as int64, and last in the file
    assert first_and_last_log_time_without_strays([np.append(log_ns, beyond)]) == (log_ns[0], log_ns[-1])


def test_usual_log_times_of_hardly_any_messages() -> None:
    none = np.zeros(0, np.int64)
    assert first_and_last_log_time_without_strays([]) == first_and_last_log_time_without_strays([none, none]) == (0, 0)
    assert first_and_last_log_time_without_strays([np.array([7])]) == (7, 7)
    assert first_and_last_log_time_without_strays([np.array([1]), np.array([T0_NS])]) == (
        1,
        T0_NS,
    )  # nothing tells which is wrong
    assert first_and_last_log_time_without_strays([np.array([1, T0_NS, T0_NS + MS])]) == (T0_NS, T0_NS + MS)


@pytest.mark.parametrize(
    ("stamp_s", "log_s", "known_s"),
    [
        ([0.0, 1.0, 2.0], [0.2, 1.1, 2.3], [0.2, 1.1, 2.3]),  # received a little later
        ([0.0, 1.0, 2.0], [1.5, 1.4, 2.1], [0.0, 1.5, 2.1]),  # the first by another clock, as it seems
        ([0.0, 1.0, 2.0], [-0.1, 0.9, 2.0], [0.0, 1.0, 2.0]),  # a clock that is ahead: not before it happened
        ([0.0, 1.0, 2.0], [3600.0, 3601.2, 3602.1], [0.0, 1.2, 2.1]),  # logged an hour later, the second 0.2 s late
        ([0.0, 1.0, 2.0], [-59.0, -57.9, -56.8], [0.0, 1.1, 2.2]),  # a logger that is a minute behind
        ([], [], []),
    ],
)
def test_knowable_is_the_log_time_on_the_clock_of_the_stamps(
    stamp_s: list[float], log_s: list[float], known_s: list[float]
) -> None:
    stamp_ns, log_ns, known_ns = (np.rint(np.array(s) * 1e9).astype(np.int64) for s in (stamp_s, log_s, known_s))
    assert earliest_known_times_ns(stamp_ns, log_ns).tolist() == known_ns.tolist()
    for n in range(len(stamp_ns)):  # what comes later changes nothing
        assert earliest_known_times_ns(stamp_ns[:n], log_ns[:n]).tolist() == known_ns[:n].tolist()
