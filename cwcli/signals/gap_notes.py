"""Notes on where signals have gaps."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cwcli.signals.canonical import TimedSignal
from cwcli.signals.clocks import find_stamp_gaps
from cwcli.signals.units import NS_PER_S

MAX_GAP_NOTES = 5
"""The largest number of channels that are listed; the rest are counted."""


def format_gap_notes(signals: Iterable[TimedSignal], start_ns: int, end_ns: int) -> list[str]:
    """Return one line for each signal with gaps, a late start and an early end included: their number, and the longest
    one.

    Args:
        signals: Canonical signals.
        start_ns, end_ns: Span in which the signals should have been there.
    """
    notes = []
    for signal in signals:
        gaps = find_stamp_gaps(np.sort(signal.stamp_ns), start_ns=start_ns, end_ns=end_ns)
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
