"""The expectations of a paper, `PAPER/expectations.toml`: each figure and table, its rows, fits, reasons."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from decimal import Decimal
from functools import cache
from importlib.resources import files
from typing import Any

from cwcli.lazy_dataclass import dataclass
from cwcli.reproduction.classes import (
    BETTER,
    CLASS_MEANINGS,
    DIFFERS,
    FITTED_CLASS,
    FOLLOWS_FROM_INPUT,
    GROUP_TITLES,
    GROUPS_THAT_MAY_BE_BETTER,
    NOT_DETERMINABLE,
    NOT_IN_PAPER,
    REPRODUCED,
    WITHIN_OWN_BOUND,
    Expectation,
)

EXPECTATION_KEYS = {
    "what", "unit", "class", "paper", "says", "text", "tolerance", "better", "at_least", "at_most", "fit", "assumes",
    "why", "comparable", "group",
}  # fmt: skip
"""The keys that a row of an expectations file may have."""
BEYOND_PAPER_REASON_KEY = "beyond"
"""Key of the reason of rows without an expectation, in parts that go beyond the paper."""
TRIED_REASON_PREFIX = "Tried: "
"""A reason for `not determinable` says behind this what was tried."""


@dataclass(frozen=True)
class PaperFigure:
    """A numbered figure or table of the paper, or a part of ours that is not in it.

    Attributes:
        name: `fig 9`.
        description: What stands there in the paper, or what ours is beyond it.
        expectation_by_number: What is expected of our numbers, by `what`.
        plot_names: Names of the plots that draw it.
        reason_for_absence: Why there is neither a number nor a picture, "" where there is one.
        is_beyond_paper: Not in the paper; a number without a row is `not in the paper`.
    """

    name: str
    description: str
    expectation_by_number: Mapping[str, Expectation]
    plot_names: tuple[str, ...]
    reason_for_absence: str
    is_beyond_paper: bool


@dataclass(frozen=True)
class FittedInputs:
    """Inputs that were chosen so that something holds: which, and how wide the choice is."""

    chosen_inputs: str
    choice_width: str


@dataclass(frozen=True)
class PaperExpectations:
    """The expectations of one paper.

    Attributes:
        paper: Its key.
        source: Its authors, title and journal.
        figures: By name, in the order of the output.
        fits, assumptions, reasons: By key.
        notes: Pages beside the generated one.
    """

    paper: str
    source: str
    figures: Mapping[str, PaperFigure]
    fits: Mapping[str, FittedInputs]
    assumptions: Mapping[str, str]
    reasons: Mapping[str, str]
    notes: tuple[str, ...] = ()

    def expectation_of_number(self, figure: str, what: str) -> Expectation:
        """Return the expectation of a number.

        Raises:
            KeyError: There is none, and the figure is in the paper.
        """
        found = self.figures[figure]
        if what in found.expectation_by_number or not found.is_beyond_paper:
            return found.expectation_by_number[what]
        return Expectation(figure, what, "", NOT_IN_PAPER, reason_key=BEYOND_PAPER_REASON_KEY)


@cache
def load_expectations(paper: str) -> PaperExpectations:
    """Read the expectations of a paper and check their form.

    Raises:
        ValueError: See `parse_expectations`.
    """
    text = files(f"cwcli.reproduction.{paper}").joinpath("expectations.toml").read_text(encoding="utf-8")
    return parse_expectations(tomllib.loads(text))


def printed_number_or_nan(paper: str, figure: str, what: str) -> float:
    """Return the number that a paper prints, NaN where it prints none or a range."""
    row = load_expectations(paper).figures[figure].expectation_by_number[what]
    if row.paper_range is None or row.paper_range[0] != row.paper_range[1]:
        return math.nan
    return row.paper_range[0]


def parse_expectations(document: Mapping[str, Any]) -> PaperExpectations:
    """Parse a document of expectations and check it.

    Raises:
        ValueError: A row claims a class that it has no right to; a key is unknown, missing or not used.
    """
    figures = {}
    for name, table in document["figures"].items():
        rows = [_parse_expectation(name, fields) for fields in table.get("rows", ())]
        pictures = tuple(table.get("pictures", ()))
        figure = PaperFigure(
            name,
            table["prints"],
            {row.what: row for row in rows},
            pictures,
            table.get("why_none", ""),
            table.get("beyond", False),
        )
        if len(figure.expectation_by_number) < len(rows):
            raise ValueError(f"{name}: two rows have the same name")
        if bool(figure.reason_for_absence) == bool(rows or pictures or figure.is_beyond_paper):
            raise ValueError(f"{name}: it has rows or a picture, or a reason why it has none")
        figures[name] = figure
    fits = {key: FittedInputs(fields["what"], fields["width"]) for key, fields in document.get("fits", {}).items()}
    assumptions = dict(document.get("assumptions", {}))
    reasons = dict(document["reasons"])
    every = [row for figure in figures.values() for row in figure.expectation_by_number.values()]
    _check_keys_defined_and_used("fit", {row.fit_key for row in every} - {""}, fits)
    _check_keys_defined_and_used("assumption", {row.assumption_key for row in every} - {""}, assumptions)
    _check_keys_defined_and_used(
        "reason", {row.reason_key for row in every} - {""} | {BEYOND_PAPER_REASON_KEY}, reasons
    )
    for row in every:
        if row.claimed_class == NOT_DETERMINABLE and TRIED_REASON_PREFIX not in reasons[row.reason_key]:
            raise ValueError(f"{row.figure}, {row.what}: the reason of 'not determinable' does not say what was tried")
    for name, figure in figures.items():
        _check_tolerances_against_spacing(name, figure.expectation_by_number.values())
    notes = tuple(document.get("notes", ()))
    return PaperExpectations(document["paper"], document["source"], figures, fits, assumptions, reasons, notes)


def _check_tolerances_against_spacing(figure: str, rows: Iterable[Expectation]) -> None:
    """Check that no tolerance is as wide as the distance to another number that the paper prints in that unit.

    A wider one could not tell the paper's numbers from each other. Half a unit of the last printed digit is always
    allowed: what is printed with fewer digits cannot be told from its neighbours.
    """
    compared = [(row, row.paper_range) for row in rows if row.paper_range is not None and row.is_comparable]
    printed: dict[str, set[float]] = {}
    for row, paper in compared:
        printed.setdefault(row.unit, set()).update(paper)
    for row, paper in compared:
        others = printed[row.unit] - set(paper)
        spacing = min((abs(other - value) for other in others for value in paper), default=math.inf)
        half_digit = max(0.5 * 10.0 ** int(Decimal(repr(value)).as_tuple().exponent) for value in paper)
        if row.tolerance > half_digit and row.tolerance >= spacing - 1e-12:
            raise ValueError(
                f"{figure}, {row.what}: the tolerance {row.tolerance:g} is not below {spacing:.4g}, "
                "the distance to another number that the paper prints"
            )


def _parse_expectation(figure: str, fields: Mapping[str, Any]) -> Expectation:
    """Parse one row and check its claim."""
    where = f"{figure}, {fields.get('what')}"
    if unknown := set(fields) - EXPECTATION_KEYS:
        raise ValueError(f"{where}: unknown keys {sorted(unknown)}")
    printed = fields.get("paper")
    paper = None
    if printed is not None:
        low, high = printed if isinstance(printed, Sequence) else (printed, printed)
        paper = (float(low), float(high))
    row = Expectation(
        figure=figure,
        what=fields["what"],
        unit=fields.get("unit", ""),
        claimed_class=fields["class"],
        paper_range=paper,
        paper_statement=fields.get("says", ""),
        paper_text=fields.get("text", ""),
        tolerance=float(fields.get("tolerance", 0.0)),
        better_direction=fields.get("better", ""),
        at_least=float(fields.get("at_least", -math.inf)),
        at_most=float(fields.get("at_most", math.inf)),
        fit_key=fields.get("fit", ""),
        assumption_key=fields.get("assumes", ""),
        reason_key=fields.get("why", ""),
        is_comparable=fields.get("comparable", True),
        group=fields.get("group", ""),
    )
    if fault := fault_in_claim_or_empty(row, has_tolerance="tolerance" in fields):
        raise ValueError(f"{where}: {fault}")
    return row


def fault_in_claim_or_empty(row: Expectation, *, has_tolerance: bool) -> str:
    """Describe what is wrong with a row's claim; "" if nothing is."""
    claim = row.claimed_class
    has_number = row.paper_range is not None and row.is_comparable
    is_compared = has_number or row.paper_text != ""
    faults = {
        f"there is no class '{claim}'": claim not in CLASS_MEANINGS,
        f"there is no group '{row.group}'": row.group not in GROUP_TITLES,
        "'reproduced' needs a number or a string of the paper that can be compared": claim == REPRODUCED
        and not is_compared,
        "'reproduced' with fitted or assumed inputs": claim == REPRODUCED
        and (row.fit_key != "" or row.assumption_key != ""),
        "'fitted' needs the fit": claim == FITTED_CLASS and not row.fit_key,
        "'follows' needs the assumption": claim == FOLLOWS_FROM_INPUT and not row.assumption_key,
        "fitted and assumed at once": row.fit_key != "" and row.assumption_key != "",
        f"'{claim}' needs a number or a bound": claim in {FITTED_CLASS, FOLLOWS_FROM_INPUT}
        and not (is_compared or row.has_bound_of_our_own),
        "'within own bound' needs a bound": claim == WITHIN_OWN_BOUND and not row.has_bound_of_our_own,
        "'within own bound' where the paper prints a number, or with fitted or assumed inputs": claim
        == WITHIN_OWN_BOUND
        and (row.is_printed or row.fit_key != "" or row.assumption_key != ""),
        "'better' needs a number that can be compared, and which way is better": claim == BETTER
        and not (has_number and row.better_direction),
        "'better' is for methods that do not look ahead": row.better_direction != ""
        and row.group not in GROUPS_THAT_MAY_BE_BETTER,
        "'better' is 'lower' or 'higher'": row.better_direction not in ("", "lower", "higher"),
        "'not determinable' needs a number of the paper": claim == NOT_DETERMINABLE and not row.is_printed,
        "'not in the paper' has neither a number of the paper nor a bound": claim == NOT_IN_PAPER
        and (row.is_printed or row.has_bound_of_our_own),
        "a number and a string at once": row.paper_range is not None and row.paper_text != "",
        "a reason is missing": claim in {BETTER, DIFFERS, NOT_DETERMINABLE, NOT_IN_PAPER} and not row.reason_key,
        "a number that can be compared needs a tolerance, and only that": has_tolerance != has_number,
    }
    return next((text for text, is_so in faults.items() if is_so), "")


def _check_keys_defined_and_used(kind: str, used: set[str], defined: Mapping[str, object]) -> None:
    """Check that every used key is defined and every defined one is used."""
    if missing := sorted(used - set(defined)):
        raise ValueError(f"there is no {kind} '{missing[0]}'")
    if idle := sorted(set(defined) - used - {BEYOND_PAPER_REASON_KEY}):
        raise ValueError(f"the {kind} '{idle[0]}' is not used")
