"""States that bridge gaps without a position."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cwcli.estimation.tolerances import MAX_BRIDGED_SHARE
from cwcli.evaluation.doubts.base import DoubtRule, Finding
from cwcli.evaluation.doubts.evidence import DoubtEvidence
from cwcli.signals.vehicle_state import StateFlag


def find_large_share_of_bridged_states(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield the share of the ego's states that no position is near."""
    if evidence.ego is None:
        return
    share = float(np.mean(evidence.ego.flags & np.uint8(StateFlag.BRIDGED) != 0))
    if share > MAX_BRIDGED_SHARE:
        yield Finding(
            share,
            f"In {100 * share:.0f} % of the track no position was measured, so it is estimated from the other sensors.",
        )


RULE = DoubtRule(
    summary="states that bridge gaps without a position",
    short_name="gaps without a position",
    threshold=MAX_BRIDGED_SHARE,
    unit="share",
    source="chosen: as in the verdict of `estimate`",
    advice="Do not use the states flagged bridged.",
    find=find_large_share_of_bridged_states,
)
