"""Two logs of two cars as one: the second car becomes a remote vehicle of the first, with its own covariance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import numpy as np

from cwcli.channels.binding import bind_roles
from cwcli.channels.other_car import (
    RecorderClock,
    estimate_recorder_clock_offset,
    merge_states_by_log_time,
    move_states_to_our_map_and_clock,
    recorder_clock_difference_text,
)
from cwcli.channels.published import EGO_ONLINE, EGO_STATE, REMOTE_ONLINE, REMOTE_STATE
from cwcli.channels.vehicle_state import VehicleStates, make_vehicle_state_channel, read_vehicle_states
from cwcli.errors import DataError, MissingSignalError
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.pipeline.call import Call, Selection
from cwcli.pipeline.execute import run_stages
from cwcli.pipeline.records import local_map_from_estimate_record, read_configuration, read_run_records
from cwcli.signals.build import build_bound_signal
from cwcli.signals.builders.base import Reading
from cwcli.signals.canonical import PositionSignal
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.mapping import is_field_mapping
from cwcli.signals.role import Role
from cwcli.signals.units import NS_PER_S
from cwcli.version import __version__

JOIN_RECORD_NAME = "cwcli.join"
"""Name of the metadata record that describes how a log was joined with another."""
WORD_FOR_CAR_OF_FIRST_LOG, WORD_FOR_CAR_OF_SECOND_LOG = "ego", "other"
"""The words for the cars of the first and of the second log in the notes of a join."""
EGO_CHANNELS_OF_SECOND_LOG_AND_JOINED_LOG_CHANNELS = ((EGO_STATE, REMOTE_STATE), (EGO_ONLINE, REMOTE_ONLINE))
"""Pairs of channels: the states of the second car's own log, and where they go in the joined log."""


@dataclass(frozen=True)
class JoinedLog:
    """Two logs joined into one.

    Attributes:
        log: The first, with the states of both cars in memory.
        offset_ns: How far the second recorder's clock is ahead of the first's.
        n_states: Channel -> number of the second car's states in it.
        n_outside: Number of its states before or after the first log, which are left out.
    """

    log: Log
    offset_ns: int
    n_states: Mapping[str, int]
    n_outside: int
    notes: tuple[str, ...]


def join_logs(ego: Log, other: Log, estimate: Call, *, name: str, late_s: float = 0.0) -> JoinedLog:
    """Join two logs: the car of the second becomes a remote vehicle in the first.

    Each car is estimated from its own sensors, unless its log holds its states already. The stamps of both are taken as
    GNSS time. What a recorder's clock adds to it is found from the positions of its log: the median of log time less
    stamp. The second car's states get the first one's map, and count as known when they were known in their own car.

    Args:
        name: Id of the second car.
        late_s: How late the stamps of the second log are [s], if that is known.

    Raises:
        MissingSignalError: A log has no position.
        DataError: A car's positions are not on the globe, or the logs have no moment in common.
        CwcliError: As the stage does.
    """
    ours, theirs = _log_with_estimated_states(ego, estimate), _log_with_estimated_states(other, estimate)
    our_map, their_map = _read_local_map(ours), _read_local_map(theirs)
    recorders = _estimate_recorder_clock_of_log(ego), _estimate_recorder_clock_of_log(other)
    stamp_shift_ns = -round(late_s * NS_PER_S)
    offset_ns = recorders[1].ahead_ns - stamp_shift_ns - recorders[0].ahead_ns
    added = {}
    counts: dict[str, int] = {}
    n_outside = 0
    span_ns = read_vehicle_states(ours.columns(EGO_STATE.topic), with_covariance=False).stamp_ns
    for source, target in EGO_CHANNELS_OF_SECOND_LOG_AND_JOINED_LOG_CHANNELS:
        if not _has_decodable_messages(theirs, source.topic):
            continue
        log_shift_ns = stamp_shift_ns if source is EGO_STATE else -offset_ns  # in hindsight, log times are the stamps
        states = move_states_to_our_map_and_clock(
            read_vehicle_states(theirs.columns(source.topic)),
            their_map,
            our_map,
            name=name,
            stamp_shift_ns=stamp_shift_ns,
            log_shift_ns=log_shift_ns,
        )
        within = states.select_rows(
            np.flatnonzero((states.stamp_ns >= span_ns.min()) & (states.stamp_ns <= span_ns.max()))
        )
        if not len(within):
            raise _no_common_time_error(ego, other, span_ns, states)
        counts[target.topic] = len(within)
        n_outside = max(n_outside, len(states) - len(within))
        all_states = (
            merge_states_by_log_time(read_vehicle_states(ours.columns(target.topic)), within)
            if _has_decodable_messages(ours, target.topic)
            else within
        )
        added[target] = all_states
    record = {
        "version": __version__,
        "role": str(Role.REMOTE),
        "id": name,
        "log": other.name,
        "input_sha256": other.begin_sha256().result(),
        "clock_offset_s": f"{offset_ns / NS_PER_S:.9f}",
        "stamps_late_s": repr(late_s),
    }
    channels = [make_vehicle_state_channel(target, states, our_map) for target, states in added.items()]
    notes = _format_join_notes(recorders, offset_ns, n_outside)
    return JoinedLog(ours.with_channels(channels, {JOIN_RECORD_NAME: record}), offset_ns, counts, n_outside, notes)


