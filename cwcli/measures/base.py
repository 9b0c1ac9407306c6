"""The interface of a measure of the criticality of two vehicles."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.measures.pair import Pair
from cwcli.metrics.table import unit_of_column
from cwcli.signals.columns import FloatArray

OPERATOR_BY_CRITICAL_SIDE = {"low": "<", "high": ">"}
"""Dangerous side of a measure (`Measure.critical`) -> the operator between a dangerous value and its threshold."""


@dataclass(frozen=True)
class Measure:
    """A measure of two vehicles, at each moment or over the whole time.

    Attributes:
        summary: What it is, in a few words.
        symbol: Its symbol in formulas.
        column: Its column in tables, with the unit: `ttc_s`.
        critical: Whether low or high values are dangerous.
        formula: How it is computed.
        source: Where the definition comes from.
        compute: A pair -> the measure at each of its stamps, (n,), NaN where a track has no data; or one number, ().
        note: Explanation of the column for readers of the table.
        is_series: One value a moment; False: one for the pair.
        is_symmetric: The same whichever of the two is the host.
        threshold: Beyond it the two are in conflict, unless the user gives another; None: the user must give one.
        threshold_source: Where the threshold comes from.
        undefined: When there is no value: NaN, an empty cell, never a large number.
        misleads: When its value means less, or something else, than it seems to.
        is_pointwise: The value of a moment follows from the two states of that moment.
        is_stepped: Its value comes in steps, so that no sigma can be computed.
        is_of_host: It depends on the host alone.
        is_sampled: It takes thousands of samples a moment; `cwcli measure` computes it when it is asked for by name.
        needs_covariance: It needs the covariances of the states; it, too, is computed when it is asked for by name.
        with_warnings: `cwcli warn` writes its most critical value to the table of pairs.
        clause: Threshold -> text of what held at a conflict: `the two were 1 s from contact`.
    """

    summary: str
    symbol: str
    column: str
    critical: Literal["low", "high"]
    formula: str
    source: str
    compute: Callable[[Pair], FloatArray]
    note: str = ""
    is_series: bool = True
    is_symmetric: bool = True
    threshold: float | None = None
    threshold_source: str = ""
    undefined: str = ""
    misleads: str = ""
    is_pointwise: bool = False
    is_stepped: bool = False
    is_of_host: bool = False
    is_sampled: bool = False
    needs_covariance: bool = False
    with_warnings: bool = False
    clause: Callable[[float], str] | None = None

    @property
    def is_expensive(self) -> bool:
        """Whether `cwcli measure` computes it only if it is asked for by name."""
        return self.is_sampled or self.needs_covariance

    @property
    def unit(self) -> str:
        """The SI symbol of its unit; "" for a plain number."""
        return unit_of_column(self.column)

    @property
    def extreme_column_name(self) -> str:
        """The column of the pair's most critical value: `min_ttc_s`."""
        return f"{'min' if self.critical == 'low' else 'max'}_{self.column}" if self.is_series else self.column

    def most_critical_value(self, pair: Pair) -> float:
        """The pair's most critical value; NaN where there is none."""
        values = np.atleast_1d(pair.evaluate_measure(self))
        known = values[~np.isnan(values)]
        if not len(known):
            return float("nan")
        return float(known.min() if self.critical == "low" else known.max())

    def conflict_text(self, threshold: float) -> str:
        """The text of what held at a conflict with this threshold."""
        if self.clause is not None:
            return self.clause(threshold)
        side = "below" if self.critical == "low" else "above"
        return f"the {self.summary} was {side} {threshold:g} {self.unit}".rstrip()


def is_column_named_by_measure(name: str, column: str) -> bool:
    """Whether a column is named by its measure and its unit: `ttc_s`, and `share` where there is no unit."""
    stem = column.rpartition("_")[0] if unit_of_column(column) else column
    return stem == name.replace("-", "_")


def require_one_value_per_stamp_or_one(values: FloatArray, pair: Pair) -> FloatArray:
    """Check the values that a plug-in's measure computed for a pair, and return them.

    Raises:
        ValueError: It is neither a number for each stamp nor one number.
    """
    shape = np.shape(values)
    if shape not in ((len(pair.stamp_ns),), ()) or np.asarray(values).dtype != np.float64:
        raise ValueError(f"{np.asarray(values).dtype} of shape {shape}, not float64 of shape ({len(pair.stamp_ns)},)")
    return np.asarray(values)
