"""The true lane at the preview point of a simulated drive."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.dynamics.samples import DEFAULT_PREVIEW_POINT_DISTANCE_M
from cwcli.dynamics.vehicle import Vehicle
from cwcli.signals.columns import FloatArray
from cwcli.simulation.lane_camera import _sample_line_from_camera
from cwcli.simulation.lane_drive import LaneDriveTruth, Road


def true_lane_at_preview(
    truth: LaneDriveTruth, run: int, index: npt.NDArray[np.intp], road: Road, vehicle: Vehicle
) -> FloatArray:
    """Exact y_L, e_L and K_L of the lane's centre line, shape (n, 3)."""
    preview_m = DEFAULT_PREVIEW_POINT_DISTANCE_M
    _, y, slope, station = _sample_line_from_camera(truth, run, index, road, vehicle, 0.0, preview_m)
    return np.column_stack([-y, -slope, -road.curvature_at_1pm(station)])
