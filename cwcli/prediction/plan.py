"""Plans of predicted paths: what each path is computed from, without its points, which are computed on demand.

A path of 71 points is 4 kB, its inputs are 0.3 kB. Two hours of twenty vehicles at 20 Hz have three million paths.
A path has the same numbers whichever others are computed with it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.prediction.paths import Paths
from cwcli.prediction.rollout import RolloutSettings, roll_out_paths
from cwcli.prediction.scales import scale_path_covariance_in_place
from cwcli.signals.columns import FloatArray
from cwcli.signals.packed_covariances import Covariances

Rows = npt.NDArray[np.intp]


@dataclass(frozen=True)
class PathPlan:
    """The inputs of the paths of n starts.

    Attributes:
        model, settings: As in `roll_out_paths`.
        state, covariance: Shapes (n, 8) and (n, 8, 8) or None.
        acting_s: Shape (n, 2, k) or None, as in `roll_out_paths`.
        log_scale: Shape (n, k, 2), of the ellipses (`calibrate.log_variance_scale_from_outcomes`); None: they are not
            scaled.
    """

    model: str
    settings: RolloutSettings
    state: FloatArray
    covariance: Covariances | None
    acting_s: FloatArray | None = None
    log_scale: FloatArray | None = None

    @property
    def time_s(self) -> FloatArray:
        """The times of each path's points, from its start."""
        return self.settings.time_s

    def __len__(self) -> int:
        return len(self.state)

    def paths_of_rows(self, rows: Rows | slice, *, points: Rows | None = None, has_core: bool = False) -> Paths:
        """Compute the paths of some starts.

        Args:
            points: The points to compute, without any scale of the covariance; None: all points, scaled.
            has_core: The paths get a `core_factor`.
        """
        paths = roll_out_paths(
            self.model,
            self.state[rows],
            None if self.covariance is None else self.covariance[rows],
            self.settings,
            points=points,
            acting_s=None if self.acting_s is None else self.acting_s[rows],
        )
        if self.log_scale is None or points is not None:
            return paths
        return scale_path_covariance_in_place(paths, self.log_scale[rows], has_core)


@dataclass(frozen=True)
class SelectedPaths:
    """A selection of the paths of a plan, in any order."""

    plan: PathPlan
    chosen: Rows

    @property
    def time_s(self) -> FloatArray:
        """The times of each path's points."""
        return self.plan.time_s

    def __len__(self) -> int:
        return len(self.chosen)

    def paths_of_rows(self, rows: Rows) -> Paths:
        """Compute the paths of some of the selected starts."""
        return self.plan.paths_of_rows(self.chosen[rows])
