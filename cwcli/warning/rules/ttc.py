"""Time to collision from centre distance and closing speed.

The oldest measure, and blind to geometry: an oncoming car in the next lane triggers it, as it closes fast without
being on the way to a collision. It is here as a baseline. The warning ends when the time has grown by a fifth.
"""

from __future__ import annotations

from cwcli.warning.measures import Measures
from cwcli.warning.rules.base import Decision, Rule
from cwcli.warning.types import WarningConfig

RELEASE_TTC_PER_HORIZON = 1.2
"""Time to collision, in horizons, beyond which a warning ends. Chosen by hand; not fitted."""


def decide_by_time_to_collision(
    measures: Measures, onset: Measures | None, config: WarningConfig, persistence_s: float
) -> Decision:
    """Decide by the time to collision: it must be below the horizon."""
    raised = measures.ttc_s < config.horizon_s
    return Decision(
        armed=raised,
        raised=raised,
        held=measures.ttc_s < RELEASE_TTC_PER_HORIZON * config.horizon_s,
        time_to_event_s=measures.ttc_s,
        predicted_distance_m=measures.min_distance_m,
    )


RULE = Rule(
    summary="centre distance over closing speed below the horizon",
    persistence_s=0.0,
    decide=decide_by_time_to_collision,
)
