"""zhang2011, first half: the worked examples, tables 1 to 4, and the three phases."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.vision.camera import Mounting, default_camera
from cwcli.vision.method import LaneFrame
from cwcli.vision.methods import METHODS
from cwcli.vision.objective import BLOCK_WEIGHTS_TENTHS
from cwcli.vision.zhang2011 import (
    CROSSOVER_PROBABILITY,
    FIRST_PHASE,
    FIRST_SEARCH_RANGES_OF_LEFT_BOUNDARY,
    FIRST_SEARCH_RANGES_OF_RIGHT_BOUNDARY,
    LATER_PHASE,
    MUTATION_PROBABILITY,
    SECOND_PHASE,
    count_parameter_bits,
    cross_chromosomes,
    decode_chromosome_to_a_b_c,
    mutate_chromosome,
    phase_after_frames,
)
from tests.unit.vision.scenes import LEFT, RIGHT, road_image

DECIMALS = (4, 2, 0)


def test_decoding_of_the_worked_example() -> None:
    low, high = (
        np.array([r[0] for r in FIRST_SEARCH_RANGES_OF_LEFT_BOUNDARY]),
        np.array([r[1] for r in FIRST_SEARCH_RANGES_OF_LEFT_BOUNDARY]),
    )
    assert decode_chromosome_to_a_b_c("01010100011100001011101", low, high, (7, 8, 8)) == (-0.0017, 0.74, -9.0)


def test_crossover_of_the_worked_example() -> None:
    # The printed second parent lost a 1: 10110001001101111100 has the 20 bits that the children need.
    children = cross_chromosomes("10101001010001011010", "10110001001101111100", (4, 13, 18))
    assert children == ("10100001001101011000", "10111001010001111110")


def test_mutation_of_the_worked_example() -> None:
    assert mutate_chromosome("011001000100110", 9) == "011001000000110"


def test_lengths_of_table_3_follow_from_eq_4() -> None:
    for region in (FIRST_SEARCH_RANGES_OF_LEFT_BOUNDARY, FIRST_SEARCH_RANGES_OF_RIGHT_BOUNDARY):
        assert (
            tuple(count_parameter_bits(*bounds, m) for bounds, m in zip(region, DECIMALS, strict=True))
            == FIRST_PHASE.bits
        )
    for phase in (SECOND_PHASE, LATER_PHASE):
        assert phase.region_half_widths is not None
        assert (
            tuple(count_parameter_bits(-r, r, m) for r, m in zip(phase.region_half_widths, DECIMALS, strict=True))
            == phase.bits
        )
    assert [sum(phase.bits) for phase in (FIRST_PHASE, SECOND_PHASE, LATER_PHASE)] == [23, 20, 15]


def test_phases_of_table_4() -> None:
    assert [phase_after_frames(n) for n in range(8)] == [FIRST_PHASE, *[SECOND_PHASE] * 5, LATER_PHASE, LATER_PHASE]
    assert [phase.generations for phase in (FIRST_PHASE, SECOND_PHASE, LATER_PHASE)] == [180, 120, 25]
    assert (CROSSOVER_PROBABILITY, MUTATION_PROBABILITY) == (0.45, 0.05)


def test_weights_of_tables_1_and_2() -> None:
    assert BLOCK_WEIGHTS_TENTHS == ((4, 6, 0), (2, 5, 3), (2, 5, 3))


@pytest.mark.parametrize("seed", range(3))
def test_both_boundaries_are_found_after_the_first_phases(seed: int) -> None:
    search = METHODS["zhang2011"].make(seed)
    camera = default_camera(320, 240, Mounting())
    fit = None
    for number in range(12):
        frame = road_image(LEFT, RIGHT, seed=number)
        fit = search.step(LaneFrame(frame, camera, 100_000_000 * number, number))
    assert fit is not None
    y_px = np.arange(1.0, 150.0)
    for boundary, truth in ((fit.left, LEFT), (fit.right, RIGHT)):
        assert boundary.found
        error_px = np.abs(boundary.x_px(y_px) - np.polyval(truth, y_px))
        assert np.mean(error_px <= 6.0) >= 0.85


def test_nothing_is_found_on_black_and_the_search_begins_again() -> None:
    search = METHODS["zhang2011"].make(0)
    camera = default_camera(320, 240, Mounting())
    black = search.step(LaneFrame(np.zeros((240, 320), np.uint8), camera, 0, 0))
    assert not black.left.found
    assert not black.right.found
    fresh = METHODS["zhang2011"].make(0)
    frame = LaneFrame(road_image(LEFT, RIGHT), camera, 1, 1)
    assert search.step(frame) == fresh.step(frame)
