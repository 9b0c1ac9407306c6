"""Both boundaries of one frame together: ridges of a marking's width, a scan, and a refinement. Deterministic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Protocol

import numpy as np
import numpy.typing as npt

from cwcli.kernels import lane_ridge, lane_stripes
from cwcli.signals.arcs import Pinhole
from cwcli.signals.columns import FloatArray
from cwcli.vision.camera import Camera
from cwcli.vision.ground import MIN_DEPTH
from cwcli.vision.lane_mean import mean_lane
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
    LanePrior,
)
from cwcli.vision.method import GreyImage
from cwcli.vision.vanishing import vanishing_point

Float32Array = npt.NDArray[np.float32]
Int32Array = npt.NDArray[np.int32]

ROW_STEP = 0.5
N_SEGMENTS = 9
MAX_ROWS = 150
COUNT: FloatArray = np.arange(float(MAX_ROWS))
WINDOWS = (0.04, 0.085, 0.08)
"""The window of a stripe over the camera's height is 6 cm: narrower than any marking, as wide as a small raised dot."""
FLOOR_GREY, RELATIVE, ROUGH = 3.0, 0.085, 2.0
LOPSIDED = 0.3
JOINT_WINDOWS = (0.025, 0.03, 0.06)
"""Of the joint between two strips of concrete, and of the shadow of a raised dot: dark, and narrower than a marking."""
JOINT_CROWDED = 0.02
"""A row of concrete has a few joints; a rough one has many dark stripes, and none of them counts."""
JOINT_WEIGHT = 0.12
"""Of a joint against a stripe."""
JOINT_REACH = 0.08
"""Over the camera's height: joints are laid where lanes meet, and markings and dots some centimetres beside them."""
BESIDE = 0.5
HALF = 0.3
DEAD = 0.25
CROWDED = 0.07
PRIOR_WEIGHT = 0.02
SCAN_STEP = 3
"""Only every so many-th judged row is scanned."""
PLACE_STEP = 0.06
MAX_PLACES = 400
"""To each side: a camera less than 0.4 m above the road sees a lane of very many of its heights."""
N_KEPT = 12
SAME_PLACE = 0.15
"""Over the camera's height: lanes whose boundaries lie nearer are one lane."""
SAME_HORIZON_PX = 1.0
INNER_SHIFTS = np.concatenate([[0.0], np.arange(0.08, 0.29, 0.02)])
"""Over the camera's height: where the inner stripe of a double marking may be."""
INNER_SHARE = 0.5
INNER_LEAST = 0.15
VP_HORIZON = 0.015
VP_COLUMN = 0.02


@dataclass(frozen=True)
class Evidence:
    """Where a frame shows stripes.

    Attributes:
        rows: Shape (n,): sampled rows from the top.
        sharp, wide, broad: Shape (n, width), 0 to 1; `wide` and `broad` are the greatest values near by.
        horizon_px: For which stripes' widths were taken.
        min_h: Rows less than this below a lane's horizon are not judged.
        pinhole: Of the camera.
    """

    rows: Int32Array
    sharp: Float32Array
    wide: Float32Array
    broad: Float32Array
    horizon_px: float
    min_h: float
    pinhole: Pinhole

    def scoring(self, *, beside: float = BESIDE) -> lane_ridge.Scoring:
        """How lanes are judged on it; `beside`: weight of the neighbouring lanes' boundaries."""
        segment = len(self.rows) // N_SEGMENTS
        return {
            "prior_weight": PRIOR_WEIGHT,
            "min_h": self.min_h,
            "beside": beside,
            "half": HALF * segment,
            "segment": segment,
            "centre": self.pinhole.centre_px,
            "focal": self.pinhole.focal_px,
        }


def rows_of(top_px: float, height_px: int) -> Int32Array:
    """Rows that are judged, evenly spaced from the top to the bottom of the road."""
    last = height_px - 2.0
    top = min(max(float(top_px), 0.0), last - 2.0 * N_SEGMENTS)
    n = min(max(int(ROW_STEP * (last - top)), 2 * N_SEGMENTS), MAX_ROWS)
    step = (last - top) / (n - 1)  # more than one row
    return np.rint(top + step * COUNT[:n]).astype(np.int32)


