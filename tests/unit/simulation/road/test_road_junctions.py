"""On-ramps and exits: where their lines are painted, and that the truth of the lane goes on beside them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.errors import UsageError
from cwcli.simulation.road.camera import wide_camera
from cwcli.simulation.road.drive import RoadDriveConfig, plan_road_drive
from cwcli.simulation.road.geometry import ARC_LENGTH_GRID_M, RoadAhead
from cwcli.simulation.road.junctions import RAMP_END_OFFSET_M, add_junctions_to_scene
from cwcli.simulation.road.render import render_frame
from cwcli.simulation.road.scene import Marking, RoadScene
from tests.unit.simulation.road.painted_stations import painted_station_mask

PLAIN = RoadScene("clear", 3.6, Marking(1.8), Marking(-1.8))
CAMERA = wide_camera(640, 360)


def made(kind: str, seed: int = 0) -> RoadScene:
    return add_junctions_to_scene(PLAIN, kind, 2000.0, np.random.default_rng(seed))


def lines_of(scene: RoadScene) -> list[Marking]:
    return [each for each in scene.others if each.path_m]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("kind", ["exits", "merges"])
def test_a_junctions_lines_begin_and_end_on_the_lane(kind: str, seed: int) -> None:
    """The outer line leaves the boundary where its solid paint ends, the inner one where it begins again."""
    scene = made(kind, seed)
    inner, outer = lines_of(scene)[:2]
    (_, leaves_m), (returns_m, _) = scene.right.painted_stretches_m[:2]
    if kind == "exits":
        assert outer.path_m[0] == (leaves_m, -1.8)
        assert inner.path_m[0] == (returns_m, -1.8)
        assert inner.path_m[-1][1] == pytest.approx(-1.8 - RAMP_END_OFFSET_M)
        assert outer.path_m[-1][1] == pytest.approx(-1.8 - 3.6 - RAMP_END_OFFSET_M)
    else:
        assert inner.path_m[-1] == (leaves_m, -1.8)
        assert outer.path_m[-1] == (returns_m, -1.8)
        assert inner.path_m[0][1] == pytest.approx(-1.8 - RAMP_END_OFFSET_M)
        assert outer.path_m[0][1] == pytest.approx(-1.8 - 3.6 - RAMP_END_OFFSET_M)
    stations, offsets = np.transpose(outer.path_m)
    taper = slice(0, 2) if kind == "exits" else slice(-2, None)
    assert 60.0 <= np.diff(stations[taper])[0] <= 240.0
    assert abs(np.diff(offsets[taper])[0]) == pytest.approx(3.6)


def test_solid_stretches_do_not_overlap() -> None:
    for kind in ("exits", "merges"):
        bounds = np.array(made(kind).right.painted_stretches_m).ravel()
        assert (np.diff(bounds) > 0).all()
        assert len(bounds) >= 6


def test_paint_lies_on_a_taper_and_none_where_the_boundary_is_bare() -> None:
    """A line that leaves by 1 : 50 from 20 m ahead: at 40 m it is 0.4 m beside the lane's boundary."""
    leaving = Marking(-1.8, path_m=((20.0, -1.8), (70.0, -2.8)), painted_stretches_m=((20.0, 70.0),))
    scene = replace(
        PLAIN, right=replace(PLAIN.right, painted_stretches_m=((-np.inf, 20.0),)), others=(leaving,), texture=0.0
    )
    frame = render_frame(scene, CAMERA, RoadAhead(np.zeros(len(ARC_LENGTH_GRID_M)), 0.0, 0.0), np.random.default_rng(0))
    for x_m, offset_m in ((8.0, -1.8), (15.0, -1.8), (25.0, -1.9), (32.0, -2.04), (40.0, -2.2)):
        row = int(np.nanargmin(np.abs(frame.truth.x_m - x_m)))
        at_m = frame.truth.x_m[row : row + 1]
        true_u, bare_u, lane_u = (
            float(frame.truth.road.line_column_at_distance_px(CAMERA, each, at_m)[0]) for each in (offset_m, -1.8, 0.0)
        )
        near = np.arange(round(true_u) - 6, round(true_u) + 7)
        excess = np.clip(frame.grey[row, near] - float(frame.grey[row, round(lane_u)]) - 25.0, 0.0, None)
        assert excess.max() > 20.0
        assert np.sum(excess * near) / excess.sum() == pytest.approx(true_u, abs=0.7)
        if offset_m < -2.0:
            assert abs(float(frame.grey[row, round(bare_u)]) - float(frame.grey[row, round(lane_u)])) < 25.0


def test_the_lane_is_marked_but_where_a_taper_is_bare() -> None:
    right = replace(PLAIN.right, painted_stretches_m=((-np.inf, 100.0), (300.0, np.inf)))
    dividing = Marking(-1.8, dash_m=(6.0, 3.0), painted_stretches_m=((180.0, 300.0),))
    leaving = Marking(-1.8, path_m=((100.0, -1.8), (180.0, -5.4)), painted_stretches_m=((100.0, 180.0),))
    scene = replace(PLAIN, right=right, others=(dividing, leaving))
    stations = np.array([50.0, 140.0, 200.0, 400.0])
    np.testing.assert_array_equal(painted_station_mask(scene, scene.right, stations), [True, False, True, True])
    np.testing.assert_array_equal(painted_station_mask(scene, scene.left, stations), [True] * 4)


@pytest.mark.parametrize("kind", ["exits", "merges"])
def test_the_lanes_truth_goes_on_beside_a_junction(kind: str) -> None:
    config = RoadDriveConfig(seed=3, duration_s=20.0, rate_hz=2.0, junctions=kind)
    drive = plan_road_drive(config, wide_camera(320, 180))
    plain = plan_road_drive(replace(config, junctions="none"), wide_camera(320, 180))
    ahead_m = np.array([8.0, 20.0, 40.0])
    assert len(drive) == len(plain)
    for index in range(len(drive)):
        truth, without = drive.lane_truth_at(index), plain.lane_truth_at(index)
        for side in ("left", "right"):
            np.testing.assert_array_equal(truth.boundary_y_m(side, ahead_m), without.boundary_y_m(side, ahead_m))
            for name in (f"{side}_u_px", f"{side}_visible"):
                np.testing.assert_array_equal(getattr(truth, name), getattr(without, name))


def test_an_unknown_junction_is_refused() -> None:
    with pytest.raises(UsageError, match="junctions"):
        plan_road_drive(RoadDriveConfig(junctions="roundabout"), CAMERA)
