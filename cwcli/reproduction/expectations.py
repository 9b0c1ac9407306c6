"""The expectations of a paper, `PAPER/expectations.toml`: each figure and table, its rows, fits, reasons."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from cwcli.reproduction.classes import BETTER, CLASSES, DIFFERS, FITTED, OPEN, REPRODUCED, WITHIN, Expectation

ROW_KEYS = {
    "what", "unit", "class", "paper", "says", "tolerance", "better", "at_least", "at_most", "fit", "why", "comparable",
}  # fmt: skip
"""The keys that a row of an expectations file may have."""
BEYOND = "beyond"
"""Key of the reason of rows without an expectation, in parts that go beyond the paper."""


@dataclass(frozen=True)
class Figure:
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
    prints: str
    rows: Mapping[str, Expectation]
    pictures: tuple[str, ...]
    why_none: str
    is_beyond: bool


@dataclass(frozen=True)
class Fit:
    """Inputs that were chosen so that something holds: which, and how wide the choice is."""

    what: str
    width: str


@dataclass(frozen=True)
class Expectations:
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
    figures: Mapping[str, Figure]
    fits: Mapping[str, Fit]
    reasons: Mapping[str, str]
    notes: tuple[str, ...] = ()

    def row(self, figure: str, what: str) -> Expectation:
        """Return the expectation of a number.

        Raises:
            KeyError: There is none, and the figure is in the paper.
        """
        found = self.figures[figure]
        if what in found.rows or not found.is_beyond:
            return found.rows[what]
        return Expectation(figure, what, "", OPEN, why=BEYOND)


@cache
def load_expectations(paper: str) -> Expectations:
    """Read the expectations of a paper and check their form.

    Raises:
        ValueError: See `expectations_of`.
    """
    text = files(f"cwcli.reproduction.{paper}").joinpath("expectations.toml").read_text(encoding="utf-8")
    return expectations_of(tomllib.loads(text))


def expectations_of(document: Mapping[str, Any]) -> Expectations:
    """Parse a document of expectations and check it.

    Raises:
        ValueError: A row claims a class that it has no right to; a key is unknown, missing or not used.
    """
    figures = {}
    for name, table in document["figures"].items():
        rows = [_row(name, fields) for fields in table.get("rows", ())]
        pictures = tuple(table.get("pictures", ()))
        figure = Figure(
            name,
            table["prints"],
            {row.what: row for row in rows},
            pictures,
            table.get("why_none", ""),
            table.get("beyond", False),
        )
        if len(figure.rows) < len(rows):
            raise ValueError(f"{name}: two rows have the same name")
        if bool(figure.why_none) == bool(rows or pictures or figure.is_beyond):
            raise ValueError(f"{name}: it has rows or a picture, or a reason why it has none")
        figures[name] = figure
    fits = {key: Fit(fields["what"], fields["width"]) for key, fields in document.get("fits", {}).items()}
    reasons = dict(document["reasons"])
    every = [row for figure in figures.values() for row in figure.rows.values()]
    _check_keys("fit", {row.fit for row in every} - {""}, fits)
    _check_keys("reason", {row.why for row in every} - {""} | {BEYOND}, reasons)
    notes = tuple(document.get("notes", ()))
    return Expectations(document["paper"], document["source"], figures, fits, reasons, notes)


def _row(figure: str, fields: Mapping[str, Any]) -> Expectation:
    """Parse one row and check its claim."""
    where = f"{figure}, {fields.get('what')}"
    if unknown := set(fields) - ROW_KEYS:
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
        claim=fields["class"],
        paper=paper,
        says=fields.get("says", ""),
        tolerance=float(fields.get("tolerance", 0.0)),
        better=fields.get("better", ""),
        at_least=float(fields.get("at_least", -math.inf)),
        at_most=float(fields.get("at_most", math.inf)),
        fit=fields.get("fit", ""),
        why=fields.get("why", ""),
        is_comparable=fields.get("comparable", True),
    )
    if fault := fault_of(row, has_tolerance="tolerance" in fields):
        raise ValueError(f"{where}: {fault}")
    return row


def fault_of(row: Expectation, *, has_tolerance: bool) -> str:
    """Describe what is wrong with a row's claim; "" if nothing is."""
    has_number = row.paper is not None and row.is_comparable
    faults = {
        f"there is no class '{row.claim}'": row.claim not in CLASSES,
        "'reproduced' needs a number of the paper that can be compared": row.claim == REPRODUCED and not has_number,
        "'reproduced' with fitted inputs": row.claim == REPRODUCED and row.fit != "",
        "'fitted' needs the fit": row.claim == FITTED and not row.fit,
        "'fitted' needs a number or a bound": row.claim == FITTED and not (has_number or row.is_bounded),
        "'within own bound' needs a bound": row.claim == WITHIN and not row.is_bounded,
        "'within own bound' where the paper prints a number, or with fitted inputs": row.claim == WITHIN
        and (row.paper is not None or row.fit != ""),
        "'better' needs a number that can be compared, and which way is better": row.claim == BETTER
        and not (has_number and row.better),
        "'better' is 'lower' or 'higher'": row.better not in ("", "lower", "higher"),
        "a reason is missing": row.claim in {BETTER, DIFFERS, OPEN} and not row.why,
        "a number that can be compared needs a tolerance, and only that": has_tolerance != has_number,
    }
    return next((text for text, is_so in faults.items() if is_so), "")


def _check_keys(kind: str, used: set[str], defined: Mapping[str, object]) -> None:
    """Check that every used key is defined and every defined one is used."""
    if missing := sorted(used - set(defined)):
        raise ValueError(f"there is no {kind} '{missing[0]}'")
    if idle := sorted(set(defined) - used - {BEYOND}):
        raise ValueError(f"the {kind} '{idle[0]}' is not used")
