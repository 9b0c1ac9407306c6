"""Predicted paths as plain arrays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, select_table_rows


@dataclass(frozen=True)
class Paths:
    """Predicted paths of n starts over k points with a common step, in the map frame.

    Attributes:
        time_s: Shape (k,), from the start: 0, step, 2 step, ...
        x_m, y_m, heading_rad, speed_mps: Shape (n, k). Column 0 is the start itself. Headings are continuous
            along a path (not wrapped).
        position_covariance_m2: Shape (n, k, 3): xx, xy, yy. Its 90 % ellipse is that of a normal distribution.
        core_factor: Shape (n, k): f. The right 50 % ellipse is that of P0 + f (P - P0), with P0 the covariance at the
            start, or of f P where f is above 1. None: it is that of P.
    """

    time_s: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    heading_rad: FloatArray
    speed_mps: FloatArray
    position_covariance_m2: FloatArray
    core_factor: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.x_m)

    def select_points(self, point_indices: npt.NDArray[np.intp]) -> Paths:
        """The paths at some of their times."""
        return Paths(
            self.time_s[point_indices],
            self.x_m[:, point_indices],
            self.y_m[:, point_indices],
            self.heading_rad[:, point_indices],
            self.speed_mps[:, point_indices],
            self.position_covariance_m2[:, point_indices],
            None if self.core_factor is None else self.core_factor[:, point_indices],
        )

    def paths_of_rows(self, rows: npt.NDArray[np.intp]) -> Paths:
        """The paths of some starts."""
        return select_table_rows(self, rows, shared=("time_s",))


def stack_paths(sets: Sequence[Paths]) -> Paths:
    """Stack sets of paths over the same times, one below the other; a `core_factor` is left out."""
    if len(sets) == 1:
        return sets[0]
    return Paths(
        sets[0].time_s,
        np.concatenate([paths.x_m for paths in sets]),
        np.concatenate([paths.y_m for paths in sets]),
        np.concatenate([paths.heading_rad for paths in sets]),
        np.concatenate([paths.speed_mps for paths in sets]),
        np.concatenate([paths.position_covariance_m2 for paths in sets]),
    )
