"""The grey of the road's surface and the light on it, by image row and lateral cell."""

from __future__ import annotations

import numpy as np

from cwcli.signals.columns import FloatArray
from cwcli.simulation.road import surface
from cwcli.simulation.road.rows import ImageRows
from cwcli.simulation.road.scene import Patch, RoadScene, Shadow
from cwcli.simulation.road.surface import (
    TEXTURE_CELL_OFFSETS_M,
    TEXTURE_CELL_WIDTH_M,
    TEXTURE_HALF_WIDTH_M,
    Float32Array,
)

VERGE_GREY = 78.0
"""Mean grey of the verge beside the pavement, 0 to 255. Chosen by hand; not fitted."""
WHEEL_TRACK_OFFSET_M = 0.75
"""Distance of the wheel tracks from the middle of a lane, m. Chosen by hand; not fitted."""
PATCH_SEAM_WIDTH_M = 0.05
"""Width of the tar seam around a patch, m. Chosen by hand; not fitted."""
MAX_PATCH_AND_SHADOW_DISTANCE_M = 150.0
"""Distance ahead beyond which patches and shadows are not drawn, m. Chosen by hand; not fitted."""
PENUMBRA_WIDTH_M = 0.06
"""Width over which the side of a shadow band fades, m. Chosen by hand; not fitted."""


def surface_grey_by_row_and_cell(rows: ImageRows, scene: RoadScene) -> Float32Array:
    """Grey of the surface without shadows and markings, by row and cell; shape (n, cells)."""
    rng = np.random.default_rng(scene.seed)
    shift, along = int(rng.integers(0, 60)) - 30, float(rng.uniform(0, 100))
    start, end = rows.start_m + along, rows.end_m + along
    road = surface.asphalt_texture().mean_over_stretches(start, end, shift) * scene.texture
    if scene.cracks > 0:
        road += surface.crack_texture().mean_over_stretches(start, end, shift) * scene.cracks
    road += (1.0 - scene.tracks * _wheel_track_darkening(scene.lane_width_m))[None, :]
    for patch in scene.patches:
        if _is_within_drawn_distance(rows, patch.station_m, patch.length_m + PATCH_SEAM_WIDTH_M):
            _draw_patch_on_road(road, rows, patch)
    road *= scene.asphalt
    right_edge_m: float | FloatArray = scene.right_edge_m
    if scene.right_edge_path_m:
        right_edge_m = np.interp(0.5 * (rows.start_m + rows.end_m), *np.transpose(scene.right_edge_path_m))[:, None]
    paved = np.atleast_2d(_cell_share_between_offsets(right_edge_m, scene.left_edge_m, 0.1))
    grass = VERGE_GREY * (1.0 + surface.verge_texture().mean_over_stretches(start, end))
    ground: Float32Array = grass + paved * (road - grass)
    return ground


def light_factor_by_row_and_cell(rows: ImageRows, scene: RoadScene) -> Float32Array | None:
    """Factor of shadows and headlights on the grey, by row and cell, shape (n, cells); None if it is 1 everywhere."""
    light = scene.light
    light_factor: Float32Array | None = None
    if light.dapple > 0 or light.shadows:
        dark = np.zeros((len(rows.v_px), len(TEXTURE_CELL_OFFSETS_M)), np.float32)
        if light.dapple > 0:
            leaves = surface.leaf_shadow_texture().mean_over_stretches(rows.start_m, rows.end_m, scene.seed % 97) + 0.5
            dark = np.maximum(dark, np.clip(leaves, 0.0, 1.0) * min(1.0, light.dapple * 1.4))
        for shadow in light.shadows:
            if not _is_within_drawn_distance(
                rows, shadow.station_m, shadow.length_m + abs(shadow.slant) * TEXTURE_HALF_WIDTH_M
            ):
                continue
            dark = np.maximum(dark, _shadow_share_by_row_and_cell(rows, shadow))
        light_factor = 1.0 - (1.0 - light.shadow_depth) * dark
    if light.night:
        lit = headlight_factor_by_row_and_cell(rows)
        light_factor = lit if light_factor is None else light_factor * lit
    return light_factor


