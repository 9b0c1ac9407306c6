"""Stripes in image rows and the pair of parallel boundaries that they support best."""

import numpy as np
import numpy.typing as npt

_G = npt.NDArray[np.uint8]
_E = npt.NDArray[np.float32]
_F = npt.NDArray[np.float64]
_I = npt.NDArray[np.int32]

def ridges(grey: _G, rows: _I, horizon_v: float, shape: _F, evidence: _E) -> None:
    """Evidence of a stripe centred at each pixel of some rows.

    The mean of a window of a marking's width, minus the greater mean of the windows on both sides, minus a share of
    their difference, is the contrast C; C^2 / (C^2 + N^2) with the noise N = floor + relative * side + rough * (mean
    depth of dark stripes in the row), above a dead zone, is the evidence. It is divided by 1 + (mean of the row /
    crowded)^2: where every other pixel looks like a stripe, none counts.

    Args:
        grey: Shape (height, width).
        rows: Shape (n,): from the top.
        horizon_v: Row of the horizon; windows grow with the rows h below it.
        shape: Width of the inner window over h, where the side windows begin, their width, floor (grey levels),
            relative, rough, share of the sides' difference, dead zone, crowded.
        evidence: Shape (n, width): filled, 0 to 1.
    """

def scan(
    evidence: _E,
    depths: _F,
    step: int,
    vanishing: _F,
    bends: _F,
    places: _F,
    prior: _F,
    weight: float,
    beside: float,
    half: float,
    segment: int,
    best: _F,
) -> None:
    """The best pair of boundaries for each vanishing point and bend.

    Args:
        evidence: Shape (n, width).
        depths: Shape (n,): rows below the horizon; not positive: not used.
        step: Only every so many-th row is used.
        vanishing, bends, places: What is tried for u0, k and m; places increase evenly and are symmetrical to 0.
        prior: Shape (5, 4).
        weight: Of a squared sigma.
        beside: Weight of the neighbouring lanes' outer boundaries.
        half: Evidence of a segment that counts one half.
        segment: Rows in a segment.
        best: Shape (len(vanishing), len(bends), 3): filled with objective, left and right place.
    """

def objective(
    evidence: _E,
    broad: _E,
    rows: _I,
    lanes: _F,
    prior: _F,
    weight: float,
    min_h: float,
    beside: float,
    half: float,
    segment: int,
    value: _F,
) -> None:
    """The objective of lanes of shape (k, 5) into `value`; -1e30 outside the prior's limits.

    For each segment of rows, and each boundary, the summed evidence e counts e / (e + half); the mean over the
    segments, minus weight times the squared distance z^2 from the prior in sigmas, is the objective; the bend counts
    z^2 / (1 + z^2 / 9). `broad` is looked up for the neighbouring lanes' boundaries.
    """

def refine(
    evidence: _E,
    broad: _E,
    rows: _I,
    near_v: float,
    far_v: float,
    steps: _F,
    halvings: int,
    prior: _F,
    weight: float,
    min_h: float,
    beside: float,
    half: float,
    segment: int,
    lanes: _F,
    value: _F,
) -> None:
    """Improve lanes of shape (k, 5) in place by a pattern search (Hooke and Jeeves 1961); their objective into `value`.

    It moves the columns of both boundaries in row near_v, the column of the middle in row far_v, the bend in pixels at
    far_v, and the horizon, by the five steps, which are halved `halvings` - 1 times.
    """

def along(evidence: _E, rows: _I, lane: _F, places: _F, min_h: float, values: _F) -> None:
    """Evidence in each row along the lines at `places` (k,), into `values` (k, n); -1 outside the image or the road."""
