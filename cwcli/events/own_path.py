"""Where others are relative to the way that the ego really drove: how far along it, and how far to its left.

The driven way stands for the ego's lane, also in bends, and needs no map.
"""

from __future__ import annotations

import numpy as np

from cwcli.errors import DataError
from cwcli.events.evidence import EventEvidence
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, Int64Array, sort_distinct_values
from cwcli.signals.units import NS_PER_S

PROJECTION_TIME_STEP_S = 0.1
"""Step of the times at which others are projected, s. Chosen by hand: a third of the accuracy of an event's start."""
DRIVEN_WAY_POINT_SPACING_M = 1.0
"""Distance of the points of the driven way, m. Chosen by hand: the way between them is straight."""
PROJECTED_DISTANCE_BEHIND_M, PROJECTED_DISTANCE_AHEAD_M = 40.0, 100.0
"""How far behind and ahead of the ego others are projected on its way, m. Chosen by hand."""
MAX_RANGE_OF_PROJECTED_OTHERS_M = 120.0
"""Others farther away than this are not projected, m. Chosen by hand."""
MAX_PROJECTION_BEYOND_DRIVEN_PATH_ENDS_M = 2.0
"""How far beyond both ends of the driven way others are projected, m. Chosen by hand: nobody knows where it goes on."""
HALF_LANE_WIDTH_M = 1.75
"""Half the width of a lane that is assumed, m: lanes are 3.0 m to 3.75 m wide (RAA 2008, AASHTO)."""
MAX_HEADING_DIFFERENCE_OF_SAME_DIRECTION_RAD = 0.5
"""Two headings that differ by less are the same direction, rad. Chosen by hand."""
ROWS_PROJECTED_AT_ONCE = 128
"""Number of rows that are projected at a time. Chosen by hand: their distances fit into the processor's cache."""
MAX_PLAUSIBLE_DRIVEN_DISTANCE_M = 1e7
"""Length of the driven way beyond which the states of a log are not believed, m. Chosen by hand: 100 h at 100 km/h."""


@dataclass(frozen=True)
class OnOwnPath:
    """Another vehicle relative to the ego's driven way, (m,) each, at a grid of times.

    Attributes:
        ahead_m: Distance along the way from the ego's centre to the other's; NaN where it is not near, or beyond the
            way that the log knows.
        left_m: Distance of the other's centre to the left of the way.
        turn_rad: Heading of the other relative to the way there, from -pi to pi.
        passed_ns: When the ego was, or will be, at that place of its way.
        speed_mps, ego_speed_mps: Speeds of the other and of the ego.
        half_length_m, half_width_m: Half the sum of both lengths, and half the other's width.
    """

    stamp_ns: Int64Array
    ahead_m: FloatArray
    left_m: FloatArray
    turn_rad: FloatArray
    passed_ns: Int64Array
    speed_mps: FloatArray
    ego_speed_mps: FloatArray
    half_length_m: float
    half_width_m: float

    @property
    def is_same_direction(self) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
        """Where the other drives in the direction of the way."""
        return np.asarray(np.abs(self.turn_rad) < MAX_HEADING_DIFFERENCE_OF_SAME_DIRECTION_RAD)


def project_on_own_path(evidence: EventEvidence, other_id: str) -> OnOwnPath:
    """Project another vehicle on the ego's driven way, at times `PROJECTION_TIME_STEP_S` apart."""
    if other_id not in evidence.on_own_path:
        evidence.on_own_path[other_id] = _compute_projection(evidence, other_id)
    return evidence.on_own_path[other_id]


def _compute_projection(evidence: EventEvidence, other_id: str) -> OnOwnPath:
    pair = evidence.pair_with_ego(other_id)
    rows = rows_one_grid_step_apart(evidence)
    stamp_ns = evidence.stamp_ns[rows]
    own, theirs = evidence.ego_state[rows], pair.other_states[rows]
    if evidence.driven_way is None:
        evidence.driven_way = DrivenWay(evidence.stamp_ns, evidence.ego_state)
    way = evidence.driven_way
    out = np.full((3, len(rows)), np.nan)
    passed_ns = np.zeros(len(rows), np.int64)
    near = np.flatnonzero(pair.distance_m[rows] < MAX_RANGE_OF_PROJECTED_OTHERS_M)
    if len(near) and len(way.along_m) > 1:
        out[:, near], passed_ns[near] = way.project_and_find_passing_ns(
            theirs[near], way.driven_distance_at_m(stamp_ns[near])
        )
    ahead_m, left_m, turn_rad = out
    return OnOwnPath(
        stamp_ns,
        ahead_m,
        left_m,
        turn_rad,
        passed_ns,
        speed_mps=theirs[:, 2],
        ego_speed_mps=own[:, 2],
        half_length_m=0.5 * (pair.host_size[0] + pair.other_size[0]),
        half_width_m=0.5 * pair.other_size[1],
    )


