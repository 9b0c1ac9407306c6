"""Correction of a source whose values were wrong in a known way, with its sentence."""

from __future__ import annotations

from cwcli.estimation.contradiction import SourceQuantity
from cwcli.estimation.hypotheses.base import Hypothesis
from cwcli.estimation.measurements import Measurements
from cwcli.lazy_dataclass import dataclass


@dataclass(frozen=True)
class Correction:
    """A source that is used after its values were corrected.

    Attributes:
        who: The source.
        name: Name of the fault, as `--as SOURCE=NAME` takes it.
        fault: What is wrong with it: the end of the sentence "SOURCE ...".
        action: What was done about it.
        evidence: What shows it, "" where the user said it.
        n_rows: Number of rows that were changed.
        n_set_aside: Number of rows that were left out instead.
    """

    who: SourceQuantity
    name: str
    fault: str
    action: str
    evidence: str = ""
    n_rows: int = 0
    n_set_aside: int = 0

    @property
    def is_by_user(self) -> bool:
        """Whether the user asked for it by `--as`."""
        return not self.evidence

    @property
    def sentence_on_fault_and_undoing(self) -> str:
        """Sentence on the fault, what was done and how to undo it."""
        if self.is_by_user:
            return f"{self.who} {self.fault}: {self.action}, as --as says"
        return (
            f"{self.who} {self.fault}: {self.action} ({self.evidence}; --trust {self.who.source} leaves it unchanged)"
        )


def correction_of_all_rows(m: Measurements, hypothesis: Hypothesis, evidence: str) -> Correction:
    """Return the correction of all rows of a source; evidence is "" where the user said it."""
    who = SourceQuantity(m.source, m.kind)
    return Correction(who, hypothesis.name, hypothesis.fault, hypothesis.action, evidence, n_rows=len(m))
