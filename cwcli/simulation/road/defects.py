"""Optional difficulties of real roads for lane methods.

They are mountain bends, ramps, lane changes, shadows of bridges, concrete's joints and raised dots. All are drawn from
a random stream of their own, so that a drive without them stays as it is.
"""

from __future__ import annotations

import math
from dataclasses import field, replace

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.simulation.drivers import SwayingDriver
from cwcli.simulation.road.scene import Light, Marking, Patch, RoadScene, Shadow

MARKING_KINDS = ("painted", "dashed", "dots")
"""Kinds of the own lane's markings that `--set markings` takes."""
DASH_AND_GAP_M = (6.0, 9.0)
"""Length of a dash and of the gap after it, m; motorways of China (GB 5768.3)."""
DOT_AND_GAP_M = (0.12, 3.6)
"""Length of a raised dot and of the gap after it, m. Chosen by hand (docs/road-renderer.md)."""
RAISED_DOT_WIDTH_M = 0.1
"""Width of a raised dot, m. Chosen by hand; not fitted."""
CURVATURE_KNOT_SPACING_OF_BENDS_AND_RAMPS_M = 5.0
"""Distance of the stations at which bends and ramps give the curvature, m. Chosen by hand; not fitted."""
MEAN_BEND_SPACING_M = 70.0
"""Mean distance from the middle of one mountain bend to that of the next, m. Chosen by hand; not fitted."""
DURATIONS_BEFORE_INTO_ROUND_AND_OUT_OF_ROAD_RAMP_S = (6.0, 2.5, 5.0, 2.5)
"""Durations of the parts of a ramp, s: straight on, into the ramp, round it, out of it. Chosen by hand
(docs/road-renderer.md)."""
LANE_CHANGE_DURATION_S = 5.0
"""Duration of a lane change, s. Chosen by hand (docs/road-renderer.md)."""
BRIDGE_SHADOW_LENGTH_RANGE_M = (8.0, 25.0)
"""Smallest and largest length of a bridge's shadow along the road, m. Chosen by hand (docs/road-renderer.md)."""
SLAB_JOINT_LENGTH_M = 0.05
"""Length of the joint between two concrete slabs along the road, m. Chosen by hand; not fitted."""
PAVED_SHOULDER_WIDTH_M = 1.0
"""Width of the pavement beyond the markings of the added lane, m. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class LaneChangingDriver(SwayingDriver):
    """Sways in the lane, and changes to the next one at given times.

    Attributes:
        lane_change_start_s: When each change begins; the first leads to the left, the second back, and so on.
        lane_width_m: Lateral distance of a lane change.
    """

    lane_change_start_s: tuple[float, ...] = field(default=())
    lane_width_m: float = 3.6

    def wanted_offset_m(self, time_s: float) -> float:
        """Offset from the middle of the first lane that the driver wants at a time, m."""
        wish = super().wanted_offset_m(time_s)
        for number, start_s in enumerate(self.lane_change_start_s):
            share = min(max((time_s - start_s) / LANE_CHANGE_DURATION_S, 0.0), 1.0)
            wish += self.lane_width_m * (1 - 2 * (number % 2)) * 0.5 * (1.0 - math.cos(math.pi * share))
        return wish


def draw_lane_change_times_s(per_min: float, duration_s: float, rng: np.random.Generator) -> tuple[float, ...]:
    """Draw the times at which lane changes begin, s: even ones, each moved by up to a quarter of their distance."""
    if per_min <= 0.0:
        return ()
    apart_s = 60.0 / per_min
    starts = np.arange(0.5 * apart_s, duration_s - LANE_CHANGE_DURATION_S, apart_s)
    return tuple((starts + rng.uniform(-0.25, 0.25, len(starts)) * (apart_s - LANE_CHANGE_DURATION_S)).tolist())


def draw_mountain_curvature_1pm(knots_m: FloatArray, bend_1pm: float, rng: np.random.Generator) -> FloatArray:
    """Draw the curvature at stations (k,), 1/m, of bends to the left and right in turn, up to `bend_1pm`."""
    n = math.ceil((knots_m[-1] - knots_m[0]) / (0.6 * MEAN_BEND_SPACING_M))
    middles = knots_m[0] + np.cumsum(rng.uniform(0.6, 1.4, n) * MEAN_BEND_SPACING_M)
    heights = bend_1pm * rng.uniform(0.4, 1.0, n) * (-1.0) ** np.arange(n)
    return np.asarray(np.interp(knots_m, middles, heights))


def draw_ramp_curvature_1pm(
    knots_m: FloatArray, yaw_rate_radps: float, speed_mps: float, rng: np.random.Generator
) -> FloatArray:
    """Draw the curvature at stations (k,), 1/m, of ramps to random sides with straights between them.

    On a ramp the car turns at the given yaw rate and speed.
    """
    bounds_m = np.cumsum(DURATIONS_BEFORE_INTO_ROUND_AND_OUT_OF_ROAD_RAMP_S) * speed_mps
    period_m = float(bounds_m[-1])
    turns = np.floor(np.maximum(knots_m, 0.0) / period_m).astype(np.intp)
    signs = rng.choice([-1.0, 1.0], int(turns.max()) + 1)
    shape = np.interp(np.maximum(knots_m, 0.0) - turns * period_m, [*bounds_m], [0.0, 1.0, 1.0, 0.0])
    return np.asarray(signs[turns] * shape * yaw_rate_radps / speed_mps)


def with_marking_kind(scene: RoadScene, kind: str) -> RoadScene:
    """The scene with another kind of markings at its own lane's boundaries."""
    if kind == "painted":
        return scene

    def change_kind(marking: Marking) -> Marking:
        if kind == "dots":
            return replace(
                marking, dash_m=DOT_AND_GAP_M, width_m=RAISED_DOT_WIDTH_M, remaining_paint_share=1.0, is_double=False
            )
        return replace(marking, dash_m=DASH_AND_GAP_M)

    return replace(scene, left=change_kind(scene.left), right=change_kind(scene.right))


