"""Where boundaries are drawn: as roads up to the horizon that was found, else as parabolas up to the paper's rows."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.vision.boundary import BOUNDARY_NOT_FOUND, Boundary
from cwcli.vision.boundary_lines import BoundaryLines
from cwcli.vision.camera import Camera, Mounting
from cwcli.vision.ground import boundary_top_rows_px, image_hyperbolas_of_flat_road
from cwcli.vision.lane_model import fit_boundary_parabolas
from cwcli.vision.method import LaneFit
from tests.unit.vision.fit_lists import columns_of

CAMERA = Camera(640, 360, 500.0, 500.0, 319.5, 179.5, mounting=Mounting(height_m=1.2, pitch_rad=0.05))
LEVEL = np.array([315.0, 0.1, 2.9, 0.0, 100.0, 0.0])
"""u0, middle, width, bend, horizon, spiral (`lane_model`): straight, a horizon in row 100."""
BENDS_PX2 = (0.0, 150.0, -250.0)
"""500 x 500 x 1.2 / 2 = 150,000 px^2 m: radii of 1000 and 600 m."""
ATOL_PX = 1e-6


def fit_of(lane: np.ndarray) -> LaneFit:
    """What the default method publishes of a lane."""
    left, right = (Boundary(a, b, c, 0.0, 1.0, True) for a, b, c in fit_boundary_parabolas(lane, CAMERA).tolist())
    return LaneFit(left, right, pitch_rad=float(np.arctan((CAMERA.cy - lane[4]) / CAMERA.fy)))


def lines_of(*lanes: np.ndarray) -> BoundaryLines:
    fits = columns_of([fit_of(lane) for lane in lanes])
    horizon_px = CAMERA.horizon_row_px(fits.pitch_rad)
    return BoundaryLines(
        fits.parabolas,
        image_hyperbolas_of_flat_road(fits, CAMERA),
        horizon_px,
        boundary_top_rows_px(fits, CAMERA, horizon_px),
    )


@pytest.mark.parametrize("bend_px2", BENDS_PX2)
def test_road_comes_back_from_its_parabola(bend_px2: float) -> None:
    lane = LEVEL.copy()
    lane[3] = bend_px2
    lines = lines_of(lane)
    rows_px = np.arange(113.0, 340.0)
    u0, middle, width, _, horizon, _ = lane
    h = rows_px - horizon
    expected = np.stack([u0 + (middle + side * width) * h + bend_px2 / h for side in (-0.5, 0.5)]) + 1.0
    np.testing.assert_allclose(
        lines.columns_at_heights_px(360.0 - rows_px[None], 360.0)[0], expected, rtol=0, atol=ATOL_PX
    )
    parabolas = BoundaryLines(lines.parabolas, lines.roads * np.nan, lines.horizon_px, lines.top_px)
    off_px = np.abs(parabolas.columns_at_heights_px(360.0 - rows_px[None], 360.0)[0] - expected).max()
    assert (off_px > 5.0) == (bend_px2 != 0.0)  # what the parabola is off far ahead


def test_roads_end_with_the_road_at_60_m() -> None:
    """1500 px of focal length x 1.2 m / 60 m = 30 rows below a level camera's horizon; at least 3 % of 360 rows."""
    lines = lines_of(LEVEL)  # about 10 rows
    assert lines.horizon_px[0] == pytest.approx(100.0)
    assert lines.top_px[0] == pytest.approx(110.8)
    long = Camera(640, 360, 1500.0, 1500.0, 319.5, 179.5, mounting=Mounting(height_m=1.2))
    fits = columns_of([LaneFit(BOUNDARY_NOT_FOUND, BOUNDARY_NOT_FOUND, pitch_rad=0.0)])
    assert boundary_top_rows_px(fits, long, np.array([179.5]))[0] == pytest.approx(179.5 + 1500.0 * 1.2 / 60.0)


@pytest.mark.parametrize(
    ("horizon_px", "top_px"),
    [(np.nan, 135.0), (100.0, 135.0), (150.0, 160.8), (-500.0, 135.0), (900.0, 358.0)],
    ids=["not known", "above 5/8", "below 5/8", "above the image", "below the image"],
)
def test_where_the_method_finds_no_horizon_lines_end_at_five_eighths_or_below_the_mountings(
    horizon_px: float, top_px: float
) -> None:
    upright = columns_of(
        [LaneFit(Boundary(0.0, 0.0, 100.0, 1.0, 1.0, True), Boundary(0.0, 0.0, 200.0, 1.0, 1.0, True))]
    )
    roads = image_hyperbolas_of_flat_road(upright, CAMERA)
    assert np.isnan(roads).all()
    lines = BoundaryLines(
        upright.parabolas, roads, np.array([horizon_px]), boundary_top_rows_px(upright, CAMERA, np.array([horizon_px]))
    )
    assert lines.top_px[0] == pytest.approx(top_px)
    rows_px = np.arange(360.0)
    expected = np.where(rows_px >= lines.top_px[0], np.array([[100.0], [200.0]]), np.nan)
    np.testing.assert_allclose(lines.columns_at_heights_px(360.0 - rows_px[None], 360.0)[0], expected)


def test_boundaries_end_where_they_meet_in_whatever_order_the_rows_are() -> None:
    fits = columns_of([LaneFit(Boundary(0.0, 1.0, 10.0, 1.0, 1.0, True), Boundary(0.0, -1.0, 100.0, 1.0, 1.0, True))])
    nothing = np.full((1, 2, 4), np.nan)
    lines = BoundaryLines(fits.parabolas, nothing, np.array([np.nan]), np.array([90.0]))
    y_px = np.array([[60.0, 20.0, 44.0, 42.0]])  # x = y + 10 and x = 100 - y are 4 px apart at 43, and cross at 45
    assert np.isfinite(lines.columns_at_heights_px(y_px, 240.0)[0]).tolist() == [[False, True, False, True]] * 2


def test_one_boundary_alone_is_a_line() -> None:
    fit = fit_of(LEVEL)
    fits = columns_of([LaneFit(BOUNDARY_NOT_FOUND, fit.right, pitch_rad=fit.pitch_rad)])
    horizon_px = CAMERA.horizon_row_px(fits.pitch_rad)
    lines = BoundaryLines(
        fits.parabolas,
        image_hyperbolas_of_flat_road(fits, CAMERA),
        horizon_px,
        boundary_top_rows_px(fits, CAMERA, horizon_px),
    )
    found = np.isfinite(lines.columns_at_heights_px(np.linspace(1.0, 240.0, 9)[None], 360.0)[0])
    assert not found[0].any()
    assert found[1].all()
