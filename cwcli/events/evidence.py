"""What events are found in: the states, lanes, warnings and message times of a log, each read when it is asked for."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from cwcli.channels.binding import Bindings, bind_roles
from cwcli.channels.lanes import BOUNDARY_SIDES
from cwcli.channels.published import EGO_STATE, LANES, WARNINGS
from cwcli.channels.vehicle_state import VehicleStates
from cwcli.channels.warning import (
    WARNING_FIELDS_FOR_EVENTS,
    WarningEvent,
    read_warnings,
    warning_events_with_known_start,
)
from cwcli.errors import MissingSignalError, UsageError
from cwcli.evaluation.actual_outcomes import ActualOutcomes, find_actual_outcomes
from cwcli.evaluation.system_topics import OtherSystemTopics
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.measures.pair import Pair
from cwcli.pipeline.states import StatesSelection
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.leaf_fields import read_numbers
from cwcli.signals.role import Role
from cwcli.signals.row_order import first_and_last_rows_of_runs
from cwcli.signals.units import NS_PER_S
from cwcli.stages.inputs.tracks import OTHER_VEHICLE_ROLES, TracksOfLog, read_ego_and_other_tracks

if TYPE_CHECKING:
    from cwcli.events.base import Moment
    from cwcli.events.own_path import DrivenWay, OnOwnPath

NEVER_PAUSING_SENSOR_ROLES = (
    Role.EGO_SPEED,
    Role.EGO_HEADING,
    Role.EGO_VELOCITY,
    Role.EGO_STEER,
    Role.IMU,
    Role.CAMERA,
    Role.DETECTIONS,
)
"""Roles of sensors of the ego that send without pause. Received messages are left out: other cars come and go."""


@dataclass(frozen=True)
class LaneDistances:
    """The distances of the lane boundaries from the car's centre line, (n,) each.

    Attributes:
        left_m, right_m: To the left positive; NaN where a boundary was not found.
    """

    stamp_ns: Int64Array
    left_m: FloatArray
    right_m: FloatArray


class EventEvidence:
    """What is known of a log. Only what an event asks for is read.

    Args:
        log: The log; it stays open while events are found.
        other_system: Topics of another system in it; None: none is named.

    Attributes:
        lane_changes: The ego's lane changes, once they have been looked for; three kinds of events need them.
        driven_way, grid_rows: The ego's way, and the rows at which it is looked at, once they were asked for.
        on_own_path: Other vehicle -> its projection on the ego's way, once it was asked for; five kinds need it.
    """

    def __init__(self, log: Log, other_system: OtherSystemTopics | None = None) -> None:
        self.log = log
        self.other_system = other_system
        self._selection = StatesSelection(states="hindsight")
        self._pairs: dict[str, Pair] = {}
        self.lane_changes: tuple[Moment, ...] | None = None
        self.driven_way: DrivenWay | None = None
        self.grid_rows: np.ndarray[tuple[int, ...], np.dtype[np.intp]] | None = None
        self.on_own_path: dict[str, OnOwnPath] = {}

    @cached_property
    def tracks(self) -> TracksOfLog:
        """The states of the ego and the others in hindsight.

        Raises:
            MissingSignalError: The log holds no states of the ego.
        """
        bound, known = self._bind_state_channels(OTHER_VEHICLE_ROLES), vars(self).get("_ego")
        tracks = read_ego_and_other_tracks(self.log, bound, self._selection, ego=known)[0]
        self._ego = tracks.ego
        return tracks

    @cached_property
    def _ego(self) -> VehicleStates:
        """The states of the ego by stamp; the others', which are most of a log, are not read."""
        return read_ego_and_other_tracks(self.log, self._bind_state_channels(()), self._selection)[0].ego

    def _bind_state_channels(self, others: tuple[str, ...]) -> Bindings:
        """Return the channels of the states of the ego, and of the others with these roles."""
        return bind_roles(
            self.log.channels,
            self._selection.topics,
            required=(EGO_STATE.role,),
            optional=others,
            where=self.log.name,
            command="find",
        )

    @property
    def stamp_ns(self) -> Int64Array:
        """The stamps of the ego's states, (n,)."""
        return self._ego.stamp_ns

    @property
    def ego_state(self) -> FloatArray:
        """The ego's states, (n, 8)."""
        return self._ego.state

    @property
    def ego_id(self) -> str:
        """The id of the ego."""
        return str(self._ego.ids.values[self._ego.ids.codes[0]])

    def iter_pairs(self) -> Iterator[tuple[str, Pair]]:
        """Yield id and pair of each other vehicle that comes near the ego."""
        for other_id in self.tracks.others:
            pair = self.pair_with_ego(other_id)
            if len(pair.near_rows):
                yield other_id, pair

    def pair_with_ego(self, other_id: str) -> Pair:
        """Return the pair of the ego and another vehicle."""
        if other_id not in self._pairs:
            self._pairs[other_id] = self.tracks.pair_with_ego(other_id)
        return self._pairs[other_id]

    @cached_property
    def lanes(self) -> LaneDistances:
        """The distances of the lane boundaries.

        Raises:
            MissingSignalError: The log holds no lanes.
        """
        self._require_topic(LANES.topic, "lane boundaries", "lanes")
        names = [f"{side}.{name}" for side in BOUNDARY_SIDES for name in ("lateral_m", "found")]
        columns = self.log.columns(LANES.topic, ("stamp_ns", *names))
        stamp_ns = np.asarray(columns.fields["stamp_ns"]).astype(np.int64)
        left_m, right_m = (
            np.where(read_numbers(columns, f"{side}.found") > 0.0, read_numbers(columns, f"{side}.lateral_m"), np.nan)
            for side in BOUNDARY_SIDES
        )
        return LaneDistances(stamp_ns, left_m, right_m)

    @cached_property
    def warnings(self) -> list[WarningEvent]:
        """The warnings, in order of time.

        Raises:
            MissingSignalError: No warning rule has run on the log.
        """
        self._require_topic(WARNINGS.topic, "warnings", "warn")
        return warning_events_with_known_start(
            read_warnings(self.log.columns(WARNINGS.topic, WARNING_FIELDS_FOR_EVENTS))
        )

    @cached_property
    def outcomes(self) -> ActualOutcomes | None:
        """The actual motion and the real conflicts; None where the states are missing."""
        return find_actual_outcomes(self.log)

    @cached_property
    def other_warning_spans_ns(self) -> list[tuple[int, int]]:
        """First and last time [ns] of each warning of the other system.

        Raises:
            UsageError: No topic of it is named.
        """
        from cwcli.evaluation.system.flag import read_flag_from_topic

        if self.other_system is None or self.other_system.condition is None:
            raise UsageError(
                "disagreement needs the other system's warnings", hint="--topic warning=/adas/fcw:data==true"
            )
        self.other_system.require_topics_in_log(self.log)
        return read_flag_from_topic(self.log, self.other_system.warning, self.other_system.condition).warning_spans_ns()

    def message_times_ns(self, topic: str) -> Int64Array:
        """Return the sorted log times [ns] of a topic of the file; nothing is decoded."""
        return self.log.log_times_ns(topic).astype(np.int64)

    def topics_of_roles(self, roles: tuple[Role, ...]) -> list[str]:
        """Return the topics of the file that fill some roles."""
        found: dict[str, None] = {}
        for role in roles:
            bound = bind_roles(self.log.channels, {}, required=(), optional=(role,), where=self.log.name)
            found.update((binding.topic, None) for each in bound.by_role.values() for binding in each)
        return list(found)

    def _require_topic(self, topic: str, what: str, stage: str) -> None:
        """Raise `MissingSignalError` if the log lacks a topic."""
        if all(channel.topic != topic for channel in self.log.channels):
            raise MissingSignalError(
                f"the log holds no {what}", where=self.log.name, hint=f"run `cwcli {stage}` on it first"
            )


def lasting_row_spans(
    holds: npt.NDArray[np.bool_], stamp_ns: Int64Array, *, min_s: float = 0.0, max_pause_s: float = 0.0
) -> list[tuple[int, int]]:
    """Return first and last row of each stretch in which a condition holds.

    Args:
        holds: Shape (n,).
        stamp_ns: Shape (n,), increasing.
        min_s: Shorter stretches are left out, s.
        max_pause_s: Stretches with a shorter pause between them are one, s.
    """
    joined_spans: list[tuple[int, int]] = []
    for first, last in first_and_last_rows_of_runs(holds):
        if joined_spans and stamp_ns[first] - stamp_ns[joined_spans[-1][1]] <= max_pause_s * NS_PER_S:
            joined_spans[-1] = joined_spans[-1][0], last
        else:
            joined_spans.append((first, last))
    return [span for span in joined_spans if stamp_ns[span[1]] - stamp_ns[span[0]] >= min_s * NS_PER_S]
