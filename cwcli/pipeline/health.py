"""How well a log was recorded, topic by topic: rates, gaps, delays, and clocks that drift apart."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext

import numpy as np

from cwcli.errors import DataError, InputError
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.codecs.ros2msg import SchemaError
from cwcli.logs.read.reader import Log
from cwcli.signals.clocks import MAX_STAMP_NS, find_stamp_gaps
from cwcli.signals.columns import Columns, Int64Array, median_of_values
from cwcli.signals.leaf_fields import read_stamps
from cwcli.signals.stamp_fields import HEADER_STAMP_FIELDS, JSON_STAMP_FIELDS, PROTOBUF_STAMP_FIELDS
from cwcli.signals.units import NS_PER_S

STAMP_FIELD_NAMES = (*HEADER_STAMP_FIELDS, *JSON_STAMP_FIELDS, *PROTOBUF_STAMP_FIELDS, "stamp.sec", "stamp.nanosec")
"""Names of the leaf fields that may hold a message's own time, of all encodings that cwcli reads."""
MIN_MESSAGES_FOR_CLOCK_DRIFT, MIN_DURATION_FOR_CLOCK_DRIFT_S = 30, 5.0
"""Fewest messages and shortest time [s] from which a clock drift is estimated; chosen by hand."""
MIN_DELAY_CHANGE_OF_DRIFT_SIGMAS = 5.0
"""Least change of the delay, relative to its scatter, that counts as a drift. Chosen by hand."""
S_PER_MIN = 60.0
"""Number of seconds in a minute."""


@dataclass(frozen=True)
class TopicHealth:
    """Statistics of how a topic was recorded; NaN where the messages do not allow one.

    Attributes:
        topic, messages: Its name and the number of messages that could be decoded.
        undecodable: Number of messages that could not; -1 where the topic can't be read as one table: then none was
            decoded, and `messages` counts all of them.
        stamped: Number of messages with a stamp of their own.
        rate_hz: One over the median interval between messages.
        gaps: Number of stretches of more than five intervals, and a second, without a message.
        longest_gap_s: The longest of them, or 0.
        out_of_order: Number of messages with an earlier stamp than the message before.
        delay_s: Median of log time less stamp.
        drift_ms_per_min: Growth of the delay, 0 where it is not significant.
    """

    topic: str
    messages: int
    undecodable: int
    stamped: int
    rate_hz: float
    gaps: float
    longest_gap_s: float
    out_of_order: float
    delay_s: float
    drift_ms_per_min: float


def measure_topic_health(log: Log, topics: Sequence[str]) -> list[TopicHealth]:
    """Read the stamps and log times of topics, and measure how each was recorded.

    Raises:
        InputError: The file is damaged, and `recover` is off.
    """
    with log.keep_chunks_unpacked() if len(topics) > 1 else nullcontext():
        return [_measure_health_of_topic(log, topic) for topic in topics]


def _measure_health_of_topic(log: Log, topic: str) -> TopicHealth:
    try:
        columns = log.columns(topic, STAMP_FIELD_NAMES)
    except (InputError, DataError) as error:
        is_of_topic = isinstance(error, DataError) or isinstance(error.__cause__, SchemaError)
        if not (is_of_topic or log.recover):
            raise
        n = sum(each.message_count or 0 for each in log.channels if each.topic == topic)
        return TopicHealth(topic, n, -1, 0, *[np.nan] * 6)
    return topic_health_from_columns(columns, log.start_ns, log.end_ns)


def topic_health_from_columns(columns: Columns, start_ns: int, end_ns: int) -> TopicHealth:
    """Measure how one topic was recorded in a log from `start_ns` to `end_ns` (log times)."""
    stamp_ns, has_stamp = read_stamps(columns)
    log_ns = columns.log_time_ns
    is_time = (log_ns >= 0) & (log_ns <= MAX_STAMP_NS)  # an unsigned number beyond 2^63 is negative here
    has_stamp &= is_time
    known_stamp_ns, logged = stamp_ns[has_stamp], log_ns[has_stamp]
    time_ns = np.sort(known_stamp_ns if len(known_stamp_ns) > 0.5 * len(log_ns) else log_ns[is_time])
    steps = np.diff(time_ns)
    median_ns = median_of_values(steps) if len(steps) else 0.0
    gaps = find_stamp_gaps(np.sort(log_ns.view(np.uint64)), start_ns=start_ns, end_ns=end_ns)
    return TopicHealth(
        columns.topic,
        len(columns),
        columns.n_undecodable,
        len(known_stamp_ns),
        NS_PER_S / median_ns if median_ns > 0.0 else np.nan,
        len(gaps),
        max((gap.duration_s for gap in gaps), default=0.0),
        int(np.count_nonzero(np.diff(known_stamp_ns) < 0)),
        median_of_values(logged - known_stamp_ns) / NS_PER_S if len(known_stamp_ns) else np.nan,
        clock_drift_ms_per_min(known_stamp_ns, logged),
    )


def clock_drift_ms_per_min(stamp_ns: Int64Array, log_ns: Int64Array) -> float:
    """Return how fast the delay (log time minus stamp) grows [ms/min]: 0 if insignificant, NaN with too few messages.

    The lower quartiles of the delay in the first and the last third of the log are compared, because messages that
    waited in queues say little about the clocks.

    Args:
        stamp_ns, log_ns: Shape (n,), in log-time order.
    """
    n = len(stamp_ns)
    if n < MIN_MESSAGES_FOR_CLOCK_DRIFT or log_ns[-1] - log_ns[0] < MIN_DURATION_FOR_CLOCK_DRIFT_S * NS_PER_S:
        return float("nan")
    third = n // 3
    delay_s = (log_ns - stamp_ns) / NS_PER_S
    first, last = delay_s[:third], delay_s[-third:]
    minutes = (median_of_values(log_ns[-third:]) - median_of_values(log_ns[:third])) / NS_PER_S / S_PER_MIN
    change_s = float(np.quantile(last, 0.25) - np.quantile(first, 0.25))
    scatter_s = max(float(np.subtract(*np.quantile(part, (0.75, 0.25)))) for part in (first, last)) / np.sqrt(third)
    return (
        1e3 * change_s / float(minutes)
        if abs(change_s) > max(MIN_DELAY_CHANGE_OF_DRIFT_SIGMAS * scatter_s, 1e-4)
        else 0.0
    )
