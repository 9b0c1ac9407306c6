"""Parameters of which a run tries some and `--long` all."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def diagonal(first: Iterable[Any], second: Iterable[Any]) -> list[Any]:
    """Pairs for `parametrize`: each value of both is in a pair of every run, and the other pairs are long."""
    rows, columns = list(first), list(second)
    n = min(len(rows), len(columns))
    return [
        pytest.param(row, column, marks=() if (i - k) % n == 0 else pytest.mark.long)
        for i, row in enumerate(rows)
        for k, column in enumerate(columns)
    ]
