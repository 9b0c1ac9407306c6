"""The expectations of a paper, `PAPER/expectations.toml`: each figure and table, its rows, fits, reasons."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import Any

from cwcli.lazy_dataclass import dataclass
from cwcli.reproduction.classes import (
    BETTER,
    CLASS_MEANINGS,
    DIFFERS,
    FITTED,
    NOT_DETERMINABLE,
    REPRODUCED,
    WITHIN_OWN_BOUND,
    Expectation,
)

EXPECTATION_KEYS = {
    "what", "unit", "class", "paper", "says", "tolerance", "better", "at_least", "at_most", "fit", "why", "comparable",
}  # fmt: skip
"""The keys that a row of an expectations file may have."""
BEYOND_PAPER_REASON = "beyond"
"""Key of the reason of rows without an expectation, in parts that go beyond the paper."""


@dataclass(frozen=True)
class PaperFigure:
    """A numbered figure or table of the paper, or a part of ours that is not in it.

    Attributes:
        name: `fig 9`.
        prints: What stands there in the paper, or what ours is beyond it.
        rows: What is expected of our numbers, by `what`.
        pictures: Names of the plots that draw it.
        why_none: Why there is neither a number nor a picture, "" where there is one.
        is_beyond: Not in the paper; a number without a row is `not determinable`.
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
        fits, reasons: By key.
        notes: Pages beside the generated one.
    """

    paper: str
    source: str
    figures: Mapping[str, PaperFigure]
    fits: Mapping[str, FittedInputs]
    reasons: Mapping[str, str]
    notes: tuple[str, ...] = ()

    def expectation_of(self, figure: str, what: str) -> Expectation:
        """Return the expectation of a number.

        Raises:
            KeyError: There is none, and the figure is in the paper.
        """
        found = self.figures[figure]
        if what in found.expectation_by_number or not found.is_beyond_paper:
            return found.expectation_by_number[what]
        return Expectation(figure, what, "", NOT_DETERMINABLE, reason_key=BEYOND_PAPER_REASON)


@cache
def load_expectations(paper: str) -> PaperExpectations:
    """Read the expectations of a paper and check their form.

    Raises:
        ValueError: See `parse_expectations`.
    """
    text = files(f"cwcli.reproduction.{paper}").joinpath("expectations.toml").read_text(encoding="utf-8")
    return parse_expectations(tomllib.loads(text))


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
    reasons = dict(document["reasons"])
    every = [row for figure in figures.values() for row in figure.expectation_by_number.values()]
    _check_keys_defined_and_used("fit", {row.fit_key for row in every} - {""}, fits)
    _check_keys_defined_and_used("reason", {row.reason_key for row in every} - {""} | {BEYOND_PAPER_REASON}, reasons)
    notes = tuple(document.get("notes", ()))
    return PaperExpectations(document["paper"], document["source"], figures, fits, reasons, notes)


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
        tolerance=float(fields.get("tolerance", 0.0)),
        better_direction=fields.get("better", ""),
        at_least=float(fields.get("at_least", -math.inf)),
        at_most=float(fields.get("at_most", math.inf)),
        fit_key=fields.get("fit", ""),
        reason_key=fields.get("why", ""),
        is_comparable=fields.get("comparable", True),
    )
    if fault := fault_in_claim(row, has_tolerance="tolerance" in fields):
        raise ValueError(f"{where}: {fault}")
    return row


def fault_in_claim(row: Expectation, *, has_tolerance: bool) -> str:
    """Describe what is wrong with a row's claim; "" if nothing is."""
    has_number = row.paper_range is not None and row.is_comparable
    faults = {
        f"there is no class '{row.claimed_class}'": row.claimed_class not in CLASS_MEANINGS,
        "'reproduced' needs a number of the paper that can be compared": row.claimed_class == REPRODUCED
        and not has_number,
        "'reproduced' with fitted inputs": row.claimed_class == REPRODUCED and row.fit_key != "",
        "'fitted' needs the fit": row.claimed_class == FITTED and not row.fit_key,
        "'fitted' needs a number or a bound": row.claimed_class == FITTED
        and not (has_number or row.has_bound_of_our_own),
        "'within own bound' needs a bound": row.claimed_class == WITHIN_OWN_BOUND and not row.has_bound_of_our_own,
        "'within own bound' where the paper prints a number, or with fitted inputs": row.claimed_class
        == WITHIN_OWN_BOUND
        and (row.paper_range is not None or row.fit_key != ""),
        "'better' needs a number that can be compared, and which way is better": row.claimed_class == BETTER
        and not (has_number and row.better_direction),
        "'better' is 'lower' or 'higher'": row.better_direction not in ("", "lower", "higher"),
        "a reason is missing": row.claimed_class in {BETTER, DIFFERS, NOT_DETERMINABLE} and not row.reason_key,
        "a number that can be compared needs a tolerance, and only that": has_tolerance != has_number,
    }
    return next((text for text, is_so in faults.items() if is_so), "")


def _check_keys_defined_and_used(kind: str, used: set[str], defined: Mapping[str, object]) -> None:
    """Check that every used key is defined and every defined one is used."""
    if missing := sorted(used - set(defined)):
        raise ValueError(f"there is no {kind} '{missing[0]}'")
    if idle := sorted(set(defined) - used - {BEYOND_PAPER_REASON}):
        raise ValueError(f"the {kind} '{idle[0]}' is not used")
