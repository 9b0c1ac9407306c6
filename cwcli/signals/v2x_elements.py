"""Converting between a quantity and its integer code in a V2X standard."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cwcli.signals.columns import Columns, FloatArray, Strings, absent_strings
from cwcli.signals.leaf_fields import find_field, format_numbers, read_numbers, read_texts
from cwcli.signals.quality import RowLedger
from cwcli.signals.v2x_tables import Element, load_elements

STATION_ID_ELEMENT = load_elements("etsi")["StationID"]
"""The data element of ETSI's station id (TS 102 894-2)."""


def decode_codes_to_values(element: Element, codes: FloatArray, ledger: RowLedger | None = None) -> FloatArray:
    """Convert codes to values.

    Args:
        codes: Shape (n,), codes; NaN where the message has none.
        ledger: Books codes that the standard does not know.

    Returns:
        Shape (n,), `sign * unit * raw`; NaN for the unavailable and out-of-range codes and those outside the range.
    """
    is_special = np.isin(codes, element.unavailable + element.out_of_range)
    in_range = (codes >= element.low) & (codes <= element.high) & ~is_special
    if ledger is not None:
        ledger.count_repaired(
            ~np.isnan(codes) & ~in_range & ~is_special, f"{element.element} outside its range, left out"
        )
    return np.where(in_range, element.sign * element.unit * codes, np.nan)


def nan_unless_a_code_could_express(
    element: Element, decoded_values: FloatArray, ledger: RowLedger | None = None
) -> FloatArray:
    """Validate values (n,) that are already in units: apply the standard's sign, and leave out what no code could
    express."""
    with np.errstate(over="ignore"):
        code = np.rint(decoded_values / element.unit)
    decoded = decode_codes_to_values(element, code, ledger)
    return np.where(np.isfinite(decoded), element.sign * decoded_values, np.nan)


def decode_identifier_codes(element: Element, codes: FloatArray, ledger: RowLedger | None = None) -> FloatArray:
    """Convert codes that name something (a cause, a station): fractional codes are out of range, too."""
    is_whole = np.isfinite(codes) & (codes == np.floor(codes))
    return decode_codes_to_values(element, np.where(is_whole | np.isnan(codes), codes, element.high + 1.0), ledger)


def decode_enumeration(values_by_code: Mapping[int, float], code: FloatArray) -> FloatArray:
    """Return the value of each code (n,) of an enumeration, NaN for other codes."""
    values = np.full(len(code), np.nan)
    for known, value in values_by_code.items():
        values[code == known] = value
    return values


def read_station_ids(columns: Columns, *paths: str, ledger: RowLedger | None = None) -> Strings:
    """Read ETSI's station ids (n,) from the first of the fields that is there.

    A number that is none of the standard's is no id, which the ledger counts.
    """
    field = find_field(columns, *paths)
    if isinstance(field, np.ndarray) and field.ndim == 1:
        return format_numbers(decode_identifier_codes(STATION_ID_ELEMENT, read_numbers(columns, *paths), ledger))
    return read_texts(columns, *paths) or absent_strings(len(columns))
