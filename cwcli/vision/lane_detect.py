"""Both boundaries of one frame together: ridges of a marking's width, a scan, and a refinement. Deterministic."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache, partial
from typing import Protocol

import numpy as np
import numpy.typing as npt

from cwcli.kernels import lane_ridge, lane_stripes
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.signals.lane_geometry import Pinhole
from cwcli.vision.camera import Camera, WidthHeightPx
from cwcli.vision.ground import MIN_DEPTH_BELOW_HORIZON_SHARE
from cwcli.vision.lane_following import SAME_LINE_TOLERANCE_IN_CAMERA_HEIGHTS, max_boundary_difference_m
from cwcli.vision.lane_mean import weighted_mean_lane
from cwcli.vision.lane_model import (
    BEND,
    HIGH,
    HORIZON,
    LOW,
    MEAN,
    MIDDLE,
    SIGMA,
    SPIRAL,
    VANISHING,
    WIDTH,
    ImageLane,
    ImageLanes,
    LanePrior,
    LanePriorTable,
)
from cwcli.vision.method import GreyImage
from cwcli.vision.vanishing import N_OTHER_VANISHING_POINTS, VanishingPoint, find_vanishing_points

Float32Array = npt.NDArray[np.float32]
Int32Array = npt.NDArray[np.int32]

SAMPLED_ROW_SHARE = 0.5
"""Share of the image's rows that is sampled for stripes. Chosen by hand; not fitted."""
N_ROW_SEGMENTS = 9
"""Number of stretches of rows in which the evidence along a boundary is counted. Chosen by hand; not fitted."""
MAX_SAMPLED_ROWS = 150
"""Greatest number of sampled rows. Chosen by hand: it bounds the time of a frame."""
SAMPLED_ROW_NUMBERS: FloatArray = np.arange(float(MAX_SAMPLED_ROWS))
"""The numbers 0, 1, 2, ... of sampled rows, made once."""
STRIPE_WINDOW_GAP_SIDE_IN_CAMERA_HEIGHTS = (0.04, 0.085, 0.08)
"""Widths of a stripe's window, of the gap beside it and of the side windows, over the camera's height. The window is 6
cm: narrower than any marking, as wide as a small raised dot. Chosen in sight of 40 labelled and of rendered frames
(docs/lanes.md)."""
NOISE_FLOOR_GREY, NOISE_BRIGHTNESS_SHARE, NOISE_ROUGHNESS_FACTOR = 3.0, 0.085, 2.0
"""Noise of a contrast: a constant in grey levels, plus this share of the brighter side, plus this many times the row's
mean depth of dark stripes. Chosen in sight of 40 labelled and of rendered frames (docs/lanes.md)."""
BRIGHTNESS_ASYMMETRY_WEIGHT = 0.3
"""Share of the brightness difference between both sides that is taken off a stripe's contrast. Chosen by hand; not
fitted."""
DARK_STRIPE_WINDOW_GAP_SIDE_IN_CAMERA_HEIGHTS = (0.025, 0.03, 0.06)
"""Widths of the window, the gap and the side windows of dark stripes (joints of concrete, shadows of raised dots), over
the camera's height. They are narrower than markings. Chosen in sight of 40 labelled frames."""
MAX_UNCROWDED_DARK_STRIPE_SHARE_OF_ROW = 0.02
"""Share of dark stripes in a row above which they count less: concrete has a few joints, rough asphalt many dark
stripes. Chosen in sight of 40 labelled frames."""
PAVEMENT_JOINT_WEIGHT_RELATIVE_TO_PAINTED_STRIPE = 0.12
"""Weight of a pavement joint relative to a painted stripe in the evidence. Chosen in sight of 40 labelled and of
rendered frames (docs/lanes.md)."""
MAX_PAVEMENT_JOINT_TO_BOUNDARY_IN_CAMERA_HEIGHTS = 0.08
"""Greatest distance of a joint from the boundary that it supports, over the camera's height (10 cm): markings and dots
are laid some centimetres beside joints. Chosen in sight of 40 labelled frames."""
NEIGHBOURING_LANE_WEIGHT = 0.5
"""Weight of the neighbouring lanes' boundaries in the objective. Chosen by hand; not fitted."""
EVIDENCE_SHARE_COUNTING_ONE_HALF = 0.3
"""Share of evidence in a stretch of rows at which the stretch counts one half. Chosen by hand; not fitted."""
EVIDENCE_DEAD_ZONE = 0.25
"""Evidence up to this value counts as none. Chosen by hand; not fitted."""
MAX_UNCROWDED_STRIPE_SHARE_OF_ROW = 0.07
"""Share of bright stripes in a row above which they count less. Chosen by hand; not fitted."""
OBJECTIVE_LOSS_PER_SQUARED_PRIOR_SIGMA = 0.02
"""Objective that one squared sigma of distance from the prior takes off. Chosen by hand; not fitted."""
SCAN_STEP_IN_SAMPLED_ROWS = 3
"""Step between the rows that the grid scan uses, in sampled rows. Chosen by hand: it bounds the time of a frame."""
SCAN_PLACE_STEP_IN_CAMERA_HEIGHTS = 0.06
"""Step of the grid scan's lateral places, over the camera's height. Chosen by hand; not fitted."""
MAX_SCAN_PLACES_PER_SIDE = 400
"""Greatest number of lateral places to each side in the grid scan: a camera less than 0.4 m above the road sees a lane
that is many of its heights wide. Chosen by hand."""
MAX_REFINED_LANES = 12
"""Greatest number of distinct lanes that a first frame's search refines. Chosen by hand; not fitted."""
SAME_LANE_TOLERANCE_IN_CAMERA_HEIGHTS = 0.15
"""Distance below which two lanes are the same lane, of the boundary that differs more, over the camera's height. Chosen
by hand; not fitted."""
SAME_HORIZON_TOLERANCE_PX = 1.0
"""Difference of horizons up to which two lanes are the same lane, in pixels. Chosen by hand; not fitted."""
INNER_STRIPE_SHIFTS_IN_CAMERA_HEIGHTS = np.concatenate([[0.0], np.arange(0.08, 0.29, 0.02)])
"""Distances from a boundary at which the inner stripe of a double marking is looked for, over the camera's height.
Chosen by hand; not fitted."""
MIN_INNER_TO_OUTER_STRIPE_EVIDENCE_RATIO = 0.5
"""Least evidence of an inner stripe relative to the outer one. Chosen by hand; not fitted."""
MIN_OUTER_STRIPE_EVIDENCE = 0.15
"""Evidence that the outer stripe has at least in that comparison. Chosen by hand; not fitted."""
VANISHING_ROW_SIGMA_SHARE = 0.015
"""Sigma of the horizon from the vanishing point, over the image's height. Chosen by hand; not fitted."""
VANISHING_COLUMN_SIGMA_SHARE = 0.02
"""Sigma of the column of the vanishing point, over the image's width. Chosen by hand; not fitted."""
OBJECTIVE_PER_VOTE_SHARE = 0.4
"""Objective that a vanishing point's share of the votes adds where a frame has several such points. Chosen on 20 of 40
labelled frames in 7 kinds of weather and on rendered ones."""


