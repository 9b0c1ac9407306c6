"""Rectangles by hand, and against an independent polygon check."""

import math

import numpy as np
import pytest

from cwcli.measures.outlines import outline_separation_m, signed_outline_distance_m

CAR = (4.5, 1.8)
SQUARE = (2.0, 2.0)


def one(value: float) -> np.ndarray:
    return np.array([value])


@pytest.mark.parametrize(
    ("dx", "dy", "heading", "distance"),
    [
        (10.0, 0.0, 0.0, 5.5),  # in line: 10 - 4.5
        (0.0, 3.5, 0.0, 1.7),  # side by side: 3.5 - 1.8
        (7.5, 5.8, 0.0, 5.0),  # corner to corner: 3 and 4
        (10.0, 0.0, math.pi / 2, 6.85),  # the other across: 10 - 2.25 - 0.9
        (4.0, 0.0, 0.0, -0.5),  # overlapping by half a metre
        (4.5, 0.0, 0.0, 0.0),  # touching
    ],
)
def test_outline_distance_by_hand(dx: float, dy: float, heading: float, distance: float) -> None:
    found = signed_outline_distance_m(one(dx), one(dy), one(0.0), one(heading), CAR, CAR)
    assert found[0] == pytest.approx(distance, abs=1e-12)


def test_outline_distance_to_a_turned_corner() -> None:
    # a square on its corner: the corner reaches sqrt(2) towards the flank of the other at 1
    found = signed_outline_distance_m(one(5.0), one(0.0), one(0.0), one(math.pi / 4), SQUARE, SQUARE)
    assert found[0] == pytest.approx(5.0 - 1.0 - math.sqrt(2.0))


def test_outline_distance_against_sampled_edges() -> None:
    rng = np.random.default_rng(0)
    place = np.linspace(-0.5, 0.5, 201)
    for _ in range(30):
        dx, dy, a, b = rng.uniform(-8, 8), rng.uniform(-8, 8), rng.uniform(-4, 4), rng.uniform(-4, 4)
        edges = []
        for heading, x, y in ((a, 0.0, 0.0), (b, dx, dy)):
            frame = np.concatenate(
                [np.column_stack([place * CAR[0], np.full(201, side * CAR[1] / 2)]) for side in (-1, 1)]
                + [np.column_stack([np.full(201, side * CAR[0] / 2), place * CAR[1]]) for side in (-1, 1)]
            )
            turn = np.array([[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]])
            edges.append(frame @ turn.T + [x, y])
        sampled = np.sqrt(((edges[0][:, None] - edges[1][None]) ** 2).sum(-1)).min()
        found = signed_outline_distance_m(one(dx), one(dy), one(a), one(b), CAR, CAR)[0]
        if found > 0.0:
            assert found == pytest.approx(sampled, abs=0.02)
        else:
            assert sampled < 0.05 or found < -0.05  # edges cross, or one lies inside the other


def test_overlap_is_symmetric() -> None:
    rng = np.random.default_rng(1)
    dx, dy, a, b = (rng.uniform(-6, 6, 500) for _ in range(4))
    one_way = outline_separation_m(dx, dy, a, b, CAR, SQUARE)
    np.testing.assert_allclose(one_way, outline_separation_m(-dx, -dy, b, a, SQUARE, CAR), atol=1e-12)
