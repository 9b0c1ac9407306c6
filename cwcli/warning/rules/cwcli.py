"""The default rule: a collision on the mean paths, probable under both covariances, and persistent.

Three conditions, each against one kind of false warning:

1. The mean paths bring the centres nearer than the collision distance within the horizon (a matter of time).
2. The probability that the cars pass each other nearer than that, given both position covariances, reaches the
   threshold. A path that only just scrapes the collision distance, or is too uncertain to say, does not warn.
3. Conditions 1 and 2 have held for the persistence time. To cost no lead, condition 1 may look farther ahead by just
   that time while it is being confirmed; the warning itself comes when the event is within the horizon.

A warning stays up until the predicted closest approach is a metre wider than the collision distance.
"""

from __future__ import annotations

import numpy as np

from cwcli.warning.measures import Measures
from cwcli.warning.rules.base import Decision, Rule
from cwcli.warning.types import WarningConfig

RELEASE_M = 1.0


def decide(measures: Measures, config: WarningConfig, persistence_s: float) -> Decision:
    """Predicted, probable, persistent."""
    probable = measures.miss_probability >= config.probability
    armed = probable & (measures.entry_s <= config.horizon_s + persistence_s)
    will_hit = np.isfinite(measures.entry_s)
    return Decision(
        armed=armed,
        raised=armed & (measures.entry_s <= config.horizon_s),
        held=measures.min_distance_m < config.distance_m + RELEASE_M,
        time_to_event_s=np.where(will_hit, measures.entry_s, measures.min_time_s),
        predicted_distance_m=measures.min_distance_m,
    )


RULE = Rule(
    name="cwcli",
    summary="collision on the mean paths, probable under both covariances, persistent",
    persistence_s=0.1,
    decide=decide,
)
