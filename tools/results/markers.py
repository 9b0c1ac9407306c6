"""Markers in pages: a number directly before `<!--=NAME/KEY-->` is the number of that key in docs/results/NAME.json.

`<!--=NAME/KEY;.2f-->` gives the format, `<!--=NAME/KEY@low;.2f-->` an end of the interval, `*100` before the format a
factor: `<!--=NAME/KEY;*100.0f-->`. In a measured section every number has a marker, or stands in backticks: a setting,
which its author typed.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping

from tools.results.result_file import ResultFile

MARKER = re.compile(
    r"(?P<shown>[-+]?\d[\d,]*(?:\.\d+)?|\?)"
    r"<!--=(?P<name>[\w-]+)/(?P<key>[^;>@]+)(?:@(?P<end>low|high))?(?:;(?P<format>[^>]*?))?-->"
)
"""A number with its marker; `?` where the number is not filled yet."""
NUMBER = re.compile(r"(?<![\w.#/^-])[-+]?\d[\d,]*(?:\.\d+)?(?![\w-]*-->)")
"""What a reader takes for a number: not part of a name (`song2016`, `K_80`)."""
NOT_TEXT = re.compile(
    r"```[\s\S]*?```|`[^`]*`|<!--[\s\S]*?-->|!?\[[^\]]*\]\([^)]*\)|^    [^\n]*$|^#[^\n]*$|^\|[^\n]*\n(?=\|[ :|-]*-)"
    r"|(?i:\b(?:figures?|tables?|eq\.|sections?) \d+(?:(?:,| and| to) \d+)*)",
    re.MULTILINE,
)
"""Code, comments, links and pictures, headings, the first row of a table, and numbers of figures and equations."""
DEFAULT_FORMAT = ".3g"


def format_marked(match: re.Match[str], results: Callable[[str], ResultFile]) -> str:
    """Return a marked number as it should be, with its marker.

    Raises:
        KeyError: The result file has no such key.
    """
    value = results(match["name"]).values[match["key"]]
    number = {"low": value.low, "high": value.high, None: value.value}[match["end"]]
    if number is None:
        raise KeyError(f"{match['name']}/{match['key']} has no number")
    text = match["format"] or DEFAULT_FORMAT
    if text.startswith("*"):
        factor, text = re.fullmatch(r"\*(-?\d+)(.*)", text).groups()  # type: ignore[union-attr]
        number *= float(factor)
    shown = f"{number:{text}}"
    if float(shown.replace(",", "")) == 0.0:
        shown = shown.lstrip("-")
    return shown + match[0][len(match["shown"]) :]


def fill_markers(text: str, results: Callable[[str], ResultFile]) -> str:
    """Fill all markers of a page."""
    return MARKER.sub(lambda match: format_marked(match, results), text)


def unmarked_numbers(text: str, headings: tuple[str, ...]) -> Iterator[str]:
    """Yield each number of the measured sections that has neither a marker nor backticks, with its line.

    Args:
        text: The page.
        headings: Of its measured sections, to the next heading; none: the whole page.

    Raises:
        ValueError: There is no such heading.
    """
    for section in _sections(text, headings):
        bare = NOT_TEXT.sub(" ", MARKER.sub(" ", section))
        for line in bare.splitlines():
            for match in NUMBER.finditer(line):
                yield f"{match[0]}: {line.strip()[:100]}"


def _sections(text: str, headings: tuple[str, ...]) -> list[str]:
    """Return the text under the headings; the whole text without any."""
    if not headings:
        return [text]
    parts: Mapping[str, str] = {
        part.split("\n", 1)[0].lstrip("# ").strip(): part for part in re.split(r"(?m)^(?=#+ )", text)
    }
    if missing := [heading for heading in headings if heading not in parts]:
        raise ValueError(f"there is no heading '{missing[0]}'")
    return [parts[heading] for heading in headings]
