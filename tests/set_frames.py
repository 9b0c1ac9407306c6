"""Frames of the sets of `cwcli.simulation.road.sets`, each drawn on its own."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cwcli.signals.columns import FloatArray
from cwcli.simulation.road.camera import RoadCamera, camera_of_zhang2011
from cwcli.simulation.road.geometry import ARC_LENGTH_GRID_M, RoadAhead
from cwcli.simulation.road.render import RoadFrame, render_frame
from cwcli.simulation.road.sets import FRAME_SETS, FRAMES_PER_SET, draw_scene
from cwcli.simulation.streams import random_stream

CURVATURE_RATE_OFFSET_AND_HEADING = {
    "good": ((1e-6, 2e-6), (0.15, 0.35), (0.004, 0.01)),
    "complex": ((4e-6, 8e-6), (0.22, 0.5), (0.007, 0.018)),
    "hard": ((4e-6, 8e-6), (0.22, 0.5), (0.007, 0.018)),
}
"""Set -> sigma and limit of the lane's change of curvature (1/m^2), and of the car's offset (m) and heading (rad)."""


def iter_set_frames(
    name: str, n: int = FRAMES_PER_SET, *, seed: int = 0, camera: RoadCamera | None = None
) -> Iterator[RoadFrame]:
    """Render the frames of a set, each drawn on its own: frame i does not depend on n.

    Args:
        name: Name of the set: good, complex or hard.
        seed: Another seed gives another set with the same distribution.
    """
    for index in range(n):
        yield render_set_frame(name, index, seed=seed, camera=camera)


def render_set_frame(name: str, index: int, *, seed: int = 0, camera: RoadCamera | None = None) -> RoadFrame:
    """Render one frame of a set."""
    rng = random_stream(seed, "road", name, str(index))
    spec = FRAME_SETS[name]
    names, chances = list(spec.conditions), list(spec.conditions.values())
    condition = names[int(rng.choice(len(names), p=np.array(chances) / sum(chances)))]
    scene = draw_scene(spec, condition, rng)
    rate_1pm2, offset_m, heading_rad = CURVATURE_RATE_OFFSET_AND_HEADING[name]
    road = RoadAhead(
        clothoid_curvature_1pm(_draw_clipped_normal(rng, spec.curvature_1pm), _draw_clipped_normal(rng, rate_1pm2)),
        offset_m=_draw_clipped_normal(rng, offset_m),
        heading_rad=_draw_clipped_normal(rng, heading_rad),
        vertical_1pm=_draw_clipped_normal(rng, spec.vertical_1pm),
        bearing_rad=float(rng.uniform(-3, 3)),
    )
    pitched = (camera or camera_of_zhang2011()).with_added_pitch(_draw_clipped_normal(rng, spec.pitch_rad))
    return render_frame(scene, pitched, road, rng)


def _draw_clipped_normal(rng: np.random.Generator, normal: tuple[float, float]) -> float:
    """Draw from a normal distribution around 0 with (sigma, limit), clipped at the limit."""
    return float(np.clip(rng.normal(0.0, normal[0]), -normal[1], normal[1]))


def clothoid_curvature_1pm(curvature_1pm: float, rate_1pm2: float = 0.0) -> FloatArray:
    """Curvature at the grid's arc lengths that changes evenly, shape (k,), 1/m; constant beyond 150 m."""
    return np.asarray(curvature_1pm + rate_1pm2 * np.clip(ARC_LENGTH_GRID_M, None, 150.0))
