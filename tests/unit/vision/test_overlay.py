"""Where the lines lie in the camera's image."""

from __future__ import annotations

import numpy as np

from cwcli.vision.boundary import NOT_FOUND, Boundary
from cwcli.vision.method import LaneFit
from cwcli.vision.overlay import burn_in, encode_jpeg, line_points
from tests.unit.vision.fit_lists import columns_of

STRAIGHT = Boundary(0.0, 1.0, 10.0, 1.0, 1.0, True)
RIGHT = Boundary(0.0, -1.0, 318.0, 1.0, 1.0, True)


def test_points_lie_on_the_boundary_in_the_pixels_of_the_camera() -> None:
    points, is_in = line_points(columns_of([LaneFit(STRAIGHT, RIGHT)]).parabolas, (320, 240), (1280, 720))
    u, v = points[0, 0].T
    # x = y + 10 in search pixels: u_search = x - 1, v_search = 240 - y; centres of pixels scale by 4 and 3.
    y_px = 240 - ((v + 0.5) / 3 - 0.5)
    x_px = (u + 0.5) / 4 - 0.5 + 1
    np.testing.assert_allclose(x_px, y_px + 10, atol=1e-9)
    assert y_px[0] == 1.0
    assert is_in[0].all()


def test_lines_end_at_the_horizon_the_edge_and_where_they_meet() -> None:
    fits = columns_of([LaneFit(STRAIGHT, RIGHT), LaneFit(STRAIGHT, Boundary(0.0, -1.0, 100.0, 1.0, 1.0, True))])
    points, is_in = line_points(fits.parabolas, (320, 240), (320, 240), np.array([150.0, np.nan]))
    assert points[0, :, :, 1].min() > 150.0
    met = points[1, :, :, 1][is_in[1]]
    assert met.min() > 240 - 45 - 1  # x = y + 10 and x = 100 - y meet at y = 45
    outside = line_points(
        columns_of([LaneFit(Boundary(0.0, 0.0, 900.0, 1.0, 1.0, True), RIGHT)]).parabolas, (320, 240), (320, 240)
    )
    assert not outside[1][0, 0].any()


def test_missing_boundary_has_no_line_and_leaves_the_other() -> None:
    _, is_in = line_points(columns_of([LaneFit(NOT_FOUND, RIGHT)]).parabolas, (320, 240), (320, 240))
    assert not is_in[0, 0].any()
    assert is_in[0, 1].all()


def test_burnt_in_line_changes_pixels_along_it_and_nothing_else() -> None:
    image = np.full((240, 320, 3), 90, np.uint8)
    drawn = burn_in(image, [np.array([[20.0, 200.0], [100.0, 100.0]]), np.zeros((0, 2))])
    assert (image == 90).all()
    changed = np.argwhere((drawn != 90).any(axis=2))
    distance_px = np.abs((changed[:, 0] - 200) * 80 + (changed[:, 1] - 20) * 100) / np.hypot(80, 100)
    assert len(changed) > 100
    assert distance_px.max() < 3.0
    assert bytes(encode_jpeg(drawn)[:2]) == b"\xff\xd8"
