"""Markings, with the exact share of every pixel that they cover.

In each sub-row a stripe covers the columns between its two edges; a pixel's share is the overlap, averaged over the
sub-rows. Along the road a sub-row covers a stretch, and the painted share of the stretch follows from the dashes.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.columns import FloatArray
from cwcli.simulation.road.geometry import ARC_LENGTH_GRID_M, DISTANCE_AHEAD_OF_ROAD_SURFACE_END_M
from cwcli.simulation.road.rows import ImageRows
from cwcli.simulation.road.scene import Marking
from cwcli.simulation.road.surface import (
    N_WEAR_TEXTURE_CELLS_ACROSS_MARKING,
    REMAINING_PAINT_LEVELS,
    WEAR_CELL_WIDTH_M,
    Float32Array,
    remaining_paint_texture_and_mean,
)

MIN_PAINT_SHARE_WITHOUT_WEAR = 0.97
"""Share of paint that is left from which a marking is drawn without wear. Chosen by hand; not fitted."""


def paint_marking(image: Float32Array, rows: ImageRows, marking: Marking, *, gain: float) -> None:
    """Blend a marking into the image of the rows, in place.

    Args:
        image: Shape (n, width): grey before the light.
        gain: Factor on the paint's grey (wet or retro-reflecting paint).
    """
    sign = 1.0 if marking.offset_m >= 0 else -1.0
    _paint_stripe(image, rows, marking, marking.offset_m, marking.dash_m, gain)
    if marking.is_double:
        _paint_stripe(image, rows, marking, marking.offset_m + sign * 2 * marking.width_m, (0.0, 0.0), gain)


def _paint_stripe(
    image: Float32Array, rows: ImageRows, marking: Marking, offset_m: float, dash_m: tuple[float, float], gain: float
) -> None:
    """Blend one stripe of a marking into the image of the rows, in place."""
    camera, road, half = rows.camera, rows.road, marking.width_m / 2
    start_m, end_m = road.station_m + ARC_LENGTH_GRID_M[0], road.station_m + DISTANCE_AHEAD_OF_ROAD_SURFACE_END_M
    where_m = [each for each in marking.painted_stretches_m if each[1] > start_m and each[0] < end_m]
    if marking.painted_stretches_m and not where_m:
        return
    at_m: float | FloatArray = offset_m
    if marking.path_m:
        station_m, path_m = np.transpose(marking.path_m)
        at_m = np.interp(road.station_m + ARC_LENGTH_GRID_M, station_m, path_m) + (offset_m - marking.offset_m)
    left = road.line_column_at_distance_px(camera, at_m + half, rows.sub_x_m)
    right = road.line_column_at_distance_px(camera, at_m - half, rows.sub_x_m)
    with np.errstate(invalid="ignore"):
        is_in_view = np.isfinite(left) & np.isfinite(right) & (right > -1) & (left < camera.width_px + 1)
    at = np.flatnonzero(is_in_view.any(axis=1))
    if not len(at):
        return
    is_in_view, left, right = is_in_view[at], np.where(is_in_view, left, 0.0)[at], np.where(is_in_view, right, 0.0)[at]
    first = np.floor(np.where(is_in_view, left, np.inf).min(axis=1) + 0.5).astype(np.intp)
    last = np.floor(np.where(is_in_view, right, -np.inf).max(axis=1) + 0.5).astype(np.intp)
    columns = first[:, None] + np.arange(int((last - first).max()) + 1)[None, :]
    edge_m = road.line_station_at_distance_m(at_m, rows.edge_x_m[at])
    shares = _painted_share_of_dashes(edge_m - marking.phase_m, dash_m) * is_in_view
    if where_m:
        shares *= _share_inside_painted_stretches(edge_m, where_m)
    start = columns[:, :, None] - 0.5
    overlap = np.clip(right[:, None, :] - start, 0.0, 1.0) - np.clip(left[:, None, :] - start, 0.0, 1.0)
    cover = (overlap * shares[:, None, :]).mean(axis=2)
    if marking.remaining_paint_share < MIN_PAINT_SHARE_WITHOUT_WEAR:
        middle_px, width_px = (left + right)[:, :, None].mean(axis=1) / 2, (right - left).mean(axis=1)[:, None]
        cover *= _remaining_paint_share(rows, at, columns, middle_px, width_px, marking, offset_m)
    inside = (columns >= 0) & (columns < camera.width_px)
    where = (np.broadcast_to(at[:, None], columns.shape)[inside], columns[inside])
    alpha = cover[inside].astype(np.float32)
    image[where] += alpha * (np.float32(marking.grey * gain) - image[where])


def _painted_share_of_dashes(edge_m: FloatArray, dash_m: tuple[float, float]) -> FloatArray:
    """Share of the stretches between neighbouring edges (n, k + 1) that dashes cover, (n, k); edges fall in a row."""
    line, gap = dash_m
    if gap <= 0.0:
        return np.ones((edge_m.shape[0], edge_m.shape[1] - 1))
    period = line + gap
    turns = np.floor(edge_m / period)
    total = turns * line + np.minimum(edge_m - turns * period, line)
    length = np.maximum(edge_m[:, :-1] - edge_m[:, 1:], 1e-6)
    return np.asarray(np.clip((total[:, :-1] - total[:, 1:]) / length, 0.0, 1.0))


def _share_inside_painted_stretches(edge_m: FloatArray, where_m: list[tuple[float, float]]) -> FloatArray:
    """Share of the stretches between neighbouring edges (n, k + 1) that lies where the line is painted, (n, k)."""
    far, near = edge_m[:, :-1], edge_m[:, 1:]
    within = sum(np.maximum(np.minimum(far, end) - np.maximum(near, start), 0.0) for start, end in where_m)
    return np.asarray(within / np.maximum(far - near, 1e-6))


def _remaining_paint_share(
    rows: ImageRows,
    row_indices: np.ndarray[tuple[int], np.dtype[np.intp]],
    columns: np.ndarray[tuple[int, int], np.dtype[np.intp]],
    middle_px: FloatArray,
    width_px: FloatArray,
    marking: Marking,
    offset_m: float,
) -> FloatArray:
    """Share of the paint that is left at the pixels of a stripe, shape of `columns`."""
    level = min(REMAINING_PAINT_LEVELS, key=lambda each: abs(each - marking.remaining_paint_share))
    texture, mean = remaining_paint_texture_and_mean(level)
    shift_m = 37.0 * offset_m  # so that neighbouring markings wear differently
    strip = texture.mean_over_stretches(rows.start_m[row_indices] + shift_m, rows.end_m[row_indices] + shift_m) + mean
    across = (columns - middle_px) / np.maximum(
        width_px, 1e-3
    ) * marking.width_m / WEAR_CELL_WIDTH_M + N_WEAR_TEXTURE_CELLS_ACROSS_MARKING / 2
    cell = np.clip(across.astype(np.intp), 0, N_WEAR_TEXTURE_CELLS_ACROSS_MARKING - 1)
    return np.asarray(np.clip(np.take_along_axis(strip, cell, axis=1), 0.0, 1.0))
