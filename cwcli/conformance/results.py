"""Results: of a repetition, a trial and a clause; the same for simulated and for recorded trials."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from cwcli.conformance.clause import TEXT_BY_BASIS_OF_CLAUSE_NUMBER, Clause, PublishedNumber, Trial
from cwcli.conformance.verdict import Verdict
from cwcli.lazy_dataclass import dataclass
from cwcli.text import finite_or_none

PASSED, FAILED, NOT_VALID, NOT_JUDGED = "pass", "fail", "not valid", "not judged"
"""Outcomes of a trial. `not valid`: it was driven out of its tolerances. `not judged`: nothing of it was driven."""


@dataclass(frozen=True)
class Repetition:
    """One repetition of a trial.

    Attributes:
        label: The seed, or the log.
        verdict: None where the trial was not valid.
        breaches: The tolerances that it broke, with their numbers, in words.
    """

    label: str
    verdict: Verdict | None
    breaches: tuple[str, ...] = ()

    @property
    def outcome(self) -> str:
        """`pass`, `fail` or `not valid`."""
        if self.verdict is None or self.breaches:
            return NOT_VALID
        return PASSED if self.verdict.is_pass else FAILED


@dataclass(frozen=True)
class TrialResult:
    """All repetitions of one trial.

    Attributes:
        n_required: How many must pass.
    """

    trial: Trial
    repetitions: tuple[Repetition, ...]
    n_required: int

    @property
    def n_passed_repetitions(self) -> int:
        """Number of repetitions that passed."""
        return sum(each.outcome == PASSED for each in self.repetitions)

    @property
    def outcome(self) -> str:
        """The outcome of the trial."""
        if not self.repetitions:
            return NOT_JUDGED
        valid = [each for each in self.repetitions if each.outcome != NOT_VALID]
        if not valid:
            return NOT_VALID
        return PASSED if self.n_passed_repetitions >= self.n_required else FAILED

    @property
    def worst_repetition(self) -> Repetition | None:
        """The repetition that is nearest to failing, or fails worst; None without a valid one."""
        valid = [each for each in self.repetitions if each.verdict is not None and not each.breaches]
        return min(valid, key=_worst_first_sort_key, default=None)

    @property
    def margin_text(self) -> str:
        """The worst margin with its unit; "" where there is no number."""
        worst = self.worst_repetition
        if worst is None or worst.verdict is None or math.isnan(worst.verdict.margin):
            return ""
        return f"{worst.verdict.margin:+.2f} {worst.verdict.unit}".rstrip()

    @property
    def passed_text(self) -> str:
        """How many repetitions passed: `3 of 5`."""
        return f"{self.n_passed_repetitions} of {len(self.repetitions)}"

    @property
    def worst_repetition_text(self) -> str:
        """What happened in the worst repetition; "" without a valid one."""
        worst = self.worst_repetition
        return "" if worst is None or worst.verdict is None else worst.verdict.text


def _worst_first_sort_key(repetition: Repetition) -> tuple[bool, float]:
    """Key of a repetition: failed ones first, then by the margin."""
    assert repetition.verdict is not None
    margin = repetition.verdict.margin
    return repetition.verdict.is_pass, math.inf if math.isnan(margin) else margin


@dataclass(frozen=True)
class ClauseResult:
    """The result of a clause.

    Attributes:
        settings: How it was run, by name: `rule`, `policy`, `grade`, `log`, `system`.
        notes: What is odd about the warnings of another system.
    """

    clause: Clause
    trials: tuple[TrialResult, ...]
    n_repetitions: int
    settings: Mapping[str, str]
    notes: tuple[str, ...] = ()

    @property
    def outcome(self) -> str:
        """`fail` if a trial fails; `not valid` if one is; `pass` if all that were driven pass."""
        outcomes = {trial.outcome for trial in self.trials}
        for outcome in (FAILED, NOT_VALID, PASSED):
            if outcome in outcomes:
                return outcome
        return NOT_JUDGED

    @property
    def trials_with_repetitions(self) -> tuple[TrialResult, ...]:
        """The trials of which something was driven."""
        return tuple(trial for trial in self.trials if trial.outcome != NOT_JUDGED)

    @property
    def worst_trial(self) -> TrialResult | None:
        """The trial that fails worst, or is nearest to failing."""
        known = [trial for trial in self.trials if trial.worst_repetition is not None]
        return min(
            known,
            key=lambda trial: (trial.outcome != FAILED, _worst_first_sort_key(_worst_repetition_of_trial(trial))),
            default=None,
        )

    @property
    def passed_text(self) -> str:
        """How many trials passed: `3 of 5`."""
        driven = self.trials_with_repetitions
        return f"{sum(trial.outcome == PASSED for trial in driven)} of {len(driven)}"

    @property
    def worst_margin_text(self) -> str:
        """The worst margin with its unit; "" where there is no number."""
        return "" if self.worst_trial is None else self.worst_trial.margin_text

    def to_json(self) -> dict[str, Any]:
        """The result as a document of plain values; what is not finite is None."""
        clause = self.clause
        return {
            "name": clause.name,
            "title": clause.title,
            "source": clause.source,
            "reading": clause.reading,
            "outcome": self.outcome,
            "repetitions": self.n_repetitions,
            "settings": dict(self.settings),
            "notes": list(self.notes),
            "numbers": [_number_document(number) for number in clause.numbers.values()],
            "tolerances": [_number_document(number) for number in clause.tolerances.values()],
            "left_out": dict(clause.left_out),
            "trials": [_trial_document(trial) for trial in self.trials],
        }


def _worst_repetition_of_trial(trial: TrialResult) -> Repetition:
    """The worst repetition of a trial that has one."""
    assert trial.worst_repetition is not None
    return trial.worst_repetition


def _number_document(number: PublishedNumber) -> dict[str, Any]:
    """A number as plain values."""
    return {
        "name": number.name,
        "values": list(number.values),
        "unit": number.unit,
        "source": number.source,
        "page": number.page_text,
        "basis": TEXT_BY_BASIS_OF_CLAUSE_NUMBER[number.basis],
        "ttc": number.ttc,
    }


def _trial_document(trial: TrialResult) -> dict[str, Any]:
    """A trial as plain values."""
    return {
        "name": trial.trial.name,
        "outcome": trial.outcome,
        "passed": trial.n_passed_repetitions,
        "required": trial.n_required,
        "repetitions": [
            {
                "label": each.label,
                "outcome": each.outcome,
                "margin": None if each.verdict is None else finite_or_none(each.verdict.margin),
                "margin_unit": "" if each.verdict is None else each.verdict.unit,
                "text": "" if each.verdict is None else each.verdict.text,
                "breaches": list(each.breaches),
                "values": {}
                if each.verdict is None
                else {name: finite_or_none(value) for name, value in each.verdict.values.items()},
            }
            for each in trial.repetitions
        ],
    }
