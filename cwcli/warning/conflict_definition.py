"""The user's definition of a conflict, with which warnings are scored: measures beyond their thresholds."""

from __future__ import annotations

import re

import numpy as np

from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.measures import MEASURES
from cwcli.measures.base import OPERATOR_BY_CRITICAL_SIDE, Measure
from cwcli.measures.pair import Pair
from cwcli.signals.columns import FloatArray
from cwcli.text import parse_float_or_nan

_DEFINITION_PATTERN = re.compile(r"\s*([\w.-]+)\s*(?:([<>])\s*(\S+))?\s*")
"""The syntax of one part of a definition: a name, and optionally a comparison and a number."""
_OR_PATTERN = re.compile(r"\s+or\s+")
"""The syntax of what stands between the parts of a definition."""
DEFAULT_CONFLICT = "distance or gap or ttc"
"""The definition of a conflict that `--conflict` has by default.

The centre distance of song2016 alone misses cars that touch at their corners or ends, or nearly do: a car that stops
right behind another one is 4.5 m from it. The outlines (`gap`: they touch) and the time to their contact (`ttc`: 1 s;
1.5 s is usual for urban conflicts, van der Horst 1990) see those."""


@dataclass(frozen=True)
class ConflictPart:
    """A measure beyond a threshold."""

    measure: Measure
    threshold: float

    @property
    def conflict_text(self) -> str:
        """The text of what held at a conflict: `the two touched`."""
        return self.measure.conflict_text(self.threshold)

    def margin_negative_in_conflict(self, pair: Pair) -> FloatArray:
        """The distance of the measure from its threshold at each stamp, (n,), negative during a conflict."""
        values = pair.evaluate_measure(self.measure)
        return values - self.threshold if self.measure.critical == "low" else self.threshold - values


@dataclass(frozen=True)
class ConflictDefinition:
    """One measure beyond its threshold, or one of several.

    Attributes:
        parts: In the order of the definition. Where several hold of one conflict, the first says when it was.
    """

    parts: tuple[ConflictPart, ...]

    @property
    def conflict_text(self) -> str:
        """The text of what held at a conflict: `the two touched, or the two were 1 s from contact`."""
        return ", or ".join(part.conflict_text for part in self.parts)


def parse_conflict_definition(text: str, *, distance_m: float) -> ConflictDefinition:
    """Parse a definition of a conflict: `NAME`, `NAME < NUMBER` or `NAME > NUMBER`, or several with ` or ` between.

    Args:
        distance_m: Threshold of `distance` without a number.

    Raises:
        UsageError: There is no such measure, or it has no value of each moment, or it lacks a threshold.
    """
    return ConflictDefinition(tuple(_parse_part(part, distance_m) for part in _OR_PATTERN.split(text)))


def _parse_part(text: str, distance_m: float) -> ConflictPart:
    """Parse one measure beyond a threshold; a `UsageError` if it is none."""
    parts = _DEFINITION_PATTERN.fullmatch(text)
    if parts is None:
        raise UsageError(
            f"'{text}' is not a definition of a conflict", hint=f"for example {format_example_option('ttc')}"
        )
    name, sign, number = parts.groups()
    measure = MEASURES.require(name)
    if not measure.is_series:
        raise UsageError(f"{name} is one number for the whole drive, so it cannot say when a conflict begins")
    if measure.needs_covariance:
        raise UsageError(
            f"{name} needs covariances, and actual motion has none", hint=f"for example {format_example_option('ttc')}"
        )
    threshold = distance_m if name == "distance" else measure.threshold
    if number is not None:
        threshold = parse_float_or_nan(number)
    if (
        threshold is None
        or not np.isfinite(threshold)
        or (sign and sign != OPERATOR_BY_CRITICAL_SIDE[measure.critical])
    ):
        raise UsageError(
            f"'{text}' does not say beyond which value it is a conflict",
            hint=f"for example {format_example_option(name)}",
        )
    return ConflictPart(measure, threshold)


def format_default_definitions() -> str:
    """Format the definitions of a conflict with the measures' own thresholds: `distance < 2.5 m, ttc < 1 s`."""

    def threshold_text(measure: Measure) -> str:
        if not measure.is_series or measure.threshold is None:
            return ""
        return f"{OPERATOR_BY_CRITICAL_SIDE[measure.critical]} {measure.threshold:g} {measure.unit}".rstrip()

    return ", ".join(f"{name} {words}" for name, words in MEASURES.describe(threshold_text).items() if words)


def format_example_option(name: str) -> str:
    """Format an example of the option with this measure."""
    return f"--conflict '{name} {OPERATOR_BY_CRITICAL_SIDE[MEASURES[name].critical]} 1.5'"
