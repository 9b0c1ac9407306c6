"""The kernels of the default lane method against their plain twins; the two optimisers on one objective."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from cwcli.kernels import lane_ridge, lane_stripes
from cwcli.signals.columns import FloatArray
from cwcli.vision import lane_detect
from cwcli.vision.boundary_probability import left_and_right_paint_shares
from cwcli.vision.camera import Camera, Mounting
from cwcli.vision.lane_detect import (
    OBJECTIVE_LOSS_PER_SQUARED_PRIOR_SIGMA,
    StripeEvidence,
    lane_objectives,
    measure_stripe_evidence,
    search_first_frame,
)
from cwcli.vision.lane_model import BEND, HIGH, HORIZON, LOW, MEAN, SIGMA, SPIRAL, LanePrior, first_frame_prior
from tests.set_frames import render_set_frame
from tests.unit.vision import naive_ridge
from tests.unit.vision.lane_scene import mounted

STRIPE: lane_stripes.Stripe = {
    "inner": 0.065,
    "gap": 0.085,
    "side": 0.08,
    "floor_grey": 3.0,
    "relative": 0.07,
    "rough": 2.0,
    "lopsided": 0.3,
    "dead": 0.25,
    "crowded": 0.07,
}
JOINT: lane_stripes.Stripe = {**STRIPE, "inner": 0.025, "gap": 0.03, "side": 0.06}


def stripes(
    grey: npt.NDArray[np.uint8],
    rows: npt.NDArray[np.int32],
    horizon: float,
    *,
    stripe: lane_stripes.Stripe = STRIPE,
    joint: lane_stripes.Stripe = JOINT,
    joint_weight: float = 0.0,
    reaches: tuple[int, int] = (1, 2),
) -> npt.NDArray[np.float32]:
    """The three tables of the kernel."""
    made = np.empty((3, len(rows), grey.shape[1]), np.float32)
    reach, broad_reach = reaches
    lane_stripes.stripes(
        grey,
        rows,
        horizon,
        stripe,
        joint,
        joint_weight=joint_weight,
        joint_reach=0.08,
        reach=reach,
        broad_reach=broad_reach,
        evidence=made,
    )
    return made


PINHOLE = {"min_h": 7.0, "centre": 160.0, "focal": 300.0}
SCORING: lane_ridge.Scoring = {
    "prior_weight": 0.0,
    "beside": 0.5,
    "half": 3.0,
    "segment": 9,
    "min_h": PINHOLE["min_h"],
    "centre": PINHOLE["centre"],
    "focal": PINHOLE["focal"],
}


def test_evidence_equals_the_plain_twin() -> None:
    grey = np.ascontiguousarray(render_set_frame("complex", 3).grey[:, 60:180])
    rows = np.array([90, 120, 239], np.int32)
    made = stripes(grey, rows, 80.3, joint_weight=0.2, reaches=(2, 5))
    bright = naive_ridge.ridges(grey, rows, 80.3, STRIPE)
    dark = naive_ridge.ridges(grey, rows, 80.3, JOINT, is_dark=True)
    both = naive_ridge.with_joints(bright, dark, rows, 80.3, weight=0.2, reach=0.08)
    assert (both > bright + 0.01).any()
    np.testing.assert_allclose(made[0], both, atol=2e-4)
    for reach, wide in zip((2, 5), made[1:], strict=True):
        np.testing.assert_array_equal(wide, naive_ridge.widened(made[0], reach))


def test_evidence_of_a_stripe_by_hand() -> None:
    # h = 100: inner window 6.5, sides from 8.5 to 16.5 beyond the centre. Road 50, stripe 150, 9 pixels wide.
    grey = np.full((101, 101), 50, np.uint8)
    grey[:, 46:55] = 150
    rows = np.array([100], np.int32)
    stripe: lane_stripes.Stripe = {**STRIPE, "rough": 0.0, "crowded": 1e9}  # no texture, no crowd
    made = stripes(grey, rows, 0.0, stripe=stripe)
    noise = 3.0 + 0.07 * 50
    assert made[0, 0, 50] == pytest.approx((100**2 / (100**2 + noise**2) - 0.25) / 0.75, abs=1e-6)
    assert made[0, 0, 20] == 0.0
    edge = np.full((101, 101), 50, np.uint8)
    edge[:, 50:] = 150  # bright on one side only
    assert stripes(edge, rows, 0.0, stripe=stripe).max() == 0.0


def test_joint_by_hand() -> None:
    # h = 100: inner window 2.5, sides from 3 to 9 beyond the centre. Concrete 150, joint 50, 3 pixels wide.
    grey = np.full((101, 101), 150, np.uint8)
    grey[:, 49:52] = 50
    joint: lane_stripes.Stripe = {**JOINT, "rough": 0.0, "crowded": 1e9}
    made = stripes(grey, np.array([100], np.int32), 0.0, joint=joint, joint_weight=0.2)[0, 0]
    noise = 3.0 + 0.07 * 150
    at_joint = 0.2 * (100**2 / (100**2 + noise**2) - 0.25) / 0.75
    np.testing.assert_allclose(made[42:59], at_joint, atol=1e-6)  # 8 columns to each side: 0.08 h
    assert made[:36].max() == made[65:].max() == 0.0
    wall = np.full((101, 101), 150, np.uint8)
    wall[:, 50:] = 50  # dark on one side only
    assert stripes(wall, np.array([100], np.int32), 0.0, joint=joint, joint_weight=0.2).max() == 0.0


def test_objective_equals_the_plain_twin() -> None:
    grey, camera = render_set_frame("good", 2).grey, mounted()
    prior = first_frame_prior(camera)
    lanes, _, evidence = search_first_frame(grey, camera, prior)
    lanes = np.vstack([lanes, lanes[0] + np.array([3.0, 0.02, 0.05, 30.0, 1.0, 0.0])])
    prior.table[[BEND, SPIRAL], LOW:] = (-9e3, 9e3), (-1e6, 1e6)
    tight = [lanes[0] + np.array([-9.0, 0.02, 0.05, bend, 1.0, 0.0]) for bend in (-7e3, -2e3, 700.0, 4e3)]
    spiral = [lanes[0] + np.array([-9.0, 0.02, 0.05, -2e3, 1.0, change]) for change in (100.0, -3e4, 8e4, 4e5)]
    lanes = np.vstack([lanes, tight, spiral])  # curves that leave the image, or turn back in it
    segment = len(evidence.rows) // lane_detect.N_ROW_SEGMENTS
    for lane, value in zip(lanes, lane_objectives(evidence, lanes, prior.table), strict=True):
        plain = naive_ridge.objective(
            evidence.sharp,
            evidence.broad,
            evidence.rows,
            lane,
            prior.table,
            weight=OBJECTIVE_LOSS_PER_SQUARED_PRIOR_SIGMA,
            min_h=evidence.min_depth_px,
            beside=lane_detect.NEIGHBOURING_LANE_WEIGHT,
            half=lane_detect.EVIDENCE_SHARE_COUNTING_ONE_HALF * segment,
            segment=segment,
            pinhole=evidence.pinhole[:2],
        )
        assert value == pytest.approx(plain, abs=1e-5)


@pytest.mark.parametrize("segment", [6, 7, 8, 9])
def test_scan_counts_stretches_of_the_rows_that_it_is_told(segment: int) -> None:
    # Paint everywhere: a stretch of s sampled rows counts s / (s + half / 2) for each side. The sampled rows of an odd
    # stretch are by turns one more and one less than half of its rows.
    n = 9 * segment
    prior = np.array([[80.0, 10, 0, 160], [0.0, 1, -9, 9], [2.0, 1, 0.1, 9], *[[0.0, 1, -9, 9]] * 3])
    half = 0.3 * segment
    best = lane_ridge.scan(
        np.ones((n, 160), np.float32),
        prior,
        {**SCORING, "beside": 0.0, "half": half, "segment": segment},
        depths=np.arange(float(n)) * 0.1 + 5.0,
        step=2,
        vanishing=np.array([80.0]),
        bends=np.zeros(1),
        places=0.5 + np.arange(-4.0, 4.0),
    )
    rows = [len(range(start + start % 2, start + segment, 2)) for start in range(0, n, segment)]
    assert best[0, 0, 0] == pytest.approx(2.0 * np.mean([k / (k + half / 2) for k in rows]))


def test_supports_equal_the_plain_twin() -> None:
    grey, camera = render_set_frame("complex", 2).grey, mounted()
    lanes, _, evidence = search_first_frame(grey, camera, first_frame_prior(camera))
    aside = lanes[0] + np.array([0.0, 1.5, 0.0, 0.0, 0.0, 0.0])  # one boundary leaves the image
    segment = len(evidence.rows) // lane_detect.N_ROW_SEGMENTS
    tight = [lanes[0] + np.array([0.0, 0.0, 0.0, bend, 0.0, 1e4]) for bend in (-6e3, 2e3)]
    for lane in (*lanes, aside, *tight):
        plain = naive_ridge.supports(
            evidence.sharp,
            evidence.rows,
            lane,
            min_h=evidence.min_depth_px,
            half=lane_detect.EVIDENCE_SHARE_COUNTING_ONE_HALF * segment,
            segment=segment,
            pinhole=evidence.pinhole[:2],
        )
        assert left_and_right_paint_shares(evidence, lane) == pytest.approx(plain, abs=1e-6)


@pytest.mark.parametrize(
    "lane",
    [
        (150.0, 0.1, 2.2, 0.0, 80.0, 0.0),
        (150.0, 0.1, 2.2, 900.0, 80.0, 4e3),
        (150.0, 2.5, 2.2, -400.0, 80.0, 0.0),  # one boundary outside the image
        (150.0, 0.1, 2.2, 100.0, 236.0, 0.0),  # two samples below the horizon
        (150.0, 0.1, 2.2, 3000.0, 80.0, 0.0),  # turns back within the image
    ],
)
def test_parabolas_are_those_of_least_squares(lane: tuple[float, ...]) -> None:
    made = lane_ridge.parabolas(np.array(lane), top_y=120.0, height=240.0, width=320.0, **PINHOLE)
    for side in range(2):
        plain = naive_ridge.parabola(np.array(lane), side, 120.0, 240, 320, **PINHOLE)
        np.testing.assert_allclose(made[side], plain, rtol=1e-7, atol=1e-9)


def test_outside_the_prior_nothing_counts() -> None:
    camera = mounted()
    prior = first_frame_prior(camera)
    evidence = measure_stripe_evidence(
        render_set_frame("good", 2).grey, np.arange(100, 238, dtype=np.int32), 80.0, prior.pinhole
    )
    lane = prior.table[:, MEAN].copy()
    lane[2] = prior.table[2, HIGH] + 0.1
    assert lane_objectives(evidence, lane[None], prior.table)[0] == -1e30


@pytest.mark.parametrize("index", [0, 5, 11])
def test_deterministic_and_genetic_search_reach_the_same_objective(index: int) -> None:
    """Both within 1 % of each other, though the genetic one may judge 65,000 candidates."""
    grey, camera = render_set_frame("good", index, seed=4).grey, mounted()
    prior = first_frame_prior(camera)
    _, values, evidence = search_first_frame(grey, camera, prior)
    genetic = genetic_best(evidence, prior, np.random.default_rng(index))
    assert values[0] >= 0.99 * genetic
    assert genetic >= 0.99 * values[0]


def genetic_best(evidence: StripeEvidence, prior: LanePrior, rng: np.random.Generator) -> float:
    """A plain real-coded genetic search: tournament, blend crossover, shrinking mutation, elitism; three restarts."""
    table = prior.table
    low = np.maximum(table[:, LOW], table[:, MEAN] - 3 * table[:, SIGMA])
    high = np.minimum(table[:, HIGH], table[:, MEAN] + 3 * table[:, SIGMA])
    best = -np.inf
    for _ in range(3):
        people: FloatArray = rng.uniform(low, high, (240, 6))
        for generation in range(90):
            fitness = lane_objectives(evidence, people, prior.table)
            order = np.argsort(-fitness)
            elite = people[order[:6]]
            rivals = rng.integers(0, len(people), (2, 2, len(people)))
            parents = [np.where((fitness[a] > fitness[b])[:, None], people[a], people[b]) for a, b in rivals]
            share = rng.uniform(-0.2, 1.2, people.shape)
            children = share * parents[0] + (1 - share) * parents[1]
            step = (high - low) * 0.15 * 0.94**generation
            children += rng.normal(size=people.shape) * step * (rng.random(people.shape) < 0.3)
            people = np.vstack([elite, np.clip(children[: len(people) - 6], low, high)])
        best = max(best, float(lane_objectives(evidence, people, prior.table).max()))
    return best


def test_a_mounting_that_is_given_fixes_the_horizon() -> None:
    known = first_frame_prior(mounted())
    assert known.is_mounting_known
    assert known.table[HORIZON, SIGMA] < 4.0
    camera = mounted()
    unknown = first_frame_prior(Camera(320, 240, camera.fx, camera.fy, camera.cx, camera.cy, mounting=Mounting()))
    assert not unknown.is_mounting_known
    assert unknown.table[HORIZON, SIGMA] > 20.0
