"""Clocks: from the stamps that messages carry to one increasing time per row, with every repair counted.

Before any channel is looked at, the few messages of the log that were logged far from all others (a clock that was not
set yet, a broken record) are taken out: `first_and_last_log_time_without_strays`.

The rules, in order, for the rows of one sender (docs/signals.md has the table):

0. A row whose log time is no time (an unsigned number that was meant to be negative) is rejected.
1. A row without a stamp (zero, not a number, before 1970 or after 2261) takes its log time, less the channel's usual
   delay where other rows have one.
2. A stamp that jumps by more than `MAX_FAULTLESS_STEP_OF_STAMP_OFFSET_S` against the log time while that runs on
   has left its clock. The rows of that stretch are moved back onto the clock that most rows keep, with their spacing.
3. A stamp that repeats with the same values is the same message: dropped. With other values (a clock of one second for
   a ten-hertz sensor, a frozen clock) the later rows are spaced by their log times after the first.
4. Rows that arrive out of order are sorted by stamp.
5. What still shares a stamp cannot be placed in time: the first that arrived stays, the others are rejected.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Literal, TypeVar

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import BoolArray, FirstAndLastNs, FloatArray, Int64Array, median_of_values
from cwcli.signals.quality import Gap, Quality, RowLedger
from cwcli.signals.units import NS_PER_S, S_PER_NS

Clock = Literal["stamp", "log"]
SignalT = TypeVar("SignalT")
"""The type of a signal."""

MAX_FAULTLESS_STEP_OF_STAMP_OFFSET_S = 30.0
"""The largest change of (stamp - log time) between neighbours that counts as a delay, in seconds; a larger one is a
clock fault. Recorders stall for seconds and receivers step from GPS time to UTC by 18 s; both stay below."""
MIN_STAMP_TO_LOG_TIME_OFFSET_OF_TWO_CLOCKS_S = 1.0
"""The difference of stamps and log times, in seconds, from which they count as two clocks: no system is so slow. Chosen
by hand."""
MIN_RATIO_OF_STRAY_LOG_TIME_GAP_TO_LONGEST_PAUSE = 10
"""The ratio (1) to the longest pause within the rest of the log by which a stray lies apart, and at least by
`MAX_FAULTLESS_STEP_OF_STAMP_OFFSET_S`; chosen by hand, so that rarely logged messages are no strays."""
MIN_MESSAGES_PER_STRAY_LOG_TIME_AT_LOG_END = 100
"""The number of messages for each stray that is allowed at either end of a log (one in a short log); chosen by hand."""
MIN_STAMP_NS = 1
"""The smallest valid stamp, in ns since 1970; 0 means that it is not set."""
MAX_STAMP_NS = 9_200_000_000 * NS_PER_S
"""The largest valid stamp, in ns since 1970: in the year 2261, before a signed 64-bit number overflows."""

STRAY_LOG_TIME_REASON = "log time far from the rest of the log"
"""The reason for rejecting a message that was logged far from the rest of the log."""
INVALID_LOG_TIME_REASON = "log time before 1970 or after 2261"
"""The reason for rejecting a message whose log time is no time."""
NO_STAMP_REASON = "no stamp, log time used"
"""The reason for a repair: a message without a stamp takes its log time."""
CLOCK_JUMP_REASON = "stamp jumps, moved back by log time"
"""The reason for a repair: a stretch whose clock jumped is moved back."""
REPEATED_STAMP_SPACED_REASON = "repeated stamp, spaced by log time"
"""The reason for a repair: messages that repeat a stamp are spaced by their log times."""
OUT_OF_ORDER_REASON = "out of order, sorted"
"""The reason for a repair: a message that arrived late is sorted by its stamp."""
DUPLICATE_REASON = "duplicate message"
"""The reason for rejecting a message that repeats another one's stamp and values."""
REPEATED_STAMP_REASON = "repeated stamp with other values"
"""The reason for rejecting a message that shares a stamp and can't be placed in time."""


@dataclass(frozen=True)
class Timeline:
    """Rows of a channel in time order.

    Attributes:
        rows: Shape (m,), indices into the channel's rows.
        stamp_ns: Shape (m,), strictly increasing for one sender.
    """

    rows: npt.NDArray[np.intp]
    stamp_ns: Int64Array


def build_signal_and_quality(
    signal_class: Callable[..., SignalT], ledger: RowLedger, timeline: Timeline, **quantities: FloatArray
) -> tuple[SignalT, Quality]:
    """Return the signal of the rows in use and the account of all.

    Args:
        signal_class: Makes the signal from its source, its times and its quantities.
        quantities: One row for each of the channel's n messages.
    """
    rows, columns = timeline.rows, ledger.columns
    values = {name: each[rows] for name, each in quantities.items()}
    times = {"stamp_ns": timeline.stamp_ns, "log_time_ns": columns.log_time_ns[rows]}
    return signal_class(source=columns.topic, **times, **values), ledger.quality


