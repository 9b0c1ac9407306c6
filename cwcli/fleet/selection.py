"""The part of a log that a run uses: times made absolute, topics by role."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING

from cwcli.errors import UsageError
from cwcli.signals.units import NS_PER_S
from cwcli.stages.call import Selection

if TYPE_CHECKING:
    from cwcli.logs.log import Log

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def select(log: Log, topic: Sequence[str], start: str | None, end: str | None) -> Selection:
    """What the options `--topic`, `--start` and `--end` mean for one log.

    Raises:
        UsageError: A malformed option, or an empty span.
    """
    from cwcli.signals.roles import parse_overrides

    start_ns = None if start is None else time_ns(start, log.start_ns, "--start")
    end_ns = None if end is None else time_ns(end, log.start_ns, "--end")
    if start_ns is not None and end_ns is not None and end_ns <= start_ns:
        raise UsageError(f"--end {end} is not after --start {start}")
    return Selection(topics=parse_overrides(topic), start_ns=start_ns, end_ns=end_ns)


def check_selection(topic: Sequence[str], start: str | None, end: str | None) -> None:
    """Check what can be checked without a log.

    Raises:
        UsageError: A malformed option, or a role that does not exist.
    """
    from cwcli.signals.roles import check_roles, parse_overrides

    check_roles(parse_overrides(topic))
    for option, text in (("--start", start), ("--end", end)):
        if text is not None:
            time_ns(text, 0, option)


def time_ns(text: str, log_start_ns: int, option: str) -> int:
    """A `--start` or `--end` as int64 ns since the epoch.

    Args:
        text: Seconds from the log's start (`12.5`), or ISO 8601 (`2026-05-01T12:00:00Z`; UTC if it names no zone).
        log_start_ns: Log time of the first message.
        option: For the message of the error.

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
        raise UsageError(f"{option} {text!r} is neither seconds nor an ISO 8601 time") from None
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=UTC)
    since = moment - _EPOCH
    return (since.days * 86_400 + since.seconds) * NS_PER_S + since.microseconds * 1000
