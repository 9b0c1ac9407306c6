"""Whether a found boundary is white or yellow, from a picture in colour."""

from __future__ import annotations

import numpy as np

from cwcli.signals.columns import FloatArray
from cwcli.vision.boundary import LineColour
from cwcli.vision.encoded import Image
from cwcli.vision.lane_detect import StripeEvidence
from cwcli.vision.lane_model import HORIZON, WIDTH, ImageLane, boundary_columns_in_rows_px

MIN_COLOUR_ROWS_BELOW_HORIZON_PX = 22.0
"""Least number of rows below the horizon at which colours are read: there a stripe of 12 cm, 1.3 m below the camera, is
two pixels wide."""
ROAD_SAMPLE_DISTANCE_IN_CAMERA_HEIGHTS = 0.4
"""Distance from a line towards the lane's middle at which the road is read, over the camera's height: half a metre.
Chosen by hand; not fitted."""
MIN_PAINT_EVIDENCE = 0.3
"""Evidence above which a row counts as painted. Chosen by hand; not fitted."""
MIN_PAINTED_ROWS = 3
"""Least number of painted rows from which a colour follows. Chosen by hand; not fitted."""
MIN_PAINT_CONTRAST_GREY = 8.0
"""Least brightness of paint above the road, in grey levels, in the mean of red and green. Chosen by hand; not
fitted."""
MAX_YELLOW_BLUE_RATIO, MIN_WHITE_BLUE_RATIO = 0.6, 0.75
"""Limits of the ratio of paint's extra brightness in blue to that in red and green, each over the road's: yellow below,
white above, unknown between. The ratio is 1 for white however much road a pixel shows beside the paint, about 0 for
yellow. Chosen by hand; not fitted."""


def classify_line_colours(picture: Image, evidence: StripeEvidence, lane: ImageLane) -> tuple[LineColour, LineColour]:
    """The colours of the left and the right boundary in one frame.

    Args:
        picture: Shape (height, width, 3): blue, green, red, of the size of the frame that was searched.
    """
    pinhole = evidence.pinhole
    first = int(
        np.searchsorted(
            evidence.rows, float(lane[HORIZON]) + MIN_COLOUR_ROWS_BELOW_HORIZON_PX / pinhole.focal_length_ratio
        )
    )
    rows, sharp = evidence.rows[first:], evidence.sharp[first:]
    inner = np.array(lane)
    inner[WIDTH] -= 2.0 * ROAD_SAMPLE_DISTANCE_IN_CAMERA_HEIGHTS * pinhole.focal_length_ratio
    lines = zip(
        *(boundary_columns_in_rows_px(each, rows.astype(np.float64), pinhole) for each in (lane, inner)), strict=True
    )
    colours = []
    for paint_px, road_px in lines:
        both = np.stack([paint_px, road_px])
        with np.errstate(invalid="ignore"):
            in_image = np.flatnonzero(((both >= 0.0) & (both <= picture.shape[1] - 1.0)).all(axis=0))
        paint_u, road_u = np.rint(both[:, in_image]).astype(np.intp)
        is_painted = sharp[in_image, paint_u] > MIN_PAINT_EVIDENCE
        paint, road = (picture[rows[in_image], u][is_painted] for u in (paint_u, road_u))
        colours.append(_classify_paint_colour(paint.astype(np.float64), road.astype(np.float64)))
    return colours[0], colours[1]


def _classify_paint_colour(paint: FloatArray, road: FloatArray) -> LineColour:
    """The colour that pixels of paint have relative to pixels of the road, shape (n, 3) each."""
    if len(paint) < MIN_PAINTED_ROWS or not np.ptp(np.concatenate([paint, road]), axis=1).any():
        return LineColour.UNKNOWN  # grey pictures have no colour
    blue, others = _blue_and_red_green_mean(paint)
    road_blue, road_others = _blue_and_red_green_mean(road)
    if others - road_others < MIN_PAINT_CONTRAST_GREY:
        return LineColour.UNKNOWN
    ratio = (blue - road_blue) / (others - road_others) / (road_blue / road_others)
    if ratio < MAX_YELLOW_BLUE_RATIO:
        return LineColour.YELLOW
    return LineColour.WHITE if ratio > MIN_WHITE_BLUE_RATIO else LineColour.UNKNOWN


def _blue_and_red_green_mean(pixels: FloatArray) -> tuple[float, float]:
    """Mean of blue, and mean of red and green, each at least one grey level."""
    blue, green, red = pixels.mean(axis=0).tolist()
    return max(blue, 1.0), max(0.5 * (green + red), 1.0)
