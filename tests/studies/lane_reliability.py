"""Fits the probabilities of `cwcli lanes` and shows how reliable they are.

    python -m tests.studies.lane_reliability             # five minutes

Frames: the rendered sets `complex` and `hard`, roads with hardly any paint, with raised dots, and with none of it, and
noise, each with the camera's mounting known and not known. A boundary is right if 85 % of its visible rows are within 6
pixels; without paint it never is. Fitted on four seeds, shown on another. Beside them, with `LABELLED_SHARE` of the
weight, the labelled pictures of even numbers in all kinds of `lane_variants`, right as TuSimple's benchmark has it,
and some of them upside down. Prints the coefficients for `vision/boundary_probability.py`, and the reliability of those
in use on the varied pictures of odd numbers and on rendered ones.
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
    CLEAR_VOTE_SHARE,
    PROBABILITY_OF_WELL_SEEN_OTHER_LINE,
    BOUNDARY_LOG_ODDS_WEIGHTS,
    LOG_ODDS_PER_VOTE_SHARE,
    probability_features_of_left_and_right,
)
from cwcli.vision.camera import Camera, Mounting, default_camera
from cwcli.vision.lane_detect import prior_with_vanishing_point, search_first_frame
from cwcli.vision.lane_model import (
    boundary_road_curves,
    first_frame_prior,
    fit_boundary_parabolas,
    pitch_from_horizon_rad,
)
from cwcli.vision.lane_tracker import MIN_FOUND_PROBABILITY, search_size
from cwcli.vision.method import GreyImage, LaneFit
from tests.studies.lane_halves import LOG, labelled, matches
from tests.studies.lane_halves import drawn as lines_of
from tests.studies.lane_variants import KINDS
from tests.studies.varied_pictures import HEIGHT_PX, WIDTH_PX, Picture

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
LABELLED_SHARE = 0.4
"""Share of the varied real pictures in the fit's weight."""
UPSIDE_DOWN = ("as it is", "gamma 1.6", "haze", "rain", "shadow stripes")
"""Kinds that are searched upside down as well."""
VARIED_SEEDS = (7, 11)
"""Seeds that draw the weather and the damage of the pictures that are fitted on, and of those that are shown."""
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
    """Features (m, 5) of boundaries, whether each is right, and 0, or for an empty set 1 + its place in `EMPTY`."""
    paper = camera_of_zhang2011()
    mounting = Mounting(height_m=paper.height_m, pitch_rad=paper.pitch_rad)
    mounted = Camera(320, 240, paper.fx, paper.fy, paper.cx, paper.cy, mounting=mounting)
    rows, right, empty = [], [], []
    for name in ("complex", "hard", "worn", "dots", *EMPTY):
        made = drawn(name, n, seed) if name in ("worn", "dots", *EMPTY) else iter_set_frames(name, n, seed=seed)
        for frame in made:
            for camera in (mounted, default_camera(320, 240, Mounting())):
                prior, votes = first_frame_prior(camera), 1.0
                if not prior.is_mounting_known:
                    prior, votes = prior_with_vanishing_point(frame.grey, prior)
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
                    own = probability_features_of_left_and_right(evidence, lanes[0], float(values[0]))[side]
                    rows.append((*own, min(votes - CLEAR_VOTE_SHARE, 0.0)))
                    right.append(float(share >= VISUAL_MIN_ROW_SHARE and name not in EMPTY))
                    empty.append(float(EMPTY.index(name) + 1 if name in EMPTY else 0))
    return np.array(rows), np.array(right), np.array(empty)


def _columns(parabolas: FloatArray) -> FloatArray:
    y = 240.0 - np.arange(240)
    return np.asarray((parabolas[:, :1] * y + parabolas[:, 1:2]) * y + parabolas[:, 2:] - 1.0)


