"""Absolute times of V2X messages, which carry only the last part of a time.

A BSM has the milliseconds of the UTC minute (SAE J2735, DE_DSecond), a CAM the milliseconds of TAI since 2004 modulo
65,536 (ETSI EN 302 637-2, generationDeltaTime). The log time says which minute, which 65.536 s.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.columns import BoolArray, FloatArray, Int64Array
from cwcli.signals.quality import RowLedger
from cwcli.signals.units import NS_PER_MS, NS_PER_S

ITS_EPOCH_UNIX_S = 1_072_915_200
"""The start of ITS time, 2004-01-01T00:00:00 UTC, in seconds since 1970."""
LEAP_SECONDS_SINCE_2004_UNIX_S = (1_136_073_600, 1_230_768_000, 1_341_100_800, 1_435_708_800, 1_483_228_800)
"""The first instants after each leap second, in seconds since 1970: 2006-01-01, 2009-01-01, 2012-07-01, 2015-07-01,
2017-01-01 (IERS Bulletin C)."""
GENERATION_TIME_MODULUS_MS = 65_536
"""The period after which a generationDeltaTime repeats, in ms (EN 302 637-2)."""
MAX_TIMESTAMP_ITS_MS = 1 << 42
"""The number of values of a TimestampIts, in ms (TS 102 894-2)."""
MS_PER_MINUTE = 60_000
"""The milliseconds in a minute."""
MAX_DSECOND_MS = 60_999
"""The largest valid DE_DSecond, in ms: 60,000 to 60,999 is a leap second, 61,000 to 65,534 reserved, 65,535 unavailable
(SAE J2735)."""
MAX_CLOCK_DISAGREEMENT_S = 5.0
"""The largest difference between message time and log time that is believed, in seconds. Chosen by hand; not fitted."""

NO_TIME_REASON = "no message time, log time used"
"""The reason for a repair: a message without a time takes its log time."""
CLOCK_DISAGREES_REASON = "message clock disagrees with log time, log time used"
"""The reason for a repair: a message whose clock disagrees with the log time takes its log time."""


def stamps_ns_and_validity_from_dsecond(
    dsecond_ms: FloatArray, log_time_ns: Int64Array
) -> tuple[Int64Array, BoolArray]:
    """Return the absolute time of a BSM: the instant with this millisecond of a UTC minute that is nearest to the log
    time.

    A leap second (60,000 and up) counts into the next minute, as UTC clocks without leap seconds do.

    Args:
        dsecond_ms: Shape (n,), codes of DE_DSecond, NaN where absent.
        log_time_ns: Shape (n,).

    Returns:
        Times in ns and whether there is one, both of shape (n,).
    """
    has_time = (dsecond_ms >= 0) & (dsecond_ms <= MAX_DSECOND_MS)
    log_ms = log_time_ns // NS_PER_MS
    ahead_ms = np.where(has_time, dsecond_ms, 0).astype(np.int64) - log_ms % MS_PER_MINUTE
    return (log_ms + _wrap_difference_to_half_modulus_ms(ahead_ms, MS_PER_MINUTE)) * NS_PER_MS, has_time


def stamps_ns_and_validity_from_generation_delta_time(
    delta_ms: FloatArray, log_time_ns: Int64Array
) -> tuple[Int64Array, BoolArray]:
    """Return the absolute time of a CAM: the instant with this generationDeltaTime that is nearest to the log time.

    Args:
        delta_ms: Shape (n,), 0 to 65,535, NaN where absent.
        log_time_ns: Shape (n,).

    Returns:
        Times in ns and whether there is one, both of shape (n,).
    """
    has_time = (delta_ms >= 0) & (delta_ms < GENERATION_TIME_MODULUS_MS)
    log_ms = log_time_ns // NS_PER_MS
    its_ms = its_ms_from_unix_ns(log_time_ns)
    ahead_ms = np.where(has_time, delta_ms, 0).astype(np.int64) - its_ms % GENERATION_TIME_MODULUS_MS
    return (log_ms + _wrap_difference_to_half_modulus_ms(ahead_ms, GENERATION_TIME_MODULUS_MS)) * NS_PER_MS, has_time


def stamps_ns_and_validity_from_timestamp_its(
    its_ms: FloatArray, log_time_ns: Int64Array
) -> tuple[Int64Array, BoolArray]:
    """Return the absolute time of milliseconds of TAI since 2004 (TimestampIts); the log time gives the leap seconds.

    Args:
        its_ms: Shape (n,), NaN where absent.
        log_time_ns: Shape (n,).

    Returns:
        Times in ns and whether there is one, both of shape (n,).
    """
    has_time = (its_ms >= 0) & (its_ms < MAX_TIMESTAMP_ITS_MS)
    ahead_ms = np.where(has_time, its_ms, 0).astype(np.int64) - its_ms_from_unix_ns(log_time_ns)
    return (log_time_ns // NS_PER_MS + ahead_ms) * NS_PER_MS, has_time


def its_ms_from_unix_ns(unix_ns: Int64Array) -> Int64Array:
    """Return the milliseconds of TAI since 2004-01-01T00:00:00 UTC (TimestampIts), shape (n,)."""
    leap_s = np.searchsorted(np.array(LEAP_SECONDS_SINCE_2004_UNIX_S) * NS_PER_S, unix_ns, side="right")
    return (unix_ns - ITS_EPOCH_UNIX_S * NS_PER_S) // NS_PER_MS + 1000 * leap_s.astype(np.int64)


def message_times_or_log_times_ns(ledger: RowLedger, stamp_ns: Int64Array, has_time: BoolArray) -> Int64Array:
    """Return the message times (n,) in ns where they can be used, else the log times, which are counted.

    A message clock that is more than `MAX_CLOCK_DISAGREEMENT_S` from the log time is not used: the age that it would
    say is beyond what a V2X link has, and beyond what the wrapped time can tell.
    """
    log_ns = ledger.columns.log_time_ns
    disagrees = has_time & (np.abs(stamp_ns - log_ns) > MAX_CLOCK_DISAGREEMENT_S * NS_PER_S)
    ledger.count_repaired(~has_time, NO_TIME_REASON)
    ledger.count_repaired(disagrees, CLOCK_DISAGREES_REASON)
    return np.where(has_time & ~disagrees, stamp_ns, log_ns)


def _wrap_difference_to_half_modulus_ms(difference_ms: Int64Array, modulus_ms: int) -> Int64Array:
    """Add whole turns so that the difference lies in [-modulus / 2, modulus / 2)."""
    half = modulus_ms // 2
    return (difference_ms + half) % modulus_ms - half
