"""Headline metrics of `lanes`: share of frames with a lane, steadiness, and errors against labels or a truth."""

from __future__ import annotations

import math

import numpy as np

from cwcli.channels.binding import is_truth_topic
from cwcli.channels.lanes import BOUNDARY_SIDES, LaneRows, read_lanes
from cwcli.channels.published import LANES
from cwcli.evaluation.evaluation_context import EvaluationContext
from cwcli.logs.read.channels import ChannelInfo
from cwcli.logs.read.reader import Log
from cwcli.metrics.headline import HeadlineCollector
from cwcli.metrics.lane_scores import TuSimpleScore, lane_width_stability, lanes_beside_ego, tusimple_score
from cwcli.signals.columns import Columns, FloatArray, Int64Array
from cwcli.signals.lane_geometry import lateral_positions_of_arcs_m
from cwcli.signals.leaf_fields import numbers_of_row, read_stamps
from cwcli.signals.row_order import Rows
from cwcli.vision.boundary_lines import BoundaryLines
from cwcli.vision.camera import Camera
from cwcli.vision.rectify import in_image_mask, lowest_visible_row_px, map_rectified_to_camera_px

MAX_STAMP_DIFFERENCE_OF_LABEL_AND_FRAME_NS = 5_000_000
"""A label and a frame belong to one image if their stamps differ by at most this, ns. Chosen by hand; not fitted."""
PREVIEW_DISTANCE_TOLERANCE_M = 1e-6
"""Greatest difference of two preview distances that count as equal, m: rounding."""
MAX_IMAGE_ROWS_SAMPLED_PER_BOUNDARY = 4096
"""Greatest number of image rows at which a boundary is sampled. Chosen to bound the work; not fitted."""

PREVIEW_METRICS = (
    ("lanes.lateral_deviation_rmse_m", 1.0),
    ("lanes.heading_deviation_rmse_deg", math.degrees(1.0)),
    ("lanes.curvature_rmse_1pm", 1.0),
)
"""Metric of each quantity at the preview point, with the factor from the quantity's unit to that of the metric."""
EVALUATED_DISTANCES_M = (5.0, 10.0, 20.0, 30.0)
"""Distances ahead, m, at which boundaries are compared with the truth of a rendered road. Chosen by hand."""

SearchedAndCameraImageSizePx = tuple[float, float, float, float]
"""Width and height of the searched image, then of the camera's image, px."""


def add_metrics(context: EvaluationContext) -> None:
    """Add the metrics of the lanes channel; nothing if the log has none."""
    headline, log = context.headline, context.log
    if all(channel.topic != LANES.topic for channel in log.channels):
        return
    lanes = read_lanes(log.columns(LANES.topic))
    if not len(lanes):
        return
    found = lanes.found
    headline.add_share("lanes.found_share", found[:, 0] & found[:, 1])
    for k, side in enumerate(BOUNDARY_SIDES):
        headline.add_share(f"lanes.{side}_found_share", found[:, k])
    width = lane_width_stability(lanes.lane_width_m)
    if width.n:
        headline.add_from_sums("lanes.width_std_m", width.std_m**2 * width.n, width.n)
        headline.add_from_sums("lanes.width_near_share", width.share_near * width.n, width.n)
        if math.isfinite(width.max_jump_m):
            headline.add_from_sums("lanes.width_max_jump_m", width.max_jump_m, 1.0, n=width.n)
    if context.uses_truth:
        for channel in log.channels:
            if is_truth_topic(channel.topic):
                _add_errors_against_truth(headline, log, channel, lanes)


