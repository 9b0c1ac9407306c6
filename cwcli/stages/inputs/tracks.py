"""Tracks of the ego and all others without covariances, which are most of a channel; those only where asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from cwcli.channels.binding import Bindings
from cwcli.channels.published import EGO_STATE, REMOTE_STATE, TARGETS
from cwcli.channels.target import read_targets_as_states
from cwcli.channels.vehicle_state import (
    COVARIANCE_FIELDS,
    KINEMATIC_AND_FLAG_FIELDS,
    KINEMATIC_FIELDS,
    VehicleStates,
    read_vehicle_states,
    require_ego_states,
)
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.measures.base import Measure
from cwcli.measures.evaluate import MeasuredPair, add_sigmas_to_extremes, stamps_of_extremes_with_sigma
from cwcli.measures.pair import ActualTrack, Pair
from cwcli.pipeline.call import Selection
from cwcli.pipeline.result import InputMessageCount
from cwcli.signals.columns import FloatArray, Int64Array, sort_distinct_values
from cwcli.signals.resample import MAX_INTERPOLATED_STATE_GAP_S
from cwcli.signals.row_order import iter_track_rows
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import N_STATES
from cwcli.warning.types import median_length_and_width_m

OTHER_VEHICLE_ROLES = (REMOTE_STATE.role, TARGETS.role)
"""Roles of the channels that hold other road users: remote vehicles and tracked targets."""
COVARIANCE_SLICE_DURATION_NS = 30 * NS_PER_S
"""Length of the part of the log whose covariances are in memory at once, ns. Chosen by hand."""
STATE_FIELDS_READ_WHERE_COVARIANCES_ARE_WANTED = (*KINEMATIC_FIELDS, *COVARIANCE_FIELDS)
"""Leaf fields of a state channel that are read when covariances are wanted."""


@dataclass(frozen=True)
class TracksOfLog:
    """The tracks of the ego and of the other road users in a log.

    Attributes:
        ego: Its states by stamp.
        others: Vehicle -> its states by stamp.
        topics: Vehicle -> topic and role of its channel; the ego's own under its id.
        has_covariance: Whether the pairs have the states' covariances.
    """

    ego: VehicleStates
    others: Mapping[str, VehicleStates]
    topics: Mapping[str, tuple[str, str]]
    has_covariance: bool = False

    @property
    def ego_id(self) -> str:
        """The id of the ego."""
        return str(self.ego.ids.values[self.ego.ids.codes[0]])

    def pair_with_ego(self, other_id: str) -> Pair:
        """Return the pair of the ego and another vehicle."""
        own, theirs = self.ego, self.others[other_id]
        return Pair(
            self._actual_track(own),
            self._actual_track(theirs),
            median_length_and_width_m(own.length_m, own.width_m),
            median_length_and_width_m(theirs.length_m, theirs.width_m),
            MAX_INTERPOLATED_STATE_GAP_S,
        )

    def _actual_track(self, states: VehicleStates) -> ActualTrack:
        """Return the states as a track, with covariances if the log's tracks have them."""
        return ActualTrack(states.stamp_ns, states.state, states.covariance if self.has_covariance else None)


def read_ego_and_other_tracks(
    log: Log,
    bound: Bindings,
    selection: Selection,
    *,
    with_covariance: bool = False,
    ego: VehicleStates | None = None,
) -> tuple[TracksOfLog, tuple[InputMessageCount, ...]]:
    """Read the tracks in the chosen span in one pass, and count the messages.

    Args:
        ego: The states of the ego by stamp, if they are known; then its channel is not read.

    Raises:
        MissingSignalError: There is no state of the ego.
    """
    counts = []
    others: dict[str, VehicleStates] = {}
    topics: dict[str, tuple[str, str]] = {}
    topic_by_role = {role: bindings[0].topic for role, bindings in bound.by_role.items()}
    fields = STATE_FIELDS_READ_WHERE_COVARIANCES_ARE_WANTED if with_covariance else KINEMATIC_AND_FLAG_FIELDS
    columns = log.load_topics(
        {
            topic: None if role == TARGETS.role else fields
            for role, topic in topic_by_role.items()
            if role != EGO_STATE.role or ego is None
        }
    )
    for role, topic in topic_by_role.items():
        if role == EGO_STATE.role and ego is not None:
            topics[ego.ids.values[ego.ids.codes[0]]] = topic, role
            continue
        own = columns.pop(topic)
        everything = (
            read_targets_as_states(own)
            if role == TARGETS.role
            else read_vehicle_states(own, with_covariance=with_covariance)
        )
        states = everything.select_logged_within(selection.start_ns, selection.end_ns)
        counts.append(InputMessageCount(topic, role, len(everything), len(states)))
        if role == EGO_STATE.role:
            require_ego_states(states, log_name=log.name, topic=topic)
            ego = states.sort_by_stamp_without_repeats()
            topics[ego.ids.values[ego.ids.codes[0]]] = topic, role
            continue
        for vehicle, rows in iter_track_rows(states.ids, states.stamp_ns):
            others[vehicle], topics[vehicle] = states.select_rows(rows), (topic, role)
    assert ego is not None  # binding requires it
    return TracksOfLog(ego, others, topics, with_covariance), tuple(counts)


