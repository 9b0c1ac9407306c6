"""The vehicles of an annotated log as the actors of a scenario."""

from __future__ import annotations

from pathlib import PurePath

import numpy as np

from cwcli.channels.published import EGO_STATE, REMOTE_STATE, TARGETS
from cwcli.channels.target import read_targets_as_states
from cwcli.channels.vehicle_state import VehicleStates, read_vehicle_states
from cwcli.errors import MissingSignalError
from cwcli.lazy_dataclass import replace
from cwcli.logs.read.reader import Log
from cwcli.signals.row_order import iter_track_rows
from cwcli.signals.units import NS_PER_S
from cwcli.simulation.recorded_actors import MIN_STATES_OF_RECORDED_ACTOR, RecordedTrack, replace_vehicles
from cwcli.simulation.scenario import EGO_VEHICLE_KEY, Scenario
from cwcli.warning.types import median_length_and_width_m


def replace_vehicles_by_those_of_log(scenario: Scenario, name: str) -> Scenario:
    """Replace a scenario's vehicles by those of a log, on their states in hindsight; the run begins with the ego's.

    Args:
        name: Log with the states of `cwcli estimate`. The others are its remote vehicles, or without them its targets.

    Raises:
        MissingSignalError: It has no states of the ego.
        UsageError: Its vehicles are too many for a run.
        InputError: It can't be read.
    """
    with Log.open(name) as log:
        topics = {channel.topic for channel in log.channels}
        if EGO_STATE.topic not in topics:
            raise MissingSignalError(
                "it holds no states of vehicles that could be actors",
                where=log.name,
                hint=f"cwcli estimate {log.name} -o annotated.mcap",
            )
        host = read_vehicle_states(log.columns(EGO_STATE.topic))
        others = None
        if REMOTE_STATE.topic in topics:
            others = read_vehicle_states(log.columns(REMOTE_STATE.topic))
        elif TARGETS.topic in topics:
            others = read_targets_as_states(log.columns(TARGETS.topic))
    start_ns = int(host.stamp_ns.min()) if len(host) else 0
    own = list(_read_tracks(host, start_ns).values())
    if len(own) != 1:
        raise MissingSignalError("the ego is known at less than two moments", where=name)
    tracks = {EGO_VEHICLE_KEY: own[0], **({} if others is None else _read_tracks(others, start_ns))}
    recorded = replace_vehicles(scenario, tracks, name=PurePath(name).stem)
    return replace(recorded, start_ns=start_ns)


def _read_tracks(states: VehicleStates, start_ns: int) -> dict[str, RecordedTrack]:
    """The tracks of vehicles by their ids, seconds from a start; a vehicle that is known but once is left out."""
    tracks = {}
    for vehicle, rows in iter_track_rows(states.ids, states.stamp_ns):
        known = rows[np.isfinite(states.state[rows]).all(axis=1)]
        if len(known) >= MIN_STATES_OF_RECORDED_ACTOR:
            size_m = median_length_and_width_m(states.length_m[known], states.width_m[known])
            time_s = (states.stamp_ns[known] - start_ns) / NS_PER_S
            tracks[vehicle] = RecordedTrack(time_s, states.state[known], *size_m)
    return tracks
