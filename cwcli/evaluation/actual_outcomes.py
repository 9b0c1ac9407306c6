"""Actual motion of the ego and the others of an annotated log: their pairs and real conflicts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from cwcli.channels.binding import bind_roles
from cwcli.channels.published import EGO_STATE, REMOTE_STATE, TARGETS
from cwcli.channels.target import read_targets_as_states
from cwcli.channels.vehicle_state import KINEMATIC_AND_FLAG_FIELDS, VehicleStates, read_vehicle_states
from cwcli.evaluation.conflicts import RealConflict, find_real_conflicts
from cwcli.evaluation.records import find_collision_warning_record_and_is_of_targets, warning_config_from_record
from cwcli.evaluation.scored_warnings import NS_PER_H
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.measures.pair import ActualTrack, Pair
from cwcli.pipeline.call import Selection
from cwcli.pipeline.records import read_configuration, read_run_records, to_int_or_none
from cwcli.signals.row_order import iter_track_rows
from cwcli.warning.types import WarningConfig, median_length_and_width_m


@dataclass(frozen=True)
class ActualOutcomes:
    """Actual motion of the host and the others.

    Attributes:
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


def read_actual_states(log: Log, selection: Selection, role: str) -> VehicleStates | None:
    """Read the states of vehicles in hindsight in the chosen span; None if the log has none."""
    topic = bind_roles(
        log.channels, selection.topics, required=(), optional=(role,), where=log.name
    ).first_topic_of_role(role)
    if topic is None:
        return None
    states = (read_targets_as_states if role == TARGETS.role else read_vehicle_states)(log.columns(topic))
    return states.select_logged_within(selection.start_ns, selection.end_ns)


def read_actual_tracks(log: Log, selection: Selection, roles: Iterable[str]) -> dict[str, ActualTrack]:
    """Read the track of each vehicle in hindsight."""
    found: dict[str, ActualTrack] = {}
    for role in roles:
        states = read_actual_states(log, selection, role)
        if states is not None:
            found |= {
                vehicle: ActualTrack(states.stamp_ns[rows], states.state[rows])
                for vehicle, rows in iter_track_rows(states.ids, states.stamp_ns)
            }
    return found


def find_actual_outcomes(log: Log) -> ActualOutcomes | None:
    """Find pairs and real conflicts from the states of an annotated log; None where states are missing."""
    record, is_of_targets = find_collision_warning_record_and_is_of_targets(read_run_records(log))
    configuration = read_configuration(record)
    topics = {channel.topic for channel in log.channels}
    if not record:
        is_of_targets = REMOTE_STATE.topic not in topics
    others_topic = TARGETS.topic if is_of_targets else REMOTE_STATE.topic
    if not {EGO_STATE.topic, others_topic} <= topics:
        return None
    fields = KINEMATIC_AND_FLAG_FIELDS
    columns = log.load_topics({EGO_STATE.topic: fields, others_topic: None if is_of_targets else fields})
    host, others = (
        read_targets_as_states(each) if topic == TARGETS.topic else read_vehicle_states(each, with_covariance=False)
        for topic, each in columns.items()
    )
    start_ns, end_ns = (to_int_or_none(configuration.get(name)) for name in ("start_ns", "end_ns"))
    host, others = host.select_logged_within(start_ns, end_ns), others.select_logged_within(start_ns, end_ns)
    if not len(host):
        return None
    config = warning_config_from_record(record)
    host_size, host = median_length_and_width_m(host.length_m, host.width_m), host.sort_by_stamp_without_repeats()
    own = ActualTrack(host.stamp_ns, host.state)
    pairs = {
        vehicle: Pair(
            own,
            ActualTrack(others.stamp_ns[rows], others.state[rows]),
            host_size,
            median_length_and_width_m(others.length_m[rows], others.width_m[rows]),
            config.max_gap_s,
        )
        for vehicle, rows in iter_track_rows(others.ids, others.stamp_ns)
    }
    conflicts = {vehicle: find_real_conflicts(pair, config) for vehicle, pair in pairs.items()}
    return ActualOutcomes(own, pairs, conflicts, config)