def varied_samples(half: int, seed: int) -> tuple[FloatArray, FloatArray]:
    """Features (m, 5) of the boundaries of every second labelled picture in every kind of `lane_variants` and whether
    each is right; of the pictures in `UPSIDE_DOWN` also upside down, where none is right.

    Args:
        half: 0: the pictures of even numbers, 1: the odd ones.
        seed: Draws the weather and the damage.
    """
    rows, right = [], []
    for number, (frame, lanes, rows_px) in enumerate(labelled(LOG, lambda width, height: (width, height))):
        if number % 2 != half:
            continue
        assert frame.image is not None
        picture = Picture(np.asarray(frame.image), lanes, np.asarray(rows_px, np.float64))
        for name, change in KINDS.items():
            made = change(picture, np.random.default_rng([number, sum(map(ord, name)), seed]))
            height, width = made.grey.shape
            size = search_size(width, height)
            how = cv2.INTER_AREA if size[0] <= width else cv2.INTER_LINEAR
            grey: GreyImage = np.asarray(cv2.resize(made.grey, size, interpolation=how), np.uint8)
            camera = default_camera(width, height, Mounting()).with_image_size(*size)
            features, lines = _searched_boundaries(grey, camera, made.rows)
            beside = lanes_beside_ego(made.lanes, made.rows, WIDTH_PX, HEIGHT_PX)
            rows.extend(features)
            right.extend(float(matches(line, beside, made.rows)) for line in lines)
            if name in UPSIDE_DOWN:
                features, _ = _searched_boundaries(np.ascontiguousarray(grey[::-1]), camera, made.rows)
                rows.extend(features)
                right.extend([0.0, 0.0])
    return np.array(rows), np.array(right)


def _searched_boundaries(
    grey: GreyImage, camera: Camera, rows_px: FloatArray
) -> tuple[list[tuple[float, ...]], list[FloatArray]]:
    """Features and columns of both boundaries that a search of one picture has found."""
    prior, votes = prior_with_vanishing_point(grey, first_frame_prior(camera))
    found, values, evidence = search_first_frame(grey, camera, prior)
    sides = [Boundary(a, b, c, 0.0, 1.0, True) for a, b, c in fit_boundary_parabolas(found[0], camera).tolist()]
    fit = LaneFit(
        sides[0],
        sides[1],
        pitch_rad=pitch_from_horizon_rad(found[0], camera),
        roads=boundary_road_curves(found[0], prior.pinhole),
    )
    features = probability_features_of_left_and_right(evidence, found[0], float(values[0]))
    return [(*each, min(votes - CLEAR_VOTE_SHARE, 0.0)) for each in features], list(
        lines_of(fit, camera, rows_px, HEIGHT_PX)
    )


def fitted(x: FloatArray, right: FloatArray, weight: FloatArray) -> FloatArray:
    """Coefficients, and behind them the lapse, of the greatest likelihood; the weights sum to one."""

    def loss(made: FloatArray) -> float:
        p = np.clip(chances(x, made), 1e-9, 1.0 - 1e-9)
        likelihood = weight @ (right * np.log(p) + (1.0 - right) * np.log1p(-p))
        return float(0.5 * SCALE * (made[:-1] @ made[:-1]) - likelihood)

    start = np.concatenate([np.zeros(x.shape[1]), [FIRST_LAPSE]])
    limits = [(-MOST, MOST), (0.0, MOST), (0.0, MOST), (-MOST, 0.0), (0.0, MOST), (0.0, 0.5)]
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
    made = fitted_on_both(rendered, varied_samples(0, VARIED_SEEDS[0]))
    in_use = np.array([*BOUNDARY_LOG_ODDS_WEIGHTS, LOG_ODDS_PER_VOTE_SHARE, PROBABILITY_OF_WELL_SEEN_OTHER_LINE])
    print("coefficients and lapse", np.round(made, 2).tolist(), "in use", in_use.tolist())
    real_x, real_right = varied_samples(1, VARIED_SEEDS[1])
    print("varied pictures of the other half:")
    print(reliability(chances(real_x, in_use), real_right))
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
