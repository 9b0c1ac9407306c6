"""The sets of frames: `good` and `complex`, as zhang2011 divides its tests (conclusion 1), and `hard`.

The paper gives no numbers of either set; `FRAME_SETS` is the one place that defines them here. What it does say
(section
1.2.1): in a complex environment there is much noise, and the gradient may be missing in places, but along the boundary
as a whole it is very clear. So a boundary of `good` is painted all along, and one of `complex` on more than half of
its rows; dashed lines (25 to 40 % painted) and double ones belong to `hard`, which the paper does not describe
(docs/road-renderer.md explains each value, and says which ones were set with zhang2011's results in view).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.simulation.road.conditions import DRAW_FUNCTION_BY_WEATHER
from cwcli.simulation.road.scene import Marking, Patch, RoadScene, SceneVehicle

FRAMES_PER_SET = 500
"""Number of frames of a set. Chosen by hand (docs/road-renderer.md)."""
DASH_PATTERNS_M = ((6.0, 9.0), (4.0, 6.0), (3.0, 9.0))
"""Lengths of dash and gap, m: motorways and main roads of China (GB 5768.3), US motorways."""
DASH_PATTERN_CHANCES = (0.5, 0.4, 0.1)
"""Chances of these dash patterns. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class SetSpec:
    """The distributions of a set's frames. Normal values have a sigma and a limit at which they are clipped.

    Attributes:
        conditions: Name of `DRAW_FUNCTION_BY_WEATHER` -> chance.
        curvature_1pm: Curvature of the lane: sigma, limit.
        vertical_1pm: Vertical curvature of crests and sags: sigma, limit.
        pitch_rad: Pitch of the car on its springs: sigma, limit.
        lane_width_m, marking_width_m, asphalt, paint: Lowest and highest value, even.
        min_remaining_paint_share: Lowest share of paint that is left; even up to 1.
        dashed, double: Chance that a boundary is dashed; that the left one is double.
        patches: Greatest number of repair patches; even from 0.
        cracks, tracks: Highest value; even from 0.
        vehicles: Chance of a vehicle in each of: own lane ahead, left lane, right lane.
        own_gap_m: Smallest and largest distance of the vehicle ahead in the own lane.
        rail: Chance of a guard rail on each side.
    """

    conditions: Mapping[str, float]
    curvature_1pm: tuple[float, float]
    vertical_1pm: tuple[float, float]
    pitch_rad: tuple[float, float]
    lane_width_m: tuple[float, float]
    marking_width_m: tuple[float, float]
    asphalt: tuple[float, float]
    paint: tuple[float, float]
    min_remaining_paint_share: float
    dashed: float
    double: float
    patches: int
    cracks: float
    tracks: float
    vehicles: tuple[float, float, float]
    own_gap_m: tuple[float, float]
    rail: float


_COMPLEX_SET = SetSpec(
    conditions={
        "clear": 0.16,
        "overcast": 0.10,
        "shadow": 0.22,
        "glare": 0.12,
        "rain": 0.16,
        "night": 0.12,
        "night-rain": 0.05,
        "fog": 0.07,
    },
    curvature_1pm=(0.0009, 0.002),
    vertical_1pm=(6e-5, 1.5e-4),
    pitch_rad=(0.003, 0.006),
    lane_width_m=(3.25, 3.9),
    marking_width_m=(0.10, 0.18),
    asphalt=(70.0, 125.0),
    paint=(165.0, 225.0),
    min_remaining_paint_share=0.6,
    dashed=0.0,
    double=0.0,
    patches=3,
    cracks=1.0,
    tracks=1.0,
    vehicles=(0.45, 0.45, 0.45),
    own_gap_m=(22.0, 80.0),
    rail=0.5,
)
"""The set `complex`, whose values docs/road-renderer.md explains."""

FRAME_SETS: Mapping[str, SetSpec] = MappingProxyType(
    {
        "good": SetSpec(
            conditions={"clear": 0.6, "overcast": 0.4},
            curvature_1pm=(0.0005, 0.001),
            vertical_1pm=(2e-5, 4e-5),
            pitch_rad=(0.0015, 0.003),
            lane_width_m=(3.5, 3.75),
            marking_width_m=(0.12, 0.16),
            asphalt=(80.0, 110.0),
            paint=(190.0, 225.0),
            min_remaining_paint_share=0.97,
            dashed=0.0,
            double=0.0,
            patches=0,
            cracks=0.15,
            tracks=0.5,
            vehicles=(0.2, 0.3, 0.3),
            own_gap_m=(50.0, 90.0),
            rail=0.4,
        ),
        "complex": _COMPLEX_SET,
        "hard": replace(_COMPLEX_SET, min_remaining_paint_share=0.45, dashed=0.55, double=0.15),
    }
)
"""The sets of frames by name. Their values are chosen by hand; docs/road-renderer.md explains them."""


