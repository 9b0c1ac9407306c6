"""The small drawings of tracks in the table of many logs."""

from __future__ import annotations

import re
from importlib import resources

import numpy as np
import pytest

from cwcli.report.thumbnail import HEIGHT_PX, MAX_THUMBNAIL_POINTS, WIDTH_PX, build_track_svg_path


def points(path: str) -> list[tuple[int, int]]:
    assert re.fullmatch(r"M\d+ \d+(L\d+ \d+)*", path)
    return [(int(x), int(y)) for x, y in (each.split() for each in path[1:].split("L"))]


def test_north_is_up_and_both_axes_have_one_scale() -> None:
    """100 m east, then 50 m north: 52 px (56 less a margin of 2 on each side) and half of it, about the middle."""
    x, y = np.r_[np.linspace(0, 100, 51), np.full(25, 100.0)], np.r_[np.zeros(51), np.linspace(2, 50, 25)]
    drawn = points(build_track_svg_path(x, y))
    assert (drawn[0], drawn[-1]) == ((2, 31), (54, 5))
    assert (54, 31) in {(px, round((py + 1) / 2) * 2 - 1) for px, py in drawn}  # the corner, to a pixel
    assert len(drawn) <= MAX_THUMBNAIL_POINTS


@pytest.mark.parametrize("n", [2, 100_000])
def test_a_thumbnail_is_small_and_inside_its_frame(n: int) -> None:
    rng = np.random.default_rng(5)
    path = build_track_svg_path(np.cumsum(rng.normal(0, 9, n)) + 4e5, np.cumsum(rng.normal(0, 9, n)) + 5e6)
    assert len(path) <= 6 * MAX_THUMBNAIL_POINTS
    assert all(0 <= x <= WIDTH_PX and 0 <= y <= HEIGHT_PX for x, y in points(path))


@pytest.mark.parametrize(
    "x_m",
    [np.zeros(0), np.zeros(1), np.full(9, 3.0), np.full(9, np.nan), np.array([0.0, np.inf]), np.linspace(0, 0.9, 5)],
    ids=["none", "one", "standing", "unknown", "infinite", "noise"],
)
def test_no_way_is_not_drawn(x_m: np.ndarray) -> None:
    assert build_track_svg_path(x_m, np.zeros(len(x_m))) == ""


def test_positions_that_are_not_known_are_left_out() -> None:
    assert points(build_track_svg_path(np.array([0, np.nan, 10.0]), np.array([0, 5.0, 0]))) == points(
        build_track_svg_path(np.array([0, 10.0]), np.array([0, 0.0]))
    )


def test_the_page_draws_in_the_frame_of_the_thumbnail() -> None:
    template = (resources.files("cwcli.report") / "assets" / "page.html").read_text()
    assert f'<svg class="track" viewBox="0 0 {WIDTH_PX} {HEIGHT_PX}"' in template
