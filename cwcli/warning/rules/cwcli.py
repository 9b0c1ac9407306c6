"""The default rule: a collision on the mean paths, probable under both covariances, and persistent.

Three conditions, each against one kind of false warning:

1. The mean paths bring the centres nearer than the collision distance within the horizon (a matter of time), and the
   cars' outlines overlap on them: two cars side by side can be that near without touching.
2. The probability that the cars pass each other nearer than that, given both position covariances, reaches the
   threshold. A path that only just scrapes the collision distance, or is too uncertain to say, does not warn.
3. Conditions 1 and 2 have held for the persistence time. To cost no lead, condition 1 may look farther ahead by just
   that time while it is being confirmed; the warning itself comes when the event is within the horizon.

The mean path comes late where the other driver has only just begun to brake hard or to turn in: on average such an
onset does not last, so a good predictor does not follow it far. A warning must. Where the other's path under the
hypothesis that the onset goes on (`VehicleTrack.onset_paths`) fulfils 1 and 2, and brings the cars clearly nearer at
the horizon than the mean path does, the rule warns at once: the hypothesis asks for a derivative that stands out of the
filter's noise, which is a persistence of its own.

A warning stays up until the predicted closest approach is a metre wider than the collision distance.
"""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from cwcli.warning.measures import Measures
from cwcli.warning.rules.base import BoolArray, Decision, Rule
from cwcli.warning.types import WarningConfig

RELEASE_M = 1.0
ONSET_MATTERS_M = 0.25


def decide(measures: Measures, onset: Measures | None, config: WarningConfig, persistence_s: float) -> Decision:
    """Predicted, probable, persistent."""
    armed, raised = _collides(measures, config, persistence_s)
    held = measures.min_distance_m < config.distance_m + RELEASE_M
    shown, at_once = measures, None
    if onset is not None:
        closer = onset.horizon_distance_m < measures.horizon_distance_m - ONSET_MATTERS_M
        at_once = closer & _collides(onset, config, 0.0)[1]
        shown = _where(at_once & ~raised, onset, measures)
        held |= onset.min_distance_m < config.distance_m
    return Decision(
        armed=armed,
        raised=raised,
        held=held,
        time_to_event_s=np.where(np.isfinite(shown.entry_s), shown.entry_s, shown.min_time_s),
        predicted_distance_m=shown.min_distance_m,
        at_once=at_once,
        probability=shown.probability,
        alert_probability=shown.hit_probability,
    )


def _collides(measures: Measures, config: WarningConfig, persistence_s: float) -> tuple[BoolArray, BoolArray]:
    """Conditions 1 and 2, with and without the time that persistence takes."""
    probable = (measures.hit_probability >= config.probability) & np.isfinite(measures.overlap_s)
    armed = probable & (measures.entry_s <= config.horizon_s + persistence_s)
    return armed, armed & (measures.entry_s <= config.horizon_s)


def _where(chosen: BoolArray, one: Measures, other: Measures) -> Measures:
    """Row by row one or the other."""
    names = (entry.name for entry in fields(Measures))
    return Measures(**{name: np.where(chosen, getattr(one, name), getattr(other, name)) for name in names})


RULE = Rule(
    summary="collision on the mean paths, probable under both covariances, persistent",
    persistence_s=0.1,
    decide=decide,
    uses_onset=True,
)