def headlight_factor_by_row_and_cell(rows: ImageRows) -> Float32Array:
    """Factor of the own low beams on the grey, by row and cell, with a little light from sky and street."""
    x = rows.x_m[:, None]
    y = rows.road.line_y_at_distance_m(0.0, rows.x_m)[:, None] + TEXTURE_CELL_OFFSETS_M[None, :]
    spread = 1.3 + 0.16 * x
    beam = np.exp(-0.5 * ((y + 0.2) / spread) ** 2) * (1.0 - np.exp(-((x / 5.0) ** 2))) / (1.0 + (x / 26.0) ** 2)
    return np.asarray(0.13 + 0.95 * np.nan_to_num(beam), np.float32)


def _is_within_drawn_distance(rows: ImageRows, station_m: float, reach_m: float) -> bool:
    """Whether an object at a station is near enough ahead to be drawn."""
    camera_station_m = rows.road.station_m
    return camera_station_m - reach_m - 5.0 < station_m < camera_station_m + reach_m + MAX_PATCH_AND_SHADOW_DISTANCE_M


def _wheel_track_darkening(lane_width_m: float) -> Float32Array:
    """Darkening of the cells by the wheel tracks of all lanes, shape (cells,), up to 0.12."""
    in_lane = np.mod(TEXTURE_CELL_OFFSETS_M + lane_width_m / 2, lane_width_m) - lane_width_m / 2
    return np.asarray(0.12 * np.exp(-0.5 * ((np.abs(in_lane) - WHEEL_TRACK_OFFSET_M) / 0.25) ** 2), np.float32)


def _cell_share_between_offsets(low_m: float | FloatArray, high_m: float, soft_m: float) -> Float32Array:
    """Share of each cell between two offsets: 1 inside, falling to 0 over soft_m (at least a cell) on both sides.

    `low_m` is a number, or of shape (n, 1) for n rows.
    """
    soft = max(soft_m, TEXTURE_CELL_WIDTH_M)
    rise = np.clip((TEXTURE_CELL_OFFSETS_M - low_m) / soft + 0.5, 0.0, 1.0)
    return np.asarray(np.minimum(rise, np.clip((high_m - TEXTURE_CELL_OFFSETS_M) / soft + 0.5, 0.0, 1.0)), np.float32)


def _row_share_between_stations(
    rows: ImageRows, start_m: FloatArray | Float32Array | float, end_m: FloatArray | Float32Array | float
) -> FloatArray:
    """Share of each row's stretch of road that lies between two stations, (n, 1) or (n, cells)."""
    low, high = rows.start_m[:, None], rows.end_m[:, None]
    return np.clip((np.minimum(high, end_m) - np.maximum(low, start_m)) / np.maximum(high - low, 1e-3), 0.0, 1.0)


def _draw_patch_on_road(road: Float32Array, rows: ImageRows, patch: Patch) -> None:
    """Draw a patch with its seam into the grey of the surface (n, cells), in place."""
    low, high = patch.offset_m - patch.width_m / 2, patch.offset_m + patch.width_m / 2
    if patch.seam:
        outer = _row_share_between_stations(
            rows, patch.station_m - PATCH_SEAM_WIDTH_M, patch.station_m + patch.length_m + PATCH_SEAM_WIDTH_M
        )
        road *= 1.0 - 0.45 * (
            outer * _cell_share_between_offsets(low - PATCH_SEAM_WIDTH_M, high + PATCH_SEAM_WIDTH_M, 0.0)
        ).astype(np.float32)
    inner = _row_share_between_stations(
        rows, patch.station_m, patch.station_m + patch.length_m
    ) * _cell_share_between_offsets(low, high, 0.0)
    grain = 1.0 + 0.5 * (road - road.mean(axis=1, keepdims=True))
    road += inner.astype(np.float32) * (patch.grey_ratio * grain - road)


def _shadow_share_by_row_and_cell(rows: ImageRows, shadow: Shadow) -> Float32Array:
    """Share of each row and cell that lies in a shadow band, shape (n, cells)."""
    start = shadow.station_m + shadow.slant * TEXTURE_CELL_OFFSETS_M[None, :]
    inside = _row_share_between_stations(rows, start, start + shadow.length_m)
    return np.asarray(inside * _cell_share_between_offsets(shadow.right_m, shadow.left_m, PENUMBRA_WIDTH_M), np.float32)