def add_sigmas_of_extremes(
    log: Log, tracks: TracksOfLog, pairs: Sequence[MeasuredPair], measures: Mapping[str, Measure]
) -> list[MeasuredPair]:
    """Return the pairs with sigmas of their extremes, from the covariances of the states at those stamps."""
    stamps_by_vehicle: dict[str, list[Int64Array]] = {tracks.ego_id: []}
    at = {pair.other_id: stamps_of_extremes_with_sigma(pair, measures) for pair in pairs}
    for vehicle, stamps in at.items():
        theirs = tracks.others[vehicle].stamp_ns
        latest = np.clip(np.searchsorted(theirs, stamps, side="right") - 1, 0, None)
        stamps_by_vehicle[vehicle] = [theirs[latest]]
        stamps_by_vehicle[tracks.ego_id].append(stamps)
    known = _read_covariances_at_stamps(
        log, tracks, {vehicle: np.concatenate(each) for vehicle, each in stamps_by_vehicle.items() if each}
    )
    rows_with_sigmas = []
    for pair in pairs:
        stamps = at[pair.other_id]
        if not len(stamps):
            rows_with_sigmas.append(pair)
            continue
        pair_at_extremes = tracks.pair_with_ego(pair.other_id).select_rows(np.searchsorted(tracks.ego.stamp_ns, stamps))
        own, theirs_ns = known[tracks.ego_id], stamps_by_vehicle[pair.other_id][0]
        covariances = _covariances_at_stamps(own, stamps), _covariances_at_stamps(known[pair.other_id], theirs_ns)
        rows_with_sigmas.append(add_sigmas_to_extremes(pair, pair_at_extremes, measures, covariances))
    return rows_with_sigmas


def _covariances_at_stamps(covariance_by_stamp: Mapping[int, FloatArray], stamps: Int64Array) -> FloatArray:
    """Return the covariances (n, N_STATES, N_STATES) at n stamps; NaN where none is known."""
    unknown = np.full((N_STATES, N_STATES), np.nan)
    return np.array([covariance_by_stamp.get(stamp, unknown) for stamp in stamps.tolist()])


def _read_covariances_at_stamps(
    log: Log, tracks: TracksOfLog, stamps_by_vehicle: Mapping[str, Int64Array]
) -> dict[str, dict[int, FloatArray]]:
    """Return vehicle -> stamp -> covariance of its state, read one slice of the log at a time."""
    found: dict[str, dict[int, FloatArray]] = {vehicle: {} for vehicle in stamps_by_vehicle}
    stamps = {vehicle: sort_distinct_values(each) for vehicle, each in stamps_by_vehicle.items()}
    for topic, role in dict.fromkeys(tracks.topics[vehicle] for vehicle in stamps_by_vehicle):
        vehicles_of_channel = [vehicle for vehicle in stamps_by_vehicle if tracks.topics[vehicle] == (topic, role)]
        for states in _iter_states_near_stamps(log, topic, role, tracks, vehicles_of_channel, stamps):
            for vehicle, rows in iter_track_rows(states.ids, states.stamp_ns):
                if vehicle in vehicles_of_channel:
                    rows_at_stamps = rows[np.isin(states.stamp_ns[rows], stamps[vehicle])]
                    pairs = zip(
                        states.stamp_ns[rows_at_stamps].tolist(), states.covariance[rows_at_stamps], strict=True
                    )
                    found[vehicle].update((stamp, covariance.copy()) for stamp, covariance in pairs)
    return found


def _iter_states_near_stamps(
    log: Log,
    topic: str,
    role: str,
    tracks: TracksOfLog,
    vehicles: Sequence[str],
    stamps: Mapping[str, Int64Array],
) -> Iterator[VehicleStates]:
    """Yield the states with covariances around the wanted stamps, one slice of the log at a time."""
    if role == TARGETS.role:
        yield read_targets_as_states(log.columns(topic))
        return
    logged = [np.zeros(0, np.int64)]
    for vehicle in vehicles:
        states = tracks.ego if vehicle == tracks.ego_id else tracks.others[vehicle]
        logged.append(states.log_time_ns[np.isin(states.stamp_ns, stamps[vehicle])])
    times = sort_distinct_values(np.concatenate(logged))
    while len(times):
        last = int(np.searchsorted(times, times[0] + COVARIANCE_SLICE_DURATION_NS))
        span = (int(times[0]), int(times[last - 1]) + 1)
        yield read_vehicle_states(
            log.load_topics({topic: STATE_FIELDS_READ_WHERE_COVARIANCES_ARE_WANTED}, logged=span)[topic]
        )
        times = times[last:]
