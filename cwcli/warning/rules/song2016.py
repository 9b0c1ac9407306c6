"""song2016 section 4: warn when the predicted distance at the horizon is below the collision distance.

The paper's thresholds are 2.5 s and 2.5 m. It says nothing of when a warning ends: here it stays up as long as the
paths still come nearer than the collision distance anywhere within the horizon, so that one conflict is one warning.
Limits: two cars that are past each other before the horizon never trigger it, and covariance plays no part.
"""

from __future__ import annotations

import numpy as np

from cwcli.warning.measures import Measures
from cwcli.warning.rules.base import Decision, Rule
from cwcli.warning.types import WarningConfig


def decide_by_distance_at_horizon(
    measures: Measures, onset: Measures | None, config: WarningConfig, persistence_s: float
) -> Decision:
    """Decide by the predicted distance at the horizon, as printed in the paper."""
    raised = measures.horizon_distance_m < config.distance_m
    return Decision(
        armed=raised,
        raised=raised,
        held=measures.min_distance_m < config.distance_m,
        time_to_event_s=np.full(len(raised), config.horizon_s),
        predicted_distance_m=measures.horizon_distance_m,
    )


RULE = Rule(
    summary="predicted distance at the horizon below the collision distance (song2016)",
    persistence_s=0.0,
    decide=decide_by_distance_at_horizon,
)
