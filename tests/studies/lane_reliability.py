"""Fits the probabilities of `cwcli lanes` and shows how reliable they are.

    python -m tests.studies.lane_reliability             # five minutes

Frames: the rendered sets `complex` and `hard`, roads with hardly any paint, with raised dots, and with none of it, and
noise, each with the camera's mounting known and not known. A boundary is right if 85 % of its visible rows are within 6
pixels; without paint it never is. Fitted on four seeds, shown on another. Beside them, with `LABELLED_SHARE` of the
weight, the labelled frames of `lane_halves` and their mirror images, right as TuSimple's benchmark has it. Prints the
coefficients for `vision/boundary_probability.py`, those of each half with the reliability on the other one, and the reliability
tables of docs/lanes.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
from scipy.optimize import minimize

from cwcli.metrics.lane_scores import VISUAL_MIN_ROW_SHARE, BoundaryColumns, lanes_beside_ego, visual_standard_score
from cwcli.signals.columns import FloatArray
from cwcli.simulation.road.camera import camera_of_zhang2011
from cwcli.simulation.road.conditions import CONDITIONS
from cwcli.simulation.road.geometry import RoadAhead, clothoid_curvature_1pm
from cwcli.simulation.road.render import RoadFrame, render_frame
from cwcli.simulation.road.scene import Marking
from cwcli.simulation.road.sets import FRAME_SETS, draw_scene, iter_set_frames
from cwcli.simulation.streams import random_stream
from cwcli.vision.boundary import Boundary
from cwcli.vision.boundary_probability import (
    PROBABILITY_OF_WELL_SEEN_OTHER_LINE,
    LOG_ODDS_COEFFICIENTS,
    probability_features_of_left_and_right,
)
from cwcli.vision.camera import Camera, Mounting, default_camera
from cwcli.vision.lane_detect import prior_with_vanishing_point, search_first_frame
from cwcli.vision.lane_model import first_frame_prior, fit_boundary_parabolas, pitch_from_horizon_rad
from cwcli.vision.lane_tracker import MIN_FOUND_PROBABILITY, search_size
from cwcli.vision.method import LaneFit
from tests.studies.lane_halves import LOG, labelled, matches
from tests.studies.lane_halves import drawn as lines_of

DOTS_M = (0.15, 3.6)
"""Length and gap of raised dots."""
EMPTY = ("bare", "noise")
"""Sets that show no lane."""
FIT_SEEDS, SHOWN_SEED = (101, 102, 103, 104), 105
SCALE = 1e-6
"""Of the ridge penalty of the fit: it only keeps the search in bounds. A stronger one flattens the probabilities."""
FIRST_LAPSE = 0.05
MOST = 200.0
"""Of a coefficient. Evidence may not speak against a boundary, nor the crowd for one."""
LABELLED_SHARE = 1.0 / 3.0
EDGES = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 1.001)


def drawn(name: str, n: int, seed: int) -> Iterator[RoadFrame]:
    """Frames of `complex` roads, `bare` of paint, `worn` as far as the renderer can, or with `dots`; or `noise`."""
    names = sorted(CONDITIONS)
    for index in range(n):
        rng = random_stream(seed, "road", name, str(index))
        scene = draw_scene(FRAME_SETS["complex"], names[index % len(names)], rng)

        def changed(marking: Marking, asphalt: float = scene.asphalt) -> Marking:
            match name:
                case "worn":
                    return replace(marking, remaining_paint_share=0.0)
                case "dots":
                    return replace(marking, remaining_paint_share=1.0, dash_m=DOTS_M)
            return replace(marking, width_m=1e-4, grey=asphalt)

        left, right, others = changed(scene.left), changed(scene.right), tuple(map(changed, scene.others))
        scene = replace(scene, left=left, right=right, others=others)
        road = RoadAhead(
            clothoid_curvature_1pm(0.0005 * rng.normal(), 0.0),
            offset_m=0.2 * rng.normal(),
            heading_rad=0.0,
            vertical_1pm=0.0,
        )
        made = render_frame(scene, camera_of_zhang2011(), road, rng)
        if name == "noise":  # of any strength, and as fine as the pixels or coarser
            grain: FloatArray = rng.normal(size=made.grey.shape)
            if index % 2:
                grain = cv2.GaussianBlur(grain, (0, 0), float(rng.uniform(0.6, 2.0)))
            grain *= rng.uniform(4.0, 70.0) / grain.std()
            made = replace(made, grey=np.clip(rng.uniform(40.0, 200.0) + grain, 0, 255).astype(np.uint8))
        yield made


def samples(seed: int, n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Features (m, 4) of boundaries, whether each is right, and 0, or for an empty set 1 + its place in `EMPTY`."""
    paper = camera_of_zhang2011()
    mounting = Mounting(height_m=paper.height_m, pitch_rad=paper.pitch_rad)
    mounted = Camera(320, 240, paper.fx, paper.fy, paper.cx, paper.cy, mounting=mounting)
    rows, right, empty = [], [], []
    for name in ("complex", "hard", "worn", "dots", *EMPTY):
        made = drawn(name, n, seed) if name in ("worn", "dots", *EMPTY) else iter_set_frames(name, n, seed=seed)
        for frame in made:
            for camera in (mounted, default_camera(320, 240, Mounting())):
                prior = first_frame_prior(camera)
                if not prior.is_mounting_known:
                    prior, _ = prior_with_vanishing_point(frame.grey, prior)
                lanes, values, evidence = search_first_frame(frame.grey, camera, prior)
                u = _columns(fit_boundary_parabolas(lanes[0], camera))
                truth, low = frame.truth, np.arange(240) >= 90
                score = visual_standard_score(
                    BoundaryColumns(u[0], truth.left_u_px, truth.left_visible & low),
                    BoundaryColumns(u[1], truth.right_u_px, truth.right_visible & low),
                )
                for side, share in enumerate((score.left_share, score.right_share)):
                    if np.isnan(share):
                        continue
                    rows.append(probability_features_of_left_and_right(evidence, lanes[0], float(values[0]))[side])
                    right.append(float(share >= VISUAL_MIN_ROW_SHARE and name not in EMPTY))
                    empty.append(float(EMPTY.index(name) + 1 if name in EMPTY else 0))
    return np.array(rows), np.array(right), np.array(empty)


