"""When each online state was available: from the log times of the measurements that it uses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cwcli.estimation.config import EstimatorConfig
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.prepare import earliest_stamp_ns, seconds_since_zero_time
from cwcli.estimation.result import SourceReport
from cwcli.estimation.tolerances import MAX_UNREPORTED_STATE_DELAY_S
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import Int64Array, quantile_of_values, sort_distinct_values
from cwcli.signals.units import NS_PER_S

STAMP_ROUNDING_SLACK_NS = 1_000
"""Time in ns by which a row may be later than the state that uses it, because the filter computes in seconds as floats.
Chosen by hand."""
NEVER_AVAILABLE_NS = np.iinfo(np.int64).max
"""Time of what is never available, ns."""
ALWAYS_AVAILABLE_NS = np.iinfo(np.int64).min
"""Time of what is available from the beginning, ns."""
ORIGIN_NAME_OF_PARAMETERS_FROM_LOG, ORIGIN_NAME_OF_PARAMETERS_FROM_MESSAGES = "this log", "messages and defaults"
"""Names of the two origins of parameters other than a calibration, as the output shows them."""


def parameter_origin_text(config: EstimatorConfig) -> str:
    """Return where noise, latencies and sensor errors of the ego's online states come from, as text."""
    if config.calibration is not None:
        return f"calibration {config.calibration.name}"
    return (
        ORIGIN_NAME_OF_PARAMETERS_FROM_MESSAGES
        if config.takes_no_online_parameter_from_log
        else ORIGIN_NAME_OF_PARAMETERS_FROM_LOG
    )


@dataclass(frozen=True)
class OnlineAvailability:
    """Delays of the online states of a channel.

    Attributes:
        topic: The channel.
        parameters: Where noise, latencies and sensor errors come from, as text.
        stamp_ns: Shape (n,): stamps of the states.
        log_time_ns: Shape (n,): when the states were available.
    """

    topic: str
    parameters: str
    stamp_ns: Int64Array
    log_time_ns: Int64Array

    @property
    def n_states(self) -> int:
        """Number of states."""
        return len(self.stamp_ns)

    def delay_median_p95_and_max_s(self) -> tuple[float, ...]:
        """Return median, 95 % quantile and maximum of the delay from stamp to availability, s; NaN without states."""
        after_s = (self.log_time_ns - self.stamp_ns) / NS_PER_S
        if not self.n_states:
            return (np.nan,) * 3
        return tuple(quantile_of_values(after_s, share) for share in (0.5, 0.95, 1.0))

    @property
    def notes_on_late_states(self) -> list[str]:
        """Note on states that are available more than `MAX_UNREPORTED_STATE_DELAY_S` after their stamps; else empty."""
        after_s = (self.log_time_ns - self.stamp_ns) / NS_PER_S
        late = after_s > MAX_UNREPORTED_STATE_DELAY_S
        if not late.any():
            return []
        advice = "; if the stamps are wrong, use --clock log" if late.mean() > 0.5 else ""
        return [
            f"{self.topic}: {int(late.sum())} of {self.n_states} states are available more than "
            f"{MAX_UNREPORTED_STATE_DELAY_S:g} s after their "
            f"stamps (up to {after_s.max():.1f} s), and so are paths and warnings{advice}"
        ]


def available_times_of_states_ns(
    measurements: Sequence[Measurements],
    sources: Sequence[SourceReport],
    stamp_ns: Int64Array,
    *,
    max_pause_s: float,
    slack_ns: int = STAMP_ROUNDING_SLACK_NS,
) -> Int64Array:
    """Return when each state of the filter was available: when the last measurement that it uses had been received.

    A state at time s uses all rows measured by s (corrected for latency). It exists only after a row at or after s has
    been received and its stretch has a position (see `from_signals.ego_output_stamps_ns`,
    `drop_stretches_without_position_and_note`). Later rows of the log change neither the state nor this time.

    Args:
        measurements: Measurements of one vehicle, positions first; each in stamp order.
        sources: Reports of its track, for the latencies.
        stamp_ns: Shape (m,), increasing: stamps of the states.
        max_pause_s: A longer pause of all measurements separates two stretches.
        slack_ns: A state may use rows that are later than it by at most this.

    Returns:
        Shape (m,), non-decreasing, on the log's clock.
    """
    known = np.full(len(stamp_ns), ALWAYS_AVAILABLE_NS)
    reached = np.full(len(stamp_ns), NEVER_AVAILABLE_NS)
    positions, zero_ns = measurements[0], earliest_stamp_ns(measurements)
    for m in measurements:
        if not len(m):
            continue
        used_ns = m.stamp_ns - _applied_latency_ns(m, sources, zero_ns)
        order = np.argsort(used_ns, kind="stable")
        newest = np.searchsorted(used_ns[order], stamp_ns + slack_ns, side="right")
        known = np.maximum(known, np.append(ALWAYS_AVAILABLE_NS, np.maximum.accumulate(m.received_ns[order]))[newest])
        # A source counts for the end of the states once a position has come that is not older than its first row.
        there_ns = positions.received_ns[positions.stamp_ns >= m.stamp_ns[0]].min(initial=NEVER_AVAILABLE_NS)
        first = np.minimum.accumulate(np.maximum(m.received_ns, there_ns)[::-1])[::-1]
        reached = np.minimum(reached, np.append(first, NEVER_AVAILABLE_NS)[np.searchsorted(m.stamp_ns, stamp_ns)])
    first_position_ns = _first_position_received_ns(measurements, stamp_ns, round(max_pause_s * NS_PER_S))
    return np.maximum.accumulate(np.maximum(np.maximum(known, reached), first_position_ns))


def not_overtaken_message_mask(stamp_ns: Int64Array, log_time_ns: Int64Array) -> npt.NDArray[np.bool_]:
    """Return a mask (n,) of the messages that arrived before every newer message."""
    order = np.lexsort((stamp_ns, log_time_ns))
    newest_ns = np.maximum.accumulate(stamp_ns[order])
    fresh = np.ones(len(order), np.bool_)
    fresh[order[1:]] = stamp_ns[order][1:] > newest_ns[:-1]
    return fresh


def _first_position_received_ns(
    measurements: Sequence[Measurements], stamp_ns: Int64Array, max_pause_ns: int
) -> Int64Array:
    """Return when the first position of each state's stretch was received, (m,)."""
    measured_ns = sort_distinct_values(np.concatenate([m.stamp_ns for m in measurements]))
    begins = np.append(measured_ns[0], measured_ns[1:][np.diff(measured_ns) > max_pause_ns])
    first_ns = np.full(len(begins), NEVER_AVAILABLE_NS)
    for m in measurements:
        if m.kind is Kind.POSITION:
            stretch = np.maximum(np.searchsorted(begins, m.stamp_ns, side="right") - 1, 0)
            np.minimum.at(first_ns, stretch, m.received_ns)
    return np.asarray(first_ns[np.maximum(np.searchsorted(begins, stamp_ns, side="right") - 1, 0)])


def _applied_latency_ns(m: Measurements, sources: Sequence[SourceReport], zero_ns: int) -> Int64Array:
    """Return the latency (ns) that was subtracted from the stamps, (n,); for an IMU the larger of its two latencies."""
    time_s = seconds_since_zero_time(m.stamp_ns, zero_ns)
    own = [s.latency for s in sources if s.source == m.source and m.kind in (s.kind, Kind.IMU)]
    late_s = [latency.applied_s + latency.drift_correction_s(time_s) for latency in own]
    return np.asarray(np.rint(np.max(late_s or [np.zeros(len(m))], axis=0) * NS_PER_S), np.int64)
