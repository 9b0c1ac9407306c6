"""The vanishing point of a frame: where the straight edges of the road scene meet.

Lane lines, seams, kerbs, barriers and the edges of shadows along the road are parallel, and so are the lines of other
lanes. Each line segment below a candidate point votes for it by its length and by how exactly it points there; a
heavy-tailed kernel keeps the edges of cars and bridges from mattering. Used where the camera's mounting is not known.

Shadows of trees and railings, drops and streaks of rain have many parallel edges. Where few of a frame's votes agree,
points to which edges of many directions lead are possible too, and the best lane from each decides (`lane_detect`).

Source of the segments: R. Grompone von Gioi et al., LSD: a line segment detector, Image Processing On Line 2 (2012), by
OpenCV. It leaves out gradients of less than some grey levels, whatever the contrast, so at dusk or in haze few lines
would be left: a faint picture is stretched to the contrast of daylight before.
"""

from __future__ import annotations

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.vision.method import GreyImage

FIRST_AND_LAST_HORIZON_ROW_SHARES = (0.25, 0.66)
"""First and last row that are tried, over the image's height. Chosen by hand; not fitted."""
COLUMN_SEARCH_HALF_WIDTH_SHARE = 0.22
"""Distance to each side of the middle up to which columns are tried, over the image's width. Chosen by hand; not
fitted."""
VANISHING_GRID_STEP_SHARE = 0.01
"""Step of the tried rows and columns, over the image's height and width. Chosen by hand; not fitted."""
MIN_SEGMENT_LENGTH_SHARE = 0.03
"""Least length of a segment that votes, over the image's width. Chosen by hand; not fitted."""
MAX_VOTING_LENGTH_OVER_IMAGE_WIDTH = 0.15
"""Length from which longer segments have no more votes, over the image's width. Chosen by hand; not fitted."""
MIN_SEGMENT_SLOPE, MAX_SEGMENT_SLOPE = 0.2, 16.0
"""Least and greatest slope of a segment that votes, in rows a column: others are beams, bridges and posts. Chosen by
hand; not fitted."""
ANGLE_LEAVING_QUARTER_OF_VOTES_RAD = 0.02
"""Angle between a segment and a point at which a quarter of the votes is left, in radians. Chosen by hand; not
fitted."""
MAX_IMAGE_WIDTH_FOR_SEGMENT_DETECTION_PX = 400
"""Greatest width in pixels at which segments are detected; wider images are halved, which keeps directions and takes a
quarter of the time."""
DARK_QUANTILE, BRIGHT_QUANTILE = 0.01, 0.99
"""Quantiles of the grey levels between which a picture's contrast is measured. Chosen by hand; not fitted."""
CONTRAST_TO_WHICH_DULL_PICTURES_ARE_STRETCHED_GREY = 150
"""Contrast in grey levels to which pictures with less are stretched: that of daylight. Stretching to all levels finds
segments in the road's grain."""
MIN_ASSUMED_CONTRAST_GREY = 16
"""Least contrast in grey levels that the stretching assumes: pictures with less hold nothing but noise. Chosen by hand;
not fitted."""
MIN_SEGMENT_REACH_BELOW_VANISHING_POINT_SHARE = 0.03
"""Least distance below a point to which a segment that votes must reach, over the image's height. Chosen by hand; not
fitted."""

