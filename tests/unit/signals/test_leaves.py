"""Values of single messages, whatever kind of column holds them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from cwcli.signals.columns import Field, Ragged, Strings
from cwcli.signals.leaf_fields import numbers_of_row, numbers_to_bit_flags, read_integers, read_texts
from tests.unit.signals.signal_columns import columns_of

LISTS: dict[str, tuple[Field | None, list[float]]] = {
    "of different lengths": (Ragged(np.array([1.0, 2.0, 3.0]), np.array([0, 0, 2, 3])), [1.0, 2.0]),
    "empty": (Ragged(np.array([1.0]), np.array([0, 1, 1])), []),
    "of one length": (np.array([[1, 2], [3, 4]]), [3.0, 4.0]),
    "one number": (np.array([5, 6]), [6.0]),
    "words": (Strings(np.zeros(2, np.int32), ("a",)), []),
    "not in the message": (None, []),
}


@pytest.mark.parametrize("kind", LISTS)
def test_numbers_of_one_message(kind: str) -> None:
    field, expected = LISTS[kind]
    found = numbers_of_row(field, 1)
    assert found.dtype == np.float64
    assert found.tolist() == expected


def test_an_unsigned_number_never_becomes_a_negative_one() -> None:
    field = np.array([2**63 - 1, 2**63, 2**64 - 1], np.uint64)
    values, is_there = read_integers(columns_of("T", {"stamp_ns": field}), "stamp_ns")
    assert values.tolist() == [2**63 - 1] * 3
    assert is_there.tolist() == [True, False, False]


def test_no_two_numbers_are_spelled_alike() -> None:
    found = read_texts(columns_of("T", {"id": np.array([7.0, 7.25, 1e300, np.nan, 7.0])}), "id")
    assert found is not None
    assert [found.values[code] if code >= 0 else None for code in found.codes] == ["7", "7.25", "1e+300", None, "7"]


@pytest.mark.parametrize("is_ragged", [True, False])
def test_numbers_that_are_no_octets_are_no_id(is_ragged: bool) -> None:
    rows = np.array([[1.0, 255.0], [1.0, 256.0], [1e300, 0.0], [0.5, 1.0], [np.nan, 1.0], [1.0, 255.0]])
    field = Ragged(rows.ravel(), np.arange(0, 13, 2)) if is_ragged else rows
    found = read_texts(columns_of("T", {"id": field}), "id")
    assert found is not None
    assert (found.values, found.codes.tolist()) == (("01ff",), [0, -1, -1, -1, -1, 0])


@pytest.mark.parametrize("dtype", [np.uint8, np.int8, np.bool_, np.int32, np.float64])
def test_octets_of_any_length_and_type_are_spelled_as_row_by_row(dtype: type) -> None:
    rng = np.random.default_rng(5)
    lengths = rng.integers(0, 4, 300)
    field = Ragged(rng.integers(0, 3, lengths.sum()).astype(dtype), np.concatenate([[0], np.cumsum(lengths)]))
    expected = [field.values[i:j].astype(np.uint8).tobytes().hex() for i, j in pairwise(field.offsets)]
    found = read_texts(columns_of("T", {"id": field}), "id")
    assert found is not None
    assert [found.values[code] if code >= 0 else "" for code in found.codes] == expected
    assert found.values == tuple(dict.fromkeys(text for text in expected if text))


def test_a_number_that_is_no_set_of_flags_sets_none() -> None:
    values = np.array([3.0, 0.0, -1.0, 2.5, 1e300, np.inf, np.nan])
    assert numbers_to_bit_flags(values).tolist() == [3, 0, 0, 0, 0, 0, 0]
