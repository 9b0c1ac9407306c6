"""Errors against the truth that exceed the covariance."""

from __future__ import annotations

import math
from collections.abc import Iterator

from cwcli.estimation.tolerances import TOLERATED_VARIANCE_FACTOR
from cwcli.evaluation.doubts.base import DoubtRule, Finding
from cwcli.evaluation.doubts.evidence import DoubtEvidence
from cwcli.pipeline.records import to_float_or_nan
from cwcli.text import format_number, shorten_and_escape


def find_understated_errors(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield each quantity whose NEES is outside its bounds and too large."""
    rows = evidence.estimate_summary.column_cells("nees", "error of", "NEES/dof", "inside")
    found = [
        (to_float_or_nan(nees), str(name))
        for name, nees, inside in rows
        if isinstance(nees, int | float) and not isinstance(nees, bool) and inside != "in"
    ]
    for nees, name in sorted(found, reverse=True):
        if TOLERATED_VARIANCE_FACTOR < nees < math.inf:
            size = _error_text(evidence, name)
            yield Finding(
                nees,
                f"Compared with the true motion in the log, the {shorten_and_escape(name, 40)} is off by {size}"
                f"{math.sqrt(nees):.1f} times its own uncertainty.",
                f"Multiply the covariance of the {shorten_and_escape(name, 40)} by {nees:.2g}.",
            )


def _error_text(evidence: DoubtEvidence, quantity: str) -> str:
    """Format `0.52 deg, `, the error of a quantity against the truth; "" where the record does not say it."""
    for name, unit, sigma in evidence.estimate_summary.column_cells("errors", "error of", "unit", "estimated"):
        if str(name).split(" ", 1)[0] == quantity and isinstance(sigma, float) and math.isfinite(sigma):
            return f"{format_number(sigma, 2)} {shorten_and_escape(str(unit), 20)}, "
    return ""


RULE = DoubtRule(
    summary="errors against the truth that exceed their covariance (NEES per degree of freedom, outside its bounds)",
    short_name="errors beyond their sigma",
    threshold=TOLERATED_VARIANCE_FACTOR,
    unit="",
    source="chosen: as in the verdict of `estimate`",
    advice="Multiply the covariance.",
    find=find_understated_errors,
)
