"""Remote vehicles, and the ego vehicle from its own messages, from one V2X channel."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from cwcli.lazy_dataclass import replace
from cwcli.signals.bsm_flags import format_flag_notes
from cwcli.signals.builders.base import Reading
from cwcli.signals.builders.position import reject_invalid_positions
from cwcli.signals.canonical import HeadingSignal, PositionSignal, RemoteQuantities, RemoteSignal, SpeedSignal
from cwcli.signals.clocks import Timeline, build_signal_and_quality, repair_and_order_times
from cwcli.signals.columns import (
    BoolArray,
    Columns,
    Strings,
    key_numbers_and_rows_of_first_appearance,
    median_of_values,
    sort_distinct_values,
)
from cwcli.signals.quality import Quality, RowLedger
from cwcli.signals.remotes import join_remote_signals
from cwcli.signals.road_events import RoadEvents
from cwcli.signals.v2x_codec import EGO_STATION_NOTE_BEGINNING, OTHER_STATION_REASON, RemoteRows, Senders, V2xCodec

MAX_STAMP_AHEAD_OF_LOG_NS = 2_000_000
"""The time by which a stamp may be after its log time, in ns: two steps of the message clock (1 ms)."""


def build_remote(codec: V2xCodec, columns: Columns, reading: Reading) -> tuple[RemoteSignal, Quality]:
    """Build a `RemoteSignal` from a V2X channel: the senders, and the objects that they perceived.

    The objects are counted for themselves.
    """
    signal, quality = _build_senders(codec, columns, reading)
    for part, inner in codec.objects(columns):
        more, its = _build_senders(inner, part, reading)
        quality.objects = its if quality.objects is None else quality.objects.combine_with(its)
        quality.notes += its.notes
        signal = join_remote_signals([signal, replace(more, is_perceived=np.ones(len(more.stamp_ns), np.bool_))])
    senders = codec.identify(columns)
    events, is_unread = codec.events(columns)
    events = _drop_ego_events(events, senders, reading) if len(events) else events
    quality.notes += format_flag_notes(events, is_unread & ~_ego_message_mask(senders, reading))
    if len(events):
        signal = replace(signal, events=_move_flag_events_to_repaired_stamps(events, signal))
    return signal, quality


def _build_senders(codec: V2xCodec, columns: Columns, reading: Reading) -> tuple[RemoteSignal, Quality]:
    ledger = RowLedger(columns, reading.role)
    senders = codec.identify(columns)
    ledger.set_aside(senders.is_roadside, "sent by a roadside unit")
    ledger.set_aside(_ego_message_mask(senders, reading), "sent by the ego station")
    decoded = codec.decode(columns, ledger)
    timeline = _reject_positions_and_repair_station_clocks(columns, reading, ledger, decoded, senders.station)
    _note_timing_anomalies(ledger, decoded, senders.station, timeline)
    rows = timeline.rows
    signal = RemoteSignal(
        source=columns.topic,
        station=_encode_used_station_names(senders.station.codes[rows], senders.station.values),
        stamp_ns=timeline.stamp_ns,
        log_time_ns=columns.log_time_ns[rows],
        **{entry.name: getattr(decoded, entry.name)[rows] for entry in fields(RemoteQuantities)},
    )
    return signal, ledger.quality


def build_ego_position(codec: V2xCodec, columns: Columns, reading: Reading) -> tuple[PositionSignal, Quality]:
    """Build the ego's position from its own messages."""
    ledger, decoded, timeline = _decode_ego_messages(codec, columns, reading)
    _note_ego_stations(codec.identify(columns), reading, ledger)
    return build_signal_and_quality(
        PositionSignal,
        ledger,
        timeline,
        latitude_deg=decoded.latitude_deg,
        longitude_deg=decoded.longitude_deg,
        altitude_m=decoded.altitude_m,
        covariance_m2=decoded.position_covariance_m2,
    )


def build_ego_speed(codec: V2xCodec, columns: Columns, reading: Reading) -> tuple[SpeedSignal, Quality]:
    """Build the ego's speed and yaw rate from its own messages."""
    ledger, decoded, timeline = _decode_ego_messages(codec, columns, reading, needs="speed_mps")
    return build_signal_and_quality(
        SpeedSignal,
        ledger,
        timeline,
        speed_mps=decoded.speed_mps,
        yaw_rate_radps=decoded.yaw_rate_radps,
        speed_variance_m2ps2=decoded.speed_sigma_mps**2,
        yaw_rate_variance_rad2ps2=decoded.yaw_rate_sigma_radps**2,
    )


def build_ego_heading(codec: V2xCodec, columns: Columns, reading: Reading) -> tuple[HeadingSignal, Quality]:
    """Build the ego's heading from its own messages."""
    ledger, decoded, timeline = _decode_ego_messages(codec, columns, reading, needs="heading_rad")
    variance_rad2 = decoded.heading_sigma_rad**2
    return build_signal_and_quality(
        HeadingSignal, ledger, timeline, heading_rad=decoded.heading_rad, variance_rad2=variance_rad2
    )


def _decode_ego_messages(
    codec: V2xCodec, columns: Columns, reading: Reading, needs: str = ""
) -> tuple[RowLedger, RemoteRows, Timeline]:
    """Decode the ego's own messages; those of others, and those without the quantity `needs`, are set aside."""
    ledger = RowLedger(columns, reading.role)
    senders = codec.identify(columns)
    ledger.set_aside(~_ego_message_mask(senders, reading), OTHER_STATION_REASON)
    decoded = codec.decode(columns, ledger)
    if needs:
        ledger.set_aside(~np.isfinite(getattr(decoded, needs)), "not available in the message")
    return (
        ledger,
        decoded,
        _reject_positions_and_repair_station_clocks(columns, reading, ledger, decoded, senders.station),
    )


