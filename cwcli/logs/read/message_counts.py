"""Compares the message counts of a summary with the messages that are read."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
import numpy.typing as npt

from cwcli.logs.format.faults import Faults
from cwcli.logs.format.records import Statistics


class MessageCounts:
    """Compares the messages per channel with the counts of the summary.

    Args:
        statistics: The counts; None or empty if the summary has none.
        faults: Gets the channels with differences.
    """

    def __init__(self, statistics: Statistics | None, faults: Faults) -> None:
        self._expected = statistics.channel_counts if statistics else {}
        self._faults = faults

    def ids_of_miscounted_channels(self, found_count_by_channel_id: Mapping[int, int]) -> set[int]:
        """Return the ids of channels with another number of messages than expected."""
        if not self._expected:
            return set()
        return {
            channel_id for channel_id, n in found_count_by_channel_id.items() if n != self._expected.get(channel_id, 0)
        }

    def start_tally(self, channel_ids: Collection[int]) -> MessageTally:
        """Return a counter for a caller that reads all messages of some channels, batch by batch."""
        return MessageTally(self, channel_ids)

    def note_miscounted_channels(self, found_count_by_channel_id: Mapping[int, int]) -> None:
        """Add channels with differences to the faults, unless damaged parts of the file explain them."""
        faults = self._faults
        if not (faults.chunks_lost or faults.bytes_lost or faults.truncated):
            faults.miscounted_channel_ids |= self.ids_of_miscounted_channels(found_count_by_channel_id)


class MessageTally:
    """Counts the messages of some channels."""

    def __init__(self, counts: MessageCounts, channel_ids: Collection[int]) -> None:
        self._counts = counts
        self._channel_ids = channel_ids
        self._found = np.zeros(1 << 16, np.int64)

    def add_messages(self, channel_ids: npt.NDArray[np.uint16]) -> None:
        """Count messages, given the channel id of each (n,)."""
        np.add.at(self._found, channel_ids, 1)

    def compare_with_summary(self) -> None:
        """Compare the counts with the summary, after all messages were added."""
        self._counts.note_miscounted_channels({each: int(self._found[each]) for each in self._channel_ids})
