"""Tables for people as JSON for programs: names in snake_case with their units, and cells as values.

`latency [ms]` becomes `latency_ms`; a cell that people read as `12 +- 3` says for itself what it is in numbers.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any, Self

JSON_UNIT_SUFFIXES = {
    "m": "m",
    "s": "s",
    "ms": "ms",
    "Hz": "hz",
    "deg": "deg",
    "rad": "rad",
    "m/s": "mps",
    "m/s^2": "mps2",
    "m/s^3": "mps3",
    "km/h": "kmh",
    "rad/s": "radps",
    "deg/s": "degps",
    "pixel": "px",
    "%": "percent",
}
"""Unit in brackets at the end of a heading -> the ending of the JSON name."""
_HEADING_WITH_UNIT_PATTERN = re.compile(r"(?P<words>[^\[]*)(?:\[(?P<unit>[^\]]+)\])?(?P<more>.*)")
"""Pattern of a table's heading: words, a unit in brackets, and further words such as `median`."""
_JSON_WORD_PATTERN = re.compile("[a-z0-9]+")
"""Pattern of the runs of lower-case letters and digits that make up a JSON name."""


class CellWithValues(str):
    """A cell that is text on the terminal and one or more values in JSON.

    Attributes:
        values: Ending of the column's name in the JSON output ("" for none) -> the value.
    """

    __slots__ = ("values",)
    values: Mapping[str, float | str | bool | None]

    def __new__(cls, text: str, values: Mapping[str, float | str | bool | None]) -> Self:
        self = super().__new__(cls, text)
        self.values = values
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the cell with its values, which a plain `str` would lose."""
        return type(self), (str(self), dict(self.values))


def table_row_to_json(columns: tuple[str, ...], row: tuple[Any, ...]) -> dict[str, Any]:
    """Return a row of a table as names and values; NaN, infinity and an empty text become None.

    Args:
        columns: Headings with units, or names.
        row: The cells, one a column.

    Raises:
        ValueError: Two columns have one name.
    """
    out: dict[str, Any] = {}
    for heading, cell in zip(columns, row, strict=True):
        values = cell.values if isinstance(cell, CellWithValues) else {"": cell}
        for end, value in values.items():
            name = heading_to_json_name(heading, end)
            if name in out:
                raise ValueError(f"two columns are {name}")
            out[name] = cell_to_json_value(value)
    return out


def cell_to_json_value(cell: Any) -> Any:
    """Return the value for JSON: None for NaN, infinity and an empty text."""
    if isinstance(cell, float) and not math.isfinite(cell):
        return None
    return None if cell == "" else cell


def heading_to_json_name(heading: str, end: str = "") -> str:
    """Return a heading's JSON name: `max_speed_mps` for `max speed [m/s]`, with end `sigma` `max_speed_sigma_mps`."""
    matched = _HEADING_WITH_UNIT_PATTERN.fullmatch(heading)
    assert matched is not None
    unit = JSON_UNIT_SUFFIXES.get(matched["unit"] or "", matched["unit"])
    words = f"{matched['words']} {matched['more']} {end}".lower().replace("%", " percent ").replace("/", " per ")
    name = "_".join(_JSON_WORD_PATTERN.findall(words))
    name = f"at_{name}" if name[:1].isdigit() else name  # `95 % from` -> `at_95_percent_from`
    ending = "_".join(_JSON_WORD_PATTERN.findall((unit or "").lower()))
    return name if not ending or name.endswith(f"_{ending}") else f"{name}_{ending}"
