"""The type of an interval's ends."""

from __future__ import annotations

from typing import NamedTuple


class Bounds(NamedTuple):
    """Lower and upper end of an interval, in the unit of the value; NaN at both ends where there is none."""

    low: float
    high: float
