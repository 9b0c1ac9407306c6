"""Remote vehicles, and the ego vehicle from its own messages, out of one V2X channel."""

from __future__ import annotations

import numpy as np

from cwcli.signals.builders.base import Build, Reading
from cwcli.signals.builders.position import reject_bad_positions
from cwcli.signals.canonical import HeadingSignal, PositionSignal, RemoteSignal, SpeedSignal
from cwcli.signals.clocks import Timeline, settle
from cwcli.signals.columns import Columns, Strings
from cwcli.signals.quality import BoolArray, Quality, RowLedger
from cwcli.signals.v2x_codec import RemoteRows, Senders, V2xCodec

OWN_STATION = "sent by the ego station"
OTHER_STATION = "sent by another station"
ROADSIDE = "sent by a roadside unit"
NO_VALUE = "not available in the message"
MAX_AHEAD_NS = 2_000_000
"""Two steps of the message clock."""


def remote_builder(codec: V2xCodec) -> Build:
    """The builder of a `RemoteSignal` from a V2X channel."""

    def build(columns: Columns, reading: Reading) -> tuple[RemoteSignal, Quality]:
        ledger = RowLedger(columns, reading.role)
        senders = codec.identify(columns)
        ledger.set_aside(senders.is_roadside, ROADSIDE)
        ledger.set_aside(_is_own(senders, reading), OWN_STATION)
        decoded = codec.decode(columns, ledger)
        timeline = _timeline(columns, reading, ledger, decoded, senders.station)
        _note_repeats(ledger, decoded, senders.station, timeline)
        rows = timeline.rows
        codes = senders.station.codes[rows]
        signal = RemoteSignal(
            source=columns.topic,
            station=_only_used(codes, senders.station.values),
            stamp_ns=timeline.stamp_ns,
            log_time_ns=columns.log_time_ns[rows],
            latitude_deg=decoded.latitude_deg[rows],
            longitude_deg=decoded.longitude_deg[rows],
            altitude_m=decoded.altitude_m[rows],
            speed_mps=decoded.speed_mps[rows],
            heading_rad=decoded.heading_rad[rows],
            accel_mps2=decoded.accel_mps2[rows],
            lateral_accel_mps2=decoded.lateral_accel_mps2[rows],
            yaw_rate_radps=decoded.yaw_rate_radps[rows],
            length_m=decoded.length_m[rows],
            width_m=decoded.width_m[rows],
            position_covariance_m2=decoded.position_covariance_m2[rows],
            speed_sigma_mps=decoded.speed_sigma_mps[rows],
            heading_sigma_rad=decoded.heading_sigma_rad[rows],
            accel_sigma_mps2=decoded.accel_sigma_mps2[rows],
            yaw_rate_sigma_radps=decoded.yaw_rate_sigma_radps[rows],
        )
        return signal, ledger.quality

    return build


def own_position_builder(codec: V2xCodec) -> Build:
    """The builder of the ego's `PositionSignal` from its own messages."""

    def build(columns: Columns, reading: Reading) -> tuple[PositionSignal, Quality]:
        ledger, senders, decoded = _own(codec, columns, reading)
        timeline = _timeline(columns, reading, ledger, decoded, senders.station)
        rows = timeline.rows
        signal = PositionSignal(
            source=columns.topic,
            stamp_ns=timeline.stamp_ns,
            log_time_ns=columns.log_time_ns[rows],
            latitude_deg=decoded.latitude_deg[rows],
            longitude_deg=decoded.longitude_deg[rows],
            altitude_m=decoded.altitude_m[rows],
            covariance_m2=decoded.position_covariance_m2[rows],
        )
        return signal, ledger.quality

    return build


def own_speed_builder(codec: V2xCodec) -> Build:
    """The builder of the ego's `SpeedSignal` (speed and yaw rate) from its own messages."""

    def build(columns: Columns, reading: Reading) -> tuple[SpeedSignal, Quality]:
        ledger, senders, decoded = _own(codec, columns, reading)
        ledger.set_aside(~np.isfinite(decoded.speed_mps), NO_VALUE)
        timeline = _timeline(columns, reading, ledger, decoded, senders.station)
        rows = timeline.rows
        signal = SpeedSignal(
            source=columns.topic,
            stamp_ns=timeline.stamp_ns,
            log_time_ns=columns.log_time_ns[rows],
            speed_mps=decoded.speed_mps[rows],
            yaw_rate_radps=decoded.yaw_rate_radps[rows],
            speed_variance_m2ps2=decoded.speed_sigma_mps[rows] ** 2,
            yaw_rate_variance_rad2ps2=decoded.yaw_rate_sigma_radps[rows] ** 2,
        )
        return signal, ledger.quality

    return build