class Look(Protocol):
    """What makes the evidence of a frame; see `evidence_of`."""

    def __call__(
        self,
        grey: GreyImage,
        rows: Int32Array,
        horizon_px: float,
        pinhole: Pinhole,
        room: Float32Array | None = None,
        *,
        with_joints: bool = False,
    ) -> Evidence:
        """The evidence in some rows."""


def reaches(width_px: int) -> tuple[int, int]:
    """Columns to each side from which `Evidence.wide` and `broad` take the greatest value."""
    return max(1, round(width_px / 320)), max(2, round(width_px / 128))


@lru_cache(maxsize=8)
def _stripe_of(stretch: float, *, is_joint: bool = False) -> lane_stripes.Stripe:
    """How stripes, or joints, are told, with windows for fx / fy."""
    inner, gap, side = (stretch * each for each in (JOINT_WINDOWS if is_joint else WINDOWS))
    return {
        "inner": inner,
        "gap": gap,
        "side": side,
        "floor_grey": FLOOR_GREY,
        "relative": RELATIVE,
        "rough": ROUGH,
        "lopsided": LOPSIDED,
        "dead": DEAD,
        "crowded": JOINT_CROWDED if is_joint else CROWDED,
    }


def evidence_of(
    grey: GreyImage,
    rows: Int32Array,
    horizon_px: float,
    pinhole: Pinhole,
    room: Float32Array | None = None,
    *,
    with_joints: bool = False,
) -> Evidence:
    """Stripes of the frame for a horizon.

    Args:
        grey, rows: The frame, and the rows that are judged.
        horizon_px: For which stripes' widths are taken.
        pinhole: Of the camera.
        room: Shape (3 `MAX_ROWS` width,): filled and looked into by the result; None: new memory.
        with_joints: Joints count as well.
    """
    height, width = grey.shape
    size = 3 * len(rows) * width
    evidence = (np.empty(size, np.float32) if room is None else room[:size]).reshape(3, len(rows), width)
    reach, broad_reach = reaches(width)
    lane_stripes.stripes(
        np.ascontiguousarray(grey),
        rows,
        horizon_px,
        _stripe_of(pinhole.stretch),
        _stripe_of(pinhole.stretch, is_joint=True),
        joint_weight=JOINT_WEIGHT if with_joints else 0.0,
        joint_reach=JOINT_REACH * pinhole.stretch,
        reach=reach,
        broad_reach=broad_reach,
        evidence=evidence,
    )
    return Evidence(rows, evidence[0], evidence[1], evidence[2], horizon_px, MIN_DEPTH * height, pinhole)


