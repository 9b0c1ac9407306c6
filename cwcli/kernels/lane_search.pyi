import numpy as np
import numpy.typing as npt

_F = npt.NDArray[np.float64]
_I = npt.NDArray[np.int32]
_R = npt.NDArray[np.int16]

def block_responses(grey: npt.NDArray[np.uint8], nine_road: int, left: _R, right: _R) -> None:
    """Responses of every block for both boundaries.

    Args:
        grey: Shape (height, width), C order; three rows a block, from the bottom.
        nine_road: Nine times the mean road grey.
        left, right: Shape (3, rows of blocks, width), int16, out: see `objective`; the outermost columns are left
            alone.
    """

def objective(response: _R, parabolas: _F, is_left: bool, value: _F, n_blocks: _I) -> None:
    """Value of eq. 2 or 3 of each parabola.

    Args:
        response: Shape (3, rows, width), int16, C order: 1/90 grey level; by slope class (0.5 to 2, above, below), row
            of blocks from the bottom, and column of the block's centre.
        parabolas: Shape (n, 3): a, b, c.
        is_left: Else the right boundary: the sign of the slope is mirrored.
        value: Shape (n,), out: grey levels; -1e300 where no block lies on the image.
        n_blocks: Shape (n,), out: blocks on the image.
    """

def search(
    response: _R,
    is_left: bool,
    low: _F,
    high: _F,
    bits: _I,
    decimals: _F,
    generations: int,
    crossover_rate: float,
    mutation_rate: float,
    wheel_shift: float,
    with_centre: bool,
    min_blocks: int,
    seed_state: int,
    seed_stream: int,
    parabola: _F,
) -> float:
    """The best parabola that the genetic search finds in a region.

    Args:
        response, is_left: As in `objective`.
        low, high: Shape (3,): the region of a, b, c.
        bits: Shape (3,), int32: length of each parameter's string, 4 to 30 in all.
        decimals: Shape (3,): 10^m for m decimals, to which the parameters are rounded.
        generations: After the first population.
        crossover_rate, mutation_rate: Probability per individual, below 1.
        wheel_shift: Added to the fitness on the roulette wheel, grey levels.
        with_centre: The first individual is the middle of the region (the previous result), not a random one.
        min_blocks: A candidate with fewer blocks on the image is the worst there is; 1 at least.
        seed_state, seed_stream: Of PCG32, uint64.
        parabola: Shape (3,), out.

    Returns:
        Its objective, grey levels; -1e300 if no candidate had enough blocks.
    """

def decode_code(code: int, low: _F, high: _F, bits: _I, decimals: _F, parabola: _F) -> None:
    """A chromosome as a, b, c (eq. 5), rounded to their decimals; `parabola` is out."""

def crossover_mask(p: int, q: int, r: int, bits: int) -> int:
    """The bits that crossover exchanges: places p to q and r to the end, counted from 0 at the left."""

def mutation_mask(place: int, bits: int) -> int:
    """The bit at a place, counted from 0 at the left."""
