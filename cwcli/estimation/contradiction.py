"""Contradiction between two sources, with its texts."""

from __future__ import annotations

from cwcli.estimation.measurements import KINDS_THAT_IMU_MEASURES_TOO, Kind
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.role import Role

_ROLE_OF_KIND = {
    Kind.POSITION: Role.EGO_POSITION,
    Kind.VELOCITY: Role.EGO_VELOCITY,
    Kind.SPEED: Role.EGO_SPEED,
    Kind.HEADING: Role.EGO_HEADING,
}
"""Role of the sources of each kind; all other kinds come from an IMU."""
GRAVITY_TEXT = "gravity"
"""Name of gravity in texts, for an IMU that contradicts it."""

CAR_MOTION_TEXT = "how a car moves"
"""Text for what a source contradicts if there is no other source."""


@dataclass(frozen=True)
class SourceQuantity:
    """A quantity of a source.

    Attributes:
        source: Topic.
        kind: What it measures.
    """

    source: str
    kind: Kind

    @property
    def role_name_for_options(self) -> str:
        """The role, so that it can be named in `--topic` and `--map`."""
        return str(_ROLE_OF_KIND.get(self.kind, Role.IMU))

    def __str__(self) -> str:
        """The role and the topic."""
        if self.kind in KINDS_THAT_IMU_MEASURES_TOO:
            return f"{Role.IMU} {self.kind.name.lower().replace('_', ' ')} ({self.source})"
        return f"{self.role_name_for_options} ({self.source})"


@dataclass(frozen=True)
class Contradiction:
    """A source that contradicts another one.

    Attributes:
        who: The source that is more likely wrong, as far as that is known.
        against: The other one, or `GRAVITY_TEXT`, or `CAR_MOTION_TEXT`.
        what: What shows it, in words, with a number.
        allies: Further sources that contradict `who` and agree with each other.
        left_out: The sources that were not used for the estimate: `who`, both, or neither.
        explains_misfits: No other source is to be blamed for what does not fit, because of this one.
    """

    who: SourceQuantity
    against: SourceQuantity | str
    what: str
    allies: tuple[SourceQuantity, ...] = ()
    left_out: tuple[SourceQuantity, ...] = ()
    explains_misfits: bool = False

    def with_left_out(self, *sources: SourceQuantity) -> Contradiction:
        """Return the contradiction with the sources that are left out of the estimate."""
        return replace(self, left_out=sources)

    @property
    def contradiction_sentence(self) -> str:
        """Sentence on who contradicts whom, and by what."""
        return f"{self.who} contradicts {self.against}: {self.what}"

    @property
    def votes_and_left_out_sources_text(self) -> str:
        """Text on the votes and on the sources that are left out."""
        if self.allies:
            why = f"{', '.join(str(each) for each in self.allies)} {'agree' if len(self.allies) > 1 else 'agrees'} with"
            action_text = f"{why} {self.against}"
        elif self.against in (GRAVITY_TEXT, CAR_MOTION_TEXT):
            action_text = ""
        else:
            action_text = "no third source tells which of them is wrong"
        if self.against in self.left_out:
            left_out = "both are left out of the estimate"
        elif self.left_out:
            left_out = f"{self.who} is left out of the estimate"
        else:
            left_out = "both are used" if isinstance(self.against, SourceQuantity) else "it is used all the same"
        return "; ".join(part for part in (action_text, left_out) if part)
