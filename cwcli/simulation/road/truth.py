"""The exact truth of a rendered frame."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import BoolArray, FloatArray
from cwcli.simulation.road.camera import RoadCamera
from cwcli.simulation.road.geometry import ARC_LENGTH_GRID_M, RoadAhead

MAX_VISIBLE_BOUNDARY_DISTANCE_M = 60.0
"""Distance beyond which a boundary counts as not visible, m: a marking of 0.15 m is 2 pixels wide there at 320 x
240."""


@dataclass(frozen=True)
class LaneTruth:
    """The truth of one frame. Arrays over rows have one value for every image row, from the top.

    A boundary is the centre line of its marking; of a double marking it is the stripe next to the lane. Where paint is
    missing (the gaps of a dashed line, worn places) the boundary goes on.

    Attributes:
        camera: The camera with the pitch of this moment.
        road: The road ahead; see `boundary_y_m`.
        x_m: Shape (height,): distance ahead that each row's centre shows, NaN above the road's end.
        left_u_px, right_u_px: Shape (height,): column of the boundary, NaN where there is no road; may lie outside the
            image.
        left_visible, right_visible: Shape (height,): inside the image, nearer than `MAX_VISIBLE_BOUNDARY_DISTANCE_M`,
            not hidden by a crest or a vehicle.
        left_half_width_px, right_half_width_px: Shape (height,): half the painted width.
        lane_width_m: Distance of the two boundaries.
        condition: Name of the weather, e.g. `rain`.
        lane_m: Offset of the lane's centre line from that of `road`.
    """

    camera: RoadCamera
    road: RoadAhead
    x_m: FloatArray
    left_u_px: FloatArray
    right_u_px: FloatArray
    left_visible: BoolArray
    right_visible: BoolArray
    left_half_width_px: FloatArray
    right_half_width_px: FloatArray
    lane_width_m: float
    condition: str
    lane_m: float = 0.0

    @property
    def lateral_offset_m(self) -> float:
        """The offset of the camera from the lane's centre beside it, m, left positive."""
        return self.road.offset_m - self.lane_m

    @property
    def heading_rad(self) -> float:
        """The heading of the body from the lane's direction beside the camera, rad, counter-clockwise positive."""
        return self.road.heading_rad

    @property
    def curvature_1pm(self) -> float:
        """The curvature of the lane beside the camera, 1/m, left positive."""
        return float(np.interp(0.0, ARC_LENGTH_GRID_M, self.road.curvature_1pm))

    def boundary_y_m(self, side: str, x_m: FloatArray) -> FloatArray:
        """Lateral place of a boundary (`left`, `right`) in the body frame at distances ahead, m, left positive."""
        half = self.lane_width_m / 2
        return self.road.line_y_at_distance_m(self.lane_m + (half if side == "left" else -half), x_m)

    def lane_centre_at_preview(self, preview_m: float) -> tuple[float, float, float]:
        """y (m), direction (rad) and curvature (1/m) of the lane's centre preview_m ahead on the body's x axis."""
        y_m, direction_rad, curvature_1pm = self.lane_centre_y_direction_curvature(np.array([preview_m]))[:, 0].tolist()
        return y_m, direction_rad, curvature_1pm

    def lane_centre_y_direction_curvature(self, x_m: FloatArray) -> FloatArray:
        """y, direction and curvature of the lane's centre at distances ahead (n,), shape (3, n).

        y (m) and curvature (1/m) are left positive, the direction in the body frame (rad) is counter-clockwise
        positive. NaN where the lane has turned away before (75 deg).
        """
        n = self.road.n_grid_points_ahead
        x, y = self.road.line_at_offset_m(self.lane_m)
        s = np.interp(x_m, x[:n], ARC_LENGTH_GRID_M[:n], left=np.nan, right=np.nan)
        curvature_1pm = self.road.curvature_1pm / (1.0 - self.lane_m * self.road.curvature_1pm)
        return np.array([np.interp(s, ARC_LENGTH_GRID_M, each) for each in (y, self.road.direction_rad, curvature_1pm)])

    def tusimple_lane_columns(self, h_samples: npt.NDArray[np.int64]) -> list[list[int]]:
        """Both boundaries in TuSimple's form: whole columns at the given rows, -2 where it is not visible."""
        lanes = []
        for u, visible in ((self.left_u_px, self.left_visible), (self.right_u_px, self.right_visible)):
            inside = h_samples[(h_samples >= 0) & (h_samples < len(u))]
            at = np.where(visible[inside], np.round(np.where(visible[inside], u[inside], 0.0)), -2).astype(int)
            lanes.append(np.pad(at, (0, len(h_samples) - len(inside)), constant_values=-2).tolist())
        return lanes

    def fit_boundary_parabola_px(self, side: str) -> tuple[float, float, float]:
        """Fit a, b, c of x = a y^2 + b y + c to a boundary by least squares (zhang2011, eq. 1).

        The fit uses the visible rows of the lower five eighths of the image. Pixels numbered from 1 at the bottom left,
        y up. NaN with fewer than three visible rows.
        """
        u, visible = (self.left_u_px, self.left_visible) if side == "left" else (self.right_u_px, self.right_visible)
        rows = np.flatnonzero(visible)
        rows = rows[rows >= self.camera.height_px * 3 // 8]
        if len(rows) < 3:
            return np.nan, np.nan, np.nan
        a, b, c = np.polyfit(self.camera.height_px - rows, u[rows] + 1.0, 2)
        return float(a), float(b), float(c)


def compute_lane_truth(
    camera: RoadCamera,
    road: RoadAhead,
    lane_width_m: float,
    marking_width_m: tuple[float, float],
    condition: str,
    occluded: BoolArray | None = None,
    *,
    lane_m: float = 0.0,
) -> LaneTruth:
    """Compute the truth of a frame.

    Args:
        marking_width_m: Width of the left and of the right boundary's stripe.
        occluded: Shape (height, width): pixels where a vehicle hides the road.
        lane_m: Offset of the lane's centre line.
    """
    rows = np.arange(camera.height_px, dtype=np.float64)
    x_m = road.distance_of_rows_m(camera, rows)
    columns, visibles, halves = [], [], []
    for sign, width_m in zip((1.0, -1.0), marking_width_m, strict=True):
        u = road.line_column_at_distance_px(camera, lane_m + sign * lane_width_m / 2, x_m)
        with np.errstate(invalid="ignore"):
            visible = (u >= 0) & (u <= camera.width_px - 1) & (x_m <= MAX_VISIBLE_BOUNDARY_DISTANCE_M)
        if occluded is not None:
            at = np.flatnonzero(visible)
            visible[at] &= ~occluded[at, np.round(u[at]).astype(np.intp)]
        columns.append(u)
        visibles.append(visible)
        halves.append(
            camera.fx
            * width_m
            / 2
            / camera.depth_along_optical_axis_m(x_m, camera.height_m - road.surface_height_at_distance_m(x_m))
        )
    return LaneTruth(
        camera=camera,
        road=road,
        x_m=x_m,
        left_u_px=columns[0],
        right_u_px=columns[1],
        left_visible=visibles[0],
        right_visible=visibles[1],
        left_half_width_px=halves[0],
        right_half_width_px=halves[1],
        lane_width_m=lane_width_m,
        condition=condition,
        lane_m=lane_m,
    )
