"""Bright stripes of a marking's width in image rows, and the dark joints beside them."""

from typing import TypedDict

import numpy as np
import numpy.typing as npt

_G = npt.NDArray[np.uint8]
_E = npt.NDArray[np.float32]
_I = npt.NDArray[np.int32]

class Stripe(TypedDict):
    """The struct of this name in lane_stripes.pyx: the windows over h, the rows below the horizon, and the noise."""

    inner: float
    gap: float
    side: float
    floor_grey: float
    relative: float
    rough: float
    lopsided: float
    dead: float
    crowded: float

def stripes(
    grey: _G,
    rows: _I,
    horizon_v: float,
    stripe: Stripe,
    joint: Stripe,
    *,
    joint_weight: float,
    joint_reach: float,
    reach: int,
    broad_reach: int,
    evidence: _E,
) -> None:
    """Evidence of a stripe centred at each pixel of some rows, and the greatest evidence near by.

    Each pixel of a row counts as the brightest of it, the one above and the one below, if the inner window is at least
    two pixels wide: farther away a boundary moves as much as that from row to row.

    The mean of a window of a marking's width, minus the greater mean of the windows on both sides, minus a share of
    their difference, is the contrast C; C^2 / (C^2 + N^2) with the noise N = floor + relative * side + rough * (mean
    depth of dark stripes in the row), above a dead zone, is the evidence. It is divided by 1 + (mean of the row /
    crowded)^2: where every other pixel looks like a stripe, none counts.

    Joints are dark: their evidence is that of `joint` in the negative of the row itself, N with the grey of the darker
    side. The greatest within `joint_reach` h columns counts `joint_weight` times, where it is more than the stripe's.

    Args:
        grey: Shape (height, width).
        rows: Shape (n,): from the top.
        horizon_v: Row of the horizon; windows grow with the rows h below it.
        stripe, joint: The windows and the noise.
        joint_weight: 0 to 1; 0: joints are not looked for.
        joint_reach: Times h.
        reach, broad_reach: Columns to each side for the greatest values; the second is not the smaller one.
        evidence: Shape (3, n, width): filled, 0 to 1: the evidence, the greatest within `reach` columns, and within
            `broad_reach`.
    """
