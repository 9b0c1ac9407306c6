"""The stamps of a table: which column is the time, and what its values mean."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cwcli.errors import DataError, MissingSignalError
from cwcli.importing.load import LoadedTable
from cwcli.importing.meaning import Meaning
from cwcli.importing.names import split_name, unit_of_name
from cwcli.importing.tables import Answers, Guess, Question
from cwcli.importing.times import (
    APPLE_EPOCH_S,
    MAX_STAMP_NS,
    Instants,
    TextTimes,
    TimeBaseOfNumbers,
    can_be_gps_seconds,
    count_midnights_before_each_row,
    is_clock_of_twelve_hours,
    is_each_date_next_day,
    ns_and_validity_of_text_times,
    parse_start_ns,
    possible_date_orders,
    require_known_zone,
    time_base_of_numbers,
    utc_ns_from_gps_seconds,
    with_day_halves,
)
from cwcli.importing.units import find_unit
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import BoolArray, Int64Array
from cwcli.signals.units import NS_PER_S
from cwcli.text import format_count

MAX_DIFFERENCE_CHANGE_OF_SAME_CLOCK_S = 0.1
"""Largest change in s of the difference of two columns of time that count as the same clock. Chosen by hand."""
HALF_DAY_S, MAX_DEVIATION_OF_CLOCK_OFFSET_FROM_HALF_DAY_S = 43_200, 60
"""Half a day in s, and the difference from it below which two clocks may be of 12 and of 24 hours. Chosen by hand."""
MAX_SHARE_OF_ROWS_BACK_IN_TIME = 0.2
"""Largest share of rows that are earlier than the row before; they are sorted, and more is an error. Chosen by hand."""
MAX_SHARE_OF_REPEATED_STAMPS = 0.5
"""Largest share of rows with the stamp of the row before at which a column counts as time. Chosen by hand."""
MAX_SHARE_OF_TIMES_OUTSIDE_1970_TO_2038 = 0.05
"""Largest share of rows with a time before 1970 or after 2038 that are left out; more show another unit. Chosen by
hand."""
MAX_LATENESS_OF_WRITTEN_ROWS_S = 5.0
"""Greatest time in s by which rows may be written late; later ones among the others are a second recording. Chosen by
hand: buffers of sensors hold less."""
MAX_FILE_PART_SWITCHES_PER_STEP_BACK_IN_TIME = 4
"""Largest number of changes between the parts of a file, in time order, for each step back in time: a late row, or
block, makes three."""
MAX_GPS_WEEK = 11_000
"""Greatest week since the GPS epoch that is accepted, in the year 2190. Chosen by hand."""
WORDS_OF_TIME_SINCE_1970 = frozenset(
    {"unix", "posix", "epoch", "utc", "gmt", "ros", "system", "sys", "device", "phone"}
)
"""Words in a column's name that say that its seconds count from 1970, not from the GPS epoch."""
DATE_PART_QUANTITIES = ("year", "month", "day", "hour", "minute", "second")
"""Quantities that make a time together."""
NS_BY_FRACTION_OF_SECOND_QUANTITY = {"millisecond": 1_000_000, "microsecond": 1000, "nanosecond": 1}
"""Quantity of a column of parts of a second beside them -> its unit in ns."""
MIN_SHARE_OF_ROWS_THAT_SHOW_PARTS_OF_SECOND = 0.95
"""Least share of rows between which parts of a second rise, or fall back as the second steps. Chosen by hand: a gap of
more than a second can show neither."""
DESCRIPTION_BY_DATE_ORDER = {"ymd": "", "dmy": "day before month", "mdy": "month before day"}
"""Order of a date -> what is said about it."""
TIME_MEANINGS_BY_USEFULNESS = (
    "1970",
    "gps",
    "week",
    "zoned date",
    "date and clock",
    "local date",
    "start",
    "clock",
    "unknown",
)
"""Meanings of columns of time, the most useful first."""

