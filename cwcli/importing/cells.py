"""Cells of a column as numbers: Arrow arrays of text or numbers, a batch at a time.

A number may have a decimal comma and, in the same text, a unit of its own behind it (`12.5 km/h`) or a hemisphere
(`48.1 N`). What is no number is NaN and counted, empty cells are not counted.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import numpy.typing as npt

from cwcli.importing.units import is_unit_text
from cwcli.signals.columns import FloatArray, Int64Array

ArrowArray = Any
"""A column of a batch: an Arrow array of n cells."""

EMPTY_CELL_TEXTS = ("", "nan", "na", "n/a", "null", "none", "-", "--", "---", "inf", "-inf", "#n/a", "?", "*")
"""Texts that stand for no value, in lower case."""
DECIMAL_POINT_PATTERN = r"^[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d{1,3})?$"
"""A number with a decimal point."""
DECIMAL_COMMA_PATTERN = r"^[+-]?(\d+,\d*|,\d+)([eE][+-]?\d{1,3})?$"
"""A number with a decimal comma."""
_TIME_NUMBER_PATTERN = r"^(?P<sign>[+-]?)(?P<whole>\d{1,19})(?:[.](?P<part>\d*))?$"
"""A number of time, as sign, whole units and decimals."""
_COORDINATE_WITH_HEMISPHERE_PATTERN = r"^(?P<a>[NSEWnsew]?)\s*(?P<number>[+-]?\d+[.]?\d*)\s*°?\s*(?P<b>[NSEWnsew]?)$"
"""A latitude or longitude with a hemisphere before or behind it."""
_DEGREES_MINUTES_PATTERN = (
    r"^(?P<a>[NSEWnsew]?)\s*(?P<sign>-?)(?P<deg>\d{1,3})\s*(?:°|deg|\s)\s*(?P<min>\d{1,2}(?:\.\d*)?)\s*['\x{2032}]?\s*"
    r"(?:(?P<sec>\d{1,2}(?:\.\d*)?)\s*(?:[\"\x{2033}]|'')\s*)?(?P<b>[NSEWnsew]?)$"
)
"""A latitude or longitude in degrees, minutes and perhaps seconds: 48°08'13.2"N."""
_NUMBER_WITH_UNIT_PATTERN = r"^[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d{1,3})?\s*(?P<unit>[^\d\s.,+-].*)$"
"""A number with a text behind it."""
N_KEPT_DECIMALS_OF_TIME = 9
"""Number of decimals of a time that are kept: nanoseconds."""


def is_text_column(array: ArrowArray) -> bool:
    """Tell whether a column of a batch holds text."""
    import pyarrow as pa

    if isinstance(array, np.ndarray):
        return False
    kind = array.type
    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind))


def trimmed_texts_or_null(array: ArrowArray) -> ArrowArray:
    """Return the texts of a batch without spaces around them; null where a cell is empty."""
    import pyarrow as pa
    import pyarrow.compute as pc

    texts = pc.utf8_trim_whitespace(array)
    empty = pc.is_in(pc.utf8_lower(texts), value_set=pa.array(EMPTY_CELL_TEXTS, texts.type))
    return pc.if_else(empty, pa.scalar(None, texts.type), texts)


def unit_behind_every_number_or_empty(array: ArrowArray) -> str:
    """Return the unit that stands behind every number of a batch of texts (`12.5 km/h`), "" without one."""
    import pyarrow.compute as pc

    if not is_text_column(array):
        return ""
    texts = pc.drop_null(trimmed_texts_or_null(array))
    found = pc.extract_regex(texts, _NUMBER_WITH_UNIT_PATTERN)
    if not len(texts) or found.null_count:
        return ""
    units = pc.unique(pc.struct_field(found, "unit")).to_pylist()
    return units[0] if len(units) == 1 and is_unit_text(units[0]) else ""


def texts_without_unit(array: ArrowArray, unit: str) -> ArrowArray:
    """Return texts without the unit behind their numbers."""
    import pyarrow.compute as pc

    return pc.replace_substring_regex(array, rf"\s*{re.escape(unit)}\s*$", "")