def _columns(parabolas: FloatArray) -> FloatArray:
    y = 240.0 - np.arange(240)
    return np.asarray((parabolas[:, :1] * y + parabolas[:, 1:2]) * y + parabolas[:, 2:] - 1.0)


def labelled_samples() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Features (m, 4) of the boundaries of labelled frames and their mirror images, whether right, and the frame."""
    rows, right, numbers = [], [], []
    for number, (frame, lanes, rows_px) in enumerate(labelled(LOG, search_size)):
        assert frame.image is not None
        mirrored = np.where(lanes >= 0.0, frame.width_px - 1.0 - lanes, lanes)
        for grey, labels in ((frame.image, lanes), (np.ascontiguousarray(frame.image[:, ::-1]), mirrored)):
            camera = default_camera(frame.width_px, frame.height_px, Mounting()).with_image_size(
                grey.shape[1], grey.shape[0]
            )
            prior, _ = prior_with_vanishing_point(grey, first_frame_prior(camera))
            found, values, evidence = search_first_frame(grey, camera, prior)
            sides = [Boundary(a, b, c, 0.0, 1.0, True) for a, b, c in fit_boundary_parabolas(found[0], camera).tolist()]
            fit = LaneFit(sides[0], sides[1], pitch_rad=pitch_from_horizon_rad(found[0], camera))
            beside = lanes_beside_ego(labels, rows_px, frame.width_px, frame.height_px)
            lines = lines_of(fit, camera, rows_px, frame.height_px)
            rows.extend(probability_features_of_left_and_right(evidence, found[0], float(values[0])))
            right.extend(float(matches(line, beside, rows_px)) for line in lines)
            numbers.extend([number, number])
    return np.array(rows), np.array(right), np.array(numbers)


def fitted(x: FloatArray, right: FloatArray, weight: FloatArray) -> FloatArray:
    """Coefficients, and behind them the lapse, of the greatest likelihood; the weights sum to one."""

    def loss(made: FloatArray) -> float:
        p = np.clip(chances(x, made), 1e-9, 1.0 - 1e-9)
        likelihood = weight @ (right * np.log(p) + (1.0 - right) * np.log1p(-p))
        return float(0.5 * SCALE * (made[:-1] @ made[:-1]) - likelihood)

    start = np.concatenate([np.zeros(x.shape[1]), [FIRST_LAPSE]])
    limits = [(-MOST, MOST), (0.0, MOST), (0.0, MOST), (-MOST, 0.0), (0.0, 0.5)]
    return np.asarray(minimize(loss, start, method="L-BFGS-B", bounds=limits, options={"maxiter": 2000}).x)


def fitted_on_both(rendered: tuple[FloatArray, FloatArray], real: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Coefficients and lapse from rendered and labelled boundaries: features and whether right of each."""
    shares = (1.0 - LABELLED_SHARE, LABELLED_SHARE)
    weight = np.concatenate(
        [np.full(len(y), share / len(y)) for (_, y), share in zip((rendered, real), shares, strict=True)]
    )
    return fitted(np.concatenate([rendered[0], real[0]]), np.concatenate([rendered[1], real[1]]), weight)


