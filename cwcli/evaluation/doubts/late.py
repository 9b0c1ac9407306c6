"""States that could have been known only long after their stamps."""

from __future__ import annotations

from collections.abc import Iterator

from cwcli.channels.published import EGO_ONLINE
from cwcli.estimation.tolerances import MAX_UNREPORTED_DELAY_S
from cwcli.evaluation.doubts.base import DoubtRule, Finding
from cwcli.evaluation.doubts.evidence import DoubtEvidence
from cwcli.pipeline.records import to_float_or_nan


def find_late_states(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield the delay of the ego's online states that 95 % of them keep."""
    for topic, delay in evidence.estimate_summary.column_cells("online", "channel", "95 %"):
        delay_s = to_float_or_nan(delay) if isinstance(delay, int | float) else 0.0
        if topic == EGO_ONLINE.topic and delay_s > MAX_UNREPORTED_DELAY_S:
            yield Finding(
                delay_s,
                f"A car could have known these states only {delay_s:.1f} s late, so warnings come as late.",
            )


RULE = DoubtRule(
    summary="online states that could be known only late (95 % of them within this time)",
    short_name="late states",
    threshold=MAX_UNREPORTED_DELAY_S,
    unit="s",
    source="chosen: a second is what a driver needs to react",
    advice="Check the stamps against the log times; --clock log uses the log times.",
    find=find_late_states,
)