@dataclass(frozen=True)
class StripeEvidence:
    """The stripes that a frame shows.

    Attributes:
        rows: Shape (n,): sampled rows, counted from the top.
        sharp, wide, broad: Shape (n, width), 0 to 1; `wide` and `broad` hold the greatest values near by.
        horizon_px: The horizon for which the widths of stripes were taken.
        min_depth_px: Rows less than this below a lane's horizon are not judged.
        pinhole: Intrinsics of the camera.
    """

    rows: Int32Array
    sharp: Float32Array
    wide: Float32Array
    broad: Float32Array
    horizon_px: float
    min_depth_px: float
    pinhole: Pinhole

    def scoring_settings(self, *, neighbour_weight: float = NEIGHBOURING_LANE_WEIGHT) -> lane_ridge.Scoring:
        """Settings with which the kernel judges lanes on this evidence, with a weight for neighbouring lanes."""
        segment = len(self.rows) // N_ROW_SEGMENTS
        return {
            "prior_weight": OBJECTIVE_LOSS_PER_SQUARED_PRIOR_SIGMA,
            "min_h": self.min_depth_px,
            "beside": neighbour_weight,
            "half": EVIDENCE_SHARE_COUNTING_ONE_HALF * segment,
            "segment": segment,
            "centre": self.pinhole.centre_px,
            "focal": self.pinhole.focal_px,
        }


