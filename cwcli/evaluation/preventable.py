"""Whether a careful driver would have avoided the conflicts that really happened."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cwcli.control.preventable import DRIVERS, Preventability, preventability
from cwcli.evaluation.conflicts import RealConflict
from cwcli.evaluation.happened import Happened
from cwcli.measures.gap import MEASURE as GAP
from cwcli.measures.pair import Pair
from cwcli.metrics.headline import Headline
from cwcli.signals.units import NS_PER_S

CAREFUL = "careful human"
MAX_CONFLICTS = 100
"""Judged of a log: each takes tens of milliseconds. The metric's `n` tells how many were."""


@dataclass(frozen=True)
class Careful:
    """What a careful driver would have made of a conflict.

    Attributes:
        at_ns: When the outlines first touched, or the centres were nearest.
        outcome: Of the careful and competent human of UN Regulation 157, in control from 8 s before.
    """

    at_ns: int
    outcome: Preventability

    @property
    def braked_ns(self) -> int | None:
        """When it would have braked first; None: never."""
        braked_s = self.outcome.braked_s
        return self.at_ns - round(braked_s * NS_PER_S) if np.isfinite(braked_s) else None


def careful_driver(pair: Pair, conflict: RealConflict) -> Careful | None:
    """The careful driver in a conflict; None where the two are not both known right before it."""
    touches = pair.value(GAP) <= 0.0  # NaN does not
    rows = np.flatnonzero(touches & (pair.stamp_ns >= conflict.onset_ns) & (pair.stamp_ns <= conflict.end_ns))
    at_ns = conflict.closest_ns
    if len(rows):
        apart = np.flatnonzero(~touches[: rows[0]])  # the outlines may touch before the conflict's definition is met
        at_ns = int(pair.stamp_ns[apart[-1] + 1 if len(apart) else 0])
    found = preventability(pair, at_ns, {CAREFUL: DRIVERS[CAREFUL]})
    return Careful(at_ns, found[0]) if found else None


def add_preventable(headline: Headline, real: Happened) -> None:
    """Add the share of the conflicts that the careful driver would have avoided."""
    conflicts = [(real.pairs[vehicle], each) for vehicle, found in real.conflicts.items() for each in found]
    conflicts.sort(key=lambda entry: entry[1].onset_ns)
    judged = [careful_driver(*entry) for entry in conflicts[:MAX_CONFLICTS]]
    headline.share("warnings.preventable_share", [each.outcome.avoided for each in judged if each is not None])
