"""When a state could have been known: from the log times of the measurements that are in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cwcli.estimation.config import EstimatorConfig
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.prepare import epoch_ns, seconds
from cwcli.estimation.result import SourceReport
from cwcli.signals.columns import Int64Array
from cwcli.signals.units import NS_PER_S

SLACK_NS = 1_000
"""The filter counts in seconds: a row so little later than a state may be in it."""
NEVER_NS = np.iinfo(np.int64).max
LONG_AGO_NS = np.iinfo(np.int64).min
LATE_S = 1.0
THIS_LOG, MESSAGES = "this log", "messages and defaults"


def parameters_of(config: EstimatorConfig) -> str:
    """Where noise, latencies and sensors' errors of the ego's online states are from."""
    if config.calibration is not None:
        return f"calibration {config.calibration.name}"
    return MESSAGES if config.is_blind_online else THIS_LOG


@dataclass(frozen=True)
class Knowledge:
    """What is told of a channel of online states.

    Attributes:
        topic: The channel.
        parameters: Where noise, latencies and sensors' errors are from.
        stamp_ns, log_time_ns: Shape (n,): of the states, and when they could have been known.
    """

    topic: str
    parameters: str
    stamp_ns: Int64Array
    log_time_ns: Int64Array

    @property
    def n(self) -> int:
        """States."""
        return len(self.stamp_ns)

    def after_s(self) -> tuple[float, ...]:
        """How long after their stamps the states are known: median, 95 % and most; NaN without states."""
        after_s = (self.log_time_ns - self.stamp_ns) / NS_PER_S
        return tuple(np.quantile(after_s, [0.5, 0.95, 1.0]).tolist()) if self.n else (np.nan,) * 3

    @property
    def notes(self) -> list[str]:
        """A remark where the states come seconds late."""
        after_s = (self.log_time_ns - self.stamp_ns) / NS_PER_S
        late = after_s > LATE_S
        if not late.any():
            return []
        advice = "; if the stamps are off, --clock log" if late.mean() > 0.5 else ""
        return [
            f"{self.topic}: {int(late.sum())} of {self.n} states are known more than {LATE_S:g} s after their stamps "
            f"(up to {after_s.max():.1f} s), and so are paths and warnings{advice}"
        ]


def known_ns(
    measurements: Sequence[Measurements],
    sources: Sequence[SourceReport],
    stamp_ns: Int64Array,
    *,
    max_pause_s: float,
    slack_ns: int = SLACK_NS,
) -> Int64Array:
    """When the filter's states could have been known: when the last measurement that is in them had been received.

    A state at s has in it what was measured by s (latencies taken off), and there is none before something has told
    that s has come and that its stretch has a position (see `from_signals.output_grid`, `near_positions`). Whatever
    comes into the log later changes neither the state nor this time.

    Args:
        measurements: Of one vehicle, positions first; each by stamp.
        sources: Of its track, for the latencies.
        stamp_ns: Shape (m,), increasing: of the states.
        max_pause_s: Longer pauses of all measurements part two stretches.
        slack_ns: Rows so much later than a state may be in it.

    Returns:
        Shape (m,), non-decreasing, on the log's clock.
    """
    known = np.full(len(stamp_ns), LONG_AGO_NS)
    reached = np.full(len(stamp_ns), NEVER_NS)
    positions, epoch = measurements[0], epoch_ns(measurements)
    for m in measurements:
        if not len(m):
            continue
        used_ns = m.stamp_ns - _late_ns(m, sources, epoch)
        order = np.argsort(used_ns, kind="stable")
        newest = np.searchsorted(used_ns[order], stamp_ns + slack_ns, side="right")
        known = np.maximum(known, np.append(LONG_AGO_NS, np.maximum.accumulate(m.received_ns[order]))[newest])
        # A source counts for the end of the states once a position has come that is not older than its first row.
        there_ns = positions.received_ns[positions.stamp_ns >= m.stamp_ns[0]].min(initial=NEVER_NS)
        first = np.minimum.accumulate(np.maximum(m.received_ns, there_ns)[::-1])[::-1]
        reached = np.minimum(reached, np.append(first, NEVER_NS)[np.searchsorted(m.stamp_ns, stamp_ns)])
    placed = _placed_ns(measurements, stamp_ns, round(max_pause_s * NS_PER_S))
    return np.maximum.accumulate(np.maximum(np.maximum(known, reached), placed))


def in_time(stamp_ns: Int64Array, log_time_ns: Int64Array) -> npt.NDArray[np.bool_]:
    """Which messages had not been overtaken by a newer one when they were received, (n,)."""
    order = np.lexsort((stamp_ns, log_time_ns))
    newest_ns = np.maximum.accumulate(stamp_ns[order])
    fresh = np.ones(len(order), np.bool_)
    fresh[order[1:]] = stamp_ns[order][1:] > newest_ns[:-1]
    return fresh


def _placed_ns(measurements: Sequence[Measurements], stamp_ns: Int64Array, max_pause_ns: int) -> Int64Array:
    """When the first position of each state's stretch had been received, (m,)."""
    measured_ns = np.unique(np.concatenate([m.stamp_ns for m in measurements]))
    begins = np.append(measured_ns[0], measured_ns[1:][np.diff(measured_ns) > max_pause_ns])
    first_ns = np.full(len(begins), NEVER_NS)
    for m in measurements:
        if m.kind is Kind.POSITION:
            stretch = np.maximum(np.searchsorted(begins, m.stamp_ns, side="right") - 1, 0)
            np.minimum.at(first_ns, stretch, m.received_ns)
    return np.asarray(first_ns[np.maximum(np.searchsorted(begins, stamp_ns, side="right") - 1, 0)])


def _late_ns(m: Measurements, sources: Sequence[SourceReport], epoch: int) -> Int64Array:
    """What was taken off the stamps, (n,); of an IMU the larger of its two kinds' latencies."""
    time_s = seconds(m.stamp_ns, epoch)
    own = [s.latency for s in sources if s.source == m.source and m.kind in (s.kind, Kind.IMU)]
    late_s = [latency.applied_s + latency.drifted_s(time_s) for latency in own]
    return np.asarray(np.rint(np.max(late_s or [np.zeros(len(m))], axis=0) * NS_PER_S), np.int64)
