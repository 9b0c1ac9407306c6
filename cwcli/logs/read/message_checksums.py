"""Computes the checksum of each message of a topic, without decoding it."""

from __future__ import annotations

import zlib

import numpy as np
import numpy.typing as npt

from cwcli.logs.format.faults import Faults
from cwcli.logs.read.message_reader import MessageReader
from cwcli.logs.read.reader import Log
from cwcli.signals.columns import Int64Array


def read_log_times_and_crc32_of_messages(log: Log, topic: str) -> tuple[Int64Array, npt.NDArray[np.uint32]]:
    """Return log times [ns] and CRC-32 of the messages of a topic of the file, (n,) each, in the order of columns.

    Raises:
        InputError: The file is damaged, and the log was not opened with `recover`.
    """
    ids = [channel.id for channel in log.index.channels.values() if channel.topic == topic]
    reader = MessageReader(log.file, log.index, Faults(), recover=log.recover)
    reader.distrust_indexes_if_miscounted(ids)
    times: list[int] = []
    checksums: list[int] = []
    for batch in reader.iter_batches(ids):
        for log_time_ns, message in batch.iter_log_times_and_payloads():
            times.append(log_time_ns)
            checksums.append(zlib.crc32(message))
    times_ns = np.array(times, np.int64)
    order = np.argsort(times_ns, kind="stable")
    return times_ns[order], np.array(checksums, np.uint32)[order]
