"""Recorded vehicles as the actors of a scenario: their states at some times, and between them."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.signals.vehicle_state import ACCEL, HEADING, JERK, N_STATES, SPEED, YAW_ACCEL, YAW_RATE, X, Y
from cwcli.simulation.attitude import LEVEL_ATTITUDE
from cwcli.simulation.scenario import EGO_VEHICLE_KEY, MAX_VEHICLE_SECONDS, Scenario, ScenarioVehicle

MIN_STATES_OF_RECORDED_ACTOR = 2
"""Least number of states of a recorded actor: two, between which its motion is interpolated."""
MAX_STEP_OF_PRESENT_ACTOR_S = 1.0
"""Longest time between two states, s, in which a recorded actor is on the road. Chosen by hand."""


@dataclass(frozen=True)
class RecordedTrack:
    """A recorded vehicle.

    Attributes:
        time_s: Shape (n,), increasing, seconds of the run.
        state: Shape (n, 8): states as `vehicle_state.STATE_NAMES`, `map` frame.
        length_m, width_m: Outline.
    """

    time_s: FloatArray
    state: FloatArray
    length_m: float
    width_m: float


class RecordedMotion:
    """True states of a recorded vehicle at any time.

    Positions are cubic between the states and have their velocities there; the other states are linear. Before the
    first state and after the last one the vehicle drives straight on at its speed.
    """

    def __init__(self, track: RecordedTrack) -> None:
        """Take the states of a track.

        Raises:
            UsageError: There are fewer than two, their times do not increase, or one is not finite.
        """
        time_s, state = track.time_s, track.state
        if (
            len(time_s) < MIN_STATES_OF_RECORDED_ACTOR
            or not (np.diff(time_s) > 0.0).all()
            or not np.isfinite(state).all()
        ):
            raise UsageError("a recorded vehicle needs two finite states or more whose times increase")
        self._time_s, self._state = time_s, state.copy()
        self._state[:, HEADING] = np.unwrap(state[:, HEADING])

    def is_present_at(self, time_s: FloatArray) -> npt.NDArray[np.bool_]:
        """Tell at which times (n,) the vehicle is on the road: between two states that follow each other closely."""
        k = np.clip(np.searchsorted(self._time_s, time_s, side="right") - 1, 0, len(self._time_s) - 2)
        is_known = (self._time_s[k + 1] - self._time_s[k] <= MAX_STEP_OF_PRESENT_ACTOR_S) | (time_s == self._time_s[k])
        return np.asarray(is_known & (time_s >= self._time_s[0]) & (time_s <= self._time_s[-1]))

    def states_at(self, time_s: FloatArray) -> FloatArray:
        """The states (n, 8) at times (n,), seconds of the run; columns as `vehicle_state.STATE_NAMES`."""
        inside_s = np.clip(time_s, self._time_s[0], self._time_s[-1])
        k = np.clip(np.searchsorted(self._time_s, inside_s, side="right") - 1, 0, len(self._time_s) - 2)
        step_s = self._time_s[k + 1] - self._time_s[k]
        u = ((inside_s - self._time_s[k]) / step_s)[:, None]
        before, after = self._state[k], self._state[k + 1]
        found = before + u * (after - before)
        found[:, [X, Y]] = _cubic_positions(before, after, u, step_s[:, None])
        beyond_s = time_s - inside_s
        found[:, X] += beyond_s * found[:, SPEED] * np.cos(found[:, HEADING])
        found[:, Y] += beyond_s * found[:, SPEED] * np.sin(found[:, HEADING])
        found[np.ix_(beyond_s != 0.0, (ACCEL, YAW_RATE, JERK, YAW_ACCEL))] = 0.0
        return np.asarray(found)


def _cubic_positions(before: FloatArray, after: FloatArray, u: FloatArray, step_s: FloatArray) -> FloatArray:
    """Positions (n, 2) at shares u (n, 1) of steps (n, 1) by Hermite's cubic through both states (n, 8)."""
    first, second = (
        np.column_stack([state[:, SPEED] * np.cos(state[:, HEADING]), state[:, SPEED] * np.sin(state[:, HEADING])])
        for state in (before, after)
    )
    rest = 1.0 - u
    return np.asarray(
        (1.0 + 2.0 * u) * rest**2 * before[:, [X, Y]]
        + u**2 * (3.0 - 2.0 * u) * after[:, [X, Y]]
        + u * rest * step_s * (rest * first - u * second)
    )


def replace_vehicles(scenario: Scenario, tracks: Mapping[str, RecordedTrack], *, name: str) -> Scenario:
    """Replace a scenario's vehicles by recorded ones; the sensors, the link and the seed stay.

    Args:
        scenario: Whose sensors and link the vehicles get.
        tracks: By name: `host` and the others. The run lasts as long as the host's track.

    Raises:
        UsageError: There is no host, a track is none, or there are too many.
    """
    if EGO_VEHICLE_KEY not in tracks:
        raise UsageError("recorded actors need the track of the host")
    vehicles = {}
    for vehicle, track in tracks.items():
        if track.state.shape[1:] != (N_STATES,):
            raise UsageError(f"the states of {vehicle} have {track.state.shape[1:]} columns; permitted: {N_STATES}")
        is_id = len(vehicle) == 8 and all(each in "0123456789abcdef" for each in vehicle)
        station = vehicle if is_id else f"{zlib.crc32(vehicle.encode()):08x}"
        vehicles[vehicle] = ScenarioVehicle(
            vehicle, station, RecordedMotion(track), LEVEL_ATTITUDE, track.length_m, track.width_m,
            has_v2x=vehicle != EGO_VEHICLE_KEY,
        )  # fmt: skip
    ordered = {EGO_VEHICLE_KEY: vehicles[EGO_VEHICLE_KEY], **vehicles}
    end_s = float(tracks[EGO_VEHICLE_KEY].time_s[-1])
    if len(tracks) * end_s > MAX_VEHICLE_SECONDS:
        raise UsageError(
            f"{len(tracks)} recorded vehicles for {end_s:.0f} s are too many: permitted are {MAX_VEHICLE_SECONDS:,} s "
            "of all vehicles together",
            hint="cut the log first (`cwcli cut --start --end`)",
        )
    return replace(
        scenario,
        name=name,
        description=f"The vehicles of {name} as they were recorded",
        duration_s=end_s,
        vehicles=MappingProxyType(ordered),
        document={**scenario.document, "duration_s": end_s, "vehicles": {vehicle: {} for vehicle in ordered}},
    )