def draw_scene(spec: SetSpec, condition: str, rng: np.random.Generator) -> RoadScene:
    """Draw markings, surface, traffic and light; the road's shape is drawn separately."""
    width_m = rng.uniform(*spec.lane_width_m)
    n_left, n_right = int(rng.integers(0, 3)), int(rng.integers(0, 2))
    left = _draw_boundary_marking(spec, width_m / 2, rng, may_be_double=True)
    right = _draw_boundary_marking(spec, -width_m / 2, rng, may_be_double=False)
    # Beyond a lane that is there, the boundary is what the next lane ends at: mostly solid at the edge.
    lefts = [_draw_boundary_marking(spec, width_m * (k + 1.5), rng, may_be_double=False) for k in range(n_left)]
    rights = [_draw_boundary_marking(spec, -width_m * (k + 1.5), rng, may_be_double=False) for k in range(n_right)]
    for row in (lefts, rights):
        if row:
            row[-1] = replace(row[-1], dash_m=(0.0, 0.0))
    left_edge = width_m * (n_left + 0.5) + rng.uniform(0.5, 2.5)
    right_edge = -width_m * (n_right + 0.5) - rng.uniform(0.5, 3.0)
    scene = RoadScene(
        condition=condition,
        lane_width_m=width_m,
        left=left,
        right=right,
        others=(*lefts, *rights),
        left_edge_m=left_edge,
        right_edge_m=right_edge,
        asphalt=rng.uniform(*spec.asphalt),
        texture=rng.uniform(0.6, 1.3),
        tracks=rng.uniform(0.0, spec.tracks),
        cracks=rng.uniform(0.0, spec.cracks),
        patches=tuple(_draw_repair_patch(width_m, rng) for _ in range(int(rng.integers(0, spec.patches + 1)))),
        vehicles=_draw_traffic(spec, width_m, n_left, n_right, rng),
        rail_left_m=left_edge + 0.5 if rng.random() < spec.rail else float("nan"),
        rail_right_m=right_edge - 0.5 if rng.random() < spec.rail else float("nan"),
        seed=int(rng.integers(0, 2**31)),
    )
    return DRAW_FUNCTION_BY_WEATHER[condition](scene, rng)


def _draw_boundary_marking(spec: SetSpec, offset_m: float, rng: np.random.Generator, *, may_be_double: bool) -> Marking:
    dash = DASH_PATTERNS_M[int(rng.choice(len(DASH_PATTERNS_M), p=DASH_PATTERN_CHANCES))]
    is_dashed = rng.random() < spec.dashed
    return Marking(
        offset_m=offset_m,
        width_m=rng.uniform(*spec.marking_width_m),
        dash_m=dash if is_dashed else (0.0, 0.0),
        is_double=bool(rng.random() < spec.double) and may_be_double,
        grey=rng.uniform(*spec.paint),
        remaining_paint_share=rng.uniform(spec.min_remaining_paint_share, 1.0),
        phase_m=rng.uniform(0.0, sum(dash)),
    )


def _draw_repair_patch(lane_width_m: float, rng: np.random.Generator) -> Patch:
    """Draw a repair patch in the own lane."""
    return Patch(
        station_m=rng.uniform(5.0, 45.0),
        length_m=rng.uniform(1.0, 8.0),
        offset_m=rng.uniform(-0.5, 0.5) * lane_width_m,
        width_m=rng.uniform(0.6, 2.5),
        grey_ratio=rng.choice([rng.uniform(0.62, 0.85), rng.uniform(1.15, 1.4)], p=[0.7, 0.3]),
        seam=bool(rng.random() < 0.6),
    )


def _draw_traffic(
    spec: SetSpec, lane_width_m: float, n_left: int, n_right: int, rng: np.random.Generator
) -> tuple[SceneVehicle, ...]:
    """Draw the vehicles ahead in the own lane and in the lanes to its left and right."""
    found = []
    places = [(0.0, spec.vehicles[0], True)]
    places += [(lane_width_m * (k + 1), spec.vehicles[1], n_left > 0) for k in range(n_left)]
    places += [(-lane_width_m * (k + 1), spec.vehicles[2], n_right > 0) for k in range(n_right)]
    for middle, chance, is_lane in places:
        if rng.random() >= chance or not is_lane:
            continue
        nearest, farthest = spec.own_gap_m if middle == 0.0 else (8.0, 70.0)
        is_lorry = rng.random() < 0.25
        found.append(
            SceneVehicle(
                ahead_m=rng.uniform(nearest, farthest),
                offset_m=middle + rng.uniform(-0.25, 0.25),
                length_m=rng.uniform(8.0, 13.0) if is_lorry else rng.uniform(4.0, 4.9),
                width_m=rng.uniform(2.3, 2.5) if is_lorry else rng.uniform(1.7, 1.9),
                height_m=rng.uniform(3.0, 3.8) if is_lorry else rng.uniform(1.4, 1.75),
                grey=rng.uniform(30.0, 225.0),
                is_oncoming=middle > lane_width_m * 1.5 and bool(rng.random() < 0.5),
                is_braking=bool(rng.random() < 0.2),
            )
        )
    return tuple(found)
