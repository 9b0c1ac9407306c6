"""The classes of a number compared with a paper's, and how a number gets its class from its expectation."""

from __future__ import annotations

import math
from dataclasses import field

from cwcli.lazy_dataclass import dataclass

REPRODUCED = "reproduced"
"""The class of the paper's number or string within the tolerance, on inputs that were not fitted to it."""
FITTED_CLASS = "fitted"
"""The class of what holds on inputs that were chosen so that it holds."""
FOLLOWS_FROM_INPUT = "follows"
"""The class of what was put in, or follows by arithmetic from a value that was put in or assumed."""
WITHIN_OWN_BOUND = "within own bound"
"""The class of a number within a bound of our own, where the paper prints none."""
BETTER = "better"
"""The class of a causal method's number that is better than the paper's by more than the tolerance."""
DIFFERS = "differs"
"""The class of another number than the paper's, or one outside our own bound."""
NOT_DETERMINABLE = "not determinable"
"""The class of a printed number that ours cannot be compared with, although something was tried."""
NOT_IN_PAPER = "not in the paper"
"""The class of a number of ours for which the paper prints none."""
CLASS_MEANINGS: dict[str, str] = {
    REPRODUCED: "the paper's number or string, within the tolerance, on inputs that were not fitted to it",
    FITTED_CLASS: "it holds on inputs that were chosen so that it holds",
    FOLLOWS_FROM_INPUT: "it was put in, or follows by arithmetic from a value that was put in or assumed",
    WITHIN_OWN_BOUND: "within a bound of our own; the paper prints no number",
    BETTER: "a causal method's number, better than the paper's by more than the tolerance",
    DIFFERS: "another number than the paper's, or outside our own bound",
    NOT_DETERMINABLE: "the paper prints it, but it cannot be compared; the reason says what was tried",
    NOT_IN_PAPER: "the paper prints no such number",
}
"""Class -> its meaning, in the order of the tables."""
CLASSES_THAT_MUST_BE_REACHED_WHERE_CLAIMED = frozenset(
    {REPRODUCED, FITTED_CLASS, FOLLOWS_FROM_INPUT, WITHIN_OWN_BOUND, BETTER}
)
"""Classes that must be reached where they are claimed, or the exit code is 1."""
CLASSES_WITHIN_TOLERANCE_OF_PAPER_NUMBER = frozenset({REPRODUCED, FITTED_CLASS, FOLLOWS_FROM_INPUT})
"""Classes of a number that is within the tolerance around the paper's."""
GROUP_OF_PAPER_METHOD = ""
"""The group of the numbers that the paper's own method gives: those that its printed numbers are compared with."""
GROUP_TITLES: dict[str, str] = {
    GROUP_OF_PAPER_METHOD: "The paper's own method",
    "repeat": "The same printed numbers on another drive or with another reading",
    "causal": "Our causal filter",
    "default": "Our default",
    "smoother": "Our smoother, which looks ahead",
}
"""Group of numbers -> its title; each group is counted apart."""
GROUPS_THAT_MAY_BE_BETTER = frozenset({GROUP_OF_PAPER_METHOD, "repeat", "causal"})
"""Groups of causal methods. A method that looks ahead is not compared with a filter that does not."""
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
        text: Our string, where the paper prints a string; "" else.
    """

    figure: str
    what: str
    ours: float
    low: float = math.nan
    high: float = math.nan
    text: str = field(default="", kw_only=True)


@dataclass(frozen=True)
class Expectation:
    """What is expected of one number, from the file `PAPER/expectations.toml`.

    Attributes:
        figure, what: As in `MeasuredNumber`.
        unit: Of the number, "" for a share or a yes (1) or no (0).
        claimed_class: The class that it should get, a key of `CLASS_MEANINGS`.
        paper_range: Least and largest of the paper's number, equal where it prints one; None where it prints none.
        paper_statement: What the paper says, where it is no number, "" else.
        paper_text: The string that the paper prints, "" where it prints none.
        tolerance: How far from `paper_range` ours may be.
        better_direction: `lower` or `higher`: which numbers are better than the paper's; "" where none is.
        at_least, at_most: Our own bound; infinite where there is none.
        fit_key: Key of the fit: which inputs were chosen so that this holds; "" where none were.
        assumption_key: Key of the assumption: which value it is or follows from; "" where it follows from none.
        reason_key: Key of the reason, "" where none is needed.
        is_comparable: False: the paper's number was measured on something that cannot be had.
        group: A key of `GROUP_TITLES`.
    """

    figure: str
    what: str
    unit: str
    claimed_class: str
    paper_range: tuple[float, float] | None = None
    paper_statement: str = ""
    paper_text: str = ""
    tolerance: float = 0.0
    better_direction: str = ""
    at_least: float = -math.inf
    at_most: float = math.inf
    fit_key: str = ""
    assumption_key: str = ""
    reason_key: str = ""
    is_comparable: bool = True
    group: str = GROUP_OF_PAPER_METHOD

    @property
    def is_printed(self) -> bool:
        """Whether the paper prints a number or a string for it."""
        return self.paper_range is not None or self.paper_text != ""

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
    def verdict_class_of_number(self) -> str:
        """The class that the number reaches, a key of `CLASS_MEANINGS`."""
        row, measured = self.expected, self.measured
        if row.paper_text:
            return self._class_of_what_holds if measured.text == row.paper_text else DIFFERS
        if math.isnan(measured.ours) or (row.paper_range is not None and not row.is_comparable):
            return NOT_DETERMINABLE if self._is_within_own_bound or math.isnan(measured.ours) else DIFFERS
        if row.paper_range is None:
            return self._class_without_printed_number
        if self._is_within_own_bound and self._is_within_tolerance:
            return self._class_of_what_holds
        return BETTER if self._is_within_own_bound and self._is_better_than_paper else DIFFERS

    @property
    def _class_without_printed_number(self) -> str:
        """The class where the paper prints no number."""
        row = self.expected
        if not row.has_bound_of_our_own:
            return NOT_IN_PAPER
        if not self._is_within_own_bound:
            return DIFFERS
        return self._class_of_what_holds if row.fit_key or row.assumption_key else WITHIN_OWN_BOUND

    @property
    def _class_of_what_holds(self) -> str:
        """The class of what agrees with the paper, by what was put in for it."""
        if self.expected.fit_key:
            return FITTED_CLASS
        return FOLLOWS_FROM_INPUT if self.expected.assumption_key else REPRODUCED

    @property
    def has_failed(self) -> bool:
        """Whether a claimed class is not reached, or our own bound is violated."""
        claim, reached = self.expected.claimed_class, self.verdict_class_of_number
        if not self._is_within_own_bound:
            return claim != DIFFERS
        may_be = {claim, BETTER} if claim in CLASSES_WITHIN_TOLERANCE_OF_PAPER_NUMBER else {claim}
        return claim in CLASSES_THAT_MUST_BE_REACHED_WHERE_CLAIMED and reached not in may_be

    @property
    def differs_from_claim_without_failing(self) -> bool:
        """Whether the class differs from the claimed one without being a failure."""
        return not self.has_failed and self.verdict_class_of_number != self.expected.claimed_class

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
        if row.paper_range is None or not row.is_comparable or row.group not in GROUPS_THAT_MAY_BE_BETTER:
            return False
        if row.better_direction == "lower":
            return (measured.ours if math.isnan(measured.high) else measured.high) < row.paper_range[0]
        if row.better_direction == "higher":
            return (measured.ours if math.isnan(measured.low) else measured.low) > row.paper_range[1]
        return False
