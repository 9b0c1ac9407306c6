"""A doubt, and the rule that finds it."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from cwcli.evaluation.doubts.evidence import DoubtEvidence
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.vehicle_state import StateFlag

WHOLE_DRIVE_SENTENCE_BEGINNING = "In the whole drive, of which this log is a part, "
"""Begins the sentence of a doubt that rests on counts over more than the log holds."""


@dataclass(frozen=True)
class Doubt:
    """A reason not to believe the results on a log as they are.

    Attributes:
        name: Of its rule in `DOUBT_RULES`.
        sentence: What is doubtful, with the number; a whole sentence.
        advice: What to do about it; a whole sentence.
        value: The number that exceeds the threshold.
        threshold, unit: From which value on it is doubted, and the unit of both.
        is_repaired: cwcli has corrected the fault: the results need a check, not distrust.
    """

    name: str
    sentence: str
    advice: str
    value: float
    threshold: float
    unit: str
    is_repaired: bool = False

    @property
    def headline(self) -> str:
        """The sentence behind what it means for the results: `Do not trust this as it is: the track lies ...`."""
        meaning = "A wrong sensor was corrected" if self.is_repaired else "Do not trust this as it is"
        return f"{meaning}: {self.sentence[:1].lower()}{self.sentence[1:]}"


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
        short_name: What a list of further doubts calls it; "": its name in `DOUBT_RULES`.
        is_repaired: As in `Doubt`.
        is_of_whole_log: It rests on counts over all that was estimated: of a log that is a part of that (`cwcli cut`),
            the sentence says so.
        flag: What it finds marks states with this flag: a part without such a state has nothing of it.
    """

    summary: str
    threshold: float
    unit: str
    source: str
    advice: str
    find: Callable[[DoubtEvidence], Iterable[Finding]]
    is_remark: bool = False
    short_name: str = ""
    is_repaired: bool = False
    is_of_whole_log: bool = False
    flag: StateFlag | None = None

    def find_doubts(self, name: str, evidence: DoubtEvidence) -> list[Doubt]:
        """Return the doubts of this rule; of a part of a log, only those that may concern it."""
        if evidence.is_part and self.flag is not None and not evidence.has_state_flagged(self.flag):
            return []
        whole = WHOLE_DRIVE_SENTENCE_BEGINNING if evidence.is_part and self.is_of_whole_log else ""
        return [
            Doubt(
                name,
                f"{whole}{found.sentence[:1].lower()}{found.sentence[1:]}" if whole else found.sentence,
                found.advice or self.advice,
                found.value,
                self.threshold,
                self.unit,
                self.is_repaired,
            )
            for found in self.find(evidence)
        ]