DATED_TIME_MEANINGS = frozenset(TIME_MEANINGS_BY_USEFULNESS[:6])
"""Meanings whose times are dates; others may count down."""


@dataclass(frozen=True)
class TimeCandidate:
    """A column that can be the time.

    Attributes:
        column: Its name.
        rank: A name of `TIME_MEANINGS_BY_USEFULNESS`.
        stamp_ns: Shape (n,), as far as it is known.
        valid: Shape (n,).
        guess: What it means.
        question: What is not known about it, or None.
    """

    column: str
    rank: str
    stamp_ns: Int64Array
    valid: BoolArray
    guess: Guess
    question: Question | None = None


def interpret_times_of_table(table: LoadedTable, answers: Answers) -> Meaning:
    """Return the table with its stamps; its quantities are still to be found.

    Raises:
        MissingSignalError: There is no column of time, or what it means is not known.
        DataError: The times do not advance.
    """
    where = table.source.name
    columns = [*table.candidates.get("time", ()), *table.candidates.get("date", ())]
    candidates = [
        found
        for column in dict.fromkeys(columns)
        if (found := _time_candidate_of_column(table, column, answers)) is not None
    ]
    candidates = _candidates_with_time_or_question(candidates)
    is_clear = any(each.question is None and _does_time_advance(each) for each in candidates)
    if not is_clear and (parts := _date_parts_candidate(table, answers)) is not None:
        candidates = [parts]
    if not candidates:
        names = ", ".join(table.source.columns[:12])
        raise MissingSignalError(
            "no column is the time",
            where=where,
            found=table.source.columns[:30],
            hint=f"--column time=NAME, one of {names}",
        )
    column_and_unit = answers.column_and_unit_for(table.source, "time")
    coarse = [each for each in candidates if not _does_time_advance(each)]
    if column_and_unit is None:
        candidates = [each for each in candidates if _does_time_advance(each)] or candidates
    else:
        candidates = [each for each in candidates if each.column == column_and_unit[0]] or candidates
    best = min(candidates, key=lambda each: TIME_MEANINGS_BY_USEFULNESS.index(each.rank))
    if column_and_unit is None:
        best = _prefer_candidate_without_question(candidates, best)
        rivals = [each for each in candidates if each.rank == best.rank and each is not best and each.question is None]
        for rival in rivals:
            if not _do_both_times_advance_together(best, rival) or _are_half_a_day_apart(best, rival):
                raise Question(
                    where,
                    f"{best.column!r} and {rival.column!r} can each be the time, and do not advance together, or are "
                    "half a day apart",
                    f"--column time='{best.column}' or --column time='{rival.column}'",
                ).as_error()
    if best.question is not None:
        raise best.question.as_error()
    if best.rank == "start":
        best = _add_date_of_whole_second_column(best, coarse)
    return _sort_rows_by_stamp(table, answers, best)


def _does_time_advance(candidate: TimeCandidate) -> bool:
    """Tell whether most rows have another time than the row before."""
    if candidate.question is not None:
        return True
    steps = np.diff(candidate.stamp_ns[candidate.valid])
    return bool(np.count_nonzero(steps) > (1.0 - MAX_SHARE_OF_REPEATED_STAMPS) * len(steps))


def _add_date_of_whole_second_column(best: TimeCandidate, coarse: Sequence[TimeCandidate]) -> TimeCandidate:
    """Return times that count from the start with the date of a column that shows whole seconds.

    A date without decimals is at most a second before the row; the row where it changes is the nearest.
    """
    for each in coarse:
        if each.question is not None or each.rank not in {"1970", "zoned date", "date and clock"}:
            continue
        both = best.valid & each.valid
        start_ns = each.stamp_ns[both] - best.stamp_ns[both]
        if not len(start_ns) or np.ptp(start_ns) > NS_PER_S + MAX_DIFFERENCE_CHANGE_OF_SAME_CLOCK_S * NS_PER_S:
            continue
        guess = replace(best.guess, why=f"{best.guess.why.partition(';')[0]}; dated by the seconds of {each.column!r}")
        return replace(best, rank="1970", stamp_ns=best.stamp_ns + int(start_ns.max()), guess=guess)
    return best


