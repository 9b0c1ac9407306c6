"""Fits the probabilities of `cwcli lanes` and shows how reliable they are.

    python tests/studies/lane_reliability.py             # five minutes

Frames: the rendered sets `complex` and `hard`, roads with hardly any paint, with raised dots, and with none of it, and
noise, each with the camera's mounting known and not known. A boundary is right if 85 % of its visible rows are within 6
pixels; without paint it never is. Fitted on two seeds, shown on another. Prints the coefficients for
`vision/lane_belief.py` and the reliability tables of docs/lanes.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np

from cwcli.metrics.lane_scores import VISUAL_SHARE, visual_score
from cwcli.signals.columns import FloatArray
from cwcli.simulation.road.camera import paper_camera
from cwcli.simulation.road.conditions import CONDITIONS
from cwcli.simulation.road.geometry import RoadAhead, clothoid
from cwcli.simulation.road.render import RoadFrame, render
from cwcli.simulation.road.scene import Marking
from cwcli.simulation.road.sets import SETS, draw_scene, frames
from cwcli.simulation.streams import stream
from cwcli.vision.camera import Camera, Mounting, default_camera
from cwcli.vision.lane_belief import COEFFICIENTS, features
from cwcli.vision.lane_detect import acquire, with_vanishing_point
from cwcli.vision.lane_model import parabolas_of_lane, prior_of
from cwcli.vision.lane_tracker import FOUND_PROBABILITY

DOTS_M = (0.15, 3.6)
"""Length and gap of raised dots."""
EMPTY = ("bare", "noise")
"""Sets that show no lane."""
FIT_SEEDS, SHOWN_SEED = (101, 102), 103
SCALE = 1e-4
"""Of the ridge penalty of the fit."""


def drawn(name: str, n: int, seed: int) -> Iterator[RoadFrame]:
    """Frames of `complex` roads, `bare` of paint, `worn` as far as the renderer can, or with `dots`; or `noise`."""
    names = sorted(CONDITIONS)
    for index in range(n):
        rng = stream(seed, "road", name, str(index))
        scene = draw_scene(SETS["complex"], names[index % len(names)], rng)

        def changed(marking: Marking, asphalt: float = scene.asphalt) -> Marking:
            match name:
                case "worn":
                    return replace(marking, kept=0.0)
                case "dots":
                    return replace(marking, kept=1.0, dash_m=DOTS_M)
            return replace(marking, width_m=1e-4, grey=asphalt)

        left, right, others = changed(scene.left), changed(scene.right), tuple(map(changed, scene.others))
        scene = replace(scene, left=left, right=right, others=others)
        road = RoadAhead(
            clothoid(0.0005 * rng.normal(), 0.0), offset_m=0.2 * rng.normal(), heading_rad=0.0, vertical_1pm=0.0
        )
        made = render(scene, paper_camera(), road, rng)
        if name == "noise":  # of any strength, and as fine as the pixels or coarser
            grain: FloatArray = rng.normal(size=made.grey.shape)
            if index % 2:
                grain = cv2.GaussianBlur(grain, (0, 0), float(rng.uniform(0.6, 2.0)))
            grain *= rng.uniform(4.0, 70.0) / grain.std()
            made = replace(made, grey=np.clip(rng.uniform(40.0, 200.0) + grain, 0, 255).astype(np.uint8))
        yield made


def samples(seed: int, n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Features (m, 4) of boundaries, whether each is right, and 0, or for an empty set 1 + its place in `EMPTY`."""
    paper = paper_camera()
    mounting = Mounting(height_m=paper.height_m, pitch_rad=paper.pitch_rad)
    mounted = Camera(320, 240, paper.fx, paper.fy, paper.cx, paper.cy, mounting=mounting)
    rows, right, empty = [], [], []
    for name in ("complex", "hard", "worn", "dots", *EMPTY):
        made = drawn(name, n, seed) if name in ("worn", "dots", *EMPTY) else frames(name, n, seed=seed)
        for frame in made:
            for camera in (mounted, default_camera(320, 240, Mounting())):
                prior = prior_of(camera)
                if not prior.is_mounted:
                    prior = with_vanishing_point(frame.grey, prior)
                lanes, values, evidence = acquire(frame.grey, camera, prior)
                u = _columns(parabolas_of_lane(lanes[0], camera))
                truth, low = frame.truth, np.arange(240) >= 90
                score = visual_score(
                    *u,
                    truth.left_u_px,
                    truth.right_u_px,
                    truth.left_visible & low,
                    truth.right_visible & low,
                )
                for side, share in enumerate((score.left_share, score.right_share)):
                    if np.isnan(share):
                        continue
                    rows.append(features(evidence, lanes[0], float(values[0]))[side])
                    right.append(float(share >= VISUAL_SHARE and name not in EMPTY))
                    empty.append(float(EMPTY.index(name) + 1 if name in EMPTY else 0))
    return np.array(rows), np.array(right), np.array(empty)


def _columns(parabolas: FloatArray) -> FloatArray:
    y = 240.0 - np.arange(240)
    return np.asarray((parabolas[:, :1] * y + parabolas[:, 1:2]) * y + parabolas[:, 2:] - 1.0)


def fitted(x: FloatArray, right: FloatArray) -> FloatArray:
    """Logistic regression by Newton's method."""
    w = np.zeros(x.shape[1])
    for _ in range(50):
        p = 1.0 / (1.0 + np.exp(-x @ w))
        hessian = (x * (p * (1.0 - p))[:, None]).T @ x / len(x) + SCALE * np.eye(len(w))
        w = w + np.linalg.solve(hessian, x.T @ (right - p) / len(x) - SCALE * w)
    return w


def main() -> None:
    """Fit on two seeds, judge on another."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=100, help="of each set")
    n = parser.parse_args().frames
    fit_on = [samples(seed, n) for seed in FIT_SEEDS]
    x, right = (np.concatenate([each[k] for each in fit_on]) for k in range(2))
    print("coefficients", np.round(fitted(x, right), 2).tolist(), "in use", COEFFICIENTS.tolist())
    x, right, empty = samples(SHOWN_SEED, n)
    p = 1.0 / (1.0 + np.exp(-x @ COEFFICIENTS))
    print(f"{len(p)} boundaries, {right.mean():.3f} right, Brier score {np.mean((p - right) ** 2):.3f}\n")
    found = p >= FOUND_PROBABILITY
    there = empty == 0
    print(f"found: {found[there].mean():.3f} of those with paint, {right[found & there].mean():.3f} of them right")
    for kind, name in enumerate(EMPTY, 1):
        print(f"found, {name}: {found[empty == kind].mean():.3f}")
    print()
    print("| probability | boundaries | mean probability | right |\n|---|---|---|---|")
    edges = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 1.001)
    for low, high in pairwise(edges):
        use = (p >= low) & (p < high)
        if use.any():
            print(f"| {low:g} to {min(high, 1):g} | {use.sum()} | {p[use].mean():.2f} | {right[use].mean():.2f} |")


if __name__ == "__main__":
    main()
