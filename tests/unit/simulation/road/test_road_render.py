"""Rendered frames: paint where the truth says, shares of pixels, repeatability, conditions, sets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.simulation.road.camera import camera_of_zhang2011, wide_camera
from cwcli.simulation.road.conditions import DRAW_FUNCTION_BY_WEATHER
from cwcli.simulation.road.geometry import RoadAhead
from cwcli.simulation.road.names import WEATHER_NAMES
from cwcli.simulation.road.paint import paint_marking
from cwcli.simulation.road.render import RoadFrame, compute_frame_truth, render_frame
from cwcli.simulation.road.rows import compute_road_rows
from cwcli.simulation.road.scene import Light, Marking, RoadScene, SceneVehicle
from cwcli.simulation.road.sets import FRAME_SETS
from cwcli.simulation.road.surface import asphalt_texture, remaining_paint_texture_and_mean
from tests.set_frames import CURVATURE_RATE_OFFSET_AND_HEADING, clothoid_curvature_1pm, render_set_frame

WIDTH_M = 3.6
CAMERA = camera_of_zhang2011()


def scene(**more: object) -> RoadScene:
    made = RoadScene("clear", WIDTH_M, Marking(WIDTH_M / 2), Marking(-WIDTH_M / 2), right_edge_m=-4.0, left_edge_m=4.0)
    return replace(made, **more)  # type: ignore[arg-type]


def make(made: RoadScene, road: RoadAhead | None = None, seed: int = 1) -> RoadFrame:
    return render_frame(
        made, CAMERA, road or RoadAhead(clothoid_curvature_1pm(0.0), 0.0, 0.0), np.random.default_rng(seed)
    )


def painted(marking: Marking, road: RoadAhead) -> tuple[np.ndarray, np.ndarray]:
    """Share of paint of every pixel, and the rows."""
    rows = compute_road_rows(CAMERA, road)
    image = np.zeros(rows.map_u.shape, np.float32)
    paint_marking(image, rows, replace(marking, grey=1.0), gain=1.0)
    return image, rows.v_px


@pytest.mark.parametrize("curvature", [-0.0015, 0.0, 0.0015])
def test_paint_has_its_centre_on_the_truth_and_its_exact_width(curvature: float) -> None:
    road = RoadAhead(clothoid_curvature_1pm(curvature), 0.2, 0.005)
    image, v = painted(Marking(WIDTH_M / 2, width_m=0.15), road)
    x_m = road.distance_of_rows_m(CAMERA, v.astype(float))
    u = road.line_column_at_distance_px(CAMERA, WIDTH_M / 2, x_m)
    width_px = CAMERA.fx * 0.15 / CAMERA.depth_along_optical_axis_m(x_m, CAMERA.height_m)
    inside = (u > 12) & (u < 307) & (x_m < 60)
    share = image[inside]
    assert inside.sum() > 80
    np.testing.assert_allclose(share.sum(axis=1), width_px[inside], rtol=0.02)
    centre = (share * np.arange(320)).sum(axis=1) / share.sum(axis=1)
    np.testing.assert_allclose(centre, u[inside], atol=0.06)


def test_dashes_cover_their_share_of_the_road() -> None:
    road = RoadAhead(clothoid_curvature_1pm(0.0), 0.0, 0.0)
    solid, v = painted(Marking(WIDTH_M / 2), road)
    dashed, _ = painted(Marking(WIDTH_M / 2, dash_m=(6.0, 9.0), phase_m=20.0), road)
    x_m = road.distance_of_rows_m(CAMERA, v.astype(float))
    share = dashed.sum(axis=1) / np.maximum(solid.sum(axis=1), 1e-9)
    np.testing.assert_allclose(share[(x_m > 21) & (x_m < 25)], 1.0, atol=1e-4)  # 20 to 26 m is painted
    np.testing.assert_allclose(share[(x_m > 27) & (x_m < 34)], 0.0, atol=1e-4)  # 26 to 35 m is not
    # Rows near the horizon cover many periods: 6 of 15 m.
    np.testing.assert_allclose(share[(x_m > 250) & (x_m < 380)].mean(), 0.4, atol=0.12)


def test_double_marking_is_centred_on_its_inner_stripe() -> None:
    road = RoadAhead(clothoid_curvature_1pm(0.0), 0.0, 0.0)
    single, v = painted(Marking(WIDTH_M / 2), road)
    double, _ = painted(Marking(WIDTH_M / 2, is_double=True), road)
    assert (double >= single - 1e-6).all()
    # The second stripe lies one width (0.15 m) apart: its centre is 0.30 m farther out. Row 80 of the road: about 21 m.
    columns, row = np.arange(320), 80
    x_m = road.distance_of_rows_m(CAMERA, v[row : row + 1].astype(float))
    apart_px = CAMERA.fx * 0.30 / CAMERA.depth_along_optical_axis_m(x_m, CAMERA.height_m)[0]
    centres = [np.average(columns, weights=stripe[row]) for stripe in (single, double - single)]
    assert centres[0] - centres[1] == pytest.approx(apart_px, abs=0.1)
    assert double[row].sum() == pytest.approx(2 * single[row].sum(), rel=0.02)


def test_worn_paint_keeps_its_share() -> None:
    roads = [
        RoadAhead(clothoid_curvature_1pm(0.0), 0.0, 0.0, station_m=station) for station in np.arange(0.0, 100.0, 5.0)
    ]
    for level in (0.45, 0.75):
        worn = [painted(Marking(-WIDTH_M / 2, remaining_paint_share=level), road)[0].sum() for road in roads]
        new = [painted(Marking(-WIDTH_M / 2), road)[0].sum() for road in roads]
        assert sum(worn) / sum(new) == pytest.approx(level, abs=0.04)


def test_texture_mean_over_a_whole_period_is_zero_and_wear_levels_hold() -> None:
    start = np.array([0.0, 13.7])
    period = 2048 * 0.05
    np.testing.assert_allclose(asphalt_texture().mean_over_stretches(start, start + period), 0.0, atol=1e-4)
    assert remaining_paint_texture_and_mean(0.6)[1].mean() == pytest.approx(0.6, abs=0.01)


def test_markings_are_brighter_than_the_road_at_the_truth_and_asphalt_has_its_grey() -> None:
    made = make(scene(asphalt=95.0))
    truth = made.truth
    rows = np.flatnonzero(truth.right_visible & (truth.x_m < 40))
    at = made.grey[rows, np.round(truth.right_u_px[rows]).astype(int)].astype(float)
    beside = made.grey[rows, np.round(truth.right_u_px[rows] - 4 * truth.right_half_width_px[rows] - 2).astype(int)]
    assert (at - beside).mean() > 60
    assert made.grey[180:240, 120:200].mean() == pytest.approx(95, abs=15)


def test_same_seed_same_frame_and_another_seed_another_noise() -> None:
    assert np.array_equal(make(scene()).grey, make(scene()).grey)
    assert not np.array_equal(make(scene()).grey, make(scene(), seed=2).grey)


def test_vehicle_hides_the_boundary_behind_it() -> None:
    # A car 20 m ahead, from 0.9 to 2.7 m to the left. The line at 1.8 m passes behind it up to 40 m (1.8 * 20 / 40 =
    # 0.9), and under its bumper (0.16 m) one sees the road to 22.2 m.
    blocked = scene(vehicles=(SceneVehicle(20.0, WIDTH_M / 2),))
    road = RoadAhead(clothoid_curvature_1pm(0.0), 0.0, 0.0)
    truth = compute_frame_truth(blocked, CAMERA, road)
    beyond = (truth.x_m > 23) & (truth.x_m < 38)
    before = (truth.x_m < 19.5) & (truth.left_u_px > 0)
    assert not truth.left_visible[beyond].any()
    assert truth.left_visible[before].all()
    assert truth.right_visible[beyond].all()
    rendered = make(blocked, road).truth
    assert np.array_equal(rendered.left_visible, truth.left_visible)


@pytest.mark.parametrize("name", DRAW_FUNCTION_BY_WEATHER)
def test_every_condition_renders_and_leaves_the_geometry_alone(name: str) -> None:
    rng = np.random.default_rng(4)
    made = make(DRAW_FUNCTION_BY_WEATHER[name](scene(), rng))
    assert made.grey.dtype == np.uint8
    assert 3 < made.grey.mean() < 230
    np.testing.assert_array_equal(made.truth.left_u_px, make(scene()).truth.left_u_px)


def test_names_for_the_command_line_are_the_registry() -> None:
    assert tuple(DRAW_FUNCTION_BY_WEATHER) == WEATHER_NAMES
    for spec in FRAME_SETS.values():
        assert set(spec.conditions) <= set(DRAW_FUNCTION_BY_WEATHER)
        assert sum(spec.conditions.values()) == pytest.approx(1.0)


def contrast(grey: np.ndarray) -> float:
    """Of the right marking against the road beside it, at 35 to 45 m of the straight road."""
    truth = compute_frame_truth(scene(), CAMERA, RoadAhead(clothoid_curvature_1pm(0.0), 0.0, 0.0))
    rows = np.flatnonzero((truth.x_m > 35) & (truth.x_m < 45))
    u = truth.right_u_px[rows]
    return float((grey[rows, np.round(u).astype(int)] - grey[rows, np.round(u - 9).astype(int)]).mean())


def test_conditions_do_what_they_say() -> None:
    clear = make(scene()).grey.astype(float)
    night = make(scene(light=Light(night=True))).grey.astype(float)
    fog = make(scene(light=Light(fog_1pm=0.03))).grey.astype(float)
    glare = make(scene(light=Light(glare=120.0))).grey.astype(float)
    dapple = make(scene(light=Light(dapple=1.0, shadow_depth=0.4))).grey.astype(float)
    assert night[:60].mean() < 30 < clear[:60].mean()
    assert contrast(fog) == pytest.approx(contrast(clear) * np.exp(-0.03 * 40), rel=0.35)
    assert glare.mean() > clear.mean() + 20
    assert dapple[150:].mean() < clear[150:].mean() - 10


@pytest.mark.parametrize("name", FRAME_SETS)
def test_frames_of_a_set_do_not_depend_on_each_other_and_stay_in_their_limits(name: str) -> None:
    spec = FRAME_SETS[name]
    for index in (0, 7):
        one, again = render_set_frame(name, index), render_set_frame(name, index)
        assert np.array_equal(one.grey, again.grey)
        truth = one.truth
        assert abs(truth.lateral_offset_m) <= CURVATURE_RATE_OFFSET_AND_HEADING[name][1][1]
        assert abs(truth.curvature_1pm) <= spec.curvature_1pm[1] + 1e-12
        assert spec.lane_width_m[0] <= truth.lane_width_m <= spec.lane_width_m[1]
        assert truth.left_visible.sum() > 20
        assert truth.right_visible.sum() > 20
    assert not np.array_equal(render_set_frame(name, 0).grey, render_set_frame(name, 0, seed=1).grey)


@pytest.mark.parametrize("camera", [camera_of_zhang2011(64, 48), wide_camera(1280, 720)], ids=["small", "720p"])
def test_other_sizes_render(camera: object) -> None:
    made = render_set_frame("complex", 1, camera=camera)  # type: ignore[arg-type]
    assert made.grey.shape == (camera.height_px, camera.width_px)  # type: ignore[attr-defined]