def _prefer_candidate_without_question(candidates: list[TimeCandidate], best: TimeCandidate) -> TimeCandidate:
    """Return a column that needs no answer, if there is one that says as much."""
    if best.question is None:
        return best
    return next((each for each in candidates if each.question is None), best)


def _candidates_with_time_or_question(candidates: list[TimeCandidate]) -> list[TimeCandidate]:
    """Return the candidates that hold any time."""
    return [each for each in candidates if each.valid.any() or each.question is not None]


def _time_candidate_of_column(table: LoadedTable, column: str, answers: Answers) -> TimeCandidate | None:
    words = split_name(column).words
    if column in table.text_times:
        times = _with_halves_of_other_column(table, table.text_times[column])
        if not times.has_date:
            return _time_of_day_candidate(table, column, times, answers)
        if not times.has_clock and not _has_date_and_clock(times):
            return _date_column_with_clock_column_candidate(table, column, times, answers)
        return _text_date_candidate(table, column, times, answers, words)
    if column not in table.instants:
        return None
    if column in table.candidates.get("date", ()) and column not in table.candidates.get("time", ()):
        return None
    return _number_time_candidate(table, column, table.instants[column], answers)


def _with_halves_of_other_column(table: LoadedTable, times: TextTimes) -> TextTimes:
    """Return times of 24 hours where another column says AM or PM of every one."""
    for column in table.candidates.get("day_half", ()) if times.has_clock else ():
        codes, names = table.codes.get(column, (None, ()))
        if codes is not None and names and all(name.upper().strip(".")[:1] in {"A", "P"} for name in names):
            return with_day_halves(times, [names[code] for code in codes.tolist()])
    return times


def _question_of_twelve_hours_or_none(where: str, column: str, times: TextTimes) -> Question | None:
    """Return the question about a clock that shows 1 again behind 12."""
    if not is_clock_of_twelve_hours(times):
        return None
    what = f"{column!r} is a clock of 12 hours, and nothing says AM or PM"
    return Question(where, what, "write 13:05:00 or 01:05:00 PM, or name another column with --column time=NAME")


def _has_date_and_clock(times: TextTimes) -> bool:
    return bool(np.isfinite(times.offset_s[times.valid]).any())


def _text_date_candidate(
    table: LoadedTable, column: str, times: TextTimes, answers: Answers, header_words: tuple[str, ...]
) -> TimeCandidate:
    where = table.source.name
    question = _question_of_twelve_hours_or_none(where, column, times)
    order, why = _date_order_and_reason(times, answers)
    if not order:
        choices = possible_date_orders(times) or ["dmy", "mdy"]
        question = question or Question(
            where,
            f"{column!r}: the order of day and month, and of the year, is not known",
            " or ".join(f"--date-order {each}" for each in choices),
        )
    has_zone = bool(np.isfinite(times.offset_s[times.valid]).all())
    zone, confidence = answers.timezone, "given"
    unit_text = split_name(column).unit_text.lower()
    if has_zone:
        confidence, why_zone = "certain", "the times name their zone"
    elif {"utc", "gmt", "zulu"} & {*header_words, unit_text}:
        zone, confidence, why_zone = "UTC", "certain", "the header says UTC"
    elif table.source.kind in {"gpx"}:
        zone, confidence, why_zone = "UTC", "certain", "the format says UTC"
    elif zone:
        why_zone = f"zone {zone}, as you said"
        require_known_zone(zone)
    else:
        why_zone = ""
        question = question or Question(
            where, f"{column!r} has times of day without a zone", "--timezone UTC, Europe/Berlin or +02:00"
        )
    stamp_ns, valid = ns_and_validity_of_text_times(times, order or "ymd", zone)
    guess = Guess("time", column, "date", confidence, "; ".join(text for text in (why, why_zone) if text))
    rank = "zoned date" if has_zone or zone == "UTC" else "local date"
    return TimeCandidate(column, rank, stamp_ns, valid, guess, question)