def rows_one_grid_step_apart(evidence: EventEvidence) -> np.ndarray[tuple[int, ...], np.dtype[np.intp]]:
    """Return rows of the ego's states that are about `PROJECTION_TIME_STEP_S` apart."""
    if evidence.grid_rows is None:
        stamp_ns = evidence.stamp_ns
        steps = np.arange(stamp_ns[0], stamp_ns[-1] + 1, round(PROJECTION_TIME_STEP_S * NS_PER_S))
        rows = np.minimum(np.searchsorted(stamp_ns, steps), len(stamp_ns) - 1)
        evidence.grid_rows = sort_distinct_values(rows)
    return evidence.grid_rows


class DrivenWay:
    """The ego's way as points `DRIVEN_WAY_POINT_SPACING_M` apart.

    Args:
        stamp_ns, state: The ego's states, (n,) and (n, 8).

    Attributes:
        along_m: Length of the way up to each point, (p,).
    """

    def __init__(self, stamp_ns: Int64Array, state: FloatArray) -> None:
        steps_m = np.hypot(*np.diff(state[:, :2], axis=0).T)
        driven_m = np.concatenate([[0.0], np.cumsum(steps_m)])
        if not driven_m[-1] < MAX_PLAUSIBLE_DRIVEN_DISTANCE_M:
            raise DataError(f"the ego's states lead over {driven_m[-1] / 1000:,.0f} km, or are no numbers")
        moving = np.concatenate([[True], np.diff(driven_m) > 1e-6])
        self._driven_m, self._stamp_ns = driven_m, stamp_ns
        self.along_m = np.arange(0.0, driven_m[-1] + DRIVEN_WAY_POINT_SPACING_M, DRIVEN_WAY_POINT_SPACING_M)
        self._x_m, self._y_m = (np.interp(self.along_m, driven_m[moving], state[moving, k]) for k in (0, 1))
        self._time_ns = np.interp(self.along_m, driven_m[moving], (stamp_ns[moving] - stamp_ns[0]).astype(float))
        self._heading_rad = np.arctan2(np.gradient(self._y_m), np.gradient(self._x_m)) if len(self.along_m) > 1 else 0.0

    def driven_distance_at_m(self, at_ns: Int64Array) -> FloatArray:
        """Return how far the ego had driven at some times, m."""
        return np.asarray(np.interp(at_ns, self._stamp_ns, self._driven_m))

    def project_and_find_passing_ns(self, theirs: FloatArray, ego_along_m: FloatArray) -> tuple[FloatArray, Int64Array]:
        """Project states (m, 4) on the way near the ego: (ahead, left, turn), (3, m), and when the ego is there."""
        n_behind, n_ahead = (
            round(reach_m / DRIVEN_WAY_POINT_SPACING_M)
            for reach_m in (PROJECTED_DISTANCE_BEHIND_M, PROJECTED_DISTANCE_AHEAD_M)
        )
        at = np.clip(np.round(ego_along_m / DRIVEN_WAY_POINT_SPACING_M).astype(int), 0, len(self.along_m) - 1)
        x_m, y_m = (
            np.lib.stride_tricks.sliding_window_view(
                np.pad(each, (n_behind, n_ahead), mode="edge"), n_behind + 1 + n_ahead
            )
            for each in (self._x_m, self._y_m)
        )
        nearest = np.empty(len(at), np.intp)
        for first in range(0, len(at), ROWS_PROJECTED_AT_ONCE):
            some = slice(first, first + ROWS_PROJECTED_AT_ONCE)
            apart_m2 = (x_m[at[some]] - theirs[some, :1]) ** 2 + (y_m[at[some]] - theirs[some, 1:2]) ** 2
            nearest[some] = apart_m2.argmin(axis=1)
        best = np.clip(at - n_behind + nearest, 0, len(self.along_m) - 1)
        dx_m, dy_m = theirs[:, 0] - self._x_m[best], theirs[:, 1] - self._y_m[best]
        heading_rad = np.asarray(self._heading_rad)[best]
        cosine, sine = np.cos(heading_rad), np.sin(heading_rad)
        beyond_m = dx_m * cosine + dy_m * sine
        is_known = ((best > 0) & (best < len(self.along_m) - 1)) | (
            np.abs(beyond_m) <= MAX_PROJECTION_BEYOND_DRIVEN_PATH_ENDS_M
        )
        ahead_m = np.where(is_known, self.along_m[best] + beyond_m - ego_along_m, np.nan)
        left_m = np.where(is_known, dy_m * cosine - dx_m * sine, np.nan)
        turn_rad = np.angle(np.exp(1j * (theirs[:, 3] - heading_rad)))
        passed_ns = self._stamp_ns[0] + self._time_ns[best].astype(np.int64)
        return np.stack([ahead_m, left_m, turn_rad]), passed_ns
