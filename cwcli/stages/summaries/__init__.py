"""What the stages say: tables and sections of their summaries, and the cells that several of them have."""

from __future__ import annotations

import math

import numpy as np

from cwcli.pipeline.json_names import CellWithValues
from cwcli.signals.columns import FloatArray

NIS_CELL_BY_IS_WITHIN_BOUNDS = {
    None: CellWithValues("", {"": None}),
    True: CellWithValues("in", {"": True}),
    False: CellWithValues("OUT", {"": False}),
}
"""Whether the innovations lie within their bounds (None: not known) -> the cell that says so."""


def cell_of_low_and_high_bound(low: float, high: float) -> CellWithValues:
    """Return a cell with two bounds, "" where they are not known."""
    return CellWithValues("" if math.isnan(low) else f"{low:.2f} to {high:.2f}", {"low": low, "high": high})


def largest_finite_magnitude(values: FloatArray) -> float | None:
    """Return the largest magnitude of the finite values; None without any."""
    finite = np.abs(values[np.isfinite(values)])
    return float(finite.max()) if len(finite) else None
