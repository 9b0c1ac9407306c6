"""Where signals have gaps, in words."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cwcli.signals.canonical import TimedSignal
from cwcli.signals.clocks import find_gaps
from cwcli.signals.units import NS_PER_S

MAX_GAP_NOTES = 5


def gap_notes(signals: Iterable[TimedSignal], start_ns: int, end_ns: int) -> list[str]:
    """One line for each signal with gaps, a late start and an early end included: how many, and where the longest is.

    Args:
        signals: Canonical signals.
        start_ns, end_ns: Span in which the signals should have been there.
    """
    notes = []
    for signal in signals:
        gaps = find_gaps(np.sort(signal.stamp_ns), start_ns=start_ns, end_ns=end_ns)
        if not gaps:
            continue
        longest = max(gaps, key=lambda gap: gap.duration_s)
        at_s = (longest.start_ns - start_ns) / NS_PER_S
        count = len(gaps)
        notes.append(
            f"{signal.source}: {count} gap{'s' if count > 1 else ''}, the longest {longest.duration_s:.1f} s "
            f"from {at_s:.1f} s on"
        )
    return notes[:MAX_GAP_NOTES] + (
        [f"{len(notes) - MAX_GAP_NOTES} more channels have gaps"] if len(notes) > MAX_GAP_NOTES else []
    )
