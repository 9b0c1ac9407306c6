"""How many messages of each channel a summary counts, against those that are there."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
import numpy.typing as npt

from cwcli.logs.format.faults import Faults
from cwcli.logs.format.records import Statistics


class MessageCounts:
    """Compares counts.

    Args:
        statistics: What counts; None, or nothing in it, if nobody has counted.
        faults: Where differences are noted.
    """

    def __init__(self, statistics: Statistics | None, faults: Faults) -> None:
        self._expected = statistics.channel_counts if statistics else {}
        self._faults = faults

    def differing(self, found: Mapping[int, int]) -> set[int]:
        """The channels of which other numbers of messages were found than are expected."""
        if not self._expected:
            return set()
        return {channel_id for channel_id, n in found.items() if n != self._expected.get(channel_id, 0)}

    def tally(self, channel_ids: Collection[int]) -> Tally:
        """For who takes all messages of some channels, one batch after the other."""
        return Tally(self, channel_ids)

    def note(self, found: Mapping[int, int]) -> None:
        """Note differences. What is lost with damaged parts of the file is counted where it is lost."""
        faults = self._faults
        if not (faults.chunks_lost or faults.bytes_lost or faults.truncated):
            faults.miscounted |= self.differing(found)


class Tally:
    """Counts the messages of some channels."""

    def __init__(self, counts: MessageCounts, channel_ids: Collection[int]) -> None:
        self._counts = counts
        self._channel_ids = channel_ids
        self._found = np.zeros(1 << 16, np.int64)

    def add(self, channel_ids: npt.NDArray[np.uint16]) -> None:
        """Count messages, each by its channel."""
        np.add.at(self._found, channel_ids, 1)

    def end(self) -> None:
        """Compare, when all have been added."""
        self._counts.note({each: int(self._found[each]) for each in self._channel_ids})
