"""The paper's camera for lane methods, and the score of a fit on a rendered frame."""

from __future__ import annotations

import numpy as np

from cwcli.metrics.lane_scores import BoundaryColumns, VisualScore, visual_standard_score
from cwcli.simulation.road.camera import camera_of_zhang2011
from cwcli.simulation.road.truth import LaneTruth
from cwcli.vision.camera import Camera, Mounting
from cwcli.vision.method import LaneFit

SEARCHED_ROWS = 150


def mounted() -> Camera:
    """320 x 240, with its mounting."""
    paper = camera_of_zhang2011()
    mounting = Mounting(height_m=paper.height_m, pitch_rad=paper.pitch_rad)
    return Camera(320, 240, paper.fx, paper.fy, paper.cx, paper.cy, mounting=mounting)


def score(fit: LaneFit, truth: LaneTruth) -> VisualScore:
    """zhang2011's visual standard; what is not found is wrong."""
    y_px = 240.0 - np.arange(240.0)
    low = y_px <= SEARCHED_ROWS
    u = [side.x_px(y_px) - 1.0 if side.found else np.full(240, np.nan) for side in (fit.left, fit.right)]
    return visual_standard_score(
        BoundaryColumns(u[0], truth.left_u_px, truth.left_visible & low),
        BoundaryColumns(u[1], truth.right_u_px, truth.right_visible & low),
    )