def _add_errors_against_truth(headline: HeadlineCollector, log: Log, channel: ChannelInfo, lanes: LaneRows) -> None:
    """Compare with a truth channel, if it is one of lanes and the first of its kind."""
    names = {row[1] for row in headline.rows}
    if channel.schema_name == LANES.schema and "lanes.lateral_deviation_rmse_m" not in names:
        error = _errors_at_equal_preview_points(lanes, read_lanes(log.columns(channel.topic)))
        for k, (name, scale) in enumerate(PREVIEW_METRICS):
            headline.add_errors(name, scale * error[:, k])
    if channel.message_encoding == "json" and "lanes.truth_accuracy" not in names:
        truth = log.columns(channel.topic)
        if "h_samples" in truth.fields and "lanes" in truth.fields:
            label_ns, has_stamp = read_stamps(truth)
            matched = _match_rows_by_stamp(lanes.stamp_ns, np.where(has_stamp, label_ns, truth.log_time_ns))
            _add_tusimple_scores(headline, lanes, truth, *matched)
            _add_boundary_position_errors(headline, lanes, truth, *matched)


def _errors_at_equal_preview_points(lanes: LaneRows, truth: LaneRows) -> FloatArray:
    """Return quantities minus truth (n, 3) at the frames that both have; NaN where the preview distances differ."""
    mine, other = _match_rows_by_stamp(lanes.stamp_ns, truth.stamp_ns)
    is_same_point = np.abs(lanes.preview_m[mine] - truth.preview_m[other]) <= PREVIEW_DISTANCE_TOLERANCE_M
    return np.where(is_same_point[:, None], lanes.preview[mine] - truth.preview[other], np.nan)


def _add_boundary_position_errors(
    headline: HeadlineCollector, lanes: LaneRows, truth: Columns, lane_rows: Rows, truth_rows: Rows
) -> None:
    """Add the lateral errors of both boundaries on the road against a rendered truth, at its distances."""
    errors: dict[float, list[float]] = {distance_m: [] for distance_m in EVALUATED_DISTANCES_M}
    for k, side in enumerate(BOUNDARY_SIDES):
        if "ground_x_m" not in truth.fields or f"ground_{side}_y_m" not in truth.fields:
            return
        is_found = lanes.found[lane_rows, k]
        for row, label in zip(lane_rows[is_found].tolist(), truth_rows[is_found].tolist(), strict=True):
            x_m, y_m = (numbers_of_row(truth.fields[name], label) for name in ("ground_x_m", f"ground_{side}_y_m"))
            n = min(len(x_m), len(y_m))
            places_m = lateral_positions_of_arcs_m(lanes.road[row, k], x_m[:n], -lanes.curvature_change_1pm2[row])
            for distance_m, error_m in zip(x_m[:n].tolist(), (places_m - y_m[:n]).tolist(), strict=True):
                if distance_m in errors:
                    errors[distance_m].append(error_m)
    for distance_m, found_errors in errors.items():
        headline.add_errors(f"lanes.lateral_{distance_m:g}m_rmse_m", np.array(found_errors))


def _match_rows_by_stamp(ours_ns: Int64Array, theirs_ns: Int64Array) -> tuple[Rows, Rows]:
    """Return the rows in both that belong to the same image."""
    if not len(ours_ns) or not len(theirs_ns):
        none = np.zeros(0, np.intp)
        return none, none
    order = np.argsort(theirs_ns, kind="stable")
    ordered = theirs_ns[order]
    after = np.clip(np.searchsorted(ordered, ours_ns), 1, max(len(ordered) - 1, 1)) if len(ordered) > 1 else None
    if after is None:
        nearest = np.zeros(len(ours_ns), np.intp)
    else:
        nearest = np.where(ours_ns - ordered[after - 1] <= ordered[after] - ours_ns, after - 1, after)
    near = np.abs(ordered[nearest] - ours_ns) <= MAX_STAMP_DIFFERENCE_OF_LABEL_AND_FRAME_NS
    return np.flatnonzero(near), order[nearest[near]]


