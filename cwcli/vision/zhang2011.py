"""The lane boundaries of zhang2011, exactly: objective eq. 2, 3; coding eq. 4, 5; genetic search in three phases.

The image is squeezed to 320 x 240 whatever its aspect ratio: the regions and the 150 searched rows belong to that size.
"""

from __future__ import annotations

from functools import cache
from math import nan

import numpy as np

from cwcli.kernels import lane_search
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.vision.boundary import BOUNDARY_NOT_FOUND, Boundary
from cwcli.vision.camera import WidthHeightPx
from cwcli.vision.method import LaneFit, LaneFrame, Method
from cwcli.vision.objective import (
    PAPER_HEIGHT_PX,
    PAPER_WIDTH_PX,
    BlockResponses,
    ResponseArray,
    compute_block_responses,
)

CROSSOVER_PROBABILITY = 0.45
"""Probability with which two chromosomes are crossed (zhang2011)."""
MUTATION_PROBABILITY = 0.05
"""Probability with which a chromosome is mutated (zhang2011)."""
ROULETTE_SHIFT_GREY = 50.0
"""Grey levels that are added to the fitness on the roulette wheel: F can be negative, a field of the wheel can't.
Chosen by hand (docs/papers/zhang2011-lanes.md)."""
MIN_BOUNDARY_BLOCKS_OF_CANDIDATE_INSIDE_IMAGE = 25
"""Least number of its 50 blocks that a candidate must show: the mean of a few blocks on a bright spot beats any road.
Chosen by hand; not fitted."""
PARAMETER_DECIMALS = (4, 2, 0)
"""Number of decimals of a, b and c (zhang2011)."""
FIRST_SEARCH_RANGES_OF_LEFT_BOUNDARY = ((-0.005, 0.005), (0.3, 2.3), (-100.0, 150.0))
"""Search ranges of a (1/pixel), b and c (pixels) of the left boundary u = a v^2 + b v + c in the first phase, in images
of 320 x 240 pixels (zhang2011)."""
FIRST_SEARCH_RANGES_OF_RIGHT_BOUNDARY = ((-0.005, 0.005), (-2.3, -0.3), (200.0, 450.0))
"""Search ranges of a (1/pixel), b and c (pixels) of the right boundary u = a v^2 + b v + c in the first phase, in
images of 320 x 240 pixels (zhang2011)."""

_MASK_64 = (1 << 64) - 1
"""Mask of a 64-bit number."""


@dataclass(frozen=True)
class SearchPhase:
    """Settings of one of the three phases.

    Attributes:
        bits: Length of the strings of a, b, c (table 3).
        generations: g_max (table 4).
        region_half_widths: Half widths of the region around the previous result; None: the first frame's region.
    """

    bits: tuple[int, int, int]
    generations: int
    region_half_widths: tuple[float, float, float] | None


FIRST_PHASE = SearchPhase((7, 8, 8), 180, None)
"""Phase of a first frame (zhang2011, tables 3 and 4)."""
SECOND_PHASE = SearchPhase((6, 7, 7), 120, (0.003, 0.6, 60.0))
"""Phase of the second to the sixth frame (zhang2011, tables 3 and 4)."""
LATER_PHASE = SearchPhase((5, 5, 5), 25, (0.001, 0.15, 15.0))
"""Phase of all later frames (zhang2011, tables 3 and 4)."""


@cache
def genetic_settings(phase: SearchPhase) -> lane_search.Genetic:
    """The kernel's settings for a phase."""
    a, b, c = (10.0**m for m in PARAMETER_DECIMALS)
    return {
        "bits": phase.bits,
        "decimals": (a, b, c),
        "generations": phase.generations,
        "crossover_rate": CROSSOVER_PROBABILITY,
        "mutation_rate": MUTATION_PROBABILITY,
        "wheel_shift": ROULETTE_SHIFT_GREY,
        "with_centre": phase.region_half_widths is not None,
        "min_blocks": MIN_BOUNDARY_BLOCKS_OF_CANDIDATE_INSIDE_IMAGE,
    }


def phase_after_frames(n_before: int) -> SearchPhase:
    """The phase of a frame that follows `n_before` frames of the same run."""
    if n_before == 0:
        return FIRST_PHASE
    return SECOND_PHASE if n_before < 6 else LATER_PHASE