def sampled_road_rows(top_px: float, height_px: int) -> Int32Array:
    """Rows that are sampled for stripes, evenly spaced from the top to the bottom of the road."""
    last = height_px - 2.0
    top = min(max(float(top_px), 0.0), last - 2.0 * N_ROW_SEGMENTS)
    n = min(max(int(SAMPLED_ROW_SHARE * (last - top)), 2 * N_ROW_SEGMENTS), MAX_SAMPLED_ROWS)
    step = (last - top) / (n - 1)  # more than one row
    return np.rint(top + step * SAMPLED_ROW_NUMBERS[:n]).astype(np.int32)


class EvidenceSource(Protocol):
    """A function that measures the evidence of a frame, such as `measure_stripe_evidence`."""

    def __call__(
        self,
        grey: GreyImage,
        rows: Int32Array,
        horizon_px: float,
        pinhole: Pinhole,
        buffer: Float32Array | None = None,
        *,
        with_joints: bool = False,
    ) -> StripeEvidence:
        """Measure the evidence in some rows of a frame."""


def half_widths_of_two_widened_evidences_px(width_px: int) -> tuple[int, int]:
    """Columns to each side over which the two widened evidences take the greatest value."""
    return max(1, round(width_px / 320)), max(2, round(width_px / 128))


@lru_cache(maxsize=8)
def _stripe_kernel_settings(stretch: float, *, is_joint: bool = False) -> lane_stripes.Stripe:
    """Settings with which the kernel finds stripes, or joints, for a camera of this fx / fy."""
    inner, gap, side = (
        stretch * each
        for each in (
            DARK_STRIPE_WINDOW_GAP_SIDE_IN_CAMERA_HEIGHTS if is_joint else STRIPE_WINDOW_GAP_SIDE_IN_CAMERA_HEIGHTS
        )
    )
    return {
        "inner": inner,
        "gap": gap,
        "side": side,
        "floor_grey": NOISE_FLOOR_GREY,
        "relative": NOISE_BRIGHTNESS_SHARE,
        "rough": NOISE_ROUGHNESS_FACTOR,
        "lopsided": BRIGHTNESS_ASYMMETRY_WEIGHT,
        "dead": EVIDENCE_DEAD_ZONE,
        "crowded": MAX_UNCROWDED_DARK_STRIPE_SHARE_OF_ROW if is_joint else MAX_UNCROWDED_STRIPE_SHARE_OF_ROW,
    }


