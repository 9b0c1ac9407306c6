"""Finds latched messages: those that a publisher gives to every later subscriber, such as static transforms and maps.

Sources: rosbag2 stores the quality of service of a topic's publishers in the channel's metadata
(https://github.com/ros2/rosbag2/tree/rolling/rosbag2_storage_mcap, `offered_qos_profiles`, durability `transient_local`
or 1); rosbag stores `latching=1` in a connection's header (http://wiki.ros.org/Bags/Format/2.0).
"""

from __future__ import annotations

import re
from collections.abc import Collection

import numpy as np

from cwcli.logs.format.index import LogIndex
from cwcli.logs.format.records import Channel
from cwcli.logs.read.message_reader import MIN_MESSAGE_BYTES, MessageReader

LATCHED_QOS_PATTERN = re.compile(r"durability:\s*(?:1\b|transient_local)", re.IGNORECASE)
"""Pattern of a quality of service whose messages are latched, in either spelling of rosbag2."""
LAST_PART_OF_STATIC_TRANSFORMS_TOPIC = "tf_static"
"""Last part of the topic of static transforms (ROS REP 105); it has many publishers, of which each one latches."""
MAX_LATCHED_MESSAGES_PER_CHANNEL = 1000
"""Greatest number of earlier messages that are kept of a channel. Chosen by hand: more are no static transforms."""


def is_latched(channel: Channel) -> bool:
    """Tell whether a channel's metadata or its topic says that its messages are latched."""
    if _is_static_transforms(channel) or channel.metadata.get("latching") == "1":
        return True
    return LATCHED_QOS_PATTERN.search(channel.metadata.get("offered_qos_profiles", "")) is not None


def _is_static_transforms(channel: Channel) -> bool:
    return channel.topic.rpartition("/")[2] == LAST_PART_OF_STATIC_TRANSFORMS_TOPIC


def latched_channel_ids(index: LogIndex, channel_ids: Collection[int]) -> frozenset[int]:
    return frozenset(each for each in channel_ids if is_latched(index.channels[each]))


def find_latched_messages(
    reader: MessageReader, index: LogIndex, channel_ids: Collection[int], first_ns: int
) -> list[memoryview]:
    """Return the message records before a log time [ns] that are still in force at it, in the order of log times.

    That is the last message of a channel; of static transforms the last of each content, because several publishers
    share the topic.

    Raises:
        InputError: A chunk that may hold them is damaged.
    """
    found: list[tuple[int, int, memoryview]] = []
    for channel_id in sorted(channel_ids):
        is_static = _is_static_transforms(index.channels[channel_id])
        in_force: dict[bytes, tuple[int, memoryview]] = {}
        for batch in reader.iter_batches([channel_id], 0, first_ns):
            log_time_ns = batch.log_time_ns.view(np.uint64)
            data = batch.payloads.data.data
            for row in np.flatnonzero(log_time_ns < np.uint64(first_ns)).tolist():
                start, end = int(batch.payloads.starts[row]), int(batch.payloads.ends[row])
                key = bytes(data[start:end]) if is_static else b""
                known = in_force.get(key)
                if known is None and len(in_force) >= MAX_LATCHED_MESSAGES_PER_CHANNEL:
                    continue
                if known is None or known[0] <= int(log_time_ns[row]):
                    record = memoryview(bytes(data[start - MIN_MESSAGE_BYTES : end]))
                    in_force[key] = int(log_time_ns[row]), record
        found += [(time_ns, channel_id, record) for time_ns, record in in_force.values()]
    return [record for _, _, record in sorted(found, key=lambda each: each[:2])]