def count_parameter_bits(low: float, high: float, decimals: int) -> int:
    """Number of bits that code a parameter: the k of 2^(k-1) < (high - low) 10^m < 2^k (eq. 4)."""
    steps = round((high - low) * 10**decimals)
    return int(steps).bit_length()


def decode_chromosome_to_a_b_c(
    code: str, low_abc: FloatArray, high_abc: FloatArray, n_bits_abc: tuple[int, int, int]
) -> tuple[float, float, float]:
    """Decode a chromosome to a, b and c (eq. 5), each rounded to its decimals.

    Args:
        code: Zeros and ones: the strings of a, b and c.
        low_abc, high_abc: Shape (3,): the region.
        n_bits_abc: Their lengths.
    """
    return lane_search.decode_code(int(code, 2), low_abc, high_abc, genetic_settings(SearchPhase(n_bits_abc, 0, None)))


def cross_chromosomes(first: str, second: str, cut_places: tuple[int, int, int]) -> tuple[str, str]:
    """Cross two chromosomes: exchange the second and fourth of the segments that three points cut."""
    n = len(first)
    differing = (int(first, 2) ^ int(second, 2)) & lane_search.crossover_mask(*cut_places, n)
    return f"{int(first, 2) ^ differing:0{n}b}", f"{int(second, 2) ^ differing:0{n}b}"


def mutate_chromosome(code: str, bit_index: int) -> str:
    """Change the bit at `bit_index` of a chromosome, counted from 0 at the left."""
    return f"{int(code, 2) ^ lane_search.mutation_mask(bit_index, len(code)):0{len(code)}b}"


def search_boundary(
    responses: ResponseArray,
    phase: SearchPhase,
    previous: Boundary,
    *,
    is_left: bool,
    seed: int,
    stream: int,
) -> Boundary:
    """Search one boundary of one frame.

    Args:
        phase: Bits, generations and region.
        previous: The boundary in the frame before; not used in the first phase.
        seed, stream: Seed and stream of the random numbers, 0 to 2^64 - 1 and 0 to 2^63 - 1.
    """
    if phase.region_half_widths is None:
        region = np.array(FIRST_SEARCH_RANGES_OF_LEFT_BOUNDARY if is_left else FIRST_SEARCH_RANGES_OF_RIGHT_BOUNDARY)
        low, high = np.ascontiguousarray(region[:, 0]), np.ascontiguousarray(region[:, 1])
    else:
        centre, reach = np.array([previous.a, previous.b, previous.c]), np.array(phase.region_half_widths)
        low, high = centre - reach, centre + reach
    (a, b, c), score = lane_search.search(
        responses,
        low,
        high,
        genetic_settings(phase),
        is_left=is_left,
        seed_state=seed & _MASK_64,
        seed_stream=stream,
    )
    return Boundary(a, b, c, score, nan, True) if score > 0.0 else BOUNDARY_NOT_FOUND


class Zhang2011Search:
    """Both boundaries over the frames of one camera; each side has its own phase.

    The paper does not say what happens when there is nothing to see. Here a boundary whose objective is not positive is
    'not found', and its search begins again with the first phase. The random numbers of a frame depend on the seed, the
    frame's number and the side alone.

    Args:
        seed: Seed of all random numbers.
    """

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._last = [BOUNDARY_NOT_FOUND, BOUNDARY_NOT_FOUND]
        self._n_before = [0, 0]

    def step(self, frame: LaneFrame) -> LaneFit:
        """Find both boundaries in the next frame (320 x 240)."""
        prepared = frame.prepared
        both = prepared if isinstance(prepared, BlockResponses) else compute_block_responses(frame.grey)
        for side, responses in enumerate((both.left, both.right)):
            boundary = search_boundary(
                responses,
                phase_after_frames(self._n_before[side]),
                self._last[side],
                is_left=side == 0,
                seed=self._seed,
                stream=2 * frame.number + side,
            )
            self._last[side] = boundary
            self._n_before[side] = self._n_before[side] + 1 if boundary.found else 0
        return LaneFit(self._last[0], self._last[1])


def search_size(width_px: int, height_px: int) -> WidthHeightPx:
    """The paper's image size, whatever the camera's."""
    return PAPER_WIDTH_PX, PAPER_HEIGHT_PX


METHOD = Method(
    summary="the paper's genetic search on 320 x 240",
    search_size=search_size,
    make=Zhang2011Search,
    prepare=compute_block_responses,
)
"""The registered lane method of zhang2011."""
