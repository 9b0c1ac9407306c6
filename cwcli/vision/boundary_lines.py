"""The lines along which the boundaries of a frame are drawn and judged, and where they end."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, select_table_rows
from cwcli.signals.lane_geometry import image_columns_of_arcs

MIN_DISTANCE_BETWEEN_BOTH_BOUNDARIES_SEARCH_PX = 4.0
"""Distance between both boundaries, in search pixels, below which they end. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class BoundaryLines:
    """Both boundaries of n frames in the pixels of the search image; side 0 is left.

    Attributes:
        parabolas: Shape (n, 2, 3): a, b, c of x = a y^2 + b y + c, y up from the bottom; NaN where not found.
        roads: Shape (n, 2, 4): far, near, bend, spiral of curves on the ground, h rows below the horizon
            (`ground.image_hyperbolas_of_flat_road`, `lane_geometry.image_columns_of_arcs`); NaN where they are not
            known: then the parabolas are the lines.
        horizon_px: Shape (n,): row of the horizon from the top; NaN where it is not known.
        top_px: Shape (n,): row from the top at which lines end (`ground.boundary_top_rows_px`).
        pinhole: Shape (n, 2): column of the principal point, counted from 1, and fx, both in pixels; NaN where they
            are not known: then roads are the polynomials. None: nowhere known.
    """

    parabolas: FloatArray
    roads: FloatArray
    horizon_px: FloatArray
    top_px: FloatArray
    pinhole: FloatArray | None = None

    def __getitem__(self, rows: slice | npt.NDArray[np.intp]) -> BoundaryLines:
        return select_table_rows(self, rows)

    def columns_at_heights_px(self, y_px: FloatArray, height_px: float) -> FloatArray:
        """Columns x of both boundaries at heights above the image's bottom; NaN where a boundary is not found or has
        ended.

        It ends above `top_px`, where both boundaries meet, and where it turns back.

        Args:
            y_px: Heights, shape (n, k).
            height_px: Height of the search image.

        Returns:
            Shape (n, 2, k).
        """
        a, b, c = np.moveaxis(self.parabolas[..., None], 2, 0)
        y = y_px[:, None]
        parabola_px = (a * y + b) * y + c
        h = height_px - y - self.horizon_px[:, None, None]
        pinhole = np.full((len(self.roads), 2), np.nan) if self.pinhole is None else self.pinhole
        centre, focal = pinhole.T[:, :, None, None]
        road_px = image_columns_of_arcs(self.roads[:, :, None], h, centre, focal)
        x_px = np.where(np.isfinite(self.roads).all(axis=2, keepdims=True), road_px, parabola_px)
        with np.errstate(invalid="ignore"):
            meet = x_px[:, 1] - x_px[:, 0] <= MIN_DISTANCE_BETWEEN_BOTH_BOUNDARIES_SEARCH_PX
        met_px = np.where(meet, y_px, np.inf).min(axis=1, initial=np.inf)
        ended = (height_px - y_px < self.top_px[:, None]) | (y_px >= met_px[:, None])
        return np.where(ended[:, None], np.nan, x_px)