def read_number_cells_and_count_bad(array: ArrowArray, decimal: str) -> tuple[FloatArray, int]:
    """Return the cells (n,) as numbers, and how many are neither a number nor empty.

    Args:
        array: Arrow or NumPy array of n cells.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    if isinstance(array, np.ndarray):
        return array.astype(np.float64), 0
    if pa.types.is_dictionary(array.type):
        array = array.dictionary_decode()
    if not is_text_column(array):
        return _typed_numbers_and_bad_count(array)
    texts = trimmed_texts_or_null(array)
    if decimal == ",":
        texts = pc.if_else(
            pc.match_substring_regex(texts, DECIMAL_COMMA_PATTERN), pc.replace_substring(texts, ",", "."), texts
        )
    try:
        return _arrow_numbers_to_floats(texts.cast(pa.float64())), 0
    except pa.ArrowInvalid:
        pass
    is_number = pc.match_substring_regex(texts, DECIMAL_POINT_PATTERN)
    numbers = pc.if_else(is_number, texts, pa.scalar(None, texts.type))
    bad = int(pc.sum(pc.invert(pc.fill_null(is_number, True))).as_py() or 0)
    return _arrow_numbers_to_floats(numbers.cast(pa.float64())), bad


def _typed_numbers_and_bad_count(array: ArrowArray) -> tuple[FloatArray, int]:
    """Return the cells of an Arrow column that holds no text as numbers, and how many are none."""
    import pyarrow as pa

    kind = array.type
    if pa.types.is_null(kind):
        return np.full(len(array), np.nan), 0
    if any(
        test(kind) for test in (pa.types.is_integer, pa.types.is_floating, pa.types.is_boolean, pa.types.is_decimal)
    ):
        return _arrow_numbers_to_floats(array.cast(pa.float64())), 0
    return np.full(len(array), np.nan), len(array)


def read_degree_cells_and_count_bad(array: ArrowArray, decimal: str) -> tuple[FloatArray, int]:
    """Return latitudes or longitudes (n,) in the file's unit, south and west negative, and how many are none."""
    import pyarrow as pa
    import pyarrow.compute as pc

    values, bad = read_number_cells_and_count_bad(array, decimal)
    if not bad or not is_text_column(array):
        return values, bad
    texts = trimmed_texts_or_null(array)
    if decimal == ",":
        texts = pc.replace_substring(texts, ",", ".")
    parts = pc.extract_regex(texts, _COORDINATE_WITH_HEMISPHERE_PATTERN)
    number = _arrow_numbers_to_floats(pc.struct_field(parts, "number").cast(pa.float64()))
    half = pc.utf8_upper(pc.binary_join_element_wise(pc.struct_field(parts, "a"), pc.struct_field(parts, "b"), ""))
    names = np.array(half.fill_null("").to_pylist(), dtype=object)
    if pc.all(pc.is_null(parts)).as_py():
        number, names = _degrees_of_minutes(texts)
    is_one = np.isin(names, ["N", "S", "E", "W", ""])
    number = np.where(is_one, np.where(np.isin(names, ["S", "W"]), -number, number), np.nan)
    is_given = ~np.asarray(pc.is_null(texts))
    return number, int(np.count_nonzero(is_given & ~np.isfinite(number)))


def _degrees_of_minutes(texts: ArrowArray) -> tuple[FloatArray, npt.NDArray[np.object_]]:
    """Return degrees (n,) of texts in degrees, minutes and seconds, and their hemispheres."""
    import pyarrow as pa
    import pyarrow.compute as pc

    parts = pc.extract_regex(texts, _DEGREES_MINUTES_PATTERN)

    def parse_number_part(name: str) -> FloatArray:
        cells = pc.struct_field(parts, name)
        return _arrow_numbers_to_floats(pc.if_else(pc.equal(cells, ""), "0", cells).cast(pa.float64()))

    degrees = parse_number_part("deg") + parse_number_part("min") / 60.0 + parse_number_part("sec") / 3600.0
    is_negative = np.asarray(pc.equal(pc.struct_field(parts, "sign"), "-").fill_null(False))
    half = pc.utf8_upper(pc.binary_join_element_wise(pc.struct_field(parts, "a"), pc.struct_field(parts, "b"), ""))
    return np.where(is_negative, -degrees, degrees), np.array(half.fill_null("").to_pylist(), dtype=object)


