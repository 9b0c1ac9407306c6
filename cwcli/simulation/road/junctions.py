"""On-ramps and exits on the right of the lane: tapers, lanes that begin and end, dividing lines and gores.

An exit, seen in the direction of driving (an on-ramp is the same backwards):

- the edge line leaves the lane over a taper, until a lane has room beside it,
- that lane goes on beside the own one for some length, or not at all (then the taper leads to the ramp at once), with
  broad short dashes between the two; along the taper too, or nothing is painted there,
- at the gore the own lane's solid line begins again, and the ramp leaves between two solid lines.

Lengths: MUTCD (2009, section 3B.09) asks for tapers of width x speed, 238 m for a lane of 3.66 m at 105 km/h; AASHTO's
Green Book gives parallel exits 55 to 90 m, RAA 2008 60 m, and 250 m for the lane beside. Dashes: RMS 6 m and 3 m,
MUTCD 0.9 m and 2.7 m (section 3A.06), others 1 m and 1 m; all broader than lane lines.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cwcli.simulation.road.defects import with_free_left_lane
from cwcli.simulation.road.scene import Marking, RoadScene

JUNCTION_KINDS = ("none", "exits", "merges")
"""Kinds of junctions that `--set junctions` takes."""
TAPER_LENGTH_RANGE_M = (60.0, 240.0)
"""Shortest and longest taper, m; from the design guides above."""
AUXILIARY_LANE_LENGTH_RANGE_M = (100.0, 250.0)
"""Shortest and longest lane beside the own one, m; the longest is that of RAA 2008, the shortest is chosen by hand."""
AUXILIARY_LANE_CHANCE = 0.7
"""Chance that a lane beside the own one follows the taper. Chosen by hand (docs/road-renderer.md)."""
UNPAINTED_TAPER_CHANCE = 0.5
"""Chance that nothing is painted between the lane and a taper. Chosen by hand (docs/road-renderer.md)."""
RAMP_LENGTH_PER_OFFSET_RANGE = (12.0, 25.0)
"""Smallest and largest length over which a ramp leaves by one metre, m. Chosen by hand (docs/road-renderer.md)."""
RAMP_END_OFFSET_M = 8.0
"""Offset from the lane at which a ramp ends, because it has turned away, m. Chosen by hand (docs/road-renderer.md)."""
PLAIN_ROAD_BEFORE_JUNCTION_RANGE_M = (60.0, 200.0)
"""Shortest and longest plain road before each junction, m. Chosen by hand (docs/road-renderer.md)."""
DIVIDING_LINE_DASH_AND_GAP_LENGTHS_M = ((6.0, 3.0), (1.0, 1.0), (0.9, 2.7))
"""Lengths of dash and gap of dividing lines, m: RMS, others, MUTCD (above)."""
DIVIDING_LINE_WIDTH_RANGE_M = (0.2, 0.3)
"""Smallest and largest width of dividing lines, m: all broader than lane lines. Chosen by hand
(docs/road-renderer.md)."""
SHOULDER_WIDTH_RANGE_M = (0.5, 2.5)
"""Smallest and largest width of the pavement right of the junction's lines, m. Chosen by hand; not fitted."""
LENGTH_OVER_WHICH_RAMP_PAVEMENT_ENDS_M = 10.0
"""Length over which the pavement of a ramp ends, m. Chosen by hand; not fitted."""


def add_junctions_to_scene(scene: RoadScene, kind: str, length_m: float, rng: np.random.Generator) -> RoadScene:
    """The scene with exits or on-ramps one after the other on its right, a lane on its left, and no other cars.

    Args:
        kind: none, exits or merges.
        length_m: Length of the road.
    """
    if kind == "none":
        return scene
    scene = with_free_left_lane(scene)
    width_m, right_m = scene.lane_width_m, scene.right.offset_m
    solid = replace(scene.right, dash_m=(0.0, 0.0), is_double=False)
    shoulder_m = rng.uniform(*SHOULDER_WIDTH_RANGE_M)
    lines: list[Marking] = []
    painted, edge = [-math.inf], [(0.0, right_m)]
    begin_m = rng.uniform(*PLAIN_ROAD_BEFORE_JUNCTION_RANGE_M)
    while begin_m < length_m:
        taper_m = rng.uniform(*TAPER_LENGTH_RANGE_M)
        gore_m = taper_m + (
            rng.uniform(*AUXILIARY_LANE_LENGTH_RANGE_M) if rng.random() < AUXILIARY_LANE_CHANCE else 0.0
        )
        end_m = gore_m + RAMP_END_OFFSET_M * rng.uniform(*RAMP_LENGTH_PER_OFFSET_RANGE)
        inner = ((gore_m, 0.0), (end_m, RAMP_END_OFFSET_M))
        outer = ((0.0, 0.0), (taper_m, width_m), (gore_m, width_m), (end_m, width_m + RAMP_END_OFFSET_M))
        divided_m = (taper_m if rng.random() < UNPAINTED_TAPER_CHANCE else 0.0, gore_m)
        start, sign = (begin_m, 1.0) if kind == "exits" else (begin_m + end_m, -1.0)
        for line in (inner, outer):
            path = sorted((start + sign * along_m, right_m - beside_m) for along_m, beside_m in line)
            lines.append(replace(solid, path_m=tuple(path), painted_stretches_m=((path[0][0], path[-1][0]),)))
        edge += [
            (path[0][0] - LENGTH_OVER_WHICH_RAMP_PAVEMENT_ENDS_M, right_m),
            *path,
            (path[-1][0] + LENGTH_OVER_WHICH_RAMP_PAVEMENT_ENDS_M, right_m),
        ]
        if divided_m[1] > divided_m[0]:
            low_m, high_m = sorted(start + sign * along_m for along_m in divided_m)
            dash_m = DIVIDING_LINE_DASH_AND_GAP_LENGTHS_M[
                int(rng.integers(0, len(DIVIDING_LINE_DASH_AND_GAP_LENGTHS_M)))
            ]
            lines.append(
                replace(
                    solid,
                    width_m=rng.uniform(*DIVIDING_LINE_WIDTH_RANGE_M),
                    dash_m=dash_m,
                    painted_stretches_m=((low_m, high_m),),
                )
            )
        painted += sorted((start, start + sign * gore_m))
        begin_m += end_m + rng.uniform(*PLAIN_ROAD_BEFORE_JUNCTION_RANGE_M)
    painted.append(math.inf)
    return replace(
        scene,
        right=replace(solid, painted_stretches_m=tuple(zip(painted[::2], painted[1::2], strict=True))),
        others=(*(each for each in scene.others if each.offset_m > right_m), *lines),
        right_edge_m=right_m - width_m - RAMP_END_OFFSET_M - shoulder_m,
        right_edge_path_m=tuple((station_m, offset_m - shoulder_m) for station_m, offset_m in edge),
        rail_right_m=math.nan,
    )
