"""The part of a log that a run uses: times made absolute, topics by role."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING

from cwcli.errors import UsageError
from cwcli.pipeline.call import Selection
from cwcli.signals.units import NS_PER_S
from cwcli.text import format_duration

if TYPE_CHECKING:
    from cwcli.logs.read.reader import Log

_UNIX_EPOCH_UTC = datetime(1970, 1, 1, tzinfo=UTC)
"""The Unix epoch, from which all stamps and log times count."""


def resolve_selection(log: Log, topic: Sequence[str], start: str | None, end: str | None) -> Selection:
    """Resolve the options `--topic`, `--start` and `--end` for one log.

    Raises:
        UsageError: A malformed option, or an empty span.
    """
    from cwcli.channels.binding import parse_role_overrides

    start_ns, end_ns = _parse_time_span(start, end, log.start_ns, "--{}")
    if log.n_messages:
        _require_overlap_of_span_and_log(log, start, start_ns, end, end_ns)
    return Selection(topics=parse_role_overrides(topic), start_ns=start_ns, end_ns=end_ns)


def _require_overlap_of_span_and_log(
    log: Log, start: str | None, start_ns: int | None, end: str | None, end_ns: int | None
) -> None:
    """Refuse a span outside the log.

    Raises:
        UsageError: The log ends before the span begins, or begins after it has ended.
    """
    duration_s = max(log.end_ns - log.start_ns, 0) / NS_PER_S
    first, last = _format_utc_iso_time(log.start_ns), _format_utc_iso_time(log.end_ns)
    hint = f"the log lasts {format_duration(duration_s)}, from {first} to {last}"
    if start_ns is not None and start_ns > log.end_ns:
        raise UsageError(f"--start {start} is after the end of the log", where=log.name, hint=hint)
    if end_ns is not None and end_ns <= log.start_ns:
        raise UsageError(f"--end {end} is not after the start of the log", where=log.name, hint=hint)


def _format_utc_iso_time(stamp_ns: int) -> str:
    """Format a stamp in UTC to the second, or in nanoseconds where the calendar ends."""
    try:
        return f"{datetime.fromtimestamp(stamp_ns // NS_PER_S, UTC):%Y-%m-%dT%H:%M:%SZ}"
    except (OverflowError, ValueError, OSError):
        return f"{stamp_ns} ns"


def check_selection_options(topic: Sequence[str], start: str | None, end: str | None, *, spelled: str = "--{}") -> None:
    """Check the options as far as that is possible without a log.

    Args:
        topic, start, end: As on the command line.
        spelled: Pattern of an option's name in error messages; `{} =` for one of a configuration file.

    Raises:
        UsageError: A malformed option, a role that does not exist, or an end that is before the start in every log.
    """
    from cwcli.channels.binding import check_topic_overrides, parse_role_overrides

    name = spelled.format("topic")
    check_topic_overrides(parse_role_overrides(topic, name), name)
    if start is None or end is None or _is_in_seconds(start) == _is_in_seconds(end):
        _parse_time_span(start, end, 0, spelled)
    else:  # which of them comes first depends on the log
        _parse_time_span(start, None, 0, spelled)
        _parse_time_span(None, end, 0, spelled)


def _parse_time_span(
    start: str | None, end: str | None, log_start_ns: int, spelled: str
) -> tuple[int | None, int | None]:
    """Return start and end [ns since the epoch], None where not given; raise `UsageError` if they do not fit."""
    first, last = spelled.format("start"), spelled.format("end")
    start_ns = None if start is None else parse_time_ns(start, log_start_ns, first)
    end_ns = None if end is None else parse_time_ns(end, log_start_ns, last)
    if start_ns is not None and end_ns is not None and end_ns <= start_ns:
        raise UsageError(f"{last} {end} is not after {first} {start}")
    return start_ns, end_ns


def _is_in_seconds(text: str) -> bool:
    """Return whether a time is given in seconds from the log's start, and not as ISO 8601."""
    try:
        Decimal(text)
    except InvalidOperation:
        return False
    return True


def parse_time_ns(text: str, log_start_ns: int, option: str) -> int:
    """Parse a `--start` or `--end`, and return it in ns since the epoch.

    Args:
        text: Seconds from the log's start (`12.5`), or ISO 8601 (`2026-05-01T12:00:00Z`; UTC if it names no zone).
        log_start_ns: Log time of the first message.
        option: Name of the option, for error messages.

    Raises:
        UsageError: It is neither.
    """
    try:
        seconds = Decimal(text)
    except InvalidOperation:
        seconds = None
    if seconds is not None:
        if not seconds.is_finite() or seconds < 0 or seconds > 10**9:
            raise UsageError(f"{option} {text} is not a time in the log: give seconds from its start, or ISO 8601")
        return log_start_ns + int(seconds * NS_PER_S)
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise UsageError(
            f"{option} {text!r} is neither seconds nor an ISO 8601 time",
            hint="for example 12.5 (seconds from the log's start) or 2026-05-01T12:00:00Z",
        ) from None
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=UTC)
    since = moment - _UNIX_EPOCH_UTC
    return (since.days * 86_400 + since.seconds) * NS_PER_S + since.microseconds * 1000
