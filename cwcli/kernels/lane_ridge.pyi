"""The pair of parallel boundaries that the stripes of a frame support best. A lane is u0, middle, width, k, v0, q."""

from typing import TypedDict

import numpy as np
import numpy.typing as npt

_E = npt.NDArray[np.float32]
_F = npt.NDArray[np.float64]
_I = npt.NDArray[np.int32]

VANISHING: int
MIDDLE: int
WIDTH: int
BEND: int
HORIZON: int
SPIRAL: int
MEAN: int
SIGMA: int
LOW: int
HIGH: int

class Scoring(TypedDict):
    """The struct of this name in lane_objective.pxd."""

    prior_weight: float
    min_h: float
    beside: float
    half: float
    segment: int
    centre: float
    focal: float

def scan(
    evidence: _E, prior: _F, scoring: Scoring, *, depths: _F, step: int, vanishing: _F, bends: _F, places: _F
) -> _F:
    """The best pair of boundaries for each vanishing point and bend.

    Args:
        evidence: Shape (n, width).
        prior: Shape (6, 4).
        scoring: Of `min_depth_px` the smallest of the rows that count.
        depths: Shape (n,): rows below the horizon; not positive: not used.
        step: Only every so many-th row is used.
        vanishing, bends, places: What is tried for u0, k and m; places increase evenly and are symmetrical to 0.

    Returns:
        Shape (len(vanishing), len(bends), 3): objective, left and right place.
    """

def objective(evidence: _E, broad: _E, rows: _I, lanes: _F, prior: _F, scoring: Scoring) -> _F:
    """The objective of lanes of shape (k, 6), shape (k,); -1e30 outside the prior's limits.

    For each segment of rows, and each boundary, the summed evidence e counts e / (e + half); the mean over the
    segments, minus weight times the squared distance z^2 from the prior in sigmas, is the objective; the bend counts
    z^2 / (1 + z^2 / 9). `broad` is looked up for the neighbouring lanes' boundaries.
    """

def refine(
    evidence: _E,
    broad: _E,
    rows: _I,
    lanes: _F,
    prior: _F,
    scoring: Scoring,
    *,
    near_v: float,
    far_v: float,
    steps: _F,
    halvings: int,
) -> _F:
    """Improve lanes of shape (k, 6) in place by a pattern search (Hooke and Jeeves 1961); their objective, (k,).

    It moves the columns of both boundaries in row near_v, the column of the middle in row far_v, the bend in pixels at
    far_v, the horizon, and the spiral in pixels at far_v, by the six steps, which are halved `halvings` - 1 times; a
    step of 0 leaves its number as it is.
    """

def along(evidence: _E, rows: _I, lane: _F, places: _F, scoring: Scoring) -> _F:
    """Evidence in each of n rows along the lines at `places` (k,), (k, n); -1 outside the image or the road."""

def crowd(evidence: _E, rows: _I, lane: _F, places: _F, scoring: Scoring) -> float:
    """Share of the samples along the lines at `places` (k,), one in each row, whose evidence is above zero; 0 if there
    are none in the image and at least min_h below the horizon.
    """

def supports(evidence: _E, rows: _I, lane: _F, scoring: Scoring) -> _F:
    """How much of each boundary of a lane shows paint, 0 to 1, shape (2,).

    In each segment of rows the summed evidence e counts e / (e + half); their mean, weighted by how many rows of the
    segment lie in the image and at least min_h below the horizon.
    """

def parabolas(lane: _F, *, top_y: float, height: float, width: float, min_h: float, centre: float, focal: float) -> _F:
    """a, b, c of the best parabola of each boundary of a lane, shape (2, 3); NaN where it can't be seen.

    x = a y^2 + b y + c with x and y as in `cwcli.vision.boundary`, fitted with least squares at sixteen heights, as
    many as `ground.N_SAMPLES`, spread evenly from 0.5 to 0.5 + top_y: those in the image, or all below the horizon if
    fewer than five are. `min_depth_px`, `centre` and `focal` as in `Scoring`.
    """
