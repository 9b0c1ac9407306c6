"""Words and numbers for people, safe wherever they are printed: terminals, pages, tables, JSON."""

from __future__ import annotations

import math
import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Sequence

_SURROGATE_PATTERN = re.compile("[\ud800-\udfff]")
"""Code points that are halves of a pair and no characters."""


def escape_control_characters(text: str) -> str:
    """`text` with every character escaped that could move the cursor, reorder or forge a line.

    Topic and file names come from others: control characters, bidirectional marks, line separators and bytes that
    are not UTF-8 become `\\x1b`, `\\u202e`, ... Plain spaces stay.
    """
    return "".join(
        char if char.isprintable() or char == " " else _escape_character_as_code_point(char) for char in text
    )


def shorten_and_escape(text: str, limit: int = 1000) -> str:
    """Escape a text like `escape_control_characters`, cut after `limit` characters; a log may hold huge names."""
    return escape_control_characters(text if len(text) <= limit else f"{text[:limit]}... ({len(text):,} characters)")


def format_first_names(names: Sequence[str], most: int = 3) -> str:
    """Join the first names with commas, at most `most`, and say how many more there are."""
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")


def map_to_distinct_endings(names: Iterable[str]) -> dict[str, str]:
    """Return path -> its last parts, as few as tell it from the other paths."""
    parts = {name: [part for part in name.split("/") if part] or [name] for name in names}
    found: dict[str, str] = {}
    n_parts = 1
    while len(found) < len(parts):
        endings = {name: "/".join(each[-n_parts:]) for name, each in parts.items()}
        uses = Counter(endings.values())
        for name, ending in endings.items():
            if name not in found and (uses[ending] == 1 or n_parts >= len(parts[name])):
                found[name] = ending
        n_parts += 1
    return found


def escape_surrogates(text: str) -> str:
    """Return a text that UTF-8 can encode: each lone surrogate becomes its escape, `\\xff` or `\\ud800`.

    Python keeps bytes of a file name that are not UTF-8 as surrogates, and JSON may hold halves of a pair.
    """
    return _SURROGATE_PATTERN.sub(lambda found: _escape_character_as_code_point(found.group()), text)


def _escape_character_as_code_point(char: str) -> str:
    """Return the escape sequence of a character, as in a Python string."""
    code = ord(char)
    if 0xDC80 <= code <= 0xDCFF:  # a byte that is not UTF-8, as Python keeps it in a file name
        return f"\\x{code - 0xDC00:02x}"
    return char.encode("unicode_escape", "surrogatepass").decode("ascii")


def format_number(value: float, digits: int = 4) -> str:
    """A number with `digits` significant digits and no exponent between 1e-4 and 1e7; "-" where it is not finite."""
    if not math.isfinite(value):
        return "-"
    if value == 0:
        return "0"
    magnitude = abs(value)
    if magnitude < 1e-4 or magnitude >= 1e7:
        return f"{value:.{digits - 1}e}"
    decimals = max(0, digits - 1 - math.floor(math.log10(magnitude)))
    text = f"{value:.{decimals}f}"
    return text.rstrip("0").rstrip(".") if "." in text and decimals > digits else text


def format_interval(low: float, high: float, digits: int = 4) -> str:
    """Format an interval, `0.1 to 0.2`; "" where it is not finite."""
    return (
        f"{format_number(low, digits)} to {format_number(high, digits)}"
        if math.isfinite(low) and math.isfinite(high)
        else ""
    )


def finite_or_none(value: float) -> float | None:
    """Return the number for JSON: None where it is not finite."""
    return value if math.isfinite(value) else None


MIN_HOURS_SHOWN_AS_DAYS = 48
"""Duration in hours from which days are shown; chosen: nobody divides more hours by 24."""
DAYS_PER_YEAR = 365.25
"""Mean length of a Julian year in days, for durations in years."""


def format_duration(seconds: float) -> str:
    """Format a duration: `12.3 s`, `4 min 5 s`, `1 h 2 min 3 s`, `9.1 days` or `46.8 years`."""
    if seconds < 120:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    hours, minutes = divmod(minutes, 60)
    if hours < MIN_HOURS_SHOWN_AS_DAYS:
        return f"{hours} h {minutes} min {rest} s"
    days = seconds / 86_400.0
    return f"{days:.1f} days" if days < DAYS_PER_YEAR else f"{days / DAYS_PER_YEAR:,.1f} years"


def format_byte_size(n_bytes: int) -> str:
    """Format a number of bytes: `512 B`, `81.3 kB` or `1.2 GB`, in powers of 1000."""
    value = float(n_bytes)
    for unit in ("B", "kB", "MB", "GB"):
        if value < 1000 or unit == "GB":
            return f"{n_bytes} B" if unit == "B" else f"{value:.1f} {unit}"
        value /= 1000
    raise AssertionError("unreachable")


def format_count(n: int, noun: str) -> str:
    """Format a number with its noun: `1 chunk`, `2 chunks`."""
    return f"{n} {noun}{'' if n == 1 else 's'}"


def join_names(names: Sequence[str]) -> str:
    """Join names in words: `a`, `a and b`, `a, b and c`."""
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} and {names[-1]}"


def split_distinct_names(text: str) -> tuple[str, ...]:
    """Return the names in a list with commas, each once."""
    return tuple(dict.fromkeys(name.strip() for name in text.split(",")))


def parse_float_or_nan(text: str) -> float:
    """Return the number that a text spells; NaN if it is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def terminal_cells_of_text(text: str) -> int:
    """Number of terminal cells of a text: two for wide East Asian characters, none for combining marks."""
    if text.isascii():
        return len(text)
    return sum(
        0 if unicodedata.combining(char) else 2 if unicodedata.east_asian_width(char) in "WF" else 1 for char in text
    )


def wrap_text(text: str, width: int) -> list[str]:
    """Wrap a text into lines of at most `width` cells.

    It breaks at spaces, else after `/ _ . ,`, else `-`, else before a capital letter (`BasicSafety Message`), else
    anywhere.
    """
    lines: list[str] = []
    rest = text
    width = max(width, 1)
    while terminal_cells_of_text(rest) > width:
        cut = _position_of_next_line_break(rest, width)
        lines.append(rest[:cut].rstrip())
        rest = rest[cut:].lstrip()
    lines.append(rest)
    return lines


def _position_of_next_line_break(text: str, width: int) -> int:
    fits = 0
    used = 0
    for char in text:
        used += terminal_cells_of_text(char)
        if used > width:
            break
        fits += 1
    fits = max(fits, 1)
    if text[fits : fits + 1] == " ":
        return fits
    for breaks in (" ", "/_.,", "-"):
        best = max((text.rfind(mark, 1, fits) for mark in breaks), default=-1)
        if best > 0:
            return best + 1 if breaks != " " else best
    capitals = [i for i in range(2, fits + 1) if text[i - 1].islower() and text[i : i + 1].isupper()]
    return capitals[-1] if capitals else fits