def _add_tusimple_scores(
    headline: HeadlineCollector, lanes: LaneRows, truth: Columns, lane_rows: Rows, truth_rows: Rows
) -> None:
    """Add TuSimple's scores against the two labelled lines next to the camera's axis."""
    sizes = np.concatenate([lanes.search_size, lanes.image_size], axis=1)
    scores: list[TuSimpleScore] = []
    for row, label in zip(lane_rows.tolist(), truth_rows.tolist(), strict=True):
        rows_px, flat = numbers_of_row(truth.fields["h_samples"], label), numbers_of_row(truth.fields["lanes"], label)
        if not len(rows_px) or len(flat) % len(rows_px) or not (sizes[row] > 0).all():
            continue
        search_w, search_h, image_w, image_h = sizes[row].tolist()
        ego_lanes = lanes_beside_ego(flat.reshape(-1, len(rows_px)), rows_px, image_w, image_h)
        image = search_w, search_h, image_w, image_h
        lines = _boundary_columns_px(
            lanes.image_boundaries[slice(row, row + 1)], rows_px, image, lanes.lenses.camera_before_rectification(row)
        )
        scores.append(tusimple_score([lines[k] for k in np.flatnonzero(lanes.found[row])], ego_lanes, rows_px))
    if scores:
        headline.add_errors("lanes.truth_accuracy", np.array([score.accuracy for score in scores]))
        headline.add_errors("lanes.truth_false_share", np.array([score.false_positive for score in scores]))
        headline.add_errors("lanes.truth_missed_share", np.array([score.false_negative for score in scores]))


def _boundary_columns_px(
    drawn: BoundaryLines, rows_px: FloatArray, sizes: SearchedAndCameraImageSizePx, lens: Camera | None = None
) -> FloatArray:
    """Return the columns (2, h) of both boundaries in the camera's image at rows from the top; NaN beyond their ends.

    A boundary ends at the image's edge and where the line ends that `cwcli lanes` draws (`BoundaryLines`). The lens is
    that of the camera, if the boundaries are those of its rectified image.
    """
    if lens is not None:
        return _boundary_columns_through_lens_px(lens, drawn, rows_px, sizes)
    search_w, search_h, image_w, image_h = sizes
    y_px = search_h + 0.5 - (rows_px + 0.5) * search_h / image_h
    x_px = drawn.columns_at_heights_px(y_px[None], search_h)[0]
    with np.errstate(invalid="ignore"):
        outside = (x_px < 0.5) | (x_px > search_w + 0.5) | (y_px < 0.5)
    return np.asarray((np.where(outside, np.nan, x_px) - 0.5) * image_w / search_w - 0.5)


def _boundary_columns_through_lens_px(
    lens: Camera, drawn: BoundaryLines, rows_px: FloatArray, sizes: SearchedAndCameraImageSizePx
) -> FloatArray:
    """Return `_boundary_columns_px` for a rectified image: its points are distorted by the lens and joined by straight
    lines."""
    search_w, search_h, image_w, image_h = sizes
    lowest_px = lowest_visible_row_px(lens)
    dense_px = np.linspace(0.0, lowest_px, min(int(lowest_px) + 1, MAX_IMAGE_ROWS_SAMPLED_PER_BOUNDARY))
    x_px = drawn.columns_at_heights_px((search_h + 0.5 - (dense_px + 0.5) * search_h / image_h)[None], search_h)[0]
    u_px = (x_px - 0.5) * image_w / search_w - 0.5
    camera_px = map_rectified_to_camera_px(np.stack([u_px, np.broadcast_to(dense_px, u_px.shape)], axis=-1), lens)
    columns_px = np.full((len(camera_px), len(rows_px)), np.nan)
    for side, points in enumerate(camera_px):
        line = points[in_image_mask(points, lens)]
        if len(line) > 1:
            line = line[np.argsort(line[:, 1], kind="stable")]
            columns_px[side] = np.interp(rows_px, line[:, 1], line[:, 0], left=np.nan, right=np.nan)
    return columns_px
