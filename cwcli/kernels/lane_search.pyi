from typing import TypedDict

import numpy as np
import numpy.typing as npt

_F = npt.NDArray[np.float64]
_I = npt.NDArray[np.int32]
_R = npt.NDArray[np.int16]
_Abc = tuple[float, float, float]

class Genetic(TypedDict):
    """The struct of this name in lane_search.pyx: coding and settings of the search."""

    bits: tuple[int, int, int]
    decimals: _Abc
    generations: int
    crossover_rate: float
    mutation_rate: float
    wheel_shift: float
    with_centre: bool
    min_blocks: int

def block_responses(grey: npt.NDArray[np.uint8], nine_road: int, n_blocks: int) -> tuple[_R, _R]:
    """Responses of every block for the left and the right boundary.

    Args:
        grey: Shape (height, width), C order; three rows a block, from the bottom.
        nine_road: Nine times the mean road grey.
        n_blocks: Rows of blocks.

    Returns:
        Shape (3, n_blocks, width) each, int16: see `objective`; the outermost columns hold zeros.
    """

def objective(response: _R, parabolas: _F, *, is_left: bool) -> tuple[_F, _I]:
    """Value of eq. 2 or 3 of each parabola.

    Args:
        response: Shape (3, rows, width), int16, C order: 1/90 grey level; by slope class (0.5 to 2, above, below), row
            of blocks from the bottom, and column of the block's centre.
        parabolas: Shape (n, 3): a, b, c.
        is_left: Else the right boundary: the sign of the slope is mirrored.

    Returns:
        Grey levels, (n,), -1e300 where no block lies on the image; and the blocks on the image, (n,).
    """

def search(
    response: _R, low: _F, high: _F, genetic: Genetic, *, is_left: bool, seed_state: int, seed_stream: int
) -> tuple[_Abc, float]:
    """The best parabola that the genetic search finds in a region.

    Args:
        response, is_left: As in `objective`.
        low, high: Shape (3,): the region of a, b, c.
        genetic: Coding and settings.
        seed_state, seed_stream: Of PCG32, uint64.

    Returns:
        a, b, c and their objective, grey levels; -1e300 if no candidate had enough blocks.
    """

def decode_code(code: int, low: _F, high: _F, genetic: Genetic) -> _Abc:
    """A chromosome as a, b, c (eq. 5), rounded to their decimals."""

def crossover_mask(p: int, q: int, r: int, bits: int) -> int:
    """The bits that crossover exchanges: places p to q and r to the end, counted from 0 at the left."""

def mutation_mask(place: int, bits: int) -> int:
    """The bit at a place, counted from 0 at the left."""