def with_free_left_lane(scene: RoadScene) -> RoadScene:
    """The scene with a free lane to the left, beyond a dashed boundary."""
    width_m = scene.lane_width_m
    beyond = 1.5 * width_m
    others = scene.others
    if not any(abs(each.offset_m - beyond) < 0.1 for each in others):
        others = (*others, replace(scene.right, offset_m=beyond))
    return replace(
        scene,
        left=replace(scene.left, dash_m=DASH_AND_GAP_M, is_double=False),
        others=others,
        left_edge_m=max(scene.left_edge_m, beyond + PAVED_SHOULDER_WIDTH_M),
        rail_left_m=max(scene.rail_left_m, beyond + PAVED_SHOULDER_WIDTH_M + 0.5),
        vehicles=(),
    )


def with_bridge_shadows(scene: RoadScene, per_km: float, road_length_m: float, rng: np.random.Generator) -> RoadScene:
    """The scene with shadows of bridges across the road."""
    n = round(per_km * road_length_m / 1000.0)
    if not n:
        return scene
    starts, lengths, slants = (
        rng.uniform(0.0, road_length_m, n),
        rng.uniform(*BRIDGE_SHADOW_LENGTH_RANGE_M, n),
        rng.normal(0.0, 0.3, n),
    )
    bands = tuple(Shadow(*each) for each in zip(starts.tolist(), lengths.tolist(), slants.tolist(), strict=True))
    light: Light = replace(scene.light, shadows=(*scene.light.shadows, *bands), shadow_depth=rng.uniform(0.3, 0.45))
    return replace(scene, light=light)


def with_concrete_joints(scene: RoadScene, slab_m: float, road_length_m: float, rng: np.random.Generator) -> RoadScene:
    """The scene on concrete slabs: brighter, with a sealed joint across the road after each, and joints along it.

    The joints along the road lie up to half a metre inside the markings, dark with a light edge where the concrete
    broke. A lane method may take them for markings.
    """
    if slab_m <= 0.0:
        return scene
    grey = scene.asphalt * rng.uniform(1.2, 1.35)
    along: list[Marking] = []
    for side in (-1.0, 1.0):
        at = side * (0.5 * scene.lane_width_m - rng.uniform(0.25, 0.55))
        along.append(Marking(at, rng.uniform(0.02, 0.04), grey=0.55 * grey))
        along.append(Marking(at + 0.04, rng.uniform(0.02, 0.04), grey=1.15 * grey, dash_m=(2.0, 7.0)))
    low, high = scene.right_edge_m, scene.left_edge_m
    across = tuple(
        Patch(station, SLAB_JOINT_LENGTH_M, 0.5 * (low + high), high - low, grey_ratio=0.65, seam=False)
        for station in np.arange(rng.uniform(0.0, slab_m), road_length_m, slab_m).tolist()
    )
    return replace(scene, asphalt=grey, others=(*along, *scene.others), patches=(*scene.patches, *across))


def with_own_lane_at_offset(scene: RoadScene, offset_m: float) -> RoadScene:
    """The scene with the lane at an offset as the own lane: its boundaries become the left and the right one."""
    lane_m = scene.lane_width_m * round(offset_m / scene.lane_width_m)
    if lane_m == 0.0:
        return scene
    lines = (scene.left, scene.right, *scene.others)
    left, right = (
        min(lines, key=lambda line: abs(line.offset_m - lane_m - side * 0.5 * scene.lane_width_m))
        for side in (1.0, -1.0)
    )
    others = tuple(line for line in lines if line is not left and line is not right)
    return replace(scene, left=left, right=right, others=others, lane_m=lane_m)
