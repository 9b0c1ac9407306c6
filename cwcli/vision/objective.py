"""The block responses of zhang2011's objective (eq. 2, 3; tables 1, 2), for every place a block can have in a frame.

The paper leaves three things open, its fig. 2 being lost in the text; the choices (docs/papers/zhang2011-lanes.md):

- T_j is the magnitude of the difference between the two parts of the block, each of three pixels; the line between them
  is left out. So both edges of a marking score, and the fitness on the roulette wheel is rarely negative. The print
  has neither bars nor a direction of the difference.
- The mean road grey is the mean of a patch in front of the car: the lowest 60 rows, columns 101 to 220.
- Centres lie in rows 2, 5, ..., 149 from the bottom, so that 50 blocks tile the lower 150 rows.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.kernels import lane_search
from cwcli.lazy_dataclass import dataclass
from cwcli.vision.method import GreyImage

PAPER_WIDTH_PX, PAPER_HEIGHT_PX = 320, 240
"""Size of the paper's image in pixels."""
N_BOUNDARY_BLOCKS = 50
"""Number of blocks along a boundary (zhang2011): they tile the lower 150 rows."""
ROAD_PATCH_ROWS = 60
"""Height of the road patch in rows, from the image's bottom. The paper does not give it. Chosen by hand; not fitted."""
ROAD_PATCH_COLUMNS = (100, 220)
"""First column of the road patch, and the column after its last one. The paper does not give them. Chosen by hand; not
fitted."""

# The kernel holds these numbers; a test compares it with them.
BLOCK_WEIGHTS_TENTHS = ((4, 6, 0), (2, 5, 3), (2, 5, 3))
"""Weights of the paper's tables 1 and 2 in tenths: alpha, beta of the diagonal, beta of T3 (second row: b > 2) or T4
(third: b < 0.5)."""

Int32Array = npt.NDArray[np.int32]
ResponseArray = npt.NDArray[np.int16]


@dataclass(frozen=True)
class BlockResponses:
    """alpha dM + sum of beta_j T_j of every block, for the left (eq. 2) and the right boundary (eq. 3).

    Attributes:
        left, right: Shape (3, 50, 320), int16, in 1/90 grey level: by slope class (|b| 0.5 to 2, above 2, below 0.5),
            row of blocks from the bottom, column of the centre. The outermost columns hold zeros.
    """

    left: ResponseArray
    right: ResponseArray


def compute_block_responses(grey: GreyImage) -> BlockResponses:
    """Compute the responses of all blocks of a frame.

    Args:
        grey: Shape (240, 320), uint8.

    Raises:
        ValueError: Another shape.
    """
    if grey.shape != (PAPER_HEIGHT_PX, PAPER_WIDTH_PX):
        raise ValueError(f"the image has shape {grey.shape} instead of {(PAPER_HEIGHT_PX, PAPER_WIDTH_PX)}")
    return BlockResponses(
        *lane_search.block_responses(np.ascontiguousarray(grey), nine_times_mean_road_grey(grey), N_BOUNDARY_BLOCKS)
    )


def nine_times_mean_road_grey(grey: GreyImage) -> int:
    """Nine times the mean grey level of the patch in front of the car, to the nearest whole number."""
    patch = grey[PAPER_HEIGHT_PX - ROAD_PATCH_ROWS :, ROAD_PATCH_COLUMNS[0] : ROAD_PATCH_COLUMNS[1]]
    total, n = int(patch.sum(dtype=np.int64)), patch.size
    return (2 * 9 * total + n) // (2 * n)
