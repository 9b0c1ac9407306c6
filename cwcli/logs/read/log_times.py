"""Reads the log times of channels from the message indexes, without decoding messages."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import numpy.typing as npt

from cwcli.input import InputFile
from cwcli.logs.format.index import LogIndex, UnchunkedRange
from cwcli.logs.read.message_reader import MessageReader, find_message_index_entries


def read_log_times_ns(
    file: InputFile, index: LogIndex, reader: MessageReader, channel_ids: Collection[int]
) -> npt.NDArray[np.uint64]:
    """Return the sorted log times in ns of the messages of some channels; chunks with message indexes are not opened.

    Raises:
        InputError: A chunk without message index is damaged, and `recover` is off.
    """
    reader.distrust_indexes_if_miscounted(channel_ids)
    found = [np.zeros(0, np.uint64)]
    n_unlisted = 0
    for chunk in reader.chunks_with_channels(channel_ids):
        own = chunk.index_offsets.keys() & set(channel_ids)
        listed = [
            entries for each in own if (entries := find_message_index_entries(file, index, chunk, each)) is not None
        ]
        found += [entries[:, 0] for entries in listed]
        n_unlisted += not chunk.index_offsets or len(listed) < len(own)
    if n_unlisted or not reader.trusts_indexes or index.items_of_type(UnchunkedRange):
        found = [
            np.zeros(0, np.uint64),
            *(batch.log_time_ns.view(np.uint64) for batch in reader.iter_batches(channel_ids)),
        ]
    return np.sort(np.concatenate(found))