MIN_CLEAR_VANISHING_POINT_VOTE_SHARE = 0.33
"""Share of the votes for a frame's vanishing point below which the point and any lane found from it are in doubt. A
road has 0.35 to 0.6, stripes of shadow 0.1 to 0.3, a picture upside down 0.04 to 0.12. Chosen on 20 of 40 labelled
frames in 15 kinds of weather and damage (tests/studies/lane_variants.py)."""
N_OTHER_VANISHING_POINTS = 3
"""Number of other points that are returned in that case. Chosen on the same frames in 7 kinds of weather and on
rendered ones."""
N_DIRECTION_SECTORS = 5
"""Number of sectors of segments' directions between which votes for the other points should be spread. Chosen on the
same frames."""
MAX_GRID_ROW_STEPS_TO_SAME_VANISHING_POINT, MAX_GRID_COLUMN_STEPS_TO_SAME_VANISHING_POINT = 5, 6
"""Steps of the grid in rows and columns up to which a point is the same as a better one. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class VanishingPoint:
    """The point in which the segments of a frame meet.

    Attributes:
        u_px, v_px: The point.
        votes: Its votes over the length of all segments, 0 to 1; 0 without segments.
    """

    u_px: float
    v_px: float
    votes: float


def find_vanishing_points(
    grey: GreyImage, middle_px: float, *, n_other_points: int = N_OTHER_VANISHING_POINTS
) -> list[VanishingPoint]:
    """Find the point with the most votes of the frame's segments; none without segments.

    If its share is below `MIN_CLEAR_VANISHING_POINT_VOTE_SHARE`, up to `n_other_points` others follow: those to which
    edges of many directions lead.

    Args:
        grey: Shape (height, width), uint8.
        middle_px: Column around which to look.
    """
    height, width = grey.shape
    segments = _detect_segments_along_road_uv_px(grey)
    if not len(segments):
        return []
    v = np.arange(
        FIRST_AND_LAST_HORIZON_ROW_SHARES[0] * height,
        FIRST_AND_LAST_HORIZON_ROW_SHARES[1] * height,
        VANISHING_GRID_STEP_SHARE * height,
    )
    u = (
        middle_px
        + np.arange(-COLUMN_SEARCH_HALF_WIDTH_SHARE, COLUMN_SEARCH_HALF_WIDTH_SHARE, VANISHING_GRID_STEP_SHARE) * width
    )
    votes, total = _vanishing_point_votes_on_grid(segments, u, v, width, height)
    points = [_point_at_best_cell(votes, votes / total, u, v)]
    if points[0].votes >= MIN_CLEAR_VANISHING_POINT_VOTE_SHARE or not n_other_points:
        return points
    run, rise = segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1]
    sectors = (np.arctan2(rise, run) % np.pi * (N_DIRECTION_SECTORS / np.pi)).astype(int)
    roots = [
        np.sqrt(_vanishing_point_votes_on_grid(segments[sectors == k], u, v, width, height)[0])
        for k in np.unique(sectors)
    ]
    spread = np.asarray(np.sum(roots, axis=0) ** 2)
    best = votes
    for _ in range(n_other_points):
        i, j = np.unravel_index(int(best.argmax()), best.shape)
        spread[
            max(i - MAX_GRID_ROW_STEPS_TO_SAME_VANISHING_POINT, 0) : i + MAX_GRID_ROW_STEPS_TO_SAME_VANISHING_POINT + 1,
            max(j - MAX_GRID_COLUMN_STEPS_TO_SAME_VANISHING_POINT, 0) : j
            + MAX_GRID_COLUMN_STEPS_TO_SAME_VANISHING_POINT
            + 1,
        ] = 0.0
        if spread.max() <= 0.0:
            break
        points.append(_point_at_best_cell(spread, votes / total, u, v))
        best = spread
    return points


def _point_at_best_cell(
    grid: FloatArray, vote_shares: FloatArray, grid_u_px: FloatArray, grid_v_px: FloatArray
) -> VanishingPoint:
    """The weighted mean of the best cell of a grid and its neighbours; the vote share is that of the cell."""
    i, j = np.unravel_index(int(grid.argmax()), grid.shape)
    rows, columns = slice(max(i - 1, 0), i + 2), slice(max(j - 1, 0), j + 2)
    near = grid[rows, columns] ** 4
    return VanishingPoint(
        u_px=float((near.sum(axis=0) @ grid_u_px[columns]) / near.sum()),
        v_px=float((near.sum(axis=1) @ grid_v_px[rows]) / near.sum()),
        votes=float(vote_shares[i, j]),
    )


def _detect_segments_along_road_uv_px(grey: GreyImage) -> FloatArray:
    """Detect the segments that may lie along the road: u, v of both ends, shape (n, 4)."""
    import cv2

    height, width = grey.shape
    top = round((FIRST_AND_LAST_HORIZON_ROW_SHARES[0] + MIN_SEGMENT_REACH_BELOW_VANISHING_POINT_SHARE) * height)
    road = np.ascontiguousarray(grey[top:])
    if width > MAX_IMAGE_WIDTH_FOR_SEGMENT_DETECTION_PX:
        road = np.asarray(cv2.resize(road, (width // 2, len(road) // 2), interpolation=cv2.INTER_AREA), np.uint8)
    scale = np.array([width / road.shape[1], (height - top) / len(road)])
    found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(_stretch_to_daylight_contrast(road))[0]
    if found is None:
        return np.empty((0, 4))
    segments = ((found.reshape(-1, 2, 2).astype(np.float64) + 0.5) * scale - 0.5).reshape(-1, 4)
    segments[:, 1::2] += top
    across, down = np.abs(segments[:, 2] - segments[:, 0]), np.abs(segments[:, 3] - segments[:, 1])
    keep = (
        (np.hypot(across, down) > MIN_SEGMENT_LENGTH_SHARE * width)
        & (down > MIN_SEGMENT_SLOPE * across)
        & (down < MAX_SEGMENT_SLOPE * across)
    )
    return np.asarray(segments[keep])


def _stretch_to_daylight_contrast(grey: GreyImage) -> GreyImage:
    """The picture, stretched to the contrast of daylight if it has less."""
    import cv2

    share = np.cumsum(cv2.calcHist([grey], [0], None, [256], [0, 256])) / grey.size
    low, high = np.searchsorted(share, [DARK_QUANTILE, BRIGHT_QUANTILE]).tolist()
    if high - low >= CONTRAST_TO_WHICH_DULL_PICTURES_ARE_STRETCHED_GREY:
        return grey
    stretched = (np.arange(256) - low) * (
        CONTRAST_TO_WHICH_DULL_PICTURES_ARE_STRETCHED_GREY / max(high - low, MIN_ASSUMED_CONTRAST_GREY)
    )
    return np.asarray(cv2.LUT(grey, np.clip(np.rint(stretched), 0, 255).astype(np.uint8)))


def _vanishing_point_votes_on_grid(
    segments_uv_px: FloatArray, grid_u_px: FloatArray, grid_v_px: FloatArray, width_px: int, height_px: int
) -> tuple[FloatArray, float]:
    """Votes for each point of a grid, shape (len(v), len(u)), and the greatest possible sum of votes."""
    run, rise = segments_uv_px[:, 2] - segments_uv_px[:, 0], segments_uv_px[:, 3] - segments_uv_px[:, 1]
    length = np.hypot(run, rise)
    weight = np.minimum(length, MAX_VOTING_LENGTH_OVER_IMAGE_WIDTH * width_px)
    lowest = np.maximum(segments_uv_px[:, 1], segments_uv_px[:, 3])
    du = (grid_u_px - 0.5 * (segments_uv_px[:, :1] + segments_uv_px[:, 2:3])).astype(np.float32)
    dv = (grid_v_px - 0.5 * (segments_uv_px[:, 1:2] + segments_uv_px[:, 3:])).astype(np.float32)
    # at the distance from a segment that 0.02 rad and a pixel at its ends allow, a quarter of its votes is left
    vote_beside = 1.0 / (length * (ANGLE_LEAVING_QUARTER_OF_VOTES_RAD + 1.0 / length))
    across = (du * (rise * vote_beside)[:, None].astype(np.float32))[:, None, :]
    across = across - (dv * (run * vote_beside)[:, None].astype(np.float32))[:, :, None]
    across *= across
    squared_distance = (du * du)[:, None, :] + (dv * dv + np.float32(1e-9))[:, :, None]
    across += squared_distance
    squared_distance /= across
    squared_distance *= squared_distance
    squared_distance *= np.where(
        lowest[:, None] > grid_v_px + MIN_SEGMENT_REACH_BELOW_VANISHING_POINT_SHARE * height_px, weight[:, None], 0.0
    )[:, :, None].astype(np.float32)
    return squared_distance.sum(axis=0, dtype=np.float64), float(weight.sum())
