"""A sharp bend is seen as sharp as it is: the first look covers every curvature that the prior allows."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.simulation.road.camera import camera_of_zhang2011
from cwcli.simulation.road.geometry import RoadAhead
from cwcli.simulation.road.render import render_frame
from cwcli.simulation.road.sets import FRAME_SETS, draw_scene
from cwcli.vision.ground import compute_lane_geometry
from cwcli.vision.lane_tracker import LaneTracker
from cwcli.vision.method import LaneFrame
from tests.set_frames import clothoid_curvature_1pm
from tests.unit.vision.fit_lists import columns_of
from tests.unit.vision.lane_scene import mounted

PREVIEW_M = 33.5
N_FRAMES = 8
MEDIAN_SHARE = 0.06


@pytest.mark.parametrize("curvature_1pm", [-0.003, 0.001, 0.003])
def test_curvature_of_a_bend(curvature_1pm: float) -> None:
    found_1pm = []
    for k in range(N_FRAMES):
        rng = np.random.default_rng(k)
        scene = draw_scene(FRAME_SETS["good"], "clear", rng)
        road = RoadAhead(clothoid_curvature_1pm(curvature_1pm, 0.0), offset_m=0.0, heading_rad=0.0, vertical_1pm=0.0)
        frame = render_frame(scene, camera_of_zhang2011(), road, rng)
        fit = LaneTracker().step(LaneFrame(frame.grey, mounted(), stamp_ns=0, number=0))
        found_1pm.append(-compute_lane_geometry(columns_of([fit]), mounted(), preview_m=PREVIEW_M).curvature_1pm[0])
    assert np.median(found_1pm) == pytest.approx(curvature_1pm, rel=MEDIAN_SHARE)