def repair_and_order_times(
    ledger: RowLedger,
    stamp_ns: Int64Array,
    has_stamp: BoolArray,
    clock: Clock,
    values_to_detect_repeats: Sequence[FloatArray],
    *,
    sender: npt.NDArray[np.integer] | None = None,
    max_step_s: float = MAX_FAULTLESS_STEP_OF_STAMP_OFFSET_S,
) -> Timeline:
    """Give each kept row of a channel its time, in order, and count what was repaired or rejected.

    Args:
        ledger: The channel's ledger; rows already rejected take no part. Fills `quality.used` and `quality.delay_s`.
        stamp_ns: Shape (n,), the stamps of all rows of the channel; any value where `has_stamp` is false.
        has_stamp: Shape (n,).
        clock: `stamp`, or `log` to use the log time throughout (steps 3 to 5 still apply).
        values_to_detect_repeats: Arrays of n rows that tell a repeated message from a new one.
        sender: Shape (n,): a code per row; each sender has a clock of its own. None means one sender.
        max_step_s: See `MAX_FAULTLESS_STEP_OF_STAMP_OFFSET_S`.

    Returns:
        The rows that remain, sorted by time (by time, then file order, over all senders).
    """
    log_ns = ledger.columns.log_time_ns
    ledger.reject((log_ns < 0) | (log_ns > MAX_STAMP_NS), INVALID_LOG_TIME_REASON)
    time_ns = log_ns.copy() if clock == "log" else np.where(has_stamp, stamp_ns, 0).astype(np.int64)
    has_time = np.ones(len(log_ns), dtype=np.bool_) if clock == "log" else has_stamp
    table = _stack_value_columns(values_to_detect_repeats, len(log_ns))
    parts = [
        _repair_sender_times_and_return_kept_rows(ledger, rows, time_ns, has_time, table, max_step_s)
        for rows in _kept_rows_of_each_sender(ledger, sender)
    ]
    rows = np.concatenate(parts) if parts else np.zeros(0, dtype=np.intp)
    rows = rows[np.lexsort((rows, time_ns[rows]))]
    stamps = time_ns[rows]
    ledger.quality.used = len(rows)
    if len(rows):
        ledger.quality.delay_s = median_of_values(log_ns[rows] - stamps) * S_PER_NS
        ledger.quality.gaps = find_stamp_gaps(stamps)
    return Timeline(rows=rows, stamp_ns=stamps)


