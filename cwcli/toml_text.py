"""TOML from files of users: bounded before it is parsed, and errors in its values.

The parser takes the square of the number of parts of a dotted key, and each part is a table inside the one before: a
line of 100 kB would keep it busy for minutes.
"""

from __future__ import annotations

import re
import tomllib
from typing import Any

from cwcli.errors import UsageError

MAX_TOML_FILE_CHARS = 4_000_000
"""Greatest number of characters of a TOML file; a calibration of a thousand sensors has a tenth of it."""
MAX_KEY_PARTS = 64
"""Greatest number of parts of a dotted key; chosen by hand."""
_KEY_PART_PATTERN = r"""(?:(?<![A-Za-z0-9_-])[A-Za-z0-9_-]++|"[^"\n]*+"|'[^'\n]*+')"""  # possessive: no second try
"""Pattern of one part of a dotted key, bare or in quotation marks."""
_LONG_KEY_PATTERN = re.compile(rf"{_KEY_PART_PATTERN}(?:[ \t]*+\.[ \t]*+{_KEY_PART_PATTERN}){{{MAX_KEY_PARTS}}}")
"""Pattern of a dotted key with more than `MAX_KEY_PARTS` parts."""

_STRING_COMMENT_OR_BRACKET = re.compile(r"""\"(?:\\.|[^"\\\n])*+"|'[^'\n]*+'|\#[^\n]*+|[\[\]{}]""")
"""Pattern of a string of one line, a comment, or a bracket."""


def parse_toml(text: str) -> dict[str, Any]:
    """Parse a TOML document.

    Raises:
        ValueError: It is no TOML, too long, nested too deeply, or has a key of too many parts.
    """
    if len(text) > MAX_TOML_FILE_CHARS:
        raise ValueError(f"it has more than {MAX_TOML_FILE_CHARS:,} characters")
    if any(line.count(".") >= MAX_KEY_PARTS and _LONG_KEY_PATTERN.search(line) for line in text.splitlines()):
        raise ValueError(f"a key has more than {MAX_KEY_PARTS} parts")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError(f"nested too deeply (at line {_line_of_deepest_bracket(text)})") from None


def _line_of_deepest_bracket(text: str) -> int:
    """Return the number of the line, from 1, with the bracket inside most others; strings and comments don't count."""
    depth, deepest, at = 0, 0, 0
    for found in _STRING_COMMENT_OR_BRACKET.finditer(text):
        depth += {"[": 1, "{": 1, "]": -1, "}": -1}.get(found[0], 0)
        if depth > deepest:
            deepest, at = depth, found.start()
    return text.count("\n", 0, at) + 1


def require_number_in_range(value: Any, low: float, high: float, where: str, key: str, permitted: str) -> float:
    """Return a number inside a closed range.

    Raises:
        UsageError: It is another value.
    """
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not low <= value <= high:  # not a number is out of range too
        raise toml_value_error(where, key, f"is {value!r}", permitted)
    return float(value)


def toml_value_error(where: str, key: str, what: str, permitted: str) -> UsageError:
    """The one-line error for a value of a file: file, key, what is wrong, what is permitted."""
    return UsageError(f"{key} {what}; permitted: {permitted}", where=where)
