"""What the stages say: tables and sections of their summaries, and the cells that several of them have."""

from __future__ import annotations

import math

import numpy as np

from cwcli.signals.columns import FloatArray

NIS_WORDS = {None: "", True: "in", False: "OUT"}


def bounds_text(low: float, high: float) -> str:
    """Two bounds in one cell, "" where they are not known."""
    return "" if math.isnan(low) else f"{low:.2f} to {high:.2f}"


def median(values: FloatArray) -> float | None:
    """Of the finite values; None without any."""
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else None


def largest(values: FloatArray) -> float | None:
    """The largest magnitude of the finite values; None without any."""
    finite = np.abs(values[np.isfinite(values)])
    return float(finite.max()) if len(finite) else None
