"""A heading that nothing measures, because the car stands and no sensor sees its heading or its turning."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cwcli.evaluation.doubts.base import DoubtRule, Finding
from cwcli.evaluation.doubts.evidence import DoubtEvidence
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import SPEED
from cwcli.text import format_duration

MAX_TOTAL_STANDSTILL_S = 5.0
"""Greatest total time of standstill in a log, s, up to which a missing sensor of the heading is not doubted. Chosen by
hand: one or two stops at a sign take less."""
STANDSTILL_MPS = 0.3
"""Speed in m/s below which a car stands. Chosen: fixes that scatter by 0.1 m look as fast."""
MAX_STEP_S = 1.0
"""Longest step between two states, s, that counts as standing. Chosen by hand; not fitted."""
HEADING_QUANTITIES = frozenset({"heading", "yaw_rate"})
"""Quantities that tell the heading, or keep it, at standstill."""


def find_unobserved_heading(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield the time for which the car stands and nothing measures its heading."""
    quantities = {str(source.get("quantity")) for source in evidence.ego_sources}
    if evidence.ego is None or not quantities or quantities & HEADING_QUANTITIES:
        return
    ego = evidence.ego.sort_by_stamp_without_repeats()
    step_s = np.diff(ego.stamp_ns) / NS_PER_S
    counted = step_s <= MAX_STEP_S
    stands = np.abs(ego.state[:-1, SPEED]) < STANDSTILL_MPS
    standing_s, all_s = float(step_s[stands & counted].sum()), float(step_s[counted].sum())
    if standing_s > MAX_TOTAL_STANDSTILL_S:
        yield Finding(
            standing_s,
            f"No sensor measures which way the car points while it stands ({format_duration(standing_s)}, "
            f"{100 * standing_s / all_s:.0f} % of the track).",
        )


RULE = DoubtRule(
    summary="a standstill without a sensor of heading or yaw rate",
    short_name="heading at standstill",
    threshold=MAX_TOTAL_STANDSTILL_S,
    unit="s",
    source="chosen: a stop at a sign is shorter",
    advice="Do not use headings and predicted paths while the car stands.",
    find=find_unobserved_heading,
)