def measure_stripe_evidence(
    grey: GreyImage,
    rows: Int32Array,
    horizon_px: float,
    pinhole: Pinhole,
    buffer: Float32Array | None = None,
    *,
    with_joints: bool = False,
) -> StripeEvidence:
    """Measure the stripes of a frame for a horizon.

    Args:
        grey: The frame, shape (height, width).
        horizon_px: The horizon for which the widths of stripes are taken.
        buffer: A buffer of 3 x rows x width numbers or more, which the result fills and refers to; None: new memory.
    """
    height, width = grey.shape
    size = 3 * len(rows) * width
    evidence = (np.empty(size, np.float32) if buffer is None else buffer[:size]).reshape(3, len(rows), width)
    reach, broad_reach = half_widths_of_two_widened_evidences_px(width)
    lane_stripes.stripes(
        np.ascontiguousarray(grey),
        rows,
        horizon_px,
        _stripe_kernel_settings(pinhole.focal_length_ratio),
        _stripe_kernel_settings(pinhole.focal_length_ratio, is_joint=True),
        joint_weight=PAVEMENT_JOINT_WEIGHT_RELATIVE_TO_PAINTED_STRIPE if with_joints else 0.0,
        joint_reach=MAX_PAVEMENT_JOINT_TO_BOUNDARY_IN_CAMERA_HEIGHTS * pinhole.focal_length_ratio,
        reach=reach,
        broad_reach=broad_reach,
        evidence=evidence,
    )
    return StripeEvidence(
        rows, evidence[0], evidence[1], evidence[2], horizon_px, MIN_DEPTH_BELOW_HORIZON_SHARE * height, pinhole
    )


def best_lanes_of_grid(
    evidence: StripeEvidence, prior: LanePrior, width_px: int, height_px: int
) -> tuple[ImageLanes, FloatArray]:
    """The best lane for each vanishing point and bend at the evidence's horizon.

    Returns:
        Lanes, shape (n, 6), and their objective, shape (n,), best first.
    """
    table = prior.table
    step = width_px / 160.0
    reach = min(2.5 * table[VANISHING, SIGMA], 0.2 * width_px)
    n = int(np.ceil(reach / step))
    vanishing: FloatArray = np.asarray(table[VANISHING, MEAN] + step * np.arange(-n, n + 1), np.float64)
    bend_step = 0.024 * width_px * (0.1 * height_px)
    n = int(np.clip(np.ceil(3.3 * table[BEND, SIGMA] / bend_step), 1, 24))
    bends: FloatArray = np.asarray(table[BEND, MEAN] + bend_step * np.arange(-n, n + 1), np.float64)
    most = (1.5 if NEIGHBOURING_LANE_WEIGHT else 0.5) * table[WIDTH, HIGH] + max(
        abs(table[MIDDLE, LOW]), abs(table[MIDDLE, HIGH])
    )
    place_step = max(SCAN_PLACE_STEP_IN_CAMERA_HEIGHTS, most / MAX_SCAN_PLACES_PER_SIDE)
    n = int(np.ceil(most / place_step))
    places: FloatArray = np.asarray(place_step * (np.arange(-n, n) + 0.5), np.float64)
    depths: FloatArray = np.asarray(evidence.rows - evidence.horizon_px, np.float64)
    depths[depths < evidence.min_depth_px] = -1.0
    best = lane_ridge.scan(
        evidence.wide,
        np.ascontiguousarray(table),
        evidence.scoring_settings(),
        depths=depths,
        step=SCAN_STEP_IN_SAMPLED_ROWS,
        vanishing=vanishing,
        bends=bends,
        places=places,
    )
    lanes = np.zeros((len(vanishing), len(bends), 6))
    lanes[..., VANISHING] = vanishing[:, None]
    lanes[..., BEND] = bends
    lanes[..., MIDDLE] = best[..., 1:].mean(axis=-1)
    lanes[..., WIDTH] = best[..., 2] - best[..., 1]
    lanes[..., HORIZON] = evidence.horizon_px
    z = (evidence.horizon_px - table[HORIZON, MEAN]) / table[HORIZON, SIGMA]
    value = best[..., 0].ravel() - OBJECTIVE_LOSS_PER_SQUARED_PRIOR_SIGMA * z * z
    order = np.argsort(-value, kind="stable")
    return lanes.reshape(-1, 6)[order], value[order]


