"""The classes of a number compared with a paper's, and how a number gets its class from its expectation."""

from __future__ import annotations

import math

from cwcli.lazy_dataclass import dataclass

REPRODUCED = "reproduced"
"""The class of the paper's number within the tolerance, on inputs that were not fitted to it."""
FITTED = "fitted"
"""The class of what holds on inputs that were chosen so that it holds."""
WITHIN_OWN_BOUND = "within own bound"
"""The class of a number within a bound of our own, where the paper prints none."""
BETTER = "better"
"""The class of a number that is better than the paper's by more than the tolerance."""
DIFFERS = "differs"
"""The class of another number than the paper's, or one outside our own bound."""
NOT_DETERMINABLE = "not determinable"
"""The class of a number that nothing can be compared with."""
CLASS_MEANINGS: dict[str, str] = {
    REPRODUCED: "the paper's number, within the tolerance, on inputs that were not fitted to it",
    FITTED: "it holds on inputs that were chosen so that it holds",
    WITHIN_OWN_BOUND: "within a bound of our own; the paper prints no number",
    BETTER: "better than the paper's number by more than the tolerance",
    DIFFERS: "another number than the paper's, or outside our own bound",
    NOT_DETERMINABLE: "there is nothing to compare with",
}
"""Class -> its meaning, in the order of the tables."""
BINDING_CLASSES = frozenset({REPRODUCED, FITTED, WITHIN_OWN_BOUND, BETTER})
"""Classes that must be reached where they are claimed, or the exit code is 1."""
ROUNDING_TOLERANCE = 1e-9
"""Numbers may exceed a bound by this much through rounding. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class MeasuredNumber:
    """One number of ours, with its 95 % interval.

    Attributes:
        figure: Where it stands in the paper: `table 1`, `fig 9`.
        what: Which quantity, of which method; with `figure` the key of its expectation.
        ours: Mean or median over the seeds, as `what` says; NaN where there is none.
        low, high: 95 % interval of `ours` over the seeds; NaN where nothing in it is random.
    """

    figure: str
    what: str
    ours: float
    low: float = math.nan
    high: float = math.nan


@dataclass(frozen=True)
class Expectation:
    """What is expected of one number, from the file `PAPER/expectations.toml`.

    Attributes:
        figure, what: As in `Measured`.
        unit: Of the number, "" for a share or a yes (1) or no (0).
        claim: The class that it should get, a key of `CLASSES`.
        paper: Least and largest of the paper's number, equal where it prints one; None where it prints none.
        says: What the paper says, where it is no number, "" else.
        tolerance: How far from `paper` ours may be.
        better: `lower` or `higher`: which numbers are better than the paper's; "" where none is.
        at_least, at_most: Our own bound; infinite where there is none.
        fit: Key of the fit: which inputs were chosen so that this holds; "" where none were.
        why: Key of the reason, "" where none is needed.
        is_comparable: False: the paper's number was measured on something that cannot be had (its computer, its road).
    """

    figure: str
    what: str
    unit: str
    claimed_class: str
    paper_range: tuple[float, float] | None = None
    paper_statement: str = ""
    tolerance: float = 0.0
    better_direction: str = ""
    at_least: float = -math.inf
    at_most: float = math.inf
    fit_key: str = ""
    reason_key: str = ""
    is_comparable: bool = True

    @property
    def has_bound_of_our_own(self) -> bool:
        """Whether there is a bound of our own."""
        return math.isfinite(self.at_least) or math.isfinite(self.at_most)


@dataclass(frozen=True)
class Finding:
    """A number together with what is expected of it."""

    expected: Expectation
    measured: MeasuredNumber

    @property
    def reached_class(self) -> str:
        """The class that the number reaches, a key of `CLASSES`."""
        row, ours = self.expected, self.measured.ours
        if math.isnan(ours):
            return NOT_DETERMINABLE
        if not self._is_within_own_bound or (
            row.paper_range is not None and row.is_comparable and not self._is_within_tolerance
        ):
            return BETTER if self._is_within_own_bound and self._is_better_than_paper else DIFFERS
        if not row.is_comparable or (row.paper_range is None and not row.has_bound_of_our_own):
            return NOT_DETERMINABLE
        if row.fit_key:
            return FITTED
        return WITHIN_OWN_BOUND if row.paper_range is None else REPRODUCED

    @property
    def has_failed(self) -> bool:
        """Whether a claimed class is not reached, or our own bound is violated."""
        claim, reached = self.expected.claimed_class, self.reached_class
        if not self._is_within_own_bound:
            return claim != DIFFERS
        may_be = {claim, BETTER} if claim in {REPRODUCED, FITTED} else {claim}
        return claim in BINDING_CLASSES and reached not in may_be

    @property
    def differs_from_claim_without_failing(self) -> bool:
        """Whether the class differs from the claimed one without being a failure."""
        return not self.has_failed and self.reached_class != self.expected.claimed_class

    @property
    def _is_within_own_bound(self) -> bool:
        """Whether the number is within our own bound; true without one."""
        row, ours = self.expected, self.measured.ours
        if not row.has_bound_of_our_own:
            return True
        return row.at_least - ROUNDING_TOLERANCE <= ours <= row.at_most + ROUNDING_TOLERANCE  # false for NaN

    @property
    def _is_within_tolerance(self) -> bool:
        """Whether the number is within the tolerance around the paper's."""
        row, ours = self.expected, self.measured.ours
        if row.paper_range is None:
            return False
        return (
            row.paper_range[0] - row.tolerance - ROUNDING_TOLERANCE
            <= ours
            <= row.paper_range[1] + row.tolerance + ROUNDING_TOLERANCE
        )

    @property
    def _is_better_than_paper(self) -> bool:
        """Whether the whole interval is better than the paper's number."""
        row, measured = self.expected, self.measured
        if row.paper_range is None or not row.is_comparable:
            return False
        if row.better_direction == "lower":
            return (measured.ours if math.isnan(measured.high) else measured.high) < row.paper_range[0]
        if row.better_direction == "higher":
            return (measured.ours if math.isnan(measured.low) else measured.low) > row.paper_range[1]
        return False