def _date_order_and_reason(times: TextTimes, answers: Answers) -> tuple[str, str]:
    """Return the order of the date's parts, "" where it is not known, and the reason."""
    orders = possible_date_orders(times)
    if answers.date_order in orders or (answers.date_order and not orders):
        return answers.date_order, "order as you said"
    if len(orders) == 1 and not answers.date_order:
        return orders[0], DESCRIPTION_BY_DATE_ORDER[orders[0]]
    if len(orders) > 1 and not answers.date_order:
        next_days = [order for order in orders if is_each_date_next_day(times, order)]
        if len(next_days) == 1:
            return next_days[0], "at midnight the day changes, not the month or the year"
    return "", ""


def _date_column_with_clock_column_candidate(
    table: LoadedTable, column: str, times: TextTimes, answers: Answers
) -> TimeCandidate | None:
    """Return the time of a column of dates together with a column of times of day."""
    clock = next(
        (name for name, other in table.text_times.items() if name != column and not other.has_date and other.has_clock),
        None,
    )
    if clock is None:
        return None
    other = _with_halves_of_other_column(table, _with_parts_of_second(table, table.text_times[clock]))
    date_and_clock = TextTimes(times.parts, other.ns_of_day, other.offset_s, times.valid & other.valid, times.mark)
    n_midnights = _midnights_that_date_ignores(date_and_clock)
    words = (*split_name(column).words, *split_name(clock).words, split_name(clock).unit_text.lower())
    found = _text_date_candidate(table, column, date_and_clock, answers, words)
    guess = Guess(
        "time", column, "date", found.guess.confidence, f"with the time of day in {clock!r}; {found.guess.why}"
    )
    rank = "date and clock" if found.rank == "zoned date" else "local date"
    stamp_ns = found.stamp_ns
    if n_midnights is not None:
        stamp_ns = stamp_ns + n_midnights * 86_400 * NS_PER_S
        guess = replace(
            guess, why=f"{guess.why}; the clock passes midnight and the date stays: it is that of the start"
        )
    return TimeCandidate(column, rank, stamp_ns, found.valid, guess, found.question)


def _with_parts_of_second(table: LoadedTable, clock: TextTimes) -> TextTimes:
    """Return times of day in whole seconds with the milliseconds or nanoseconds of another column, if there is one."""
    for part, unit_ns in NS_BY_FRACTION_OF_SECOND_QUANTITY.items():
        for name in table.candidates.get(part, ()):
            ns = np.rint(np.nan_to_num(table.numbers.get(name, np.full(len(clock.valid), np.nan))) * unit_ns)
            if not (clock.ns_of_day % NS_PER_S).any() and ns.any() and ((ns >= 0) & (ns < NS_PER_S)).all():
                return replace(clock, ns_of_day=clock.ns_of_day + ns.astype(np.int64))
    return clock


def _midnights_that_date_ignores(times: TextTimes) -> Int64Array | None:
    """Return the number of midnights before each row (n,) where the clock passes one and the date never changes."""
    parts = times.parts[times.valid]
    if not len(parts) or (parts != parts[0]).any():
        return None
    n_midnights = count_midnights_before_each_row(times.ns_of_day, times.valid)
    return n_midnights if n_midnights.any() else None


