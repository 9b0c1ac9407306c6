"""Share of the real conflicts that a careful driver would have avoided."""

from __future__ import annotations

import numpy as np

from cwcli.control.preventable import DRIVER_MODELS, DriverVerdict, judge_preventability
from cwcli.evaluation.actual_outcomes import ActualOutcomes
from cwcli.evaluation.conflicts import RealConflict
from cwcli.lazy_dataclass import dataclass
from cwcli.measures.distances import GAP
from cwcli.measures.pair import Pair
from cwcli.metrics.headline import HeadlineCollector
from cwcli.signals.units import NS_PER_S

CAREFUL_DRIVER = "careful human"
"""Name of the driver model in `control.preventable.DRIVER_MODELS`."""
MAX_JUDGED_CONFLICTS = 100
"""Greatest number of conflicts of a log that are simulated. Chosen for speed: each takes tens of milliseconds."""


@dataclass(frozen=True)
class CarefulDriverOutcome:
    """Outcome of a conflict with a careful driver.

    Attributes:
        contact_ns: When the outlines first touched, or the centres were nearest.
        outcome: Outcome with the careful and competent human of UN Regulation 157, in control from 8 s before.
    """

    contact_ns: int
    outcome: DriverVerdict

    @property
    def first_braking_ns(self) -> int | None:
        """Time at which it would have braked first; None: never."""
        braked_s = self.outcome.braked_s
        return self.contact_ns - round(braked_s * NS_PER_S) if np.isfinite(braked_s) else None


def simulate_careful_driver(pair: Pair, conflict: RealConflict) -> CarefulDriverOutcome | None:
    """Simulate the careful driver in a conflict; None where not both vehicles are known right before it."""
    touches = pair.evaluate_measure(GAP) <= 0.0  # NaN does not
    rows = np.flatnonzero(touches & (pair.stamp_ns >= conflict.onset_ns) & (pair.stamp_ns <= conflict.end_ns))
    at_ns = conflict.closest_ns
    if len(rows):
        separate_rows = np.flatnonzero(
            ~touches[: rows[0]]
        )  # the outlines may touch before the conflict's definition is met
        at_ns = int(pair.stamp_ns[separate_rows[-1] + 1 if len(separate_rows) else 0])
    found = judge_preventability(pair, at_ns, {CAREFUL_DRIVER: DRIVER_MODELS[CAREFUL_DRIVER]})
    return CarefulDriverOutcome(at_ns, found[0]) if found else None


def add_preventable_share(headline: HeadlineCollector, real: ActualOutcomes) -> None:
    """Add the share of the conflicts that the careful driver would have avoided."""
    conflicts = [(real.pairs[vehicle], each) for vehicle, found in real.conflicts.items() for each in found]
    conflicts.sort(key=lambda entry: entry[1].onset_ns)
    outcomes = [simulate_careful_driver(*entry) for entry in conflicts[:MAX_JUDGED_CONFLICTS]]
    headline.add_share("warnings.preventable_share", [each.outcome.avoided for each in outcomes if each is not None])