def own_heading_builder(codec: V2xCodec) -> Build:
    """The builder of the ego's `HeadingSignal` from its own messages."""

    def build(columns: Columns, reading: Reading) -> tuple[HeadingSignal, Quality]:
        ledger, senders, decoded = _own(codec, columns, reading)
        ledger.set_aside(~np.isfinite(decoded.heading_rad), NO_VALUE)
        timeline = _timeline(columns, reading, ledger, decoded, senders.station)
        rows = timeline.rows
        signal = HeadingSignal(
            source=columns.topic,
            stamp_ns=timeline.stamp_ns,
            log_time_ns=columns.log_time_ns[rows],
            heading_rad=decoded.heading_rad[rows],
            variance_rad2=decoded.heading_sigma_rad[rows] ** 2,
        )
        return signal, ledger.quality

    return build


def _own(codec: V2xCodec, columns: Columns, reading: Reading) -> tuple[RowLedger, Senders, RemoteRows]:
    ledger = RowLedger(columns, reading.role)
    senders = codec.identify(columns)
    ledger.set_aside(~_is_own(senders, reading), OTHER_STATION)
    return ledger, senders, codec.decode(columns, ledger)


def _is_own(senders: Senders, reading: Reading) -> BoolArray:
    """Sent by the vehicle that recorded the log: the message says so, or the user has named its station."""
    if reading.ego_station is None:
        return senders.is_own
    wanted = reading.ego_station.lower()
    is_named = np.array([value.lower() == wanted for value in senders.station.values] + [False])
    is_own: BoolArray = senders.is_own | is_named[senders.station.codes]
    return is_own


def _timeline(columns: Columns, reading: Reading, ledger: RowLedger, decoded: RemoteRows, station: Strings) -> Timeline:
    """Reject what is no position, and settle the clock of each station by itself."""
    reject_bad_positions(ledger, decoded.latitude_deg, decoded.longitude_deg)
    return settle(
        ledger,
        decoded.stamp_ns,
        np.ones(len(columns), dtype=np.bool_),
        reading.clock,
        [decoded.latitude_deg, decoded.longitude_deg, decoded.speed_mps, decoded.heading_rad],
        sender=station.codes,
    )


def _note_repeats(ledger: RowLedger, decoded: RemoteRows, station: Strings, timeline: Timeline) -> None:
    """Say what the estimator should know: repeated positions, bursts, stamps ahead of the log time."""
    rows = timeline.rows
    order = np.argsort(station.codes[rows], kind="stable")
    rows = rows[order]
    stamps_ns = timeline.stamp_ns[order]
    is_same_station = np.diff(station.codes[rows]) == 0
    repeats = (np.diff(decoded.latitude_deg[rows]) == 0) & (np.diff(decoded.longitude_deg[rows]) == 0)
    n_repeats = int(np.count_nonzero(repeats & is_same_station))
    if n_repeats:
        ledger.note(f"{n_repeats} messages repeat their station's position under a new time")
    ahead_ns = timeline.stamp_ns - ledger.columns.log_time_ns[timeline.rows]
    is_ahead = ahead_ns > MAX_AHEAD_NS
    if is_ahead.any():
        median_ms = float(np.median(ahead_ns[is_ahead])) * 1e-6
        ledger.note(
            f"{np.count_nonzero(is_ahead)} messages are stamped after they were logged (median {median_ms:.0f} ms): "
            "the sender's clock is ahead, or the log time is early"
        )
    intervals_ns = np.diff(stamps_ns)[is_same_station]
    if len(intervals_ns):
        n_bursts = int(np.count_nonzero(intervals_ns < 0.25 * np.median(intervals_ns)))
        if n_bursts:
            ledger.note(f"{n_bursts} messages come in bursts, less than a quarter of the usual interval apart")


def _only_used(codes: np.ndarray[tuple[int], np.dtype[np.int32]], values: tuple[str, ...]) -> Strings:
    """Station names of the rows in use, coded in order of first appearance; a row without an id is `unknown`."""
    distinct, first, inverse = np.unique(codes, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), dtype=np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    names = tuple(values[code] if code >= 0 else "unknown" for code in distinct[order])
    return Strings(codes=rank[inverse], values=names)