def _date_parts_candidate(table: LoadedTable, answers: Answers) -> TimeCandidate | None:
    """Return the time of six columns that hold year, month, day, hour, minute and second."""
    columns = [next(iter(table.candidates.get(part, ())), None) for part in DATE_PART_QUANTITIES]
    names = [column for column in columns if column is not None]
    numbers = {**{name: instants.values_or_nan() for name, instants in table.instants.items()}, **table.numbers}
    if len(names) < len(DATE_PART_QUANTITIES) or any(name not in numbers for name in names):
        return None
    parts = np.stack([numbers[name] for name in names], axis=1)
    valid = np.asarray(np.isfinite(parts).all(axis=1))
    whole = np.where(valid[:, np.newaxis], parts, 0.0)
    seconds_of_day = (whole[:, 3] * 60.0 + whole[:, 4]) * 60.0
    ns_of_day = (seconds_of_day.astype(np.int64) * NS_PER_S) + np.rint(whole[:, 5] * NS_PER_S).astype(np.int64)
    for part, unit_ns in NS_BY_FRACTION_OF_SECOND_QUANTITY.items():
        name = next((each for each in table.candidates.get(part, ()) if each in numbers), None)
        if name is not None and not (whole[:, 5] % 1.0).any():
            ns_of_day += np.rint(np.nan_to_num(numbers[name]) * unit_ns).astype(np.int64)
            names.append(name)
    n = len(valid)
    times = TextTimes(whole[:, :3].astype(np.int64), ns_of_day, np.full(n, np.nan), valid, "")
    times = _with_halves_of_other_column(table, times)
    words = tuple(word for name in names for word in split_name(name).words)
    return _text_date_candidate(table, names[0], times, answers, words)


def _time_of_day_candidate(table: LoadedTable, column: str, times: TextTimes, answers: Answers) -> TimeCandidate | None:
    if any(other.has_date and not other.has_clock for other in table.text_times.values()):
        return None  # the column of dates takes it
    question = _question_of_twelve_hours_or_none(table.source.name, column, times)
    if not times.has_seconds:
        what = f"{column!r}: times such as 12:05 can be minutes and seconds, or hours and minutes"
        question = Question(table.source.name, what, "--column time=NAME names another column, or write 00:12:05")
    stamp_ns, valid = ns_and_validity_of_text_times(times, "ymd", "")
    why = "times of day without a date: stamps count from midnight"
    if answers.start:
        midnight = parse_start_ns(answers.start) // (86_400 * NS_PER_S) * 86_400 * NS_PER_S
        stamp_ns, why = stamp_ns + midnight, "on the day of --start"
    return TimeCandidate(column, "clock", stamp_ns, valid, Guess("time", column, "clock", "assumed", why), question)


def _choices_of_number_time(
    column: str, base: TimeBaseOfNumbers, unit: str, *, may_be_gps: bool
) -> tuple[str, str] | None:
    """Return what is not known of numbers of time, with the options that answer it; None where all is known.

    Args:
        base: As they are meant, as far as the numbers and the header tell.
        unit: The unit in the header, "" without one.
        may_be_gps: Seconds since 1970 may as well be seconds since the GPS epoch.
    """
    if base.since == "2001" and not base.unit:
        what = f"{column!r}: the numbers may be seconds since 2001, as Apple counts them, or since 1970"
        return what, f"--column time='{column}*s-2001', or '{column}*s-1970'"
    if base.unit == "s" and base.since == "1970" and may_be_gps:
        what = f"{column!r}: the numbers may be seconds since 1980, as GPS counts them, or since 1970"
        return what, f"--column time='{column}*s-gps', or '{column}*s-1970'"
    if base.unit:
        return None
    units = " or ".join(f"--column time='{column}*{each}'" for each in ("s", "ms"))
    if unit:
        return f"{column!r}: the numbers do not fit the unit {unit}", units
    return f"{column!r}: the unit of the time is not known", units