def first_and_last_log_time_without_strays(log_time_ns: Sequence[Int64Array]) -> FirstAndLastNs:
    """Return the first and last log time (ns) of a log without its strays.

    A stray is a message before or after all others, alone or with a few more, and far away: see
    `MIN_RATIO_OF_STRAY_LOG_TIME_GAP_TO_LONGEST_PAUSE` and `MIN_MESSAGES_PER_STRAY_LOG_TIME_AT_LOG_END`. Its log time is
    no time of the drive, so step 2 would move a good stamp onto a bad clock.

    Args:
        log_time_ns: The log times of each channel, in order; read as the unsigned numbers that a log holds.

    Returns:
        Both in ns, inclusive; (0, 0) where there is no message.
    """
    times = np.sort(np.concatenate([np.zeros(0, np.int64), *log_time_ns]).view(np.uint64))
    n = len(times)
    if not n:
        return 0, 0
    most = min(max(1, n // MIN_MESSAGES_PER_STRAY_LOG_TIME_AT_LOG_END), (n - 1) // 2)
    pause_ns = np.diff(times)
    within_ns = int(pause_ns[most : n - 1 - most].max(initial=0))
    is_apart = pause_ns > max(
        round(MAX_FAULTLESS_STEP_OF_STAMP_OFFSET_S * NS_PER_S),
        MIN_RATIO_OF_STRAY_LOG_TIME_GAP_TO_LONGEST_PAUSE * within_ns,
    )
    before, after = np.flatnonzero(is_apart[:most]), np.flatnonzero(is_apart[n - 1 - most :])
    first = int(before[-1]) + 1 if len(before) else 0
    last = n - 1 - most + int(after[0]) if len(after) else n - 1
    return int(times[first]), int(times[last])


def find_stamp_gaps(
    stamp_ns: Int64Array | npt.NDArray[np.uint64],
    *,
    start_ns: int | None = None,
    end_ns: int | None = None,
    min_gap_s: float | None = None,
) -> tuple[Gap, ...]:
    """List the stretches without data.

    Args:
        stamp_ns: Shape (n,), non-decreasing; log times may need all 64 bits of an unsigned number.
        start_ns, end_ns: The log's first and last time: a channel that starts late or dies early then has a gap there.
        min_gap_s: Shortest gap to list; None means five median intervals, but at least one second.

    Returns:
        Gaps in time order.
    """
    if len(stamp_ns) == 0:
        return (Gap(start_ns, end_ns),) if start_ns is not None and end_ns is not None and end_ns > start_ns else ()
    if min_gap_s is None:
        median_s = median_of_values(np.diff(stamp_ns)) * S_PER_NS if len(stamp_ns) > 1 else 0.0
        min_gap_s = max(1.0, 5.0 * median_s)
    long_steps = np.flatnonzero(np.diff(stamp_ns) * S_PER_NS > min_gap_s)
    gaps = [Gap(int(stamp_ns[i]), int(stamp_ns[i + 1])) for i in long_steps]
    first_ns, last_ns = int(stamp_ns[0]), int(stamp_ns[-1])
    before = Gap(first_ns if start_ns is None else min(start_ns, first_ns), first_ns)
    after = Gap(last_ns, last_ns if end_ns is None else max(end_ns, last_ns))
    return tuple(gap for gap in (before, *gaps, after) if gap.duration_s > min_gap_s)


def lines_on_channels_with_other_clock(
    qualities: Sequence[Quality], *, tolerance_s: float = MAX_FAULTLESS_STEP_OF_STAMP_OFFSET_S
) -> tuple[str, ...]:
    """Return a line for each channel whose stamps count from another epoch than the others' (a time since boot, not
    UTC).

    Returns:
        One line for each channel that is not with the majority, with its offset; () when all agree.
    """
    delays = [quality.delay_s for quality in qualities if np.isfinite(quality.delay_s)]
    if not delays:
        return ()
    usual_s = float(np.sort(delays)[(len(delays) - 1) // 2])
    return tuple(
        f"{quality.source}: stamps are {usual_s - quality.delay_s:+.1f} s from other channels' stamps (try --clock log)"
        for quality in qualities
        if np.isfinite(quality.delay_s) and abs(quality.delay_s - usual_s) > tolerance_s
    )


def repaired_stamps_and_moved_mask(
    stamp_ns: Int64Array, log_time_ns: Int64Array, *, max_step_s: float = MAX_FAULTLESS_STEP_OF_STAMP_OFFSET_S
) -> tuple[Int64Array, BoolArray]:
    """Move stretches whose clock has jumped back onto the clock that most rows keep.

    A stretch begins where (stamp - log time) changes by more than `max_step_s` and the stamp itself did not simply run
    on (then it was the log time that jumped). A stretch is moved when its median offset is more than `max_step_s` from
    the median offset of all rows.

    Args:
        stamp_ns, log_time_ns: Shape (n,), in log-time order.

    Returns:
        The stamps, shape (n,), and which of them were moved, shape (n,).
    """
    max_step_ns = int(max_step_s * NS_PER_S)
    is_moved = np.zeros(len(stamp_ns), dtype=np.bool_)
    if len(stamp_ns) < 2:
        return stamp_ns, is_moved
    offset_ns = stamp_ns - log_time_ns
    step_ns = np.diff(stamp_ns)
    runs_on = (step_ns >= 0) & (step_ns <= max_step_ns)
    is_boundary = (np.abs(np.diff(offset_ns)) > max_step_ns) & ~runs_on
    if not is_boundary.any():
        return stamp_ns, is_moved
    starts = np.concatenate([[0], np.flatnonzero(is_boundary) + 1, [len(stamp_ns)]])
    usual_ns = _lower_median(offset_ns)
    repaired_ns = stamp_ns.copy()
    for start, end in pairwise(starts):
        shift_ns = usual_ns - _lower_median(offset_ns[start:end])
        if abs(shift_ns) > max_step_ns:
            repaired_ns[start:end] += shift_ns
            is_moved[start:end] = True
    return repaired_ns, is_moved


def _repair_sender_times_and_return_kept_rows(
    ledger: RowLedger,
    rows: npt.NDArray[np.intp],
    time_ns: Int64Array,
    has_time: BoolArray,
    compared_values: FloatArray,
    max_step_s: float,
) -> npt.NDArray[np.intp]:
    """Apply steps 1 to 5 to one sender: write the times into `time_ns`, return the rows that stay, in time order."""
    log_ns = ledger.columns.log_time_ns[rows]
    stamp_ns = time_ns[rows]
    row_has_time = has_time[rows]

    delay_ns = _lower_median(log_ns[row_has_time] - stamp_ns[row_has_time]) if row_has_time.any() else 0
    if abs(delay_ns) > max_step_s * NS_PER_S and 2 * np.count_nonzero(row_has_time) <= len(row_has_time):
        delay_ns = 0  # a few stamps of another epoch say nothing about the rest
    stamp_ns = np.where(row_has_time, stamp_ns, log_ns - delay_ns)
    ledger.count_repaired_rows(rows[~row_has_time], NO_STAMP_REASON)

    stamp_ns, is_moved = repaired_stamps_and_moved_mask(stamp_ns, log_ns, max_step_s=max_step_s)
    ledger.count_repaired_rows(rows[is_moved], CLOCK_JUMP_REASON)

    repeats = np.flatnonzero(np.diff(stamp_ns) == 0) + 1
    is_duplicate = np.zeros(len(rows), dtype=np.bool_)
    is_duplicate[repeats] = _equal_rows_mask(compared_values[rows[repeats]], compared_values[rows[repeats - 1]])
    ledger.reject_rows(rows[is_duplicate], DUPLICATE_REASON)
    rows, stamp_ns, log_ns = rows[~is_duplicate], stamp_ns[~is_duplicate], log_ns[~is_duplicate]

    is_repeat = np.concatenate([[False], np.diff(stamp_ns) == 0]) if len(rows) else np.zeros(0, dtype=np.bool_)
    if is_repeat.any():
        first = np.maximum.accumulate(np.where(is_repeat, 0, np.arange(len(rows))))
        spaced_ns = stamp_ns[first] + (log_ns - log_ns[first])
        is_spaced = is_repeat & (spaced_ns > stamp_ns[first])
        stamp_ns = np.where(is_spaced, spaced_ns, stamp_ns)
        ledger.count_repaired_rows(rows[is_spaced], REPEATED_STAMP_SPACED_REASON)

    if len(rows):
        latest_ns = np.maximum.accumulate(stamp_ns)
        ledger.count_repaired_rows(rows[stamp_ns < latest_ns], OUT_OF_ORDER_REASON)
    order = np.argsort(stamp_ns, kind="stable")
    rows, stamp_ns = rows[order], stamp_ns[order]
    time_ns[rows] = stamp_ns

    is_repeat = np.concatenate([[False], np.diff(stamp_ns) == 0]) if len(rows) else np.zeros(0, dtype=np.bool_)
    if is_repeat.any():
        first = np.maximum.accumulate(np.where(is_repeat, 0, np.arange(len(rows))))
        is_same = is_repeat & _equal_rows_mask(compared_values[rows], compared_values[rows[first]])
        ledger.reject_rows(rows[is_same], DUPLICATE_REASON)
        ledger.reject_rows(rows[is_repeat & ~is_same], REPEATED_STAMP_REASON)
        rows = rows[~is_repeat]
    return rows


def _kept_rows_of_each_sender(ledger: RowLedger, sender: npt.NDArray[np.integer] | None) -> list[npt.NDArray[np.intp]]:
    rows = ledger.kept_rows
    if not len(rows):
        return []
    if sender is None:
        return [rows]
    order = np.argsort(sender[rows], kind="stable")
    grouped = rows[order]
    edges = np.flatnonzero(np.diff(sender[grouped])) + 1
    return np.split(grouped, edges)


def earliest_known_times_ns(stamp_ns: Int64Array, log_time_ns: Int64Array) -> Int64Array:
    """Return when rows could have been known, on the clock of their stamps, in ns, (n,).

    That is their log time, but not before their stamp nor before what came earlier was known. Where the least
    difference of log time and stamp so far is above `MIN_STAMP_TO_LOG_TIME_OFFSET_OF_TWO_CLOCKS_S`, these are two
    clocks, and it is taken off: what was always late by as much does not show. It is the least so far, because a moment
    may not depend on what comes later.

    Args:
        stamp_ns, log_time_ns: Shape (n,), by stamp.
    """
    known_ns = np.maximum.accumulate(log_time_ns)
    least_ns = np.minimum.accumulate(known_ns - stamp_ns)
    apart_ns = np.where(np.abs(least_ns) > MIN_STAMP_TO_LOG_TIME_OFFSET_OF_TWO_CLOCKS_S * NS_PER_S, least_ns, 0)
    return np.asarray(np.maximum.accumulate(np.maximum(known_ns - apart_ns, stamp_ns)))


def _stack_value_columns(values: Sequence[FloatArray], n_rows: int) -> FloatArray:
    """Return the values side by side, shape (n, k)."""
    if not values:
        return np.zeros((n_rows, 0))
    columns = [value if value.ndim == 2 else value[:, None] for value in values]
    return np.concatenate(columns, axis=1).astype(np.float64)


def _equal_rows_mask(first_rows: FloatArray, second_rows: FloatArray) -> BoolArray:
    same: BoolArray = np.all((first_rows == second_rows) | (np.isnan(first_rows) & np.isnan(second_rows)), axis=1)
    return same


def _lower_median(values: Int64Array) -> int:
    """Return the median, or the lower of the two middle values, so that it is always one of the values."""
    middle = (len(values) - 1) // 2
    return int(np.partition(values, middle)[middle])
