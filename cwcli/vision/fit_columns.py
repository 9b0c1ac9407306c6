"""The fits of many frames as arrays: a few numbers a frame."""

from __future__ import annotations

from array import array
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, select_table_rows
from cwcli.vision.boundary import Boundary
from cwcli.vision.method import LaneFit

N_SIDES = 2
"""Number of boundaries of a lane."""
_NUMBERS_PER_SIDE = 8 + 9
"""Stored numbers of a boundary: eight of its own, nine of its covariance."""
_STORED_NUMBERS_PER_BOUNDARY_ROAD_CURVE = 4
"""Stored numbers of a boundary's road curve: far, near, bend, spiral."""
_STORED_NUMBERS_OF_BOTH_ROAD_CURVES_PER_FIT = N_SIDES * _STORED_NUMBERS_PER_BOUNDARY_ROAD_CURVE
"""Stored numbers of both road curves."""
_JOINT_COVARIANCE_SIZE = 7
"""Size of the joint covariance: a, b, c of both boundaries, and the pitch."""
_SHARED_NUMBERS_PER_FIT = 5 + _STORED_NUMBERS_OF_BOTH_ROAD_CURVES_PER_FIT + _JOINT_COVARIANCE_SIZE**2
"""Stored numbers of a fit that belong to the whole lane: pitch, yaw, state, steady time and lane change, the curves of
the road, and the joint covariance."""
_NUMBERS_PER_FIT = N_SIDES * _NUMBERS_PER_SIDE + _SHARED_NUMBERS_PER_FIT
"""Stored numbers of a fit."""
_NAN_COVARIANCE_OF_MISSING_SIDE = (float("nan"),) * 9
"""Stored numbers of a boundary's covariance where there is none."""
_NAN_NUMBERS_OF_MISSING_ROAD_CURVE = (float("nan"),) * _STORED_NUMBERS_PER_BOUNDARY_ROAD_CURVE
"""Stored numbers of a road curve where there is none."""
_MISSING_JOINT_COVARIANCE = (float("nan"),) * _JOINT_COVARIANCE_SIZE**2
"""Stored numbers of the joint covariance where there is none."""


@dataclass(frozen=True)
class FitColumns:
    """Fits of n frames; side 0 is left, 1 is right.

    Attributes:
        parabolas: Shape (n, 2, 3): a, b, c; NaN where not found.
        score, probability: Shape (n, 2).
        found: Shape (n, 2).
        kind, colour: Shape (n, 2): values of `LineKind` and `LineColour`.
        covariance: Shape (n, 2, 3, 3): of each boundary's parabola; NaN where the method gives none.
        joint_covariance: Shape (n, 7, 7): `LaneFit.covariance`; NaN where the method gives none, or a boundary is not
            found.
        pitch_rad, yaw_rad: Shape (n,); NaN where the method keeps the mounting's.
        roads: Shape (n, 2, 4): `LaneFit.roads`; NaN where not found, or not known.
        state: Shape (n,): values of `LaneState`.
        steady_s: Shape (n,): time since the lane's last jump; NaN where it is lost, or not known.
        lane_change: Shape (n,): 1 where the camera has come into the next lane to the left, -1 to the right, else 0.
    """

    parabolas: FloatArray
    score: FloatArray
    probability: FloatArray
    found: npt.NDArray[np.bool_]
    covariance: FloatArray
    pitch_rad: FloatArray
    yaw_rad: FloatArray
    state: npt.NDArray[np.int8]
    steady_s: FloatArray
    lane_change: npt.NDArray[np.int8]
    roads: FloatArray
    kind: npt.NDArray[np.int8]
    colour: npt.NDArray[np.int8]
    joint_covariance: FloatArray

    def __len__(self) -> int:
        return len(self.parabolas)

    def __getitem__(self, rows: slice | npt.NDArray[np.intp]) -> FitColumns:
        return select_table_rows(self, rows)


class FitCollector:
    """Collects the fits of frames, 770 bytes each."""

    def __init__(self) -> None:
        self._numbers = array("d")

    def append_fit(self, fit: LaneFit) -> None:
        """Add the fit of the next frame."""
        for side in (fit.left, fit.right):
            self._numbers.extend(_numbers_of_boundary_in_stored_order(side))
        self._numbers.extend((fit.pitch_rad, fit.yaw_rad, fit.state, fit.steady_s, fit.lane_change))
        found = (fit.left.found, fit.right.found)
        roads = [_NAN_NUMBERS_OF_MISSING_ROAD_CURVE] * N_SIDES if fit.roads is None else fit.roads.tolist()
        for road, is_found in zip(roads, found, strict=True):
            self._numbers.extend(road if is_found else _NAN_NUMBERS_OF_MISSING_ROAD_CURVE)
        has_joint = fit.covariance is not None and all(found)
        self._numbers.extend(fit.covariance.ravel().tolist() if has_joint else _MISSING_JOINT_COVARIANCE)  # type: ignore[union-attr]

    def to_columns(self) -> FitColumns:
        """All fits so far as columns."""
        table = np.array(self._numbers, np.float64).reshape(-1, _NUMBERS_PER_FIT)
        whole_lane_columns = table[:, N_SIDES * _NUMBERS_PER_SIDE :]
        sides = table[:, : N_SIDES * _NUMBERS_PER_SIDE].reshape(-1, N_SIDES, _NUMBERS_PER_SIDE)
        return FitColumns(
            parabolas=sides[..., :3],
            score=sides[..., 3],
            probability=sides[..., 4],
            found=sides[..., 5] > 0.0,
            kind=sides[..., 6].astype(np.int8),
            colour=sides[..., 7].astype(np.int8),
            covariance=sides[..., 8:].reshape(-1, N_SIDES, 3, 3),
            pitch_rad=whole_lane_columns[:, 0],
            yaw_rad=whole_lane_columns[:, 1],
            state=whole_lane_columns[:, 2].astype(np.int8),
            steady_s=whole_lane_columns[:, 3],
            lane_change=whole_lane_columns[:, 4].astype(np.int8),
            roads=whole_lane_columns[:, 5 : 5 + _STORED_NUMBERS_OF_BOTH_ROAD_CURVES_PER_FIT].reshape(
                -1, N_SIDES, _STORED_NUMBERS_PER_BOUNDARY_ROAD_CURVE
            ),
            joint_covariance=whole_lane_columns[:, 5 + _STORED_NUMBERS_OF_BOTH_ROAD_CURVES_PER_FIT :].reshape(
                -1, _JOINT_COVARIANCE_SIZE, _JOINT_COVARIANCE_SIZE
            ),
        )


def lowercase_enum_names(kinds: type[IntEnum], values: npt.NDArray[np.int8]) -> list[str]:
    """The names of an enumeration's values, in small letters."""
    names = {int(each): each.name.lower() for each in kinds}
    return [names[value] for value in values.tolist()]


def _numbers_of_boundary_in_stored_order(boundary: Boundary) -> tuple[float, ...]:
    """The numbers of a boundary in the order in which they are stored."""
    nan = float("nan")
    abc = (boundary.a, boundary.b, boundary.c) if boundary.found else (nan, nan, nan)
    covariance = (
        _NAN_COVARIANCE_OF_MISSING_SIDE
        if boundary.covariance is None
        else tuple(boundary.covariance.reshape(-1).tolist())
    )
    return (
        *abc,
        boundary.score,
        boundary.probability,
        1.0 if boundary.found else 0.0,
        boundary.kind,
        boundary.colour,
        *covariance,
    )
