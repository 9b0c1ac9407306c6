"""What any search on zhang2011's objective can reach: `python tests/studies/lane_bound.py [FRAMES]`.

Every second value of a, b and c of the first frame's regions is tried (0.6 million lines for each boundary), on
independent frames of the sets. Where the best line of all is wrong, no search on this objective can be right but by
chance.
"""

from __future__ import annotations

import sys

import numpy as np

from cwcli.reproduction.zhang2011.lane_drives import is_fit_correct
from cwcli.signals.columns import FloatArray
from cwcli.simulation.road.sets import FRAME_SETS
from tests.set_frames import iter_set_frames
from cwcli.vision.boundary import Boundary
from cwcli.vision.method import LaneFit
from cwcli.vision.objective import (
    PAPER_HEIGHT_PX,
    PAPER_WIDTH_PX,
    ResponseArray,
    compute_block_responses,
)
from cwcli.vision.zhang2011 import (
    PARAMETER_DECIMALS,
    FIRST_SEARCH_RANGES_OF_LEFT_BOUNDARY,
    FIRST_SEARCH_RANGES_OF_RIGHT_BOUNDARY,
    MIN_BOUNDARY_BLOCKS_OF_CANDIDATE_INSIDE_IMAGE,
)
from tests.unit.vision.parabola_objectives import parabola_objectives

EVERY = 2


def grid(is_left: bool) -> FloatArray:
    """Shape (n, 3): a, b, c."""
    axes = [
        np.arange(round(low * 10**m), round(high * 10**m) + 1, EVERY) / 10**m
        for (low, high), m in zip(
            FIRST_SEARCH_RANGES_OF_LEFT_BOUNDARY if is_left else FIRST_SEARCH_RANGES_OF_RIGHT_BOUNDARY,
            PARAMETER_DECIMALS,
            strict=True,
        )
    ]
    return np.ascontiguousarray(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3))


def best(responses: ResponseArray, lines: FloatArray, *, is_left: bool) -> Boundary:
    """The line of the highest objective."""
    value, n_blocks = parabola_objectives(responses, lines, is_left=is_left)
    value[n_blocks < MIN_BOUNDARY_BLOCKS_OF_CANDIDATE_INSIDE_IMAGE] = -np.inf
    at = int(value.argmax())
    a, b, c = lines[at].tolist()
    return Boundary(a, b, c, float(value[at]), float("nan"), True)


def main(n_frames: int) -> None:
    """Print the shares."""
    left, right = grid(True), grid(False)
    for name in FRAME_SETS:
        right_ones = np.zeros((n_frames, 2), np.bool_)
        for k, frame in enumerate(iter_set_frames(name, n_frames)):
            both = compute_block_responses(frame.grey)
            fit = LaneFit(best(both.left, left, is_left=True), best(both.right, right, is_left=False))
            right_ones[k] = [
                is_fit_correct(frame, fit, (PAPER_WIDTH_PX, PAPER_HEIGHT_PX), by_stripe=by_stripe)
                for by_stripe in (True, False)
            ]
        shares = right_ones.mean(axis=0)
        print(
            f"{name}: {shares[0]:.1%} right by the stripe, {shares[1]:.1%} by its centre ({n_frames} frames)",
            flush=True,
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
