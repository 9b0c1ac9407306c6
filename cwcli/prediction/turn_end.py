"""Where a turn ends: paths of the onset hypothesis that have turned by a right angle go straight on.

A car that turns at a junction leaves the turn when it has reached the other street, and streets mostly cross at about a
right angle. A hypothesis that lets a turn go on sweeps across the lanes beyond, so what the car has already turned
counts: its change of heading over the way that it has just driven, which a stop on that way does not alter.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass, replace
from cwcli.prediction.paths import Paths
from cwcli.prediction.plan import SelectedPaths
from cwcli.signals.angles import wrap_angle
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import HEADING, SPEED

ASSUMED_TOTAL_TURN_RAD = 0.5 * np.pi
"""Angle, rad, after which a turn is taken to end: the one at which streets mostly cross. Chosen by hand; not fitted."""
WAY_DRIVEN_IN_TURN_M = 30.0
"""Way driven in a turn, m: a quarter of a circle of 19 m, wide for a street in a town. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class TurnEndingPaths:
    """Selected paths whose turns end.

    Attributes:
        selected: The paths without that end.
        turned_rad: Shape (n,): by how much each start has turned already, see `left_turn_on_last_stretch_rad`.
    """

    selected: SelectedPaths
    turned_rad: FloatArray

    @property
    def time_s(self) -> FloatArray:
        """The times of each path's points."""
        return self.selected.time_s

    def __len__(self) -> int:
        return len(self.selected)

    def paths_of_rows(self, rows: npt.NDArray[np.intp]) -> Paths:
        """Compute the paths of some of the selected starts."""
        return end_turns_of_paths_at_quarter_turn(self.selected.paths_of_rows(rows), self.turned_rad[rows])


def left_turn_on_last_stretch_rad(stamp_ns: Int64Array, log_time_ns: Int64Array, state: FloatArray) -> FloatArray:
    """Compute by how much a car has turned to the left on its last `WAY_DRIVEN_IN_TURN_M`, (n,), from what was known
    then.

    Args:
        stamp_ns, log_time_ns: Shape (n,): times of a car's states, stamps increasing, and when each was known.
    """
    if not len(stamp_ns):
        return np.zeros(0)
    later_known_ns = np.append(np.minimum.accumulate(log_time_ns[::-1])[::-1][1:], np.iinfo(np.int64).max)
    current_rows = np.flatnonzero(log_time_ns <= later_known_ns)  # the others were overtaken by a newer state
    step_s = np.diff(stamp_ns[current_rows]) / NS_PER_S
    speed_mps, heading_rad = np.abs(state[current_rows, SPEED]), state[current_rows, HEADING]
    way_m = np.cumsum(np.append(0.0, np.nan_to_num(speed_mps[1:]) * step_s))
    course_rad = np.cumsum(np.append(0.0, np.nan_to_num(wrap_angle(np.diff(heading_rad)))))
    turned_rad = course_rad - np.interp(way_m - WAY_DRIVEN_IN_TURN_M, way_m, course_rad)
    newest = np.searchsorted(current_rows, np.arange(len(stamp_ns)), side="right") - 1
    return np.asarray(np.where(newest >= 0, turned_rad[np.maximum(newest, 0)], 0.0))


def end_turns_of_paths_at_quarter_turn(paths: Paths, turned_rad: FloatArray) -> Paths:
    """End the turn of each path where it comes to `ASSUMED_TOTAL_TURN_RAD` with what was turned before, (n,).

    Speeds and covariances stay as they are.
    """
    start = paths.heading_rad[:, :1]
    left = np.clip(ASSUMED_TOTAL_TURN_RAD - turned_rad, 0.0, ASSUMED_TOTAL_TURN_RAD)[:, None]
    right = np.clip(ASSUMED_TOTAL_TURN_RAD + turned_rad, 0.0, ASSUMED_TOTAL_TURN_RAD)[:, None]
    turn = paths.heading_rad - start
    if not ((turn > left) | (turn < -right)).any():
        return paths
    heading = start + np.clip(turn, -right, left)
    x, y = paths.x_m.copy(), paths.y_m.copy()
    for way, function in ((x, np.cos), (y, np.sin)):
        change_mps = paths.speed_mps * (function(heading) - function(paths.heading_rad))
        way[:, 1:] += np.cumsum(0.5 * (change_mps[:, 1:] + change_mps[:, :-1]) * np.diff(paths.time_s), axis=1)
    return replace(paths, x_m=x, y_m=y, heading_rad=heading)
