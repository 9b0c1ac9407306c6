"""Notes on where signals have gaps."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cwcli.signals.canonical import TimedSignal
from cwcli.signals.clocks import find_stamp_gaps
from cwcli.signals.units import NS_PER_S

MAX_LISTED_CHANNELS = 5
"""The largest number of channels that are listed; the rest are counted."""


def format_gap_notes(signals: Iterable[TimedSignal], start_ns: int, end_ns: int) -> list[str]:
    """Return one line for each signal with gaps, a late start and an early end included: their number, and the longest
    one.

    Args:
        start_ns, end_ns: Span in which the signals should have been there.
    """
    notes = []
    for signal in signals:
        gaps = find_stamp_gaps(np.sort(signal.stamp_ns), start_ns=start_ns, end_ns=end_ns)
        if not gaps:
            continue
        longest = max(gaps, key=lambda gap: gap.duration_s)
        if longest.end_ns <= int(signal.stamp_ns.min()):
            place = "before its first message"
        elif longest.start_ns >= int(signal.stamp_ns.max()):
            place = "after its last message"
        else:
            place = f"from {(longest.start_ns - start_ns) / NS_PER_S:.1f} s after the first message of any channel"
        count = f"{len(gaps)} gaps without messages; the longest is" if len(gaps) > 1 else "a gap without messages,"
        notes.append(f"{signal.source}: {count} {longest.duration_s:.1f} s {place}")
    return notes[:MAX_LISTED_CHANNELS] + (
        [f"{len(notes) - MAX_LISTED_CHANNELS} more channels have gaps"] if len(notes) > MAX_LISTED_CHANNELS else []
    )
