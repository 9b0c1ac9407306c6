"""The part of the road that each image row shows, computed once per frame for all that is painted on it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.simulation.road.camera import RoadCamera
from cwcli.simulation.road.geometry import DISTANCE_AHEAD_OF_ROAD_SURFACE_END_M, RoadAhead
from cwcli.simulation.road.surface import TEXTURE_CELL_WIDTH_M, TEXTURE_HALF_WIDTH_M, Float32Array

SUB_ROWS_PER_ROW = 4
"""Number of sub-rows of each row, for anti-aliasing. Chosen by hand; not fitted."""
LATERAL_OFFSET_OF_TEXTURE_MAPPING_LINES_M = 8.0
"""Offset of the two lines between which columns are mapped linearly to lateral cells, m (texture only, not paint).
Chosen by hand; not fitted."""


@dataclass(frozen=True)
class ImageRows:
    """The n rows that show road, from the top.

    Attributes:
        camera, road: Camera and road of the frame.
        v_px: Shape (n,): row numbers.
        x_m: Shape (n,): distance at the rows' centres.
        edge_x_m: Shape (n, SUB_ROWS_PER_ROW + 1): distance at the edges of the sub-rows, falling from top to bottom.
        sub_x_m: Shape (n, SUB_ROWS_PER_ROW): at the centres of the sub-rows; NaN above the road's end.
        start_m, end_m: Shape (n,): stations of a row's lower and upper edge.
        map_u, map_v: Shape (n, width): place of each pixel in an array (n, cells), for `cv2.remap`.
    """

    camera: RoadCamera
    road: RoadAhead
    v_px: npt.NDArray[np.intp]
    x_m: FloatArray
    edge_x_m: FloatArray
    sub_x_m: FloatArray
    start_m: FloatArray
    end_m: FloatArray
    map_u: Float32Array
    map_v: Float32Array

    def map_cells_to_image(self, strip: Float32Array) -> Float32Array:
        """Map values (n, cells) by row and cell to an image (n, width); mirrored beyond the outermost cells."""
        import cv2

        return np.asarray(cv2.remap(strip, self.map_u, self.map_v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101))


def compute_road_rows(camera: RoadCamera, road: RoadAhead) -> ImageRows:
    """Compute the rows that show road."""
    every = np.arange(camera.height_px, dtype=np.float64)
    x_m = road.distance_of_rows_m(camera, every)
    v = np.flatnonzero(np.isfinite(x_m))
    x_m = x_m[v]
    offsets = np.arange(2 * SUB_ROWS_PER_ROW + 1) / (2 * SUB_ROWS_PER_ROW) - 0.5
    fine = road.distance_of_rows_m(camera, v[:, None] + offsets[None, :])
    edge = np.where(np.isfinite(fine[:, ::2]), fine[:, ::2], DISTANCE_AHEAD_OF_ROAD_SURFACE_END_M)
    end, start = road.line_station_at_distance_m(0.0, edge[:, 0]), road.line_station_at_distance_m(0.0, edge[:, -1])
    left = road.line_column_at_distance_px(camera, LATERAL_OFFSET_OF_TEXTURE_MAPPING_LINES_M, x_m)
    right = road.line_column_at_distance_px(camera, -LATERAL_OFFSET_OF_TEXTURE_MAPPING_LINES_M, x_m)
    with np.errstate(invalid="ignore"):
        per_px = 2 * LATERAL_OFFSET_OF_TEXTURE_MAPPING_LINES_M / np.minimum(left - right, -1e-6)
    columns = np.arange(camera.width_px, dtype=np.float32)
    lateral = (
        (columns[None, :] - right[:, None]) * per_px[:, None] - LATERAL_OFFSET_OF_TEXTURE_MAPPING_LINES_M
    ).astype(np.float32)
    map_u = np.nan_to_num((lateral + TEXTURE_HALF_WIDTH_M) / TEXTURE_CELL_WIDTH_M - 0.5)
    map_v = np.repeat(np.arange(len(v), dtype=np.float32)[:, None], camera.width_px, axis=1)
    return ImageRows(camera, road, v, x_m, edge, fine[:, 1::2], start, end, map_u.astype(np.float32), map_v)
