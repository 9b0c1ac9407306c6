"""The time of a receiver: GPS week and time of week, or a calendar date in UTC, as nanoseconds since 1970.

GPS time has no leap seconds: it runs ahead of UTC by one more second after each of `LEAP_SECOND_INSTANTS_UNIX_S` (18 s
since 2017).
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.clocks import MAX_STAMP_NS, MIN_STAMP_NS
from cwcli.signals.columns import BoolArray, FloatArray, Int64Array, StampsNsAndIsGiven
from cwcli.signals.quality import RowLedger
from cwcli.signals.units import NS_PER_MS, NS_PER_S

GPS_EPOCH_UNIX_S = 315_964_800
"""The start of GPS time, 1980-01-06T00:00:00Z, in seconds since 1970."""
SECONDS_PER_WEEK = 604_800
"""The length of a week, in seconds."""
WEEKS_PER_ROLLOVER = 1024
"""The number of weeks after which a ten-bit week number starts again (19.6 years)."""
MAX_RECORDER_CLOCK_ERROR_FOR_WEEK_ROLLOVER_S = 86_400
"""The largest error of the recorder's clock, in seconds, with which it still resolves the week number's rollover;
chosen by hand."""
LEAP_SECOND_INSTANTS_UNIX_S: Int64Array = np.array(
    [
        *("1981-07-01", "1982-07-01", "1983-07-01", "1985-07-01", "1988-01-01", "1990-01-01", "1991-01-01"),
        *("1992-07-01", "1993-07-01", "1994-07-01", "1996-01-01", "1997-07-01", "1999-01-01", "2006-01-01"),
        *("2009-01-01", "2012-07-01", "2015-07-01", "2017-01-01"),
    ],
    dtype="M8[s]",
).astype(np.int64)
"""The instants from which UTC is one more second behind GPS time, in seconds since 1970 (IERS Bulletin C)."""
WEEK_ROLLOVER_REASON = "GPS week rolled over, moved by 1024 weeks"
"""The reason for a repair: a stamp is moved by whole rollovers of the week number."""


def utc_ns_and_is_time_from_gps_weeks(
    ledger: RowLedger, week: FloatArray, time_of_week_ms: FloatArray, is_wanted: BoolArray
) -> StampsNsAndIsGiven:
    """Return UTC (ns) of GPS weeks and times of week, with the week number's rollover undone.

    Args:
        week: Shape (n,), counted since 1980 or modulo 1024.
        time_of_week_ms: Shape (n,).
        is_wanted: Shape (n,): the others are no time.

    Returns:
        Nanoseconds since 1970 and whether they are a time, both (n,).
    """
    is_time: BoolArray = is_wanted & (week >= 0) & (week < 1 << 13)
    is_time &= (time_of_week_ms >= 0) & (time_of_week_ms < SECONDS_PER_WEEK * 1000)
    whole = np.where(is_time, week, 0.0).astype(np.int64)
    in_week_ns = np.round(np.where(is_time, time_of_week_ms, 0.0) * NS_PER_MS).astype(np.int64)
    # before the leap seconds: those of a week 1024 too early are fewer
    gps_ns = undo_week_rollover(ledger, (GPS_EPOCH_UNIX_S + SECONDS_PER_WEEK * whole) * NS_PER_S + in_week_ns, is_time)
    return utc_ns_from_gps_unix_ns(gps_ns), is_time


def utc_ns_from_gps_unix_ns(gps_unix_ns: Int64Array) -> Int64Array:
    """Return UTC of GPS time, (n,), both in nanoseconds since 1970."""
    # the n-th leap second has passed once GPS time, n seconds ahead, is beyond it
    passed_ns = (LEAP_SECOND_INSTANTS_UNIX_S + np.arange(1, len(LEAP_SECOND_INSTANTS_UNIX_S) + 1)) * NS_PER_S
    utc_ns: Int64Array = gps_unix_ns - np.searchsorted(passed_ns, gps_unix_ns, side="right") * NS_PER_S
    return utc_ns


def utc_ns_and_is_time_from_date(
    year: FloatArray, month: FloatArray, day: FloatArray, seconds_of_day: FloatArray, nano: FloatArray
) -> StampsNsAndIsGiven:
    """Return UTC (ns) of a calendar date, whole seconds of the day, and a fraction that may be negative.

    Args:
        year, month, day, seconds_of_day, nano: Shape (n,).

    Returns:
        Nanoseconds since 1970 and whether they are a time, both (n,).
    """
    limits = ((year, 1970, 2261), (month, 1, 12), (day, 1, 31), (seconds_of_day, 0, 86_400), (nano, -1e9, 1e9))
    is_time: BoolArray = np.logical_and.reduce([(low <= value) & (value <= high) for value, low, high in limits])
    years, months, days, seconds, nanos = (
        np.where(is_time, value, filler).astype(np.int64)
        for value, filler in ((year, 1970), (month, 1), (day, 1), (seconds_of_day, 0), (nano, 0))
    )
    first = ((years - 1970) * 12 + months - 1).astype("M8[M]")
    date = first.astype("M8[D]") + (days - 1)
    is_time &= date.astype("M8[M]") == first  # no 31st of February
    stamp_ns = date.astype("M8[s]").astype(np.int64) * NS_PER_S + seconds * NS_PER_S + nanos
    return stamp_ns, is_time & (stamp_ns >= MIN_STAMP_NS) & (stamp_ns <= MAX_STAMP_NS)


def undo_week_rollover(ledger: RowLedger, stamp_ns: Int64Array, is_time: BoolArray) -> Int64Array:
    """Return the stamps (n,) in ns, moved by whole rollovers of the GPS week towards the log time; moved ones are
    counted.

    A stamp is moved only where the log time then agrees: a recorder whose clock was never set is no reference.
    """
    round_ns = WEEKS_PER_ROLLOVER * SECONDS_PER_WEEK * NS_PER_S
    behind_ns = ledger.columns.log_time_ns - stamp_ns
    n_rounds = np.round(behind_ns / round_ns).astype(np.int64)
    is_moved = (
        is_time
        & (n_rounds != 0)
        & (np.abs(behind_ns - n_rounds * round_ns) < MAX_RECORDER_CLOCK_ERROR_FOR_WEEK_ROLLOVER_S * NS_PER_S)
    )
    ledger.count_repaired(is_moved, WEEK_ROLLOVER_REASON)
    return np.where(is_moved, stamp_ns + n_rounds * round_ns, stamp_ns)
