"""Text for a terminal: safe, plain and narrow."""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Sequence

WIDTH = 80


def printable(text: str) -> str:
    """`text` with every character escaped that could move the cursor, reorder or forge a line.

    Topic and file names come from others: control characters, bidirectional marks, line separators and bytes that
    are not UTF-8 become `\\x1b`, `\\u202e`, ... Plain spaces stay.
    """
    return "".join(char if char.isprintable() or char == " " else _escape(char) for char in text)


def _escape(char: str) -> str:
    code = ord(char)
    if 0xDC80 <= code <= 0xDCFF:  # a byte that is not UTF-8, as Python keeps it in a file name
        return f"\\x{code - 0xDC00:02x}"
    return char.encode("unicode_escape", "surrogatepass").decode("ascii")


def display_width(text: str) -> int:
    """Terminal cells that `text` fills: two for wide East Asian characters, none for combining marks."""
    if text.isascii():
        return len(text)
    return sum(
        0 if unicodedata.combining(char) else 2 if unicodedata.east_asian_width(char) in "WF" else 1 for char in text
    )


def number(value: float, digits: int = 4) -> str:
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


def duration(seconds: float) -> str:
    """`12.3 s`, `4 min 5 s` or `1 h 2 min 3 s`."""
    if seconds < 120:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min {rest} s"


def size(n_bytes: int) -> str:
    """`512 B`, `81.3 kB` or `1.2 GB`, in powers of 1000."""
    value = float(n_bytes)
    for unit in ("B", "kB", "MB", "GB"):
        if value < 1000 or unit == "GB":
            return f"{n_bytes} B" if unit == "B" else f"{value:.1f} {unit}"
        value /= 1000
    raise AssertionError("unreachable")


def count(n: int, noun: str) -> str:
    """`1 chunk`, `2 chunks`."""
    return f"{n} {noun}{'' if n == 1 else 's'}"


def wrap(text: str, width: int) -> list[str]:
    """`text` in lines of at most `width` cells, broken at spaces, else after `/ _ . ,`, else anywhere."""
    lines: list[str] = []
    rest = text
    width = max(width, 1)
    while display_width(rest) > width:
        cut = _cut(rest, width)
        lines.append(rest[:cut].rstrip())
        rest = rest[cut:].lstrip()
    lines.append(rest)
    return lines


def _cut(text: str, width: int) -> int:
    fits = 0
    used = 0
    for char in text:
        used += display_width(char)
        if used > width:
            break
        fits += 1
    fits = max(fits, 1)
    if text[fits : fits + 1] == " ":
        return fits
    for breaks in (" ", "/_.,"):
        best = max((text.rfind(mark, 1, fits) for mark in breaks), default=-1)
        if best > 0:
            return best + 1 if breaks != " " else best
    return fits


def paragraph(text: str, *, first: str = "", rest: str = "", width: int = WIDTH) -> str:
    """`text` wrapped to `width`, its first line behind `first`, the others behind `rest`."""
    lines = wrap(text, width - max(len(first), len(rest)))
    return "\n".join((first if i == 0 else rest) + line for i, line in enumerate(lines))


def pad(text: str, width: int, *, right: bool) -> str:
    """`text` filled with spaces to `width` cells, on its left if `right`-aligned."""
    fill = " " * (width - display_width(text))
    return fill + text if right else text + fill


def join_names(names: Sequence[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} and {names[-1]}"