def _number_time_candidate(table: LoadedTable, column: str, instants: Instants, answers: Answers) -> TimeCandidate:
    where = table.source.name
    column_and_unit = answers.column_and_unit_for(table.source, "time")
    preset = table.source.presets.get(column)
    words, unit_text = split_name(column).words, split_name(column).unit_text.lower()
    unit = find_unit(table.source.units.get(column, ""), "time") or unit_of_name(column, "time")
    unit = unit or next(
        (find_unit(word, "time") for word in reversed(words) if len(word) > 3 and find_unit(word, "time")), ""
    )
    if preset is not None and preset.unit:
        unit = preset.unit
    base = time_base_of_numbers(instants, unit, words)
    if column_and_unit is not None and column_and_unit[0] == column and column_and_unit[1]:
        wanted_unit, _, since = column_and_unit[1].partition("-")
        read = time_base_of_numbers(instants, wanted_unit, words)
        base = TimeBaseOfNumbers(wanted_unit, since or read.since, "given", "as you said")
    has_own_parts = _do_parts_fall_back_at_steps(table, instants)
    if has_own_parts and not base.unit and not unit and base.since == "start":
        base = TimeBaseOfNumbers("s", "start", "likely", "parts of a second fall back at its steps")
    guess = Guess("time", column, base.unit, base.confidence, base.why)
    says_epoch = (
        preset is not None
        or bool(WORDS_OF_TIME_SINCE_1970 & {*words, unit_text})
        or bool(column_and_unit and "-" in column_and_unit[1])
    )
    choices = _choices_of_number_time(column, base, unit, may_be_gps=not says_epoch and can_be_gps_seconds(instants))
    if choices is not None:
        nothing = np.zeros(len(instants.whole), np.int64)
        return TimeCandidate(column, "unknown", nothing, instants.valid, guess, Question(where, *choices))
    stamp_ns = instants.to_ns(base.unit)
    rest = (
        _nanosecond_column_of_second_column(table, column) if base.unit == "s" and not instants.fraction.any() else None
    )
    if rest is not None:
        stamp_ns = stamp_ns + table.instants[rest].to_ns("ns")
        guess = replace(guess, why=f"{guess.why}, with the nanoseconds in {rest!r}")
    elif base.unit == "s" and not instants.fraction.any() and (base.since != "start" or has_own_parts):
        stamp_ns, guess = _with_part_of_second_of_other_column(table, stamp_ns, guess)
    if base.since == "2001":
        stamp_ns = stamp_ns + APPLE_EPOCH_S * NS_PER_S
    if base.since in {"1970", "2001"}:
        return TimeCandidate(column, "1970", stamp_ns, instants.valid, guess)
    if base.since == "gps":
        return TimeCandidate(column, "gps", utc_ns_from_gps_seconds(stamp_ns, None), instants.valid, guess)
    week = next((name for name in table.candidates.get("week", ()) if name in table.numbers), None)
    if week is not None and (base.since == "week" or (base.since == "start" and {"gps", "gnss"} & set(words))):
        weeks = table.numbers[week]
        why = f"time of the GPS week, with the week in {week!r}"
        valid = instants.valid & (weeks >= 0) & (weeks <= MAX_GPS_WEEK)
        weeks = np.where(valid, weeks, 0.0)
        return TimeCandidate(
            column,
            "week",
            utc_ns_from_gps_seconds(stamp_ns, weeks),
            valid,
            Guess("time", column, base.unit, "certain", why),
        )
    start_ns, why = 0, "stamps count from the start of the recording"
    if answers.start:
        start_ns, why = parse_start_ns(answers.start), "counted from --start"
    elif table.source.start_ns is not None:
        start_ns, why = table.source.start_ns, "the file names the time of its start"
    guess = Guess("time", column, base.unit, base.confidence, f"{base.why}; {why}")
    stamps = np.minimum(stamp_ns, MAX_STAMP_NS + 1 - start_ns) + start_ns
    return TimeCandidate(column, "start" if not start_ns else "1970", stamps, instants.valid, guess)


def _with_part_of_second_of_other_column(
    table: LoadedTable, stamp_ns: Int64Array, guess: Guess
) -> tuple[Int64Array, Guess]:
    """Return stamps of whole seconds with a column of parts of a second, if they then advance from row to row."""
    for part, unit_ns in NS_BY_FRACTION_OF_SECOND_QUANTITY.items():
        for name in table.candidates.get(part, ()):
            ns = np.rint(np.nan_to_num(table.numbers.get(name, np.zeros(0))) * unit_ns)
            if not ns.any() or ns.min() < 0 or ns.max() >= NS_PER_S:
                continue
            both = stamp_ns + ns.astype(np.int64)
            if (np.diff(both) > 0).mean() > 1.0 - MAX_SHARE_OF_REPEATED_STAMPS > (np.diff(stamp_ns) > 0).mean():
                return both, replace(guess, why=f"{guess.why}, with the {part}s in {name!r}")
    return stamp_ns, guess