def read_whole_units_fraction_and_validity(
    array: ArrowArray, decimal: str
) -> tuple[Int64Array, FloatArray, npt.NDArray[np.bool_]]:
    """Return whole units, the fraction beyond them (0 to 1) and whether there is a number, each (n,).

    Times since 1970 have more digits than a double holds, so that they are read as two numbers.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    if not isinstance(array, np.ndarray) and pa.types.is_integer(array.type):
        valid = ~np.asarray(pc.is_null(array))
        whole = np.asarray(array.fill_null(0).cast(pa.int64(), safe=False))
        return whole.astype(np.int64), np.zeros(len(whole)), valid
    if isinstance(array, np.ndarray) and np.issubdtype(array.dtype, np.integer):
        return array.astype(np.int64), np.zeros(len(array)), np.ones(len(array), np.bool_)
    if not is_text_column(array):
        values, _ = read_number_cells_and_count_bad(array, decimal)
        return _split_floats_into_units_and_fraction(values)
    texts = trimmed_texts_or_null(array)
    if decimal == ",":
        texts = pc.replace_substring(texts, ",", ".")
    parts = pc.extract_regex(texts, _TIME_NUMBER_PATTERN)
    whole_text = pc.struct_field(parts, "whole")
    valid = ~np.asarray(pc.is_null(whole_text))
    try:
        whole = np.asarray(whole_text.fill_null("0").cast(pa.int64())).astype(np.int64)
    except pa.ArrowInvalid:
        values, _ = read_number_cells_and_count_bad(array, decimal)
        return _split_floats_into_units_and_fraction(values)
    part = pc.utf8_slice_codeunits(
        pc.utf8_rpad(pc.struct_field(parts, "part").fill_null(""), N_KEPT_DECIMALS_OF_TIME, "0"),
        0,
        N_KEPT_DECIMALS_OF_TIME,
    )
    fraction = np.asarray(part.cast(pa.int64())).astype(np.float64) / 10.0**N_KEPT_DECIMALS_OF_TIME
    negative = np.asarray(pc.equal(pc.struct_field(parts, "sign").fill_null(""), "-"))
    whole, fraction = np.where(negative, -whole, whole), np.where(negative, -fraction, fraction)
    rest = ~valid & ~np.asarray(pc.is_null(texts))
    if rest.any():  # 1.7e9
        values, _ = read_number_cells_and_count_bad(array, decimal)
        more = _split_floats_into_units_and_fraction(values)
        whole, fraction = np.where(rest, more[0], whole), np.where(rest, more[1], fraction)
        valid |= rest & more[2]
    return whole, fraction, valid


def _split_floats_into_units_and_fraction(values: FloatArray) -> tuple[Int64Array, FloatArray, npt.NDArray[np.bool_]]:
    valid = np.isfinite(values) & (np.abs(values) < 9e18)
    safe = np.where(valid, values, 0.0)
    whole = np.floor(safe)
    return whole.astype(np.int64), safe - whole, valid


def _arrow_numbers_to_floats(array: ArrowArray) -> FloatArray:
    """Return an Arrow array of numbers as (n,), NaN where null or infinite."""
    values = np.array(array.to_numpy(zero_copy_only=False), dtype=np.float64)
    return np.where(np.isfinite(values), values, np.nan)


def distinct_names_and_row_indices(array: ArrowArray) -> tuple[list[str], Int64Array]:
    """Return the names in a batch, each once ("" for an empty cell), and the index of the name of each row."""
    import pyarrow as pa

    if isinstance(array, np.ndarray):
        array = pa.array(array)
    texts = array if is_text_column(array) else array.cast(pa.string())
    coded = trimmed_texts_or_null(texts).fill_null("").dictionary_encode()
    return coded.dictionary.to_pylist(), np.asarray(coded.indices).astype(np.int64)
