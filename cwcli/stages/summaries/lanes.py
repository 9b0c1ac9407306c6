"""The table and the summary of the stage `lanes`."""

from __future__ import annotations

import numpy as np

from cwcli.channels.lanes import LaneFrames
from cwcli.metrics.table import ColumnDoc, Table, TableColumn
from cwcli.pipeline.result import Cell, SummaryTable
from cwcli.signals.columns import median_of_finite
from cwcli.vision.boundary import LineColour, LineKind
from cwcli.vision.fit_columns import lowercase_enum_names
from cwcli.vision.method import LaneState

SIDE_NAMES = ("left", "right")
"""Names of the boundaries, in the order in which arrays hold them."""


def lanes_table(frames: LaneFrames) -> Table:
    """Return the table with one row for each used frame."""
    geometry = frames.geometry
    columns: dict[str, TableColumn] = {
        "frame": frames.index,
        "log_time_ns": frames.log_time_ns,
        "stamp_ns": frames.stamp_ns,
        "image_width_px": frames.image_size[:, 0],
        "image_height_px": frames.image_size[:, 1],
        "search_width_px": frames.search_size[:, 0],
        "search_height_px": frames.search_size[:, 1],
    }
    docs = {
        "frame": ColumnDoc(doc="number of the frame in its channel, within the chosen span"),
        "search_width_px": ColumnDoc(doc="size of the image in whose pixels a, b and c are"),
    }
    for side, (name, body) in enumerate(zip(SIDE_NAMES, (geometry.left_body, geometry.right_body), strict=True)):
        for k, parameter in enumerate("abc"):
            columns[f"{name}_{parameter}"] = frames.fits.parabolas[:, side, k]
        columns[f"{name}_score"] = frames.fits.score[:, side]
        columns[f"{name}_probability"] = frames.fits.probability[:, side]
        columns[f"{name}_found"] = frames.fits.found[:, side]
        columns[f"{name}_kind"] = lowercase_enum_names(LineKind, frames.fits.kind[:, side])
        columns[f"{name}_colour"] = lowercase_enum_names(LineColour, frames.fits.colour[:, side])
        docs[f"{name}_kind"] = ColumnDoc(doc="of its paint: solid, dashed, dots (raised ones), double, unknown")
        docs[f"{name}_colour"] = ColumnDoc(doc="white, yellow, unknown (as in grey frames)")
        for k, parameter in enumerate(("lateral_m", "slope", "ground_curvature_1pm")):
            columns[f"{name}_{parameter}"] = body[:, k]
            docs[f"{name}_{parameter}"] = ColumnDoc(frame="body", doc="y = lateral + slope x + curvature x^2 / 2")
    columns |= {
        "lateral_deviation_m": geometry.lateral_deviation_m,
        "lateral_deviation_sigma_m": geometry.lateral_deviation_sigma_m,
        "heading_deviation_rad": geometry.heading_deviation_rad,
        "heading_deviation_sigma_rad": geometry.heading_deviation_sigma_rad,
        "curvature_1pm": geometry.curvature_1pm,
        "curvature_sigma_1pm": geometry.curvature_sigma_1pm,
        "lane_width_m": geometry.lane_width_m,
        "pitch_rad": frames.fits.pitch_rad,
        "state": lowercase_enum_names(LaneState, frames.fits.state),
        "steady_s": frames.fits.steady_s,
        "lane_change": frames.fits.lane_change.astype(np.int64),
    }
    docs |= {
        "lateral_deviation_m": ColumnDoc(doc="of the lane's centre at the preview point, right positive (y_L)"),
        "heading_deviation_rad": ColumnDoc(doc="of the car from the lane there, counter-clockwise positive (e_L)"),
        "curvature_1pm": ColumnDoc(doc="of the lane there, right bend positive (K_L)"),
        "lane_width_m": ColumnDoc(doc="10 m ahead of the camera"),
        "pitch_rad": ColumnDoc(doc="of the camera as the method estimates it, nose down positive"),
        "state": ColumnDoc(
            doc="found, held (hardly visible), carried (frame not searched), lost; untold: the method reports no state"
        ),
        "steady_s": ColumnDoc(doc="since the lane was found or took the place of another one"),
        "lane_change": ColumnDoc(doc="1: the camera has come into the next lane to the left, -1: to the right"),
    }
    return Table("lanes", columns, docs)


def lanes_summary_table(frames: LaneFrames, *, n_searches: int, n_searched: int, search_s: float) -> SummaryTable:
    """Return the table of how often boundaries were found, the lane's median values, and the search time."""
    found = frames.fits.found
    n = len(frames)
    rows: list[tuple[Cell, ...]] = [
        ("frames", n),
        ("frames searched", n_searched),
        ("left boundary found (%)", 100.0 * float(found[:, 0].mean())),
        ("right boundary found (%)", 100.0 * float(found[:, 1].mean())),
        ("both found (%)", 100.0 * float(found.all(axis=1).mean())),
        ("lane width at 10 m, median (m)", median_of_finite(frames.geometry.lane_width_m)),
        (
            f"lateral deviation at {frames.preview_m:g} m, median (m)",
            median_of_finite(frames.geometry.lateral_deviation_m),
        ),
        ("its sigma, median (m)", median_of_finite(frames.geometry.lateral_deviation_sigma_m)),
        *_lane_following_rows(frames),
        ("searches started", n_searches),
        ("time of the search per frame (ms)", 1e3 * search_s / n),
    ]
    return SummaryTable("lanes", "Lane boundaries", ("quantity", "value"), tuple(rows), is_timed=True)


def _lane_following_rows(frames: LaneFrames) -> list[tuple[Cell, ...]]:
    """Return rows on held frames, new lanes and lane changes; [] where the method does not report states."""
    fits = frames.fits
    if not (fits.state != LaneState.UNTOLD).any():
        return []
    return [
        ("held, hardly visible (%)", 100.0 * float((fits.state == LaneState.HELD).mean())),
        ("lanes found or found again", int(np.count_nonzero(fits.steady_s == 0.0))),
        ("lane changes", int(np.count_nonzero(fits.lane_change))),
    ]
