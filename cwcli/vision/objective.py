"""The block responses of zhang2011's objective (eq. 2, 3; tables 1, 2), for every place a block can have in a frame.

The paper leaves four things open, its fig. 2 being lost in the text; the choices (docs/papers/zhang2011-lanes.md):

- T_j is signed, outer part minus inner part of the block, each of three pixels; the line between them is left out. So
  the inner edge of a bright marking scores, and a dark line beside a bright road does not.
- T3 is upper minus lower, T4 is left minus right for a left boundary and right minus left for a right one.
- The mean road grey is the mean of a patch in front of the car (`ROAD_ROWS`, `ROAD_COLUMNS`).
- Centres lie in rows 2, 5, ..., 149 from the bottom, so that 50 blocks tile the lower 150 rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cwcli.signals.columns import FloatArray
from cwcli.vision.method import GreyImage

WIDTH_PX, HEIGHT_PX = 320, 240
ROWS_PX = 150
N_BLOCKS = 50
BLOCK_PX = 3
UNITS_PER_GREY = 90
ROAD_ROWS = 60
"""Rows of the road patch, from the bottom."""
ROAD_COLUMNS = (100, 220)

WEIGHTS = ((4, 6, 0), (2, 5, 3), (2, 5, 3))
"""Tables 1 and 2 in tenths: alpha, beta of the diagonal, beta of T3 (second row: b > 2) or T4 (third: b < 0.5)."""

Int32Array = npt.NDArray[np.int32]


@dataclass(frozen=True)
class BlockResponses:
    """alpha dM + sum of beta_j T_j of every block, for the left (eq. 2) and the right boundary (eq. 3).

    Attributes:
        left, right: Shape (3, 50, 320), int32, in 1/90 grey level: by slope class (|b| 0.5 to 2, above 2, below 0.5),
            row of blocks from the bottom, column of the centre. The outermost columns hold zeros.
    """

    left: Int32Array
    right: Int32Array


def block_responses(grey: GreyImage) -> BlockResponses:
    """The responses of a frame.

    Args:
        grey: Shape (240, 320), uint8.

    Raises:
        ValueError: Another shape.
    """
    if grey.shape != (HEIGHT_PX, WIDTH_PX):
        raise ValueError(f"the image has shape {grey.shape} instead of {(HEIGHT_PX, WIDTH_PX)}")
    rows = grey[HEIGHT_PX - ROWS_PX :].reshape(N_BLOCKS, BLOCK_PX, WIDTH_PX)[::-1].astype(np.int16)
    upper, middle, lower = rows[:, 0], rows[:, 1], rows[:, 2]
    left, centre, right = slice(0, -2), slice(1, -1), slice(2, None)
    columns = upper + middle + lower
    nine = (columns[:, left] + columns[:, centre] + columns[:, right]).astype(np.int32)
    # T1: above left of the diagonal / minus below right; T2: above right of \ minus below left.
    t1 = (upper[:, left] + upper[:, centre] + middle[:, left]) - (middle[:, right] + lower[:, centre] + lower[:, right])
    t2 = (upper[:, right] + upper[:, centre] + middle[:, right]) - (middle[:, left] + lower[:, centre] + lower[:, left])
    t3 = (upper[:, left] + upper[:, centre] + upper[:, right]) - (lower[:, left] + lower[:, centre] + lower[:, right])
    t4 = columns[:, left] - columns[:, right]
    contrast = nine - _nine_times_road_grey(grey)
    return BlockResponses(_weighted(contrast, t1, t3, t4), _weighted(contrast, t2, t3, -t4))


def _nine_times_road_grey(grey: GreyImage) -> int:
    patch = grey[HEIGHT_PX - ROAD_ROWS :, ROAD_COLUMNS[0] : ROAD_COLUMNS[1]]
    total, n = int(patch.sum(dtype=np.int64)), patch.size
    return (2 * 9 * total + n) // (2 * n)


def _weighted(contrast: Int32Array, diagonal: Int32Array, horizontal: Int32Array, vertical: Int32Array) -> Int32Array:
    """90 (alpha dM + beta T): 10 alpha times the sum of nine pixels, 30 beta times the difference of three."""
    made = np.zeros((len(WEIGHTS), N_BLOCKS, WIDTH_PX), np.int32)
    for k, (alpha, beta, beta_other) in enumerate(WEIGHTS):
        inner = made[k, :, 1:-1]
        np.multiply(contrast, alpha, out=inner)
        inner += 3 * beta * diagonal.astype(np.int32)
        if beta_other:
            inner += 3 * beta_other * (horizontal if k == 1 else vertical).astype(np.int32)
    return made


def objective(responses: Int32Array, parabolas: FloatArray, *, is_left: bool) -> tuple[FloatArray, Int32Array]:
    """F of eq. 2 or 3 of many parabolas.

    Args:
        responses: One array of `block_responses`.
        parabolas: Shape (n, 3): a, b, c.
        is_left: Which boundary.

    Returns:
        Grey levels, shape (n,), -inf where no block lies on the image; and the numbers of blocks, shape (n,).
    """
    from cwcli.kernels import lane_search

    value, n_blocks = np.empty(len(parabolas)), np.empty(len(parabolas), np.int32)
    lane_search.objective(responses, np.ascontiguousarray(parabolas, np.float64), is_left, value, n_blocks)
    value[n_blocks == 0] = -np.inf
    return value, n_blocks
