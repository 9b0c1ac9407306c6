"""What counts as a conflict when warnings are scored: a measure beyond a threshold, as the user says it."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from cwcli.errors import UsageError
from cwcli.measures import MEASURES
from cwcli.measures.base import SIGNS, Measure
from cwcli.measures.pair import Pair
from cwcli.signals.columns import FloatArray

OLD_NAMES = {"outline": "gap"}
"""Of measures, as earlier versions spelled them in a definition."""

_DEFINITION = re.compile(r"\s*([\w.-]+)\s*(?:([<>])\s*(\S+))?\s*")


@dataclass(frozen=True)
class ConflictDefinition:
    """A measure beyond a threshold."""

    measure: Measure
    threshold: float

    @property
    def words(self) -> str:
        """What held at a conflict: `the two touched`."""
        return self.measure.words(self.threshold)

    def margin(self, pair: Pair) -> FloatArray:
        """A function of time that is negative during a conflict, (n,)."""
        values = pair.value(self.measure)
        return values - self.threshold if self.measure.critical == "low" else self.threshold - values


def conflict_definition(text: str, *, distance_m: float) -> ConflictDefinition:
    """What counts as a conflict: `NAME`, `NAME < NUMBER` or `NAME > NUMBER`.

    Args:
        text: As above.
        distance_m: From where on `distance` alone is one.

    Raises:
        UsageError: There is no such measure, or it is not one of each moment, or it lacks a threshold.
    """
    parts = _DEFINITION.fullmatch(text)
    if parts is None:
        raise UsageError(f"'{text}' is no definition of a conflict", hint=f"for example {example('ttc')}")
    name, sign, number = parts.groups()
    name = OLD_NAMES.get(name, name)
    measure = MEASURES.require(name)
    if not measure.is_series:
        raise UsageError(f"{name} is one number for two vehicles: no conflict begins or ends by it")
    if measure.needs_covariance:
        raise UsageError(f"{name} takes covariances: what happened has none", hint=f"for example {example('ttc')}")
    threshold = distance_m if name == "distance" else measure.threshold
    if number is not None:
        threshold = _number(number)
    if threshold is None or not np.isfinite(threshold) or (sign and sign != SIGNS[measure.critical]):
        raise UsageError(
            f"'{text}' does not say from where on two vehicles are in conflict", hint=f"for example {example(name)}"
        )
    return ConflictDefinition(measure, threshold)


def definitions() -> str:
    """The definitions of a conflict with the measures' own thresholds: `distance < 2.5 m, ttc < 1 s`."""

    def beyond(measure: Measure) -> str:
        if not measure.is_series or measure.threshold is None:
            return ""
        return f"{SIGNS[measure.critical]} {measure.threshold:g} {measure.unit}".rstrip()

    return ", ".join(f"{name} {words}" for name, words in MEASURES.describe(beyond).items() if words)


def example(name: str) -> str:
    """A definition by this measure."""
    return f"--conflict '{name} {SIGNS[MEASURES[name].critical]} 1.5'"


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")
