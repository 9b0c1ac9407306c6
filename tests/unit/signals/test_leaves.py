"""Values of single messages, whatever kind of column holds them."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.signals.columns import Field, Ragged, Strings
from cwcli.signals.leaf_fields import row_of

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
    found = row_of(field, 1)
    assert found.dtype == np.float64
    assert found.tolist() == expected
