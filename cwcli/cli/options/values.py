"""What the text of a shared option means."""

from __future__ import annotations

from datetime import UTC, datetime
from decimal import Decimal, InvalidOperation

from cwcli.errors import UsageError
from cwcli.signals.units import NS_PER_S

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


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


def utc(time_ns: int) -> str:
    """`2026-05-01 12:00:00.123 UTC`."""
    seconds, rest = divmod(time_ns, NS_PER_S)
    try:
        moment = datetime.fromtimestamp(seconds, UTC)
    except (OverflowError, ValueError, OSError):
        return f"{time_ns} ns"
    return f"{moment:%Y-%m-%d %H:%M:%S}.{rest // 1_000_000:03d} UTC"
