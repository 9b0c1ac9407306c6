"""The time base of a table: numbers since 1970, since the GPS epoch or since the start; dates with and without a zone.

Nothing is assumed that would move a log silently: a date without a zone, and an order of day and month that no cell
tells, are questions.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np

from cwcli.errors import UsageError
from cwcli.importing.cells import ArrowArray, trimmed_texts_or_null
from cwcli.importing.units import FACTOR_BY_KIND_AND_UNIT
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import BoolArray, FloatArray, Int64Array
from cwcli.signals.gnss_time import GPS_EPOCH_UNIX_S, SECONDS_PER_WEEK, utc_ns_from_gps_unix_ns
from cwcli.signals.units import NS_PER_S

MAX_STAMP_NS = (2**31 - 1) * NS_PER_S
"""The last second of ROS 2 stamps, in January 2038, in ns since 1970 (builtin_interfaces/msg/Time)."""
MAX_ZONE_OFFSET_S = 15 * 3600
"""Greatest offset of a time zone from UTC, s: an hour more than the 14 of the IANA tz database."""
FIRST_LIKELY_UNIX_TIME_S, LAST_LIKELY_UNIX_TIME_S = 946_684_800, 4_102_444_800
"""Seconds since 1970 of the years 2000 and 2100, between which recordings lie. Chosen by hand."""
APPLE_EPOCH_S, MIN_SECONDS_TAKEN_AS_APPLE_TIME = 978_307_200, 631_152_000
"""Seconds since 1970 of 2001-01-01, from which Apple's systems count (`timeIntervalSinceReferenceDate`), and the least
number that may count from there: January 2021. Chosen by hand."""
MIN_SECONDS_TAKEN_AS_GPS_TIME = 1_000_000_000
"""Seconds since the GPS epoch from which a number is taken as GPS time, September 2011. Chosen by hand: earlier logs of
vehicles hardly exist."""
MIN_LIKELY_ROW_RATE_HZ, MAX_LIKELY_ROW_RATE_HZ = 0.5, 2500.0
"""Least and greatest rate of rows, Hz, of sensors of cars; other rates show that the unit of the time is another one.
Chosen by hand."""

NS_PER_HOUR = 3600 * NS_PER_S
"""Nanoseconds of an hour."""
MIN_HHMMSS_STEP_TO_NEXT_MINUTE = 40
"""Least step of a time of day written as hhmmss to the next minute: from 59 to 100."""
MIN_SHARE_OF_YEAR_MONTH_DAY_DATES = 0.9
"""Least share of dates that begin with the year and whose second number is a month, for the order year, month, day.
Chosen by hand."""
DATE_ORDERS = {"ymd": ("y", "m", "d"), "dmy": ("d", "m", "y"), "mdy": ("m", "d", "y")}
"""Order of a date by its name."""
_CLOCK_REGEX = (
    r"(?P<hour>\d{1,2}):(?P<minute>\d{2})(?::(?P<second>\d{2})(?:[.,:](?P<part>\d{1,9}))?)?"
    r"\s*(?P<half>[AaPp]\.?[Mm]\.?)?"
)
_UTC_OFFSET_PATTERN = r"(?:UTC|GMT)?[+-]\d{2}:?\d{2}|(?:UTC|GMT)?[+-]\d{2}"
_ZONE_REGEX = rf"\s*(?P<zone>Z|z|{_UTC_OFFSET_PATTERN}|UTC|GMT)?"
DATE_PATTERN = r"(?P<a>\d{1,4})(?P<mark>[-/.])(?P<b>\d{1,2})[-/.](?P<c>\d{1,4})"
DATETIME_PATTERN = rf"^{DATE_PATTERN}[T\s,]+{_CLOCK_REGEX}{_ZONE_REGEX}$"
"""A date with a time of day."""
CLOCK_PATTERN = rf"^{_CLOCK_REGEX}{_ZONE_REGEX}$"
"""A time of day."""
ONLY_DATE_PATTERN = rf"^{DATE_PATTERN}$"
"""The pattern of a date without a time of day."""
UNIX_DATE_PATTERN = (
    rf"^[A-Za-z]{{3}} (?P<b>\d{{1,2}}) +(?P<a>\d{{1,2}}) {_CLOCK_REGEX} "
    rf"(?P<zone>{_UTC_OFFSET_PATTERN}|UTC|GMT|Z) (?P<c>\d{{4}})$"
)
"""A date as Unix writes it, with the month as a number: `Tue 11 14 22:13:20 GMT 2023`."""
JOINED_DATETIME_PATTERN = (
    r"^(?P<a>(?:19|20)\d{2})[-_:.]?(?P<b>[01]\d)[-_:.]?(?P<c>[0-3]\d)[T_ -]?"
    rf"(?P<hour>[0-2]\d)[-_:.]?(?P<minute>[0-5]\d)[-_:.]?(?P<second>[0-6]\d)(?:[-_:.,](?P<part>\d{{1,9}}))?{_ZONE_REGEX}$"
)
"""A date with a time of day that begins with the year, with other marks between the parts or none:
`20231114T221320.100Z`, `2023:11:14 22:13:20`, `2023-11-14_22-13-20-100`."""
AMBIGUOUS_ZONE_ABBREVIATION_PATTERN = (
    r"\s+(?:[CEW]ES?T|ME?S?Z|BST|MSK|IST|[AECMP][SD]T|AK[SD]T|HST|[JK]ST|A[ECW][SD]T|NZ[SD]T|SGT|HKT)\b"
)
"""Short names of zones: no certain offsets (CST is used in America and China), so that the zone is a question."""
MONTH_NAME_BEGINNINGS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
MONTH_NAME_PATTERN = rf"(?i)\b({'|'.join(MONTH_NAME_BEGINNINGS)})[a-z]*\b"
"""The name of a month."""
MONTH_NAME_DATE_PATTERNS_AND_YEAR_FIRST_REWRITES = (
    (r"^[A-Za-z]{3,9}, ", ""),
    (r"^([A-Za-z]{3,9})\.? (\d{1,2}),? (\d{4})", r"\3-\1-\2"),
    (r"^(\d{1,2})\.? ([A-Za-z]{3,9})\.?,? (\d{4})", r"\3-\2-\1"),
)
"""Dates with the name of a month (`Tue, 14 Nov 2023`, `November 14, 2023`) and their order as year, month, day."""
SIX_DIGIT_DATE_PATTERN = r"^(?P<a>\d{2})(?P<b>\d{2})(?P<c>\d{2})$"
"""A date of six digits in an order that is not known."""
YEAR_LAST_DATE_PATTERN = r"^(?P<a>[0-3]\d)(?P<b>[0-3]\d)(?P<c>(?:19|20)\d{2})$"
"""A date of eight digits with the year behind day and month."""
EIGHT_DIGIT_DATE_PATTERN = r"^(?P<a>(?:19|20)\d{2})(?P<b>0[1-9]|1[0-2])(?P<c>0[1-9]|[12]\d|3[01])$"
"""A date of eight digits: year, month, day; other numbers of eight digits count milliseconds."""
DATE_PATTERNS = (
    *(DATETIME_PATTERN, UNIX_DATE_PATTERN, JOINED_DATETIME_PATTERN),
    *(CLOCK_PATTERN, ONLY_DATE_PATTERN, EIGHT_DIGIT_DATE_PATTERN),
)
"""The patterns of dates and times of day, in the order in which a text is compared with them."""


@dataclass(frozen=True)
class Instants:
    """Times as they stand in a column of numbers: whole units and a fraction (n,), and whether there is one."""

    whole: Int64Array
    fraction: FloatArray
    valid: BoolArray

    def to_ns(self, unit: str) -> Int64Array:
        """Return nanoseconds (n,); 0 where there is none, and a little more than `MAX_STAMP_NS` for all beyond it."""
        factor = int(FACTOR_BY_KIND_AND_UNIT["time"][unit])
        limit = MAX_STAMP_NS // factor + 1
        whole = np.clip(np.where(self.valid, self.whole, 0), -limit, limit)
        ns: Int64Array = whole * factor + np.rint(np.where(self.valid, self.fraction, 0.0) * factor).astype(np.int64)
        return ns

    def values_or_nan(self) -> FloatArray:
        """Return the numbers as doubles (n,), NaN where there is none."""
        return np.where(self.valid, self.whole + self.fraction, np.nan)


@dataclass(frozen=True)
class TextTimes:
    """Dates and times of day as they stand in a column of texts.

    Attributes:
        parts: Shape (n, 3): the numbers of the date in their order, -1 where there is no date.
        ns_of_day: Shape (n,): nanoseconds since midnight, 0 where there is no time of day.
        offset_s: Shape (n,): the zone's offset from UTC; NaN without a zone.
        valid: Shape (n,).
        mark: Character between the parts of the date, "" without one.
        has_seconds: Whether any time of day has seconds.
    """

    parts: Int64Array
    ns_of_day: Int64Array
    offset_s: FloatArray
    valid: BoolArray
    mark: str
    has_seconds: bool = True

    @property
    def has_date(self) -> bool:
        """Whether there are dates."""
        return bool((self.parts[self.valid] >= 0).any())

    @property
    def has_clock(self) -> bool:
        """Whether there are times of day."""
        return bool(self.ns_of_day.any())


def _with_month_numbers(texts: ArrowArray) -> tuple[Any, bool]:
    """Return texts with numbers in place of the names of months, and whether there were any."""
    import pyarrow.compute as pc

    if not pc.any(pc.match_substring_regex(texts, MONTH_NAME_PATTERN)).as_py():
        return texts, False
    for pattern, order in MONTH_NAME_DATE_PATTERNS_AND_YEAR_FIRST_REWRITES:
        texts = pc.replace_substring_regex(texts, pattern, order)
    for k, name in enumerate(MONTH_NAME_BEGINNINGS, 1):
        texts = pc.replace_substring_regex(texts, rf"(?i)\b{name}[a-z]*\b", f"{k:02d}")
    return texts, True


def times_of_day_from_digits(instants: Instants) -> TextTimes | None:
    """Return times of day written as numbers, hhmmss; None where one is none."""
    whole = instants.whole[instants.valid]
    hour, minute, second = whole // 10_000, whole // 100 % 100, whole % 100
    if not len(whole) or (hour > 23).any() or (minute > 59).any() or (second > 60).any():
        return None
    each = np.where(instants.valid, instants.whole, 0)
    seconds = (each // 10_000 * 60 + each // 100 % 100) * 60 + each % 100
    ns = seconds * NS_PER_S + np.rint(instants.fraction * NS_PER_S).astype(np.int64)
    n = len(each)
    return TextTimes(np.full((n, 3), -1, np.int64), ns, np.full(n, np.nan), instants.valid, "")


def is_clock_of_digits(instants: Instants) -> bool:
    """Tell whether numbers go on from hhmm59 to the next hundred at every minute, as times of day do."""
    whole = instants.whole[instants.valid]
    steps = np.diff(whole)
    at_minute = np.diff(whole // 100) != 0
    if not at_minute.any() or at_minute.all() or times_of_day_from_digits(instants) is None:
        return False
    return bool(
        (np.abs(steps[at_minute]) > MIN_HHMMSS_STEP_TO_NEXT_MINUTE).all() and np.abs(steps[~at_minute]).max() < 60
    )


def parse_short_dates(array: ArrowArray) -> TextTimes | None:
    """Parse dates of six digits, or of eight with the year last; None where a text is neither."""
    import pyarrow.compute as pc

    texts = trimmed_texts_or_null(array)
    for pattern in (SIX_DIGIT_DATE_PATTERN, YEAR_LAST_DATE_PATTERN):
        found = pc.extract_regex(texts, pattern)
        if texts.null_count == found.null_count < len(texts):
            return _text_times_of_column_matches(found)
    return None


def parse_text_times(array: ArrowArray) -> TextTimes | None:
    """Parse the texts of a batch; None where most are neither a date nor a time of day."""
    import pyarrow.compute as pc

    texts, has_names = _with_month_numbers(
        pc.replace_substring_regex(trimmed_texts_or_null(array), AMBIGUOUS_ZONE_ABBREVIATION_PATTERN, "")
    )
    n_given = len(texts) - texts.null_count
    best: TextTimes | None = None
    for pattern in DATE_PATTERNS:
        found = pc.extract_regex(texts, pattern)
        n_found = len(found) - found.null_count
        if n_found and n_found >= 0.5 * n_given:
            best = _text_times_of_column_matches(found)
            if has_names:  # the month is known, and the day before or behind it
                best = replace(best, mark=".")
            break
    return best


def _text_times_of_column_matches(matches: Any) -> TextTimes:
    import pyarrow as pa
    import pyarrow.compute as pc

    names = {matches.type.field(k).name for k in range(matches.type.num_fields)}
    n = len(matches)
    valid = ~np.asarray(pc.is_null(matches))

    def text_parts(name: str) -> Any:
        return pc.struct_field(matches, name).fill_null("") if name in names else pa.array([""] * n)

    def integer_parts(name: str, filler: str = "0") -> Int64Array:
        column = text_parts(name)
        return np.asarray(pc.if_else(pc.equal(column, ""), filler, column).cast(pa.int64())).astype(np.int64)

    parts = (
        np.stack([integer_parts(name, "-1") for name in "abc"], axis=1)
        if "a" in names
        else np.full((n, 3), -1, np.int64)
    )
    hour, minute, second = integer_parts("hour"), integer_parts("minute"), integer_parts("second")
    part = np.asarray(pc.utf8_rpad(text_parts("part"), 9, "0").cast(pa.int64())).astype(np.int64)
    half = np.asarray(pc.utf8_upper(pc.utf8_slice_codeunits(text_parts("half"), 0, 1)).to_pylist())
    hour = np.where(half == "P", np.where(hour < 12, hour + 12, hour), np.where((half == "A") & (hour == 12), 0, hour))
    valid &= (hour < 24) & (minute < 60) & (second < 61)
    zone = text_parts("zone").dictionary_encode()
    offsets = np.array([_utc_offset_or_nan_s(text) for text in zone.dictionary.to_pylist()] or [np.nan])
    offset_s = offsets[np.asarray(zone.indices)] if n else np.zeros(0)
    valid &= ~(np.abs(offset_s) > MAX_ZONE_OFFSET_S)
    marks = [mark for mark in pc.unique(text_parts("mark")).to_pylist() if mark]
    ns_of_day = ((hour * 60 + minute) * 60 + second) * NS_PER_S + part
    has_seconds = "second" not in names or pc.any(pc.not_equal(text_parts("second"), "")).as_py() is True
    return TextTimes(parts, ns_of_day, offset_s, valid, marks[0] if marks else "", has_seconds)


def _utc_offset_or_nan_s(text: str) -> float:
    if not text:
        return float("nan")
    if text.upper() in {"Z", "UTC", "GMT"}:
        return 0.0
    text = text.removeprefix("UTC").removeprefix("GMT")
    digits = text[1:].replace(":", "").ljust(4, "0")
    return (int(digits[:2]) * 3600 + int(digits[2:]) * 60) * (-1.0 if text[0] == "-" else 1.0)


def join_text_times(pieces: list[TextTimes]) -> TextTimes:
    """Return the times of several batches as one."""
    return TextTimes(
        np.concatenate([each.parts for each in pieces]),
        np.concatenate([each.ns_of_day for each in pieces]),
        np.concatenate([each.offset_s for each in pieces]),
        np.concatenate([each.valid for each in pieces]),
        pieces[0].mark,
        any(each.has_seconds for each in pieces),
    )


def possible_date_orders(times: TextTimes) -> list[str]:
    """Return the orders of day, month and year that every date of a column allows.

    Where most dates have a year of four digits, the others (0001-01-01 for an unknown time) say nothing.
    """
    parts = times.parts[times.valid & (times.parts[:, 0] >= 0)]
    has_long_year = (parts >= 1000).any(axis=1)
    if np.count_nonzero(has_long_year) > 0.5 * len(parts):
        parts = parts[has_long_year]
    if len(parts) and (parts[:, 0] >= 1000).all():  # no program writes year, day, month
        return ["ymd"] if (parts[:, 1] <= 12).mean() > MIN_SHARE_OF_YEAR_MONTH_DAY_DATES else []
    orders = []
    for name, order in DATE_ORDERS.items():
        year, month, day = (parts[:, order.index(each)] for each in "ymd")
        is_short = (year < 100).all()
        fits = (month >= 1).all() and (month <= 12).all() and (day >= 1).all() and (day <= 31).all()
        if fits and (is_short or (year >= 1000).all()):
            orders.append(name)
    if "dmy" in orders and times.mark == ".":
        return ["dmy"]  # dots are German: the day comes first
    if len(parts) and (parts[:, 2] >= 1000).all():
        orders = [name for name in orders if name != "ymd"]
    return orders


def with_day_halves(times: TextTimes, halves: Sequence[str]) -> TextTimes:
    """Return times of twelve hours with a text AM or PM each (n) as those of 24 hours; other texts change nothing."""
    letters = np.array([half.upper()[:1] for half in halves], dtype=object)
    hour = times.ns_of_day // NS_PER_HOUR
    is_late, is_early = (letters == "P") & (hour < 12), (letters == "A") & (hour == 12)
    shift_ns = np.where(is_late, 12, np.where(is_early, -12, 0)) * NS_PER_HOUR
    return replace(times, ns_of_day=times.ns_of_day + shift_ns)


def is_clock_of_twelve_hours(times: TextTimes) -> bool:
    """Tell whether a clock shows 1 to 12 only, and 1 follows 12, or the day changes from 11 to 12."""
    hours = (times.ns_of_day // NS_PER_HOUR)[times.valid]
    if len(hours) < 2 or hours.min() < 1 or hours.max() > 12:
        return False
    parts = times.parts[times.valid]
    is_same_day = (parts[1:] == parts[:-1]).all(axis=1)
    begins_again = (hours[:-1] == 12) & (hours[1:] == 1) & is_same_day
    changes_day_at_twelve = (hours[:-1] == 11) & (hours[1:] == 12) & ~is_same_day
    return bool((begins_again | changes_day_at_twelve).any())


def is_each_date_next_day(times: TextTimes, order: str) -> bool:
    """Tell whether the dates change, and always by one day, when they are read in an order."""
    ns, valid = ns_and_validity_of_text_times(replace(times, ns_of_day=np.zeros_like(times.ns_of_day)), order, "")
    steps = np.diff(ns[valid] // (86_400 * NS_PER_S))
    return bool((steps != 0).any() and (np.abs(steps) <= 1).all())


def ns_and_validity_of_text_times(times: TextTimes, order: str, zone: str) -> tuple[Int64Array, BoolArray]:
    """Return nanoseconds since 1970 (n,) and whether they are a time.

    Args:
        times: With dates, or without: then days are counted from 1970-01-01, on through midnight.
        order: A key of `DATE_ORDERS`; unused without dates.
        zone: Name of the zone of those without an offset, "" for UTC.

    Raises:
        UsageError: There is no such zone.
    """
    valid = times.valid.copy()
    if times.has_date:
        indices = [DATE_ORDERS[order].index(each) for each in "ymd"]
        year, month, day = times.parts[:, indices].T
        valid &= (month >= 1) & (month <= 12) & (day >= 1) & (day <= 31)
        year = np.where((times.parts[times.valid] < 1000).all() & (year < 100), year + 2000, year)
        valid &= year >= 1970
        safe = np.where(valid, year, 1970), np.where(valid, month, 1), np.where(valid, day, 1)
        first = ((safe[0] - 1970) * 12 + safe[1] - 1).astype("M8[M]").astype("M8[D]")
        valid &= (first + safe[2] - 1).astype("M8[M]") == first.astype("M8[M]")  # no 31st of February
        days = np.minimum(first.astype(np.int64) + safe[2] - 1, MAX_STAMP_NS // (86_400 * NS_PER_S) + 1)
    else:
        days = count_midnights_before_each_row(times.ns_of_day, valid)
    local_ns = days * 86_400 * NS_PER_S + times.ns_of_day
    offset_s = np.where(np.isnan(times.offset_s), _offsets_of_zone(zone, local_ns, valid), times.offset_s)
    return local_ns - np.rint(offset_s).astype(np.int64) * NS_PER_S, valid


def count_midnights_before_each_row(ns_of_day: Int64Array, valid: BoolArray) -> Int64Array:
    """Return the number of midnights before each row (n,)."""
    steps = np.diff(np.where(valid, ns_of_day, 0), prepend=ns_of_day[:1] if len(ns_of_day) else [])
    return np.cumsum(steps < -12 * 3600 * NS_PER_S).astype(np.int64)


def _offsets_of_zone(zone: str, local_ns: Int64Array, valid: BoolArray) -> FloatArray:
    """Return the offsets from UTC in s (n,) of local times; they are looked up once for each quarter of an hour."""
    if not zone or zone.upper() in {"UTC", "GMT", "Z"}:
        return np.zeros(len(local_ns))
    if re.fullmatch(r"[+-]\d{2}:?\d{2}", zone):
        return np.full(len(local_ns), _utc_offset_or_nan_s(zone))
    try:
        known = ZoneInfo(zone)
    except (KeyError, ValueError, OSError):
        raise UsageError(
            f"--timezone {zone}: there is no such zone", hint="--timezone UTC, Europe/Berlin or +02:00"
        ) from None
    quarters, index = np.unique(np.where(valid, local_ns, 0) // (900 * NS_PER_S), return_inverse=True)
    offsets = []
    for quarter in quarters.tolist():
        utc_offset = datetime.fromtimestamp(quarter * 900, UTC).replace(tzinfo=known).utcoffset()
        offsets.append(0.0 if utc_offset is None else utc_offset.total_seconds())
    return np.array(offsets)[index]


def require_known_zone(zone: str) -> str:
    """Return the zone after a check that it exists."""
    _offsets_of_zone(zone, np.zeros(1, np.int64), np.ones(1, np.bool_))
    return zone


def parse_start_ns(text: str) -> int:
    """Return a start given as ISO 8601 with a zone, or as seconds since 1970, in ns.

    Raises:
        UsageError: It is neither, or not between 1970 and 2038.
    """
    try:
        if re.fullmatch(r"[0-9]+(\.[0-9]+)?", text):
            return _require_start_in_range(round(float(text) * NS_PER_S), text)
        moment = datetime.fromisoformat(text.replace("Z", "+00:00"))
    except (ValueError, OverflowError):
        moment = None
    if moment is None or moment.tzinfo is None:
        raise UsageError(
            f"--start {text}: it is not a time with a zone", hint="--start 2024-05-01T08:00:00Z, or seconds since 1970"
        )
    return _require_start_in_range(round(moment.timestamp() * 1000) * 1_000_000, text)


def _require_start_in_range(start_ns: int, text: str) -> int:
    if not 0 <= start_ns <= MAX_STAMP_NS:
        raise UsageError(f"--start {text}: it is not between 1970 and 2038", hint="--start 2024-05-01T08:00:00Z")
    return start_ns


@dataclass(frozen=True)
class TimeBaseOfNumbers:
    """How numbers of time are meant.

    Attributes:
        unit: `s`, `ms`, `us` or `ns`; "" where the numbers and the header do not tell.
        since: `1970`, `2001`, `gps`, `week` or `start`.
        confidence, why: As in `Guess`.
    """

    unit: str
    since: str
    confidence: str
    why: str


def time_base_of_numbers(instants: Instants, unit: str, words: tuple[str, ...]) -> TimeBaseOfNumbers:
    """Return how numbers of time are meant, by their size, the header's unit and words, and the rate of the rows."""
    values = instants.values_or_nan()
    finite = values[np.isfinite(values)]
    middle = float(np.median(np.abs(finite))) if len(finite) else 0.0
    says_gps = any(word in {"gps", "gnss", "tow", "itow", "towms", "sow"} for word in words)
    for each in ("s", "ms", "us", "ns"):
        since_s = middle * FACTOR_BY_KIND_AND_UNIT["time"][each] / 1e9
        if unit and each != unit:
            continue
        if FIRST_LIKELY_UNIX_TIME_S <= since_s <= LAST_LIKELY_UNIX_TIME_S:
            if says_gps and _is_recent_gps_time(since_s):
                return TimeBaseOfNumbers(each, "gps", "likely", "the header says GPS, and the numbers fit GPS time")
            return TimeBaseOfNumbers(
                each, "1970", "certain" if unit else "likely", f"the numbers are {each} since 1970"
            )
    is_of_apple = MIN_SECONDS_TAKEN_AS_APPLE_TIME <= middle < FIRST_LIKELY_UNIX_TIME_S and unit in {"", "s"}
    if is_of_apple or (unit and middle * FACTOR_BY_KIND_AND_UNIT["time"][unit] / 1e9 > FIRST_LIKELY_UNIX_TIME_S):
        return TimeBaseOfNumbers("", "2001" if is_of_apple else "start", "", "")
    if unit:
        since = (
            "week"
            if says_gps
            and middle * FACTOR_BY_KIND_AND_UNIT["time"][unit] / 1e9 < SECONDS_PER_WEEK
            and _do_words_name_gps_week(words)
            else "start"
        )
        return TimeBaseOfNumbers(unit, since, "certain", "the header says the unit")
    step = _median_step_of_values(finite)
    fitting = [
        each
        for each in ("s", "ms", "us", "ns")
        if step > 0
        and MIN_LIKELY_ROW_RATE_HZ <= 1e9 / (step * FACTOR_BY_KIND_AND_UNIT["time"][each]) <= MAX_LIKELY_ROW_RATE_HZ
    ]
    if any(word in {"tow", "sow", "seconds", "elapsed"} for word in words) and "s" in fitting:
        fitting = ["s"]
    has_decimals = bool(len(finite)) and bool((np.abs(finite - np.rint(finite)) > 1e-9).any())
    if has_decimals and "s" in fitting and step < 1.0:
        fitting = ["s"]
    if len(fitting) == 1:
        since = "week" if _do_words_name_gps_week(words) else "start"
        return TimeBaseOfNumbers(fitting[0], since, "likely", f"steps of {step:g} {fitting[0]} are a usual rate")
    return TimeBaseOfNumbers("", "start", "", "")


