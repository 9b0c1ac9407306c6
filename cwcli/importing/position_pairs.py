"""Columns that hold a latitude and a longitude in one text: `48.1, 11.5`, `N48 08.2 E11 34.5`, `POINT (11.5 48.1)`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from cwcli.importing.cells import is_text_column, trimmed_texts_or_null
from cwcli.importing.names import split_name
from cwcli.importing.tables import ColumnsOfRows, Preset, SourceTable

_NUMBER = r"[+-]?\d{1,3}(?:\.\d+)?"
_ANGLE = r"\d{1,3}\s*(?:°|deg|\s)\s*\d{1,2}(?:\.\d*)?\s*['\x{2032}]?\s*(?:\d{1,2}(?:\.\d*)?\s*(?:[\"\x{2033}]|'')?)?"
_HEMISPHERE_BEHIND_REGEX = (
    rf"(?P<lat>(?:{_ANGLE}|{_NUMBER}\s*°?)\s*[NS])\s*[,;/]?\s*(?P<lon>(?:{_ANGLE}|{_NUMBER}\s*°?)\s*[EW])"
)
_HEMISPHERE_BEFORE_REGEX = (
    rf"(?P<lat>[NS]\s*(?:{_ANGLE}|{_NUMBER}\s*°?))\s*[,;/]?\s*(?P<lon>[EW]\s*(?:{_ANGLE}|{_NUMBER}\s*°?))"
)
_WKT_POINT_REGEX = rf"(?:SRID=4326;)?POINT ?Z?M? ?\((?P<lon>{_NUMBER}) (?P<lat>{_NUMBER})(?: [^)]*)?\)"
_BARE_PAIR_REGEX = rf"[(\[]?\s*(?P<lat>{_NUMBER})\s*[,; ]\s*(?P<lon>{_NUMBER})\s*[)\]]?"
BARE_PAIR_REASON = "the usual order"
"""Reason of a pair of bare numbers, which only the name of the column makes a place."""
PAIR_PATTERNS = (
    ("a point of WKT", rf"^{_WKT_POINT_REGEX}$"),
    ("letters name them", rf"^{_HEMISPHERE_BEHIND_REGEX}$"),
    ("letters name them", rf"^{_HEMISPHERE_BEFORE_REGEX}$"),
    (BARE_PAIR_REASON, rf"^{_BARE_PAIR_REGEX}$"),
)
"""Reasons why a text is a latitude and a longitude, and the patterns of the text."""
WORDS_OF_POSITION_PAIR_COLUMN = frozenset(
    "coordinates coordinate coords position location latlng latlon latlong gps geo point where".split()  # noqa: SIM905
)
"""Words of a column's name of which one must be there for two bare numbers to be a place."""
MIN_CELL_SHARE_HOLDING_POSITION_PAIRS = 0.95
"""Least share of the first cells with a text that must be pairs. Chosen by hand."""


def with_columns_of_position_pairs(table: SourceTable) -> SourceTable:
    """Return the table with a column of latitudes and one of longitudes, if one of its columns holds both."""
    if table.presets:
        return table
    batch = next(iter(table.read_batches(table.columns)), {})
    for column, array in batch.items():
        found = _pattern_of_pairs(column, array) if is_text_column(array) else None
        if found is not None:
            return _split_column_of_position_pairs(table, column, *found)
    return table


def _pattern_of_pairs(column: str, array: Any) -> tuple[str, str] | None:
    """Return the reason and the pattern of a column of pairs; None where it holds none."""
    import pyarrow.compute as pc

    texts = pc.drop_null(trimmed_texts_or_null(array))
    for why, pattern in PAIR_PATTERNS:
        if why == BARE_PAIR_REASON and not WORDS_OF_POSITION_PAIR_COLUMN & set(split_name(column).words):
            continue
        n_found = int(pc.sum(pc.match_substring_regex(texts, pattern)).as_py() or 0)
        if n_found and n_found >= MIN_CELL_SHARE_HOLDING_POSITION_PAIRS * len(texts):
            return why, pattern
    return None


def _split_column_of_position_pairs(table: SourceTable, column: str, why: str, pattern: str) -> SourceTable:
    names = {f"{column} (latitude)": "lat", f"{column} (longitude)": "lon"}

    def read_column_batches(wanted: Sequence[str]) -> Iterator[ColumnsOfRows]:
        import pyarrow.compute as pc

        plain = [name for name in dict.fromkeys(wanted) if name not in names]
        for batch in table.read_batches([*plain, column] if column not in plain else plain):
            parts = pc.extract_regex(trimmed_texts_or_null(batch[column]), pattern)
            both = {name: pc.struct_field(parts, part) for name, part in names.items()}
            yield {name: both.get(name, batch.get(name)) for name in wanted}

    presets = {name: Preset(quantity) for name, quantity in zip(names, ("latitude", "longitude"), strict=True)}
    note = f"{column!r} holds latitude and longitude ({why})"
    return replace(
        table,
        columns=(*table.columns, *names),
        read_batches=read_column_batches,
        presets={**table.presets, **presets},
        notes=[*table.notes, note],
    )
