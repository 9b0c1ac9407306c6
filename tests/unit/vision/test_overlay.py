"""Where the lines lie in the camera's image."""

from __future__ import annotations

import numpy as np

from cwcli.vision.boundary import BOUNDARY_NOT_FOUND, Boundary
from cwcli.vision.boundary_lines import BoundaryLines
from cwcli.vision.method import LaneFit
from cwcli.vision.overlay import boundary_points_in_image, draw_boundaries, encode_jpeg
from tests.unit.vision.fit_lists import columns_of

STRAIGHT = Boundary(0.0, 1.0, 10.0, 1.0, 1.0, True)
RIGHT = Boundary(0.0, -1.0, 318.0, 1.0, 1.0, True)


def lines_of(fits: list[LaneFit], top_px: float = 90.0) -> BoundaryLines:
    """Parabolas in a search image of 240 rows."""
    n = len(fits)
    return BoundaryLines(columns_of(fits).parabolas, np.full((n, 2, 4), np.nan), np.full(n, np.nan), np.full(n, top_px))


def test_points_lie_on_the_boundary_in_the_pixels_of_the_camera() -> None:
    points, is_in = boundary_points_in_image(lines_of([LaneFit(STRAIGHT, RIGHT)]), (320, 240), (1280, 720))
    u, v = points[0, 0].T
    # x = y + 10 in search pixels: u_search = x - 1, v_search = 240 - y; centres of pixels scale by 4 and 3.
    y_px = 240 - ((v + 0.5) / 3 - 0.5)
    x_px = (u + 0.5) / 4 - 0.5 + 1
    np.testing.assert_allclose(x_px, y_px + 10, atol=1e-9)
    assert y_px[0] == 1.0
    assert is_in[0].all()


def test_lines_end_at_the_top_the_edge_and_where_they_meet() -> None:
    fits = [LaneFit(STRAIGHT, RIGHT), LaneFit(STRAIGHT, Boundary(0.0, -1.0, 100.0, 1.0, 1.0, True))]
    points, is_in = boundary_points_in_image(lines_of(fits, top_px=150.0), (320, 240), (320, 240))
    assert points[0, :, -1, 1].tolist() == [150.0, 150.0]
    met = points[1, :, :, 1][is_in[1]]
    assert met.min() > 240 - 45 - 1  # x = y + 10 and x = 100 - y meet at y = 45
    beside = lines_of([LaneFit(Boundary(0.0, 0.0, 900.0, 1.0, 1.0, True), RIGHT)])
    assert not boundary_points_in_image(beside, (320, 240), (320, 240))[1][0, 0].any()


def test_points_are_dense_enough_for_a_bend() -> None:
    """500 m of radius, f = 500 px, a camera 1.2 m up: between the points the line is off by less than a pixel."""
    lines = BoundaryLines(
        np.full((1, 2, 3), np.nan),
        np.array([[[300.0, -1.4, 300.0, 0.0], [300.0, 1.5, 300.0, 0.0]]]),
        np.array([100.0]),
        np.array([111.0]),
    )
    points, _ = boundary_points_in_image(lines, (640, 360), (640, 360))
    u_px, v_px = points[0, 0, ::-1].T
    rows_px = np.arange(111.0, 359.0)
    true_px = lines.columns_at_heights_px(360.0 - rows_px[None], 360.0)[0, 0] - 1.0
    assert np.abs(np.interp(rows_px, v_px, u_px) - true_px).max() < 1.0


def test_missing_boundary_has_no_line_and_leaves_the_other() -> None:
    _, is_in = boundary_points_in_image(lines_of([LaneFit(BOUNDARY_NOT_FOUND, RIGHT)]), (320, 240), (320, 240))
    assert not is_in[0, 0].any()
    assert is_in[0, 1].all()


def test_burnt_in_line_changes_pixels_along_it_and_nothing_else() -> None:
    image = np.full((240, 320, 3), 90, np.uint8)
    drawn = draw_boundaries(image, [np.array([[20.0, 200.0], [100.0, 100.0]]), np.zeros((0, 2))])
    assert (image == 90).all()
    changed = np.argwhere((drawn != 90).any(axis=2))
    distance_px = np.abs((changed[:, 0] - 200) * 80 + (changed[:, 1] - 20) * 100) / np.hypot(80, 100)
    assert len(changed) > 100
    assert distance_px.max() < 3.0
    assert bytes(encode_jpeg(drawn)[:2]) == b"\xff\xd8"