def refine_lanes(
    evidence: StripeEvidence,
    lanes: ImageLanes,
    table: LanePriorTable,
    size: WidthHeightPx,
    *,
    use_wide_evidence: bool,
    step_scale: float = 1.0,
    neighbour_weight: float = NEIGHBOURING_LANE_WEIGHT,
) -> tuple[ImageLanes, FloatArray]:
    """Refine lanes by a pattern search from each; returns the lanes, shape (k, 6), and their objectives, shape (k,).

    Args:
        lanes: Where the searches begin, shape (k, 6) or (6,).
        table: The prior's table (`LanePrior.table`).
        step_scale: Factor of the first steps.
        neighbour_weight: Weight of the neighbouring lanes' boundaries.
    """
    width_px, height_px = size
    refined_lanes = np.array(lanes, np.float64, ndmin=2)
    horizon = float(refined_lanes[0, HORIZON]) if len(refined_lanes) == 1 else float(refined_lanes[:, HORIZON].mean())
    depth = height_px - horizon
    near, far, down = 0.012 * step_scale * width_px, 0.008 * step_scale * width_px, 0.008 * step_scale * height_px
    spiral = far if table[SPIRAL, LOW] < table[SPIRAL, HIGH] else 0.0
    steps = np.array([near, near, far, far, down, spiral])
    value = lane_ridge.refine(
        evidence.wide if use_wide_evidence else evidence.sharp,
        evidence.broad,
        evidence.rows,
        refined_lanes,
        table,
        evidence.scoring_settings(neighbour_weight=neighbour_weight),
        near_v=horizon + 0.6 * depth,
        far_v=horizon + 0.15 * depth,
        steps=steps,
        halvings=4 if use_wide_evidence else 6,
    )
    return refined_lanes, value


def lane_objectives(evidence: StripeEvidence, lanes: ImageLanes, table: LanePriorTable) -> FloatArray:
    """Objectives of lanes, shape (k,), the neighbouring lanes' boundaries included."""
    return lane_ridge.objective(
        evidence.sharp, evidence.broad, evidence.rows, lanes, table, evidence.scoring_settings()
    )


def best_lane_on_wide_evidence(evidence: StripeEvidence, lanes: ImageLanes, table: LanePriorTable) -> ImageLane:
    """The lane (6,) among several (k, 6) with the greatest objective on widened evidence, without neighbours."""
    scoring = evidence.scoring_settings(neighbour_weight=0.0)
    value = lane_ridge.objective(evidence.wide, evidence.broad, evidence.rows, lanes, table, scoring)
    return np.asarray(lanes[int(value.argmax())])


def first_distinct_lanes(lanes: ImageLanes, max_lanes: int) -> ImageLanes:
    """The first n lanes that differ from all lanes before them; fewer if there are not so many."""
    chosen: list[FloatArray] = []
    for lane in lanes:
        if not any(is_same_lane(lane, other) for other in chosen):
            chosen.append(lane)
            if len(chosen) == max_lanes:
                break
    return np.array(chosen)


def is_same_lane(lane: ImageLane, other: ImageLane) -> bool:
    """Whether two lanes are the same: neither their boundaries nor their horizons differ by more than the
    tolerances."""
    _, middle, width, _, horizon, _ = lane.tolist()
    _, other_middle, other_width, _, other_horizon, _ = other.tolist()
    difference = abs(middle - other_middle) + 0.5 * abs(width - other_width)  # of the boundary that differs more
    return bool(
        difference <= SAME_LANE_TOLERANCE_IN_CAMERA_HEIGHTS
        and abs(horizon - other_horizon) <= SAME_HORIZON_TOLERANCE_PX
    )


def prior_at_vanishing_point(prior: LanePrior, point: VanishingPoint, size: WidthHeightPx) -> LanePrior:
    """The prior with horizon and direction taken from a vanishing point."""
    width, height = size
    table = prior.table.copy()
    table[HORIZON] = (
        point.v_px,
        VANISHING_ROW_SIGMA_SHARE * height,
        point.v_px - 0.05 * height,
        point.v_px + 0.05 * height,
    )
    sigma = VANISHING_COLUMN_SIGMA_SHARE * width
    table[VANISHING] = point.u_px, sigma, point.u_px - 5.0 * sigma, point.u_px + 5.0 * sigma
    return prior.with_table(table)