def _log_with_estimated_states(log: Log, estimate: Call) -> Log:
    """Return the log with its car's states, estimated if it holds none; raise an error if there is still none."""
    if all(channel.topic != EGO_STATE.topic for channel in log.channels):
        with _hint_at_estimate_on_missing_signal(log):
            log = run_stages(log, {"estimate": estimate}, Selection())[1]
    if not _has_decodable_messages(log, EGO_STATE.topic):
        hint = "estimate its sensors' log again, and join what that writes"
        raise MissingSignalError(f"{EGO_STATE.topic} holds no state", where=log.name, hint=hint)
    return log


def _has_decodable_messages(log: Log, topic: str) -> bool:
    return any(channel.topic == topic for channel in log.channels) and len(log.columns(topic)) > 0


@contextmanager
def _hint_at_estimate_on_missing_signal(log: Log) -> Iterator[None]:
    """Replace the hint of a missing signal: the position is chosen in `cwcli estimate`, not in `cwcli join`."""
    try:
        yield
    except MissingSignalError as error:
        hint = f"choose it in `cwcli estimate {log.name} --topic ego_position=/name`, and join what that writes"
        raise MissingSignalError(error.what, where=error.where, found=error.found, hint=hint) from error


def _read_local_map(log: Log) -> LocalMap:
    """Return the map's place on the earth from the log's record; raise `DataError` where it has none."""
    found = local_map_from_estimate_record(read_run_records(log).get("estimate", {}))
    if found is None:
        raise DataError(
            "its positions are Cartesian: their place on the globe is not known",
            where=log.name,
            hint="name fixes with --topic ego_position= in `cwcli estimate`, and join what that writes",
        )
    return found


def _estimate_recorder_clock_of_log(log: Log) -> RecorderClock:
    """Estimate the recorder's clock from the positions that the log's estimate used, if its record names them."""
    sources = read_configuration(read_run_records(log).get("estimate", {})).get("sources")
    topics = sources.get("topics") if isinstance(sources, dict) else None
    named = topics.get(Role.EGO_POSITION) if isinstance(topics, dict) else None
    chosen = str(named) if is_field_mapping(str(named)) else str(named).split(",")[0]  # of several the first
    is_there = any(each.topic == chosen.partition(":")[0] for each in log.channels)
    overrides = {str(Role.EGO_POSITION): chosen} if is_there else {}
    with _hint_at_estimate_on_missing_signal(log):
        bound = bind_roles(log.channels, overrides, required=(Role.EGO_POSITION,), where=log.name, command="join")
    one = bound.channels_of_role(Role.EGO_POSITION)[0]
    topic = one.topic
    parts = [(log.columns(part.topic), part.mapping) for part in one.parts if part.mapping is not None]
    reading = Reading(Role.EGO_POSITION)
    signal = build_bound_signal(one.input, log.columns(topic), reading, one.mapping, parts)[0]
    if not isinstance(signal, PositionSignal):
        raise DataError("its positions are no fixes of a GNSS receiver", where=f"{log.name}: {topic}")
    if not len(signal.stamp_ns):
        hint = "choose positions that hold fixes in `cwcli estimate`, and join what that writes"
        raise MissingSignalError("none of its positions is a fix", where=f"{log.name}: {topic}", hint=hint)
    return estimate_recorder_clock_offset(signal.stamp_ns, signal.log_time_ns)


def _no_common_time_error(ego: Log, other: Log, span_ns: np.ndarray, states: VehicleStates) -> DataError:
    """Return the error that says how far apart in time the states of the two cars are."""
    behind_s = (int(states.stamp_ns.min()) - int(span_ns.max())) / NS_PER_S
    ahead_s = (int(span_ns.min()) - int(states.stamp_ns.max())) / NS_PER_S
    what = f"begins {behind_s:.3f} s after the end of" if behind_s > 0 else f"ends {ahead_s:.3f} s before"
    return DataError(
        f"it {what} {ego.name}: the cars have no moment in common",
        where=other.name,
        hint="if its clock is wrong, --late SECONDS corrects the stamps",
    )


def _format_join_notes(
    recorders: tuple[RecorderClock, RecorderClock], offset_ns: int, n_outside: int
) -> tuple[str, ...]:
    """Return the notes on the recorders' clocks and on the states that were left out."""
    notes = [recorder_clock_difference_text(offset_ns, *recorders)]
    for who, recorder in zip((WORD_FOR_CAR_OF_FIRST_LOG, WORD_FOR_CAR_OF_SECOND_LOG), recorders, strict=True):
        if not recorder.is_on_epochs:
            notes.append(
                f"the stamps of the {who}'s positions are no whole epochs of GNSS time: they may be the computer's, "
                "and the cars are then apart in time by what the two clocks differ (--late corrects it)"
            )
    if n_outside:
        notes.append(f"{n_outside} states of the other car are before or after this log, left out")
    return tuple(notes)
