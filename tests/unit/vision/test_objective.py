"""The block responses against blocks that are computed one by one, and against a hand calculation."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from cwcli.vision.objective import (
    BLOCK_WEIGHTS_TENTHS,
    ROAD_PATCH_COLUMNS,
    ROAD_PATCH_ROWS,
    compute_block_responses,
    nine_times_mean_road_grey,
)
from tests.unit.vision import naive_search as naive
from tests.unit.vision.parabola_objectives import parabola_objectives

ROAD = (slice(240 - ROAD_PATCH_ROWS, 240), slice(*ROAD_PATCH_COLUMNS))


@pytest.mark.parametrize("slope", [1.0, 3.0, 0.2])
@pytest.mark.parametrize("is_left", [True, False])
def test_block_equals_the_paper_word_by_word(slope: float, is_left: bool) -> None:
    grey = np.random.default_rng(2).integers(0, 256, (240, 320)).astype(np.uint8)
    grey[ROAD] = 90  # a road grey without a remainder
    responses = compute_block_responses(grey)
    response = responses.left if is_left else responses.right
    kind = {1.0: 0, 3.0: 1, 0.2: 2}[slope]
    b = slope if is_left else -slope
    for i, column in ((0, 2), (0, 319), (49, 2), (49, 319), (20, 57), (7, 230)):
        expected = naive.block_value(grey, column, 2 + 3 * i, b, 90, is_left=is_left)
        assert Fraction(int(response[kind, i, column - 1]), 90) == expected


def test_upper_left_pixel_of_a_left_block_by_hand() -> None:
    # x = y + 9: the lowest block has its centre at x = 11, y = 2, in the array's column 10 and row 238. Its upper left
    # pixel is 150 brighter than the road: dM = 150 / 9, T1 = 150 / 3. The other 49 blocks see road only.
    grey = np.full((240, 320), 50, np.uint8)
    grey[237, 9] = 200
    value, n = parabola_objectives(compute_block_responses(grey).left, np.array([[0.0, 1.0, 9.0]]), is_left=True)
    assert n[0] == 50
    assert value[0] == pytest.approx((0.4 * 150 / 9 + 0.6 * 150 / 3) / 50, abs=1e-12)


def test_both_edges_of_a_marking_score_alike() -> None:
    # A bright stripe along x = y + 100, 12 pixels wide, on a darker road: its edges have the same gradient.
    x, y = np.arange(1, 321)[None, :], np.arange(240, 0, -1)[:, None]
    grey = np.where(np.abs(x - (y + 100)) < 6, 180, 80).astype(np.uint8)
    value, _ = parabola_objectives(
        compute_block_responses(grey).left, np.array([[0.0, 1.0, c] for c in (94.0, 106.0)]), is_left=True
    )
    assert value[0] == pytest.approx(value[1], abs=1e-12)


@pytest.mark.parametrize("extreme", [False, True])
def test_every_response_equals_its_twin(extreme: bool) -> None:
    grey = np.random.default_rng(6).integers(0, 256, (240, 320)).astype(np.uint8)
    if extreme:  # nothing overflows 16 bits
        grey = np.where(grey < 128, 0, 255).astype(np.uint8)
        grey[ROAD] = 0
    expected = naive.block_responses(grey, nine_times_mean_road_grey(grey), BLOCK_WEIGHTS_TENTHS)
    made = compute_block_responses(grey)
    np.testing.assert_array_equal(made.left, expected[0])
    np.testing.assert_array_equal(made.right, expected[1])


def test_uniform_image_scores_nothing() -> None:
    responses = compute_block_responses(np.full((240, 320), 77, np.uint8))
    assert not responses.left.any()
    assert not responses.right.any()


def test_right_is_the_mirror_image_of_left() -> None:
    grey = np.random.default_rng(3).integers(0, 256, (240, 320)).astype(np.uint8)
    grey[ROAD] = 90
    mirrored = np.ascontiguousarray(grey[:, ::-1])
    np.testing.assert_array_equal(
        compute_block_responses(grey).right, compute_block_responses(mirrored).left[:, :, ::-1]
    )


def test_other_sizes_are_refused() -> None:
    with pytest.raises(ValueError, match="shape"):
        compute_block_responses(np.zeros((480, 640), np.uint8))
