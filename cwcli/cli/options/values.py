"""Parses times of shared options, and formats times."""

from __future__ import annotations

from datetime import UTC, datetime

from cwcli.pipeline.selection import parse_time_ns
from cwcli.signals.units import NS_PER_S

__all__ = ["format_utc_time", "parse_time_ns"]


def format_utc_time(time_ns: int) -> str:
    """Format a Unix time as `2026-05-01 12:00:00.123 UTC`."""
    seconds, rest = divmod(time_ns, NS_PER_S)
    try:
        moment = datetime.fromtimestamp(seconds, UTC)
    except (OverflowError, ValueError, OSError):
        return f"{time_ns} ns"
    return f"{moment:%Y-%m-%d %H:%M:%S}.{rest // 1_000_000:03d} UTC"
