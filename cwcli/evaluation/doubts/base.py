"""A doubt, and the rule that finds it."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from cwcli.evaluation.doubts.evidence import DoubtEvidence
from cwcli.lazy_dataclass import dataclass


@dataclass(frozen=True)
class Doubt:
    """A reason not to believe the results on a log as they are.

    Attributes:
        name: Of its rule in `DOUBTS`.
        sentence: What is doubtful, with the number; a whole sentence.
        advice: What to do about it; a whole sentence.
        value: The number that exceeds the threshold.
        threshold, unit: From which value on it is doubted, and the unit of both.
    """

    name: str
    sentence: str
    advice: str
    value: float
    threshold: float
    unit: str


@dataclass(frozen=True)
class Finding:
    """What a rule found.

    Attributes:
        value: The number that exceeds the threshold of the rule.
        sentence: As in `Doubt`.
        advice: As in `Doubt`; "": that of the rule.
    """

    value: float
    sentence: str
    advice: str = ""


@dataclass(frozen=True)
class DoubtRule:
    """A rule that finds doubts.

    Attributes:
        summary: One line for the documentation.
        threshold, unit: From which value on it is a doubt, and the unit of both ("" for counts and ratios).
        source: Where the threshold comes from.
        advice: What to do, a whole sentence.
        find: Returns the findings in the evidence, the worst first.
        is_remark: It only limits what is known, as a missing truth does: it is shown where there is no doubt, and is
            not counted as one.
        short_name: What a list of further doubts calls it; "": its name in `DOUBTS`.
    """

    summary: str
    threshold: float
    unit: str
    source: str
    advice: str
    find: Callable[[DoubtEvidence], Iterable[Finding]]
    is_remark: bool = False
    short_name: str = ""

    def find_doubts(self, name: str, evidence: DoubtEvidence) -> list[Doubt]:
        """Return the doubts of this rule."""
        return [
            Doubt(name, found.sentence, found.advice or self.advice, found.value, self.threshold, self.unit)
            for found in self.find(evidence)
        ]