def _do_parts_fall_back_at_steps(table: LoadedTable, instants: Instants) -> bool:
    """Tell whether parts of a second rise between the steps of a column and fall back at them: it counts seconds."""
    if "minute" in table.candidates or instants.fraction.any() or not instants.valid.all():
        return False
    for part, unit_ns in NS_BY_FRACTION_OF_SECOND_QUANTITY.items():
        for name in table.candidates.get(part, ()):
            ns = table.numbers.get(name, np.zeros(0)) * unit_ns
            steps = np.diff(instants.whole)
            if len(ns) != len(steps) + 1 or not ((ns >= 0) & (ns < NS_PER_S)).all():
                continue
            if not (steps == 0).any() or not (steps == 1).any() or (steps < 0).any():
                continue
            is_as_of_second = np.where(steps == 1, np.diff(ns) < 0, (steps == 0) & (np.diff(ns) > 0))
            if is_as_of_second.mean() > MIN_SHARE_OF_ROWS_THAT_SHOW_PARTS_OF_SECOND:
                return True
    return False


def _nanosecond_column_of_second_column(table: LoadedTable, column: str) -> str | None:
    """Return the column of the nanoseconds beside a column of whole seconds (`stamp.sec`, `stamp.nanosec`)."""
    prefix = column.rstrip("abcdefghijklmnopqrstuvwxyz")
    for name, other in table.instants.items():
        is_part = name != column and name.startswith(prefix) and unit_of_name(name, "time") == "ns"
        whole = other.whole[other.valid]
        if is_part and len(whole) and whole.min() >= 0 and whole.max() < NS_PER_S:
            return name
    return None


def _do_both_times_advance_together(first: TimeCandidate, second: TimeCandidate) -> bool:
    both = first.valid & second.valid
    if np.count_nonzero(both) < 2:
        return True
    difference = (first.stamp_ns[both] - second.stamp_ns[both]) / NS_PER_S
    return float(np.ptp(difference)) <= MAX_DIFFERENCE_CHANGE_OF_SAME_CLOCK_S


def _are_half_a_day_apart(first: TimeCandidate, second: TimeCandidate) -> bool:
    """Tell whether one of two clocks shows 12 hours more: it may be one of 24 hours, and the other of 12."""
    both = first.valid & second.valid
    if not both.any():
        return False
    apart_s = abs(float(np.median(first.stamp_ns[both] - second.stamp_ns[both]))) / NS_PER_S
    return abs(apart_s - HALF_DAY_S) < MAX_DEVIATION_OF_CLOCK_OFFSET_FROM_HALF_DAY_S