def chances(x: FloatArray, made: FloatArray) -> FloatArray:
    """The probabilities by coefficients and lapse."""
    return np.asarray((1.0 - made[-1]) / (1.0 + np.exp(-np.clip(x @ made[:-1], -30.0, 30.0))))


def reliability(p: FloatArray, right: FloatArray) -> str:
    """How often boundaries of like probability are right."""
    lines = ["| probability | boundaries | mean probability | right |", "|---|---|---|---|"]
    for low, high in pairwise(EDGES):
        use = (p >= low) & (p < high)
        if use.any():
            lines.append(
                f"| {low:g} to {min(high, 1):g} | {use.sum()} | {p[use].mean():.2f} | {right[use].mean():.2f} |"
            )
    return "\n".join(lines)


def main() -> None:
    """Fit on four seeds and the labelled frames, judge on another seed and by halves."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=50, help="of each set")
    n = parser.parse_args().frames
    fit_on = [samples(seed, n) for seed in FIT_SEEDS]
    rendered = np.concatenate([each[0] for each in fit_on]), np.concatenate([each[1] for each in fit_on])
    real_x, real_right, numbers = labelled_samples()
    for half, name in enumerate(("even", "odd")):
        fit_half = numbers % 2 == half
        made = fitted_on_both(rendered, (real_x[fit_half], real_right[fit_half]))
        print(f"fitted on the {name} labelled frames: {np.round(made, 2).tolist()}; on the others:")
        print(reliability(chances(real_x[~fit_half], made), real_right[~fit_half]))
    made = fitted_on_both(rendered, (real_x, real_right))
    in_use = np.array([*LOG_ODDS_COEFFICIENTS, PROBABILITY_OF_WELL_SEEN_OTHER_LINE])
    print("coefficients and lapse", np.round(made, 2).tolist(), "in use", in_use.tolist())
    x, right, empty = samples(SHOWN_SEED, n)
    p = chances(x, in_use)
    print(f"{len(p)} boundaries, {right.mean():.3f} right, Brier score {np.mean((p - right) ** 2):.3f}\n")
    found = p >= MIN_FOUND_PROBABILITY
    there = empty == 0
    print(f"found: {found[there].mean():.3f} of those with paint, {right[found & there].mean():.3f} of them right")
    for kind, name in enumerate(EMPTY, 1):
        print(f"found, {name}: {found[empty == kind].mean():.3f}")
    print(f"\n{reliability(p, right)}")


if __name__ == "__main__":
    main()