def search_first_frame_at_vanishing_points(
    grey: GreyImage,
    camera: Camera,
    prior: LanePrior,
    evidence_source: EvidenceSource = measure_stripe_evidence,
    *,
    n_other_points: int = N_OTHER_VANISHING_POINTS,
) -> tuple[ImageLanes, FloatArray, StripeEvidence, float]:
    """Search a first frame whose mounting is not known, from the point where its straight edges meet.

    Where few of them agree, the frame is also searched from another point if the grid's best lane and the votes speak
    for that one: to search it from each takes four times the work, and finds hardly more.

    Args:
        n_other_points: Greatest number of points beside that of the most votes, where few edges agree.

    Returns:
        What `search_first_frame` returns at the best point, and the share of the votes for it; 1 where there are no
        edges.
    """
    size = camera.width_px, camera.height_px
    points = find_vanishing_points(grey, float(prior.table[VANISHING, MEAN]), n_other_points=n_other_points)
    if not points:
        return *search_first_frame(grey, camera, prior, evidence_source), 1.0
    priors = [prior_at_vanishing_point(prior, point, size) for point in points]
    chosen = [0]
    if len(points) > 1:
        scores = [
            _best_objective_of_grid(grey, own, evidence_source, size) + OBJECTIVE_PER_VOTE_SHARE * point.votes
            for own, point in zip(priors, points, strict=True)
        ]
        chosen = sorted({0, int(np.argmax(scores))})
    searches = [(*search_first_frame(grey, camera, priors[k], evidence_source), points[k].votes) for k in chosen]
    return max(searches, key=lambda search: float(search[1][0]) + OBJECTIVE_PER_VOTE_SHARE * search[3])


def _best_objective_of_grid(
    grey: GreyImage, prior: LanePrior, evidence_source: EvidenceSource, size: WidthHeightPx
) -> float:
    """The objective of the grid's best lane at the prior's horizon."""
    horizon_px = float(prior.table[HORIZON, MEAN])
    rows = sampled_road_rows(horizon_px + MIN_DEPTH_BELOW_HORIZON_SHARE * size[1], size[1])
    return float(best_lanes_of_grid(evidence_source(grey, rows, horizon_px, prior.pinhole), prior, *size)[1][0])


def search_first_frame(
    grey: GreyImage, camera: Camera, prior: LanePrior, evidence_source: EvidenceSource = measure_stripe_evidence
) -> tuple[ImageLanes, FloatArray, StripeEvidence]:
    """Search a first frame for the lanes that it supports best, knowing nothing but the prior.

    Args:
        camera: The camera in the pixels of the frame.
        prior: The prior, with a narrow horizon.

    Returns:
        Lanes, shape (k, 6): the mean of the lanes around the best one (`lane_mean`), then those with other lines, best
        first by paint and joints; the objective of each by paint alone, shape (k,); and the evidence of paint at the
        best lane's horizon.
    """
    height, width = grey.shape
    row = prior.table[HORIZON]
    horizons = row[MEAN] + row[SIGMA] * np.array([-1.5, 0.0, 1.5])
    rows = sampled_road_rows(row[MEAN] + MIN_DEPTH_BELOW_HORIZON_SHARE * height, height)
    starts: list[FloatArray] = []
    values: list[FloatArray] = []
    for horizon in horizons.tolist():
        evidence = evidence_source(grey, rows, horizon, prior.pinhole)
        lanes, _ = best_lanes_of_grid(evidence, prior, width, height)
        lanes, value = refine_lanes(
            evidence, first_distinct_lanes(lanes[:60], 4), prior.table, (width, height), use_wide_evidence=True
        )
        starts.append(lanes)
        values.append(value)
    lanes, value = np.concatenate(starts), np.concatenate(values)
    lanes = first_distinct_lanes(lanes[np.argsort(-value, kind="stable")], MAX_REFINED_LANES)
    evidence = evidence_source(grey, rows, float(lanes[0, HORIZON]), prior.pinhole, with_joints=True)
    for wide in (True, False):
        lanes, _ = refine_lanes(
            evidence, lanes, prior.table, (width, height), use_wide_evidence=wide, step_scale=1.0 if wide else 0.5
        )
    lanes = move_to_inner_stripes(evidence, lanes, prior, (width, height))
    lanes = lanes[np.argsort(-lane_objectives(evidence, lanes, prior.table), kind="stable")]
    lanes[0] = weighted_mean_lane(
        partial(lane_objectives, evidence, table=prior.table), lanes[0], prior.table, (width, height)
    )
    # lanes on the lines of the mean are part of it: as rivals they would count against the lane that they support
    tolerance_m = SAME_LINE_TOLERANCE_IN_CAMERA_HEIGHTS / prior.place_units_per_m
    has_other_lines = [max_boundary_difference_m(lane, lanes[0], prior, height) > tolerance_m for lane in lanes[1:]]
    lanes = lanes[[True, *has_other_lines]]
    evidence = evidence_source(grey, rows, float(lanes[0, HORIZON]), prior.pinhole)
    return lanes, lane_objectives(evidence, lanes, prior.table), evidence