def scan(evidence: Evidence, prior: LanePrior, width_px: int, height_px: int) -> tuple[FloatArray, FloatArray]:
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
    most = (1.5 if BESIDE else 0.5) * table[WIDTH, HIGH] + max(abs(table[MIDDLE, LOW]), abs(table[MIDDLE, HIGH]))
    place_step = max(PLACE_STEP, most / MAX_PLACES)
    n = int(np.ceil(most / place_step))
    places: FloatArray = np.asarray(place_step * (np.arange(-n, n) + 0.5), np.float64)
    depths: FloatArray = np.asarray(evidence.rows - evidence.horizon_px, np.float64)
    depths[depths < evidence.min_h] = -1.0
    best = lane_ridge.scan(
        evidence.wide,
        np.ascontiguousarray(table),
        evidence.scoring(),
        depths=depths,
        step=SCAN_STEP,
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
    value = best[..., 0].ravel() - PRIOR_WEIGHT * z * z
    order = np.argsort(-value, kind="stable")
    return lanes.reshape(-1, 6)[order], value[order]


def refined(
    evidence: Evidence,
    lanes: FloatArray,
    table: FloatArray,
    size: tuple[int, int],
    *,
    wide: bool,
    scale: float = 1.0,
    beside: float = BESIDE,
) -> tuple[FloatArray, FloatArray]:
    """Lanes after a pattern search from each, and their objective.

    Args:
        evidence, lanes: Lanes have shape (k, 6) or (6,).
        table: Of the prior (`LanePrior.table`).
        size: Width and height of the image.
        wide: Use the widened evidence.
        scale: Of the first steps.
        beside: Weight of the neighbouring lanes' boundaries.
    """
    width_px, height_px = size
    made = np.array(lanes, np.float64, ndmin=2)
    horizon = float(made[0, HORIZON]) if len(made) == 1 else float(made[:, HORIZON].mean())
    depth = height_px - horizon
    near, far, down = 0.012 * scale * width_px, 0.008 * scale * width_px, 0.008 * scale * height_px
    spiral = far if table[SPIRAL, LOW] < table[SPIRAL, HIGH] else 0.0
    steps = np.array([near, near, far, far, down, spiral])
    value = lane_ridge.refine(
        evidence.wide if wide else evidence.sharp,
        evidence.broad,
        evidence.rows,
        made,
        table,
        evidence.scoring(beside=beside),
        near_v=horizon + 0.6 * depth,
        far_v=horizon + 0.15 * depth,
        steps=steps,
        halvings=4 if wide else 6,
    )
    return made, value


def judged(evidence: Evidence, lanes: FloatArray, table: FloatArray) -> FloatArray:
    """Objective of lanes, the neighbouring lanes' boundaries included."""
    return lane_ridge.objective(evidence.sharp, evidence.broad, evidence.rows, lanes, table, evidence.scoring())


def widely_best(evidence: Evidence, lanes: FloatArray, table: FloatArray) -> FloatArray:
    """The lane (6,) of several (k, 6) that has the greatest objective on widened evidence, without neighbours."""
    scoring = evidence.scoring(beside=0.0)
    value = lane_ridge.objective(evidence.wide, evidence.broad, evidence.rows, lanes, table, scoring)
    return np.asarray(lanes[int(value.argmax())])


def distinct(lanes: FloatArray, n: int) -> FloatArray:
    """Up to n of the lanes, in their order, that are none of those taken before (`is_same`)."""
    taken: list[FloatArray] = []
    for lane in lanes:
        if not any(is_same(lane, other) for other in taken):
            taken.append(lane)
            if len(taken) == n:
                break
    return np.array(taken)


def is_same(lane: FloatArray, other: FloatArray) -> bool:
    """Whether neither boundary of two lanes differs by more than `SAME_PLACE`, nor their horizon by a row."""
    _, middle, width, _, horizon, _ = lane.tolist()
    _, other_middle, other_width, _, other_horizon, _ = other.tolist()
    apart = abs(middle - other_middle) + 0.5 * abs(width - other_width)  # of the boundary that differs more
    return bool(apart <= SAME_PLACE and abs(horizon - other_horizon) <= SAME_HORIZON_PX)


def with_vanishing_point(grey: GreyImage, prior: LanePrior) -> LanePrior:
    """The prior with the horizon, and where a straight lane would vanish, from the lines of the frame."""
    height, width = grey.shape
    point = vanishing_point(grey, float(prior.table[VANISHING, MEAN]))
    if point is None:
        return prior
    table = prior.table.copy()
    table[HORIZON] = point.v_px, VP_HORIZON * height, point.v_px - 0.05 * height, point.v_px + 0.05 * height
    sigma = VP_COLUMN * width
    table[VANISHING] = point.u_px, sigma, point.u_px - 5.0 * sigma, point.u_px + 5.0 * sigma
    return prior.with_table(table)


def acquire(
    grey: GreyImage, camera: Camera, prior: LanePrior, look: Look = evidence_of
) -> tuple[FloatArray, FloatArray, Evidence]:
    """The lanes that a frame supports best, knowing nothing but the prior.

    Args:
        grey: Of the camera's size.
        camera: The camera.
        prior: Its horizon must be narrow (`with_vanishing_point`).
        look: Makes the evidence.

    Returns:
        Shape (k, 6) and (k,): the mean of the lanes around the best one (`lane_mean`), the others, best first by paint
        and joints, and the objective of each by paint alone; and the evidence of paint at the best one's horizon.
    """
    height, width = grey.shape
    row = prior.table[HORIZON]
    horizons = row[MEAN] + row[SIGMA] * np.array([-1.5, 0.0, 1.5])
    rows = rows_of(row[MEAN] + MIN_DEPTH * height, height)
    starts: list[FloatArray] = []
    values: list[FloatArray] = []
    for horizon in horizons.tolist():
        evidence = look(grey, rows, horizon, prior.pinhole)
        lanes, _ = scan(evidence, prior, width, height)
        lanes, value = refined(evidence, distinct(lanes[:60], 4), prior.table, (width, height), wide=True)
        starts.append(lanes)
        values.append(value)
    lanes, value = np.concatenate(starts), np.concatenate(values)
    lanes = distinct(lanes[np.argsort(-value, kind="stable")], N_KEPT)
    evidence = look(grey, rows, float(lanes[0, HORIZON]), prior.pinhole, with_joints=True)
    for wide in (True, False):
        lanes, _ = refined(evidence, lanes, prior.table, (width, height), wide=wide, scale=1.0 if wide else 0.5)
    lanes = innermost(evidence, lanes, prior, (width, height))
    lanes = lanes[np.argsort(-judged(evidence, lanes, prior.table), kind="stable")]
    lanes[0] = mean_lane(partial(judged, evidence, table=prior.table), lanes[0], prior.table, (width, height))
    evidence = look(grey, rows, float(lanes[0, HORIZON]), prior.pinhole)
    return lanes, judged(evidence, lanes, prior.table), evidence


def glance(
    evidence: Evidence, prior: LanePrior, size: tuple[int, int], known: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Other lanes that a frame supports at a known horizon and under a narrow prior of direction and bend.

    Args:
        evidence, prior, size: As elsewhere.
        known: The lanes that are followed: none of them comes back.

    Returns:
        As `acquire`: lanes and objective; there may be none.
    """
    lanes = _unknown(distinct(scan(evidence, prior, *size)[0], 2), known)
    if len(lanes):
        lanes, _ = refined(evidence, lanes, prior.table, size, wide=True)
        lanes, _ = refined(evidence, lanes, prior.table, size, wide=False, scale=0.5)
        lanes = _unknown(innermost(evidence, lanes, prior, size), known)
    return lanes, judged(evidence, lanes, prior.table)


def _unknown(lanes: FloatArray, known: Sequence[FloatArray]) -> FloatArray:
    return lanes[[not any(is_same(lane, other) for other in known) for lane in lanes]]


def innermost(evidence: Evidence, lanes: FloatArray, prior: LanePrior, size: tuple[int, int]) -> FloatArray:
    """Lanes whose boundaries are moved to the inner stripe of a double marking, where there is one."""
    shifts = INNER_SHIFTS * prior.pinhole.stretch
    made = np.array(lanes)
    for lane in made:
        for sign in (1.0, -1.0):
            own = lane[MIDDLE] - 0.5 * sign * lane[WIDTH]
            values = lane_ridge.along(evidence.sharp, evidence.rows, lane, own + sign * shifts, evidence.scoring())
            mean = np.maximum(values, 0.0).mean(axis=1)
            k = 1 + int(mean[1:].argmax())
            if mean[k] > INNER_SHARE * max(mean[0], INNER_LEAST) and mean[: k + 1].min() < 0.5 * mean[k]:
                lane[MIDDLE] += 0.5 * sign * shifts[k]
                lane[WIDTH] -= shifts[k]
        # (the following search has short steps: it can't jump back)
    made, _ = refined(evidence, made, prior.table, size, wide=False, scale=0.12)
    return made