def _sort_rows_by_stamp(table: LoadedTable, answers: Answers, best: TimeCandidate) -> Meaning:
    """Return the rows that have a stamp, in the order of their stamps."""
    where = table.source.name
    rows = np.flatnonzero(best.valid & ~_times_outside_1970_to_2038_if_few_mask(best))
    stamps = best.stamp_ns[rows]
    notes = []
    if len(rows) < table.n_rows:
        n_without = table.n_rows - len(rows)
        notes.append(f"{format_count(n_without, 'row')} without a time {'is' if n_without == 1 else 'are'} left out")
    if len(stamps) < 2:
        raise DataError(
            f"it has {format_count(len(stamps), 'row')} with a time", where=where, hint="a log needs at least two"
        )
    if stamps.min() < 0:
        notes.append("times before 0 are moved, so that the first stamp is 0")
        stamps = stamps - stamps.min()
    if stamps.max() > MAX_STAMP_NS:
        raise DataError(
            f"{best.column!r}: times behind January 2038, which ROS 2 can't hold",
            where=where,
            hint="--column time=NAME*UNIT",
        )
    steps = np.diff(stamps)
    if best.rank in DATED_TIME_MEANINGS and steps.any() and (steps <= 0).all():
        notes.append("the newest row comes first: rows are read from the last to the first")
        rows, stamps = rows[::-1], stamps[::-1]
        steps = np.diff(stamps)
    if not steps.any():
        raise DataError(
            f"{best.column!r}: every row has the same time",
            where=where,
            hint="name another column with --column time=NAME",
        )
    n_back = int(np.count_nonzero(steps < 0))
    if n_back > MAX_SHARE_OF_ROWS_BACK_IN_TIME * len(steps) and not _has_several_vehicles(table):
        raise DataError(
            f"{best.column!r}: {n_back} of {len(steps)} times are before their predecessor",
            where=where,
            hint="name another column with --column time=NAME",
        )
    if n_back and not _has_several_vehicles(table):
        notes.append(f"{n_back} times lie before their predecessor; rows are put into the order of time")
    order = np.argsort(stamps, kind="stable")
    n_repeated = int(np.count_nonzero(np.diff(stamps[order]) == 0))
    if n_repeated > MAX_SHARE_OF_REPEATED_STAMPS * len(stamps) and not _has_several_vehicles(table):
        raise DataError(
            f"{best.column!r}: {n_repeated} of {len(stamps)} rows have the time of the row before",
            where=where,
            hint="the time is too coarse for the rows; name another column with --column time=NAME",
        )
    since = "start" if best.rank in {"start", "clock"} and not answers.start else "1970"
    meaning = Meaning(table, answers, rows[order], stamps[order], since)
    meaning.guesses.append(best.guess)
    meaning.notes += notes
    meaning.chosen["time"] = best.column
    return meaning


def _times_outside_1970_to_2038_if_few_mask(best: TimeCandidate) -> BoolArray:
    """Return the rows (n,) whose time lies before 1970 or behind 2038, if they are few; else none."""
    is_relative = best.rank in {"start", "clock"}
    absurd = best.valid & ((best.stamp_ns > MAX_STAMP_NS) | ((best.stamp_ns < 0) & (not is_relative)))
    is_few = np.count_nonzero(absurd) <= MAX_SHARE_OF_TIMES_OUTSIDE_1970_TO_2038 * np.count_nonzero(best.valid)
    return absurd if is_few else np.zeros_like(absurd)


def require_rows_of_one_recording(meaning: Meaning) -> None:
    """Check that the rows are of one recording: two have rows at the same times.

    Raises:
        DataError: Two recordings would be mixed.
    """
    in_file = np.argsort(meaning.rows)
    rows, steps = meaning.rows[in_file], np.diff(meaning.stamp_ns[in_file])
    if not (steps < 0).any() or (steps <= 0).all():
        return
    part = np.concatenate([[0], np.cumsum(steps < 0)])
    by_time = np.argsort(in_file)
    n_changes = np.count_nonzero(np.diff(part[by_time]))
    if (
        -steps.min() < MAX_LATENESS_OF_WRITTEN_ROWS_S * NS_PER_S
        or n_changes <= MAX_FILE_PART_SWITCHES_PER_STEP_BACK_IN_TIME * part[-1]
    ):
        return
    first = int(rows[int(np.argmin(steps)) + 1])
    raise DataError(
        f"{meaning.chosen['time']!r}: the time of row {first + 1} begins again {-steps.min() / NS_PER_S:g} s earlier, "
        "so that two recordings would be mixed",
        where=meaning.name,
        hint="import each recording by itself; local times repeat an hour when daylight saving ends",
    )


def _has_several_vehicles(table: LoadedTable) -> bool:
    return any(
        len(table.codes[column][1]) > 1 for column in table.candidates.get("vehicle_id", ()) if column in table.codes
    )
