"""From a log to canonical signals: bind the roles, load the columns in one pass, build the signals, count faults."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import field

import numpy as np

from cwcli.channels.binding import Bindings, bind_roles
from cwcli.errors import MissingSignalError
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.logs.read.reader import Log
from cwcli.pipeline.call import Selection, config_with_selection
from cwcli.pipeline.result import InputMessageCount
from cwcli.pipeline.stations import add_stations_to_error
from cwcli.signals.build import build_bound_signal, require_usable_rows
from cwcli.signals.builders.base import Reading
from cwcli.signals.canonical import Signal
from cwcli.signals.clocks import (
    STRAY_LOG_TIME_REASON,
    Clock,
    first_and_last_log_time_without_strays,
    lines_on_channels_with_other_clock,
)
from cwcli.signals.columns import Columns, Int64Array
from cwcli.signals.quality import Quality
from cwcli.signals.role import Role

UP_AXIS_COLUMN_OF_GYRO = 2
"""Column of the turn rate about the upward axis in `ImuSignal.gyro_radps` (x, y, z)."""

ROLES_WHOSE_MESSAGES_HOLD_AT_ANY_TIME = frozenset({Role.CAMERA_INFO})
"""Roles whose messages hold at any time: a calibration may be logged long before the drive."""


@dataclass(frozen=True)
class SourceConfig(Selection):
    """Which channels are read, and how.

    Attributes:
        clock: A measurement's time: its header `stamp`, or its `log` time.
        ego_station: Station id of the ego's own V2X messages, or None.
    """

    clock: Clock = "stamp"
    ego_station: str | None = None


@dataclass(frozen=True)
class SensorSignals:
    """The signals of a log.

    Attributes:
        by_role: Role -> its signals, one per bound channel that has a usable row.
        qualities: Counts of each channel's used, rejected and repaired messages.
        notes: Notes for the user.
        columns: Role -> columns, in the chosen span, of a channel that was read in addition to the signals.
    """

    by_role: Mapping[Role, tuple[Signal, ...]]
    qualities: tuple[Quality, ...]
    notes: tuple[str, ...]
    columns: Mapping[str, Columns] = field(default_factory=dict)

    def input_message_counts(self) -> tuple[InputMessageCount, ...]:
        """Return the counts of messages, and of the objects in them, for the summary."""
        return tuple(
            InputMessageCount(q.source, role, q.read, q.used, q.rejected, q.repaired, q.set_aside, q.first_fault_ns)
            for of_messages in self.qualities
            for q, role in ((of_messages, of_messages.role), (of_messages.objects, "each object"))
            if q is not None
        )


def read_sensor_signals(
    log: Log,
    config: Selection,
    *,
    command: str,
    required: Collection[Role] = (),
    optional: Collection[Role] = (),
    also: Bindings | None = None,
    fields: Mapping[str, Collection[str]] | None = None,
) -> SensorSignals:
    """Read the signals that a stage needs.

    Args:
        config: The channels to read, and how; a plain `Selection` means the clock `stamp`.
        also: Further channels of one topic each that are read in the same pass.
        fields: Role of such a channel -> the leaf fields to read; all fields without an entry.

    Raises:
        MissingSignalError: A required role has no channel, or more than one, or no message of the ego.
        UsageError: An override that does not fit the log.
        DataError: Every message of a required role was rejected.
        InputError: The log is damaged.
    """
    how = config if isinstance(config, SourceConfig) else config_with_selection(SourceConfig(), config)
    try:
        bound = bind_roles(
            log.channels,
            config.topics,
            required=required,
            optional=optional,
            ego_station=how.ego_station,
            where=log.name,
            command=command,
        )
    except MissingSignalError as error:
        if Role.EGO_POSITION in required:
            raise add_stations_to_error(error, log, ego_station=how.ego_station) from None
        raise
    fields_to_load = bound.fields_to_load()
    every = {role: [each for one in b for each in (one, *one.parts)] for role, b in bound.by_role.items()}
    for binding in (each for bindings in every.values() for each in bindings):
        fields_to_load.setdefault(binding.topic, set())  # of an unknown encoding: the reader says so
    own = {} if also is None else {role: bindings[0].topic for role, bindings in also.by_role.items()}
    further = {topic: (fields or {}).get(role) for role, topic in own.items()}
    loaded = {
        topic: columns.slice_by_log_time(config.start_ns, config.end_ns)
        for topic, columns in log.load_topics({**fields_to_load, **further}).items()
    }
    timed = {
        each.topic
        for role, bindings in every.items()
        if role not in ROLES_WHOSE_MESSAGES_HOLD_AT_ANY_TIME
        for each in bindings
    }
    usual_ns = first_and_last_log_time_without_strays([loaded[topic].log_time_ns for topic in timed])
    by_role: dict[Role, tuple[Signal, ...]] = {}
    qualities: list[Quality] = []
    for role in dict.fromkeys((*required, *optional)):
        bindings = bound.channels_of_role(role)
        signals: list[Signal] = []
        for one in bindings:
            columns = replace(loaded[one.topic], schema_name=one.schema_name)  # which the user may have said
            strays_ns = columns.log_time_ns[:0]
            if role not in ROLES_WHOSE_MESSAGES_HOLD_AT_ANY_TIME:
                columns, strays_ns = _rows_in_span_and_times_of_others(columns, *usual_ns)
            signal, quality = build_bound_signal(
                one.input,
                columns,
                Reading(role, how.clock, how.ego_station, one.is_override),
                one.mapping,
                [
                    (_rows_in_span_and_times_of_others(loaded[p.topic], *usual_ns)[0], p.mapping)
                    for p in one.parts
                    if p.mapping
                ],
            )
            quality.count_rejected_before_build(STRAY_LOG_TIME_REASON, strays_ns)
            qualities.append(quality)
            if quality.n_rows or getattr(signal, "events", None) is not None:
                signals.append(signal)
        if signals:
            by_role[role] = tuple(signals)
        elif role in required:
            for quality in qualities[-len(bindings) :]:
                is_cut = config.start_ns is not None or config.end_ns is not None
                try:
                    require_usable_rows(quality, where=log.name, is_cut=is_cut)
                except MissingSignalError as error:
                    if role is Role.EGO_POSITION:
                        topics = {quality.source}
                        raise add_stations_to_error(error, log, ego_station=how.ego_station, topics=topics) from None
                    raise
    notes = (*bound.notes, *(f"{q.source}: {note}" for q in qualities for note in q.notes))
    others = {role: loaded[topic] for role, topic in own.items()}
    return SensorSignals(by_role, tuple(qualities), (*notes, *lines_on_channels_with_other_clock(qualities)), others)


def read_bound_columns(log: Log, bound: Bindings, *, without: Collection[str] = ()) -> dict[str, Columns]:
    """Read all columns of the channels of earlier stages, from the whole log in one pass; return role -> columns."""
    topics = {role: bindings[0].topic for role, bindings in bound.by_role.items() if role not in without}
    columns = log.load_topics(dict.fromkeys(topics.values()))
    return {role: columns[topic] for role, topic in topics.items()}


def _rows_in_span_and_times_of_others(columns: Columns, first_ns: int, last_ns: int) -> tuple[Columns, Int64Array]:
    """Return the messages logged from `first_ns` to `last_ns`, and the log times of the others.

    Log times are unsigned in a file, and the rows are in that order.
    """
    log_ns = columns.log_time_ns.view(np.uint64)
    first = int(np.searchsorted(log_ns, np.uint64(first_ns)))
    end = int(np.searchsorted(log_ns, np.uint64(last_ns), side="right"))
    if end - first == len(columns):
        return columns, columns.log_time_ns[:0]
    return columns.slice_rows(first, end), np.delete(columns.log_time_ns, slice(first, end))
