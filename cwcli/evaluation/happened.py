"""Actual motion of the ego and the others of an annotated log: their pairs and real conflicts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from cwcli.channels.binding import bind
from cwcli.channels.published import EGO_STATE, REMOTE_STATE, TARGETS
from cwcli.channels.target import read_targets
from cwcli.channels.vehicle_state import VehicleStates, read_states
from cwcli.evaluation.conflicts import RealConflict, real_conflicts
from cwcli.evaluation.records import rule_of, warn_record
from cwcli.evaluation.scored_warnings import NS_PER_H
from cwcli.logs.read.reader import Log
from cwcli.measures.pair import ActualTrack, Pair
from cwcli.pipeline.call import Selection
from cwcli.pipeline.records import configuration_of, run_records, whole
from cwcli.signals.row_order import tracks_of
from cwcli.warning.types import WarningConfig, outline_of


@dataclass(frozen=True)
class Happened:
    """Actual motion of the host and the others.

    Attributes:
        host: Track of the host.
        pairs: Vehicle -> pair of the host and it.
        conflicts: Vehicle -> real conflicts with it, in order of time.
        config: Definition of a conflict and limits of a verdict as `cwcli warn` used them, else the defaults.
    """

    host: ActualTrack
    pairs: Mapping[str, Pair]
    conflicts: Mapping[str, list[RealConflict]]
    config: WarningConfig

    @property
    def host_hours(self) -> float:
        """Duration of the host's track, hours."""
        return float(self.host.stamp_ns[-1] - self.host.stamp_ns[0]) / NS_PER_H

    @property
    def n_conflicts(self) -> int:
        """Number of real conflicts with all vehicles."""
        return sum(map(len, self.conflicts.values()))


def recorded(log: Log, selection: Selection, role: str) -> VehicleStates | None:
    """Read the states of vehicles in hindsight in the chosen span; None if the log has none."""
    topic = bind(log.channels, selection.topics, required=(), optional=(role,), where=log.name).topic(role)
    if topic is None:
        return None
    states = (read_targets if role == TARGETS.role else read_states)(log.columns(topic))
    return states.logged_within(selection.start_ns, selection.end_ns)


def recorded_tracks(log: Log, selection: Selection, roles: Iterable[str]) -> dict[str, ActualTrack]:
    """Read the track of each vehicle in hindsight."""
    found: dict[str, ActualTrack] = {}
    for role in roles:
        states = recorded(log, selection, role)
        if states is not None:
            found |= {
                vehicle: ActualTrack(states.stamp_ns[rows], states.state[rows])
                for vehicle, rows in tracks_of(states.ids, states.stamp_ns)
            }
    return found


def what_happened(log: Log) -> Happened | None:
    """Find pairs and real conflicts from the states of an annotated log; None where states are missing."""
    record, is_of_targets = warn_record(run_records(log))
    configuration = configuration_of(record)
    topics = {channel.topic for channel in log.channels}
    if not record:
        is_of_targets = REMOTE_STATE.topic not in topics
    others_topic = TARGETS.topic if is_of_targets else REMOTE_STATE.topic
    if not {EGO_STATE.topic, others_topic} <= topics:
        return None
    columns = log.load(dict.fromkeys((EGO_STATE.topic, others_topic)))
    host = read_states(columns[EGO_STATE.topic])
    others = (read_targets if others_topic == TARGETS.topic else read_states)(columns[others_topic])
    start_ns, end_ns = (whole(configuration.get(name)) for name in ("start_ns", "end_ns"))
    host, others = host.logged_within(start_ns, end_ns), others.logged_within(start_ns, end_ns)
    if not len(host):
        return None
    config = rule_of(record)
    host_size, host = outline_of(host.length_m, host.width_m), host.by_stamp()
    own = ActualTrack(host.stamp_ns, host.state)
    pairs = {
        vehicle: Pair(
            own,
            ActualTrack(others.stamp_ns[rows], others.state[rows]),
            host_size,
            outline_of(others.length_m[rows], others.width_m[rows]),
            config.max_gap_s,
        )
        for vehicle, rows in tracks_of(others.ids, others.stamp_ns)
    }
    conflicts = {vehicle: real_conflicts(pair, config) for vehicle, pair in pairs.items()}
    return Happened(own, pairs, conflicts, config)
