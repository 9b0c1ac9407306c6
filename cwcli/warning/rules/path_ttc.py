"""Time to the first overlap of the cars' outlines along their predicted paths.

Rectangles of the cars' length and width follow the two paths; the warning comes when they first overlap within the
horizon. It ends when the paths no longer bring the centres as near as the outlines' half diagonals allow, which is a
little wider than the overlap itself.
"""

from __future__ import annotations

import numpy as np

from cwcli.warning.measures import Measures
from cwcli.warning.rules.base import Decision, Rule
from cwcli.warning.types import WarningConfig


def decide_by_path_overlap(
    measures: Measures, onset: Measures | None, config: WarningConfig, persistence_s: float
) -> Decision:
    """Decide by the first overlap of the outlines within the horizon."""
    raised = measures.overlap_s <= config.horizon_s
    return Decision(
        armed=raised,
        raised=raised,
        held=np.isfinite(measures.overlap_s),
        time_to_event_s=measures.overlap_s,
        predicted_distance_m=measures.min_distance_m,
    )


RULE = Rule(
    summary="outlines overlap along the predicted paths within the horizon",
    persistence_s=0.0,
    decide=decide_by_path_overlap,
)
