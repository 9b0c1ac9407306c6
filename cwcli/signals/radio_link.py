"""Quality of the radio link: loss, latency, information age and range of remote vehicles' messages.

A sender counts its messages modulo 128 (SAE J2735, msgCnt): a gap in the count is a loss. A pause in which the count
may have gone round is an absence (out of range, switched off), no loss.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.canonical import MESSAGE_COUNT_MODULUS, RemoteSignal
from cwcli.signals.columns import BoolArray, FloatArray, Int64Array, median_of_values, quantile_of_values
from cwcli.signals.units import NS_PER_S

MIN_RECEPTION_GAP_S = 1.0
"""The shortest pause that counts as a gap, in seconds. Chosen by hand; not fitted."""
MIN_GAP_IN_SENDING_PERIODS = 5.0
"""The shortest pause that counts as a gap, in sending periods. Chosen by hand; not fitted."""
MAX_NEGATIVE_LATENCY_S = 0.002
"""The time by which a median latency may be negative, in seconds: two steps of the message clock. Below, the clocks
disagree."""
RECEPTION_DISTANCE_BIN_M = 50.0
"""The width of a bin of distance, in metres; chosen by hand."""


@dataclass(frozen=True)
class StationLink:
    """The link from one station.

    Attributes:
        station: Its id.
        n_received: Messages received.
        present_s: The time from the first to the last of them, without absences.
        rate_hz: Messages sent per second where the sender counts them, else received.
        n_sent: Messages sent while it was present, NaN where the sender does not count them.
        latency_median_s, latency_p95_s: The time from generation to reception; NaN where the clocks disagree.
        age: The information age as pieces in which it grows with time: shape (p, 2), from and to, s.
        n_gaps, longest_gap_s: Pauses while it was present.
        n_absences: Pauses in which the count may have gone round.
        range_m: Greatest distance of reception, NaN where none is known.
    """

    station: str
    n_received: int
    present_s: float
    rate_hz: float
    n_sent: float
    latency_median_s: float
    latency_p95_s: float
    age: FloatArray
    n_gaps: int
    longest_gap_s: float
    n_absences: int
    range_m: float

    @property
    def loss_share(self) -> float:
        """The share (1) of the sent messages that did not arrive."""
        return 1.0 - self.n_received / self.n_sent if self.n_sent > 0 else float("nan")


@dataclass(frozen=True)
class ReceptionByDistance:
    """The reception by distance, over all stations that count their messages.

    Attributes:
        edges_m: Shape (b + 1,).
        received, sent: Shape (b,). A lost message counts where its sender was between its neighbours.
    """

    edges_m: FloatArray
    received: Int64Array
    sent: Int64Array


def measure_station_links(
    signal: RemoteSignal, distance_m: FloatArray
) -> tuple[list[StationLink], ReceptionByDistance]:
    """Measure the radio link from each station.

    Args:
        signal: Messages of one channel, n rows.
        distance_m: Shape (n,), from the receiver; NaN where it is not known.

    Returns:
        Stations in the order of their first message, and the reception by distance.
    """
    links, distances_received_m, distances_lost_m = [], [np.zeros(0)], [np.zeros(0)]
    for code, station in enumerate(signal.station.values):
        rows = np.flatnonzero(signal.station.codes == code)
        if not len(rows):
            continue
        order = rows[np.argsort(signal.stamp_ns[rows], kind="stable")]
        sent_s = (signal.stamp_ns[order] - signal.stamp_ns[order[0]]) / NS_PER_S
        n_lost, is_absence, period_s = _lost_counts_absences_and_period_s(sent_s, signal.message_count[order])
        links.append(_measure_station_link(station, signal, order, n_lost, is_absence, period_s, distance_m))
        if np.isfinite(n_lost).any():
            distances_received_m.append(distance_m[order])
            distances_lost_m.append(_distances_of_lost_messages_m(distance_m[order], np.nan_to_num(n_lost)))
    return links, _reception_by_distance(np.concatenate(distances_received_m), np.concatenate(distances_lost_m))


def information_age_quantile_s(ages: Sequence[FloatArray], share: float) -> float:
    """Return the information age (s) that the newest message stays below for a share of the time.

    Args:
        ages: Pieces of time, shape (p, 2): the age grows from the first to the second value, s.
        share: A share of the time, in (0, 1).

    Returns:
        In s, NaN without any piece.
    """
    pieces = np.concatenate([np.zeros((0, 2)), *ages])
    pieces = pieces[pieces[:, 1] > pieces[:, 0]]
    if not len(pieces):
        return float("nan")
    at = np.sort(pieces.reshape(-1))
    rising = np.searchsorted(np.sort(pieces[:, 0]), at, side="right")
    n_ended = np.searchsorted(np.sort(pieces[:, 1]), at, side="right")
    below_s = np.concatenate([[0.0], np.cumsum(np.diff(at) * (rising - n_ended)[:-1])])
    return float(np.interp(share * below_s[-1], below_s, at))


def _lost_counts_absences_and_period_s(sent_s: FloatArray, count: FloatArray) -> tuple[FloatArray, BoolArray, float]:
    """Count the messages lost between each two received ones, find absences, and measure the sending period.

    Args:
        sent_s: Shape (n,), increasing.
        count: Shape (n,), modulo 128; NaN where there is none.

    Returns:
        Shape (n - 1,): NaN where the sender does not count (a count that never changes is none), 0 in an absence; shape
        (n - 1,); the period in s, NaN of a single message.
    """
    pause_s, steps = np.diff(sent_s), np.diff(count) % MESSAGE_COUNT_MODULUS
    if not len(pause_s):
        return np.full(0, np.nan), np.zeros(0, np.bool_), float("nan")
    if np.isnan(steps).any() or not steps.any():
        period_s = median_of_values(pause_s)
        return np.full(len(steps), np.nan), pause_s >= MESSAGE_COUNT_MODULUS * period_s, period_s
    period_s = median_of_values((pause_s / np.maximum(steps, 1))[steps > 0])
    is_absence: BoolArray = pause_s >= (MESSAGE_COUNT_MODULUS - 0.5) * period_s
    is_repeat = (steps == 0) & (pause_s < 0.5 * MESSAGE_COUNT_MODULUS * period_s)
    n_lost = np.where(is_absence | is_repeat, 0.0, (steps - 1) % MESSAGE_COUNT_MODULUS)
    return n_lost, is_absence, period_s


def _measure_station_link(
    station: str,
    signal: RemoteSignal,
    order: Int64Array,
    n_lost: FloatArray,
    is_absence: BoolArray,
    period_s: float,
    distance_m: FloatArray,
) -> StationLink:
    latency_s = (signal.log_time_ns[order] - signal.stamp_ns[order]) / NS_PER_S
    has_clock = bool(latency_s.any()) and median_of_values(latency_s) >= -MAX_NEGATIVE_LATENCY_S
    heard_ns = np.sort(signal.log_time_ns[order])
    pause_s = np.diff(heard_ns) / NS_PER_S
    present = ~is_absence
    fresh_s = np.maximum(latency_s[np.argsort(signal.log_time_ns[order], kind="stable")][:-1], 0.0)
    fresh_s = fresh_s if has_clock else np.zeros(len(pause_s))
    present_s = float(np.diff(signal.stamp_ns[order])[present].sum()) / NS_PER_S
    counted = np.isfinite(n_lost).all() and len(n_lost) > 0
    n_sent = len(order) + float(n_lost.sum()) if counted else float("nan")
    n_steps = (n_sent if counted else len(order)) - 1 - np.count_nonzero(is_absence)
    is_gap = present & (pause_s > max(MIN_RECEPTION_GAP_S, MIN_GAP_IN_SENDING_PERIODS * period_s))
    known_m = distance_m[order][np.isfinite(distance_m[order])]
    nothing = float("nan")
    return StationLink(
        station=station,
        n_received=len(order),
        present_s=present_s,
        rate_hz=n_steps / present_s if present_s > 0 else nothing,
        n_sent=n_sent,
        latency_median_s=median_of_values(latency_s) if has_clock else nothing,
        latency_p95_s=quantile_of_values(latency_s, 0.95) if has_clock else nothing,
        age=np.stack([fresh_s, fresh_s + pause_s], axis=1)[present],
        n_gaps=int(np.count_nonzero(is_gap)),
        longest_gap_s=float(pause_s[present].max()) if present.any() else nothing,
        n_absences=int(np.count_nonzero(is_absence)),
        range_m=float(known_m.max()) if len(known_m) else nothing,
    )


def _distances_of_lost_messages_m(distance_m: FloatArray, n_lost: FloatArray) -> FloatArray:
    """Return the distances (m) at which lost messages were sent, spaced evenly between their received neighbours."""
    n = n_lost.astype(np.int64)
    gap = np.repeat(np.arange(len(n)), n)
    place = np.arange(len(gap)) - np.repeat(np.cumsum(n) - n, n) + 1
    part = place / (n[gap] + 1)
    return distance_m[gap] * (1.0 - part) + distance_m[gap + 1] * part


def _reception_by_distance(received_m: FloatArray, lost_m: FloatArray) -> ReceptionByDistance:
    received_m, lost_m = received_m[np.isfinite(received_m)], lost_m[np.isfinite(lost_m)]
    farthest_m = max([0.0, *received_m, *lost_m]) if len(received_m) else 0.0
    edges_m = RECEPTION_DISTANCE_BIN_M * np.arange(int(farthest_m // RECEPTION_DISTANCE_BIN_M) + 2, dtype=np.float64)
    received = np.histogram(received_m, edges_m)[0]
    return ReceptionByDistance(edges_m, received, received + np.histogram(lost_m, edges_m)[0])