def is_since_1970(instants: Instants) -> bool:
    """Tell whether numbers advance, and are s, ms, us or ns since 1970 between the years 2000 and 2038."""
    values = instants.values_or_nan()
    finite = values[np.isfinite(values)]
    if len(finite) < 2 or not np.diff(finite).any():
        return False
    ends = np.array([finite.min(), finite.max()])
    for factor in (FACTOR_BY_KIND_AND_UNIT["time"][each] / NS_PER_S for each in ("s", "ms", "us", "ns")):
        if ends[0] * factor >= FIRST_LIKELY_UNIX_TIME_S and ends[1] * factor <= MAX_STAMP_NS / NS_PER_S:
            return True
    return False


def can_be_gps_seconds(instants: Instants) -> bool:
    """Tell whether numbers, as seconds since the GPS epoch, lie between the first logs of vehicles and today."""
    values = instants.values_or_nan()
    finite = values[np.isfinite(values)]
    return bool(len(finite)) and _is_recent_gps_time(float(np.median(finite)))


def _is_recent_gps_time(since_s: float) -> bool:
    return MIN_SECONDS_TAKEN_AS_GPS_TIME <= since_s <= datetime.now(UTC).timestamp() - GPS_EPOCH_UNIX_S + 86_400


def _do_words_name_gps_week(words: tuple[str, ...]) -> bool:
    return any(word in {"tow", "itow", "towms", "sow"} for word in words) or ("week" in words)


def _median_step_of_values(values: FloatArray) -> float:
    steps = np.abs(np.diff(values))
    steps = steps[steps > 0]
    return float(np.median(steps)) if len(steps) else 0.0


def utc_ns_from_gps_seconds(gps_ns: Int64Array, week: FloatArray | None) -> Int64Array:
    """Return UTC in ns since 1970 of GPS times: since the GPS epoch, or in a week.

    Args:
        gps_ns: Shape (n,), ns since the GPS epoch, or since the week began.
        week: Shape (n,), or None.
    """
    epoch_ns = GPS_EPOCH_UNIX_S * NS_PER_S
    if week is not None:
        whole = np.where(np.isfinite(week), week, 0.0).astype(np.int64)
        gps_ns = gps_ns + whole * SECONDS_PER_WEEK * NS_PER_S
    return utc_ns_from_gps_unix_ns(gps_ns + epoch_ns)