def search_rival_lanes(
    evidence: StripeEvidence, prior: LanePrior, size: WidthHeightPx, known_lanes: Sequence[ImageLane]
) -> tuple[ImageLanes, FloatArray]:
    """Search for other lanes at a known horizon, under a narrow prior of direction and bend.

    Args:
        known_lanes: The lanes that are followed already; none of them is returned.

    Returns:
        Lanes, shape (k, 6), and their objectives, shape (k,); k may be 0.
    """
    lanes = _drop_known_lanes(first_distinct_lanes(best_lanes_of_grid(evidence, prior, *size)[0], 2), known_lanes)
    if len(lanes):
        lanes, _ = refine_lanes(evidence, lanes, prior.table, size, use_wide_evidence=True)
        lanes, _ = refine_lanes(evidence, lanes, prior.table, size, use_wide_evidence=False, step_scale=0.5)
        lanes = _drop_known_lanes(move_to_inner_stripes(evidence, lanes, prior, size), known_lanes)
    return lanes, lane_objectives(evidence, lanes, prior.table)


def _drop_known_lanes(lanes: ImageLanes, known_lanes: Sequence[ImageLane]) -> ImageLanes:
    """Lanes that are none of the known ones."""
    return lanes[[not any(is_same_lane(lane, other) for other in known_lanes) for lane in lanes]]


def move_to_inner_stripes(
    evidence: StripeEvidence, lanes: ImageLanes, prior: LanePrior, size: WidthHeightPx
) -> ImageLanes:
    """Lanes whose boundaries are moved to the inner stripe of a double marking, where there is one."""
    shifts = INNER_STRIPE_SHIFTS_IN_CAMERA_HEIGHTS * prior.pinhole.focal_length_ratio
    moved_lanes = np.array(lanes)
    for lane in moved_lanes:
        for sign in (1.0, -1.0):
            own = lane[MIDDLE] - 0.5 * sign * lane[WIDTH]
            values = lane_ridge.along(
                evidence.sharp, evidence.rows, lane, own + sign * shifts, evidence.scoring_settings()
            )
            mean = np.maximum(values, 0.0).mean(axis=1)
            k = 1 + int(mean[1:].argmax())
            if (
                mean[k] > MIN_INNER_TO_OUTER_STRIPE_EVIDENCE_RATIO * max(mean[0], MIN_OUTER_STRIPE_EVIDENCE)
                and mean[: k + 1].min() < 0.5 * mean[k]
            ):
                lane[MIDDLE] += 0.5 * sign * shifts[k]
                lane[WIDTH] -= shifts[k]
        # (the following search has short steps: it can't jump back)
    moved_lanes, _ = refine_lanes(evidence, moved_lanes, prior.table, size, use_wide_evidence=False, step_scale=0.12)
    return moved_lanes