def _note_ego_stations(senders: Senders, reading: Reading, ledger: RowLedger) -> None:
    """Note which station is the ego, and why."""
    codes = sort_distinct_values(senders.station.codes[_ego_message_mask(senders, reading)])
    for name in (senders.station.values[code] for code in codes if code >= 0):
        is_named = reading.ego_station is not None and name.lower() == reading.ego_station.lower()
        why = "named by --ego-station" if is_named else "whose messages say that the recording vehicle sent them"
        ledger.add_note(f"{EGO_STATION_NOTE_BEGINNING} {name}, {why}")


def _drop_ego_events(events: RoadEvents, senders: Senders, reading: Reading) -> RoadEvents:
    """Return the events without those of the ego's own messages."""
    own_codes = sort_distinct_values(senders.station.codes[_ego_message_mask(senders, reading)])
    own = {senders.station.values[code] for code in own_codes if code >= 0}
    is_own = np.array([*(name in own for name in events.station.values), False])
    return events.select_rows(np.flatnonzero(~is_own[events.station.codes]))


def _move_flag_events_to_repaired_stamps(events: RoadEvents, signal: RemoteSignal) -> RoadEvents:
    """Return the events with the flags at the repaired stamps of their messages."""
    code_of_name = {name: code for code, name in enumerate(signal.station.values)}
    event_station = np.array([code_of_name.get(name, -1) for name in (*events.station.values, "")])
    log_times_ns, log_of_state = np.unique(signal.log_time_ns, return_inverse=True)
    state_keys = signal.station.codes.astype(np.int64) * len(log_times_ns) + log_of_state
    by_key = np.argsort(state_keys, kind="stable")
    is_flag = (events.until_ns == events.stamp_ns) & np.isnan(events.cause)
    flags = np.flatnonzero(is_flag & np.isin(events.log_time_ns, log_times_ns))
    station = event_station[events.station.codes[flags]]
    keys = station * len(log_times_ns) + np.searchsorted(log_times_ns, events.log_time_ns[flags])
    last = np.searchsorted(state_keys[by_key], keys, side="right") - 1
    is_found = (station >= 0) & (last >= 0) & (state_keys[by_key[np.maximum(last, 0)]] == keys)
    stamp_ns, until_ns = events.stamp_ns.copy(), events.until_ns.copy()
    at_ns = signal.stamp_ns[by_key[last[is_found]]]
    stamp_ns[flags[is_found]] = until_ns[flags[is_found]] = at_ns
    return replace(events, stamp_ns=stamp_ns, until_ns=until_ns)


def _ego_message_mask(senders: Senders, reading: Reading) -> BoolArray:
    """Return which messages (n,) the recording vehicle sent: they say so, or the user has named its station."""
    if reading.ego_station is None:
        return senders.is_own
    ego_station = reading.ego_station.lower()
    is_named = np.array([value.lower() == ego_station for value in senders.station.values] + [False])
    is_own: BoolArray = senders.is_own | is_named[senders.station.codes]
    return is_own


def _reject_positions_and_repair_station_clocks(
    columns: Columns, reading: Reading, ledger: RowLedger, decoded: RemoteRows, station: Strings
) -> Timeline:
    """Reject invalid positions, and repair the clock of each station by itself."""
    reject_invalid_positions(ledger, decoded.latitude_deg, decoded.longitude_deg)
    return repair_and_order_times(
        ledger,
        decoded.stamp_ns,
        np.ones(len(columns), dtype=np.bool_),
        reading.clock,
        [decoded.latitude_deg, decoded.longitude_deg, decoded.speed_mps, decoded.heading_rad],
        sender=station.codes,
    )


def _note_timing_anomalies(ledger: RowLedger, decoded: RemoteRows, station: Strings, timeline: Timeline) -> None:
    """Add notes on repeated positions, bursts, and stamps ahead of the log time."""
    rows = timeline.rows
    order = np.argsort(station.codes[rows], kind="stable")
    rows = rows[order]
    stamps_ns = timeline.stamp_ns[order]
    is_same_station = np.diff(station.codes[rows]) == 0
    repeats = (np.diff(decoded.latitude_deg[rows]) == 0) & (np.diff(decoded.longitude_deg[rows]) == 0)
    n_repeats = int(np.count_nonzero(repeats & is_same_station))
    if n_repeats:
        ledger.add_note(f"{n_repeats} messages repeat their station's position under a new time")
    ahead_ns = timeline.stamp_ns - ledger.columns.log_time_ns[timeline.rows]
    is_ahead = ahead_ns > MAX_STAMP_AHEAD_OF_LOG_NS
    if is_ahead.any():
        median_ms = median_of_values(ahead_ns[is_ahead]) * 1e-6
        ledger.add_note(
            f"{np.count_nonzero(is_ahead)} messages are stamped after they were logged (median {median_ms:.0f} ms): "
            "the sender's clock is ahead, or the log time is early"
        )
    intervals_ns = np.diff(stamps_ns)[is_same_station]
    if len(intervals_ns):
        n_bursts = int(np.count_nonzero(intervals_ns < 0.25 * median_of_values(intervals_ns)))
        if n_bursts:
            ledger.add_note(f"{n_bursts} messages come in bursts (less than a quarter of the usual interval apart)")


def _encode_used_station_names(codes: np.ndarray[tuple[int], np.dtype[np.int32]], values: tuple[str, ...]) -> Strings:
    """Return the station names of the rows in use, in order of first appearance; a row without an id is `unknown`."""
    number, first = key_numbers_and_rows_of_first_appearance(codes)
    names = tuple(values[code] if code >= 0 else "unknown" for code in codes[first].tolist())
    return Strings(codes=number, values=names)
