"""Absolute time of V2X messages: minutes, 65.536 s periods, leap seconds, and when not to believe them."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest

from cwcli.signals.quality import RowLedger
from cwcli.signals.v2x_time import (
    CLOCK_DISAGREES_REASON,
    NO_TIME_REASON,
    its_ms_from_unix_ns,
    message_times_or_log_times_ns,
    stamps_ns_and_validity_from_dsecond,
    stamps_ns_and_validity_from_generation_delta_time,
)
from tests.unit.signals.signal_columns import columns_of

MS = 1_000_000


def ns(text: str) -> int:
    return int(datetime.fromisoformat(text).replace(tzinfo=UTC).timestamp() * 1000) * MS


@pytest.mark.parametrize(
    ("dsecond_ms", "log_time", "expected"),
    [
        pytest.param(12_120, "2025-02-11T15:32:12.200", "2025-02-11T15:32:12.120", id="same-minute"),
        pytest.param(59_900, "2025-02-11T15:33:00.050", "2025-02-11T15:32:59.900", id="sent-before-the-minute"),
        pytest.param(20, "2025-02-11T15:32:59.990", "2025-02-11T15:33:00.020", id="sender-clock-ahead-over-the-minute"),
        pytest.param(0, "2025-02-11T00:00:00.100", "2025-02-11T00:00:00.000", id="zero-is-a-time"),
        pytest.param(60_500, "2017-01-01T00:00:00.600", "2017-01-01T00:00:00.500", id="leap-second"),
    ],
)
def test_stamp_from_dsecond_by_hand(dsecond_ms: int, log_time: str, expected: str) -> None:
    stamp_ns, has_time = stamps_ns_and_validity_from_dsecond(np.array([float(dsecond_ms)]), np.array([ns(log_time)]))
    assert has_time[0]
    assert stamp_ns[0] == ns(expected)


@pytest.mark.parametrize("dsecond_ms", [65_535.0, 61_000.0, 65_534.0, -1.0, np.nan])
def test_stamp_from_dsecond_unavailable_or_reserved_is_no_time(dsecond_ms: float) -> None:
    _, has_time = stamps_ns_and_validity_from_dsecond(np.array([dsecond_ms]), np.array([ns("2025-02-11T15:32:12")]))
    assert not has_time[0]


@pytest.mark.parametrize(
    ("utc", "seconds_since_2004"),
    [
        # (days since 2004-01-01) * 86400, plus the leap seconds so far
        pytest.param("2004-01-01T00:00:00", 0, id="epoch"),
        pytest.param("2005-12-31T23:59:59", 731 * 86_400 - 1, id="before-the-first"),
        pytest.param("2006-01-01T00:00:00", 731 * 86_400 + 1, id="after-2005-12-31"),
        pytest.param("2009-01-01T00:00:00", 1827 * 86_400 + 2, id="after-2008-12-31"),
        pytest.param("2012-07-01T00:00:00", 3104 * 86_400 + 3, id="after-2012-06-30"),
        pytest.param("2015-07-01T00:00:00", 4199 * 86_400 + 4, id="after-2015-06-30"),
        pytest.param("2017-01-01T00:00:00", 4749 * 86_400 + 5, id="after-2016-12-31"),
    ],
)
def test_its_time_counts_the_leap_seconds(utc: str, seconds_since_2004: int) -> None:
    assert its_ms_from_unix_ns(np.array([ns(utc)]))[0] == seconds_since_2004 * 1000


def test_its_time_of_the_data_dictionary_s_example() -> None:
    # ETSI TS 102 894-2, TimestampIts: 2007-01-01T00:00:00.000 UTC is 94 694 401 000 ms
    assert its_ms_from_unix_ns(np.array([ns("2007-01-01T00:00:00")]))[0] == 94_694_401_000


@pytest.mark.parametrize("age_ms", [-2000, 0, 5, 300, 30_000])
def test_stamp_from_generation_delta_time_undoes_the_modulus(age_ms: int) -> None:
    log_ns = np.arange(ns("2019-10-08T08:07:10"), ns("2019-10-08T08:09:30"), 777 * MS)
    sent_ms = log_ns // MS - age_ms
    # by hand: days from 2004-01-01 to 2019-10-08 are 5759, and 5 leap seconds
    its_ms = sent_ms - ns("2019-10-08T00:00:00") // MS + (5759 * 86_400 + 5) * 1000
    stamp_ns, has_time = stamps_ns_and_validity_from_generation_delta_time((its_ms % 65_536).astype(np.float64), log_ns)
    assert has_time.all()
    np.testing.assert_array_equal(stamp_ns, sent_ms * MS)


def test_or_log_time_counts_what_it_does_not_believe() -> None:
    log_ns = np.array([10_000, 20_000, 30_000, 40_000], dtype=np.int64) * MS
    ledger = RowLedger(columns_of("X", {"a": [1.0] * 4}, log_time_ns=log_ns), "remote")
    stamp_ns = log_ns + np.array([-100, -5001, 5001, 0]) * MS
    settled = message_times_or_log_times_ns(ledger, stamp_ns, np.array([True, True, True, False]))
    assert settled.tolist() == [log_ns[0] - 100 * MS, log_ns[1], log_ns[2], log_ns[3]]
    assert ledger.quality.repaired == {NO_TIME_REASON: 1, CLOCK_DISAGREES_REASON: 2}
