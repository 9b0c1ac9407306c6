"""Fits the probabilities of `cwcli lanes` for frames that are searched alone and shows how reliable they are.

    python -m tests.studies.lane_reliability             # five minutes

Frames: the rendered sets `complex` and `hard`, `hard` roads evenly in each weather, roads with hardly any paint, with
raised dots, and with none of it, and noise, each with the camera's mounting known and not known. A boundary is right if
85 % of its visible rows are within 6 pixels; without paint it never is. Fitted on four seeds, shown on another. Beside
them, with `WEATHER_SHARE` and `LABELLED_SHARE` of the weight, the labelled pictures of even numbers in the weather and
in the other kinds of `lane_variants`, right as TuSimple's benchmark has it, and some of them upside down. Prints the coefficients for `vision/boundary_probability.py`, and the reliability of those
in use on the varied pictures of odd numbers and on rendered ones.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
from scipy.optimize import minimize

from cwcli.metrics.lane_scores import (
    VISUAL_STANDARD_MIN_ROW_SHARE,
    BoundaryColumns,
    lanes_beside_ego,
    visual_standard_score,
)
from cwcli.signals.columns import FloatArray
from cwcli.simulation.road.camera import camera_of_zhang2011
from cwcli.simulation.road.conditions import DRAW_FUNCTION_BY_WEATHER
from cwcli.simulation.road.geometry import RoadAhead
from tests.set_frames import clothoid_curvature_1pm
from cwcli.simulation.road.render import RoadFrame, render_frame
from cwcli.simulation.road.scene import Marking
from cwcli.simulation.road.sets import FRAME_SETS, draw_scene
from tests.set_frames import iter_set_frames
from cwcli.simulation.streams import random_stream
from cwcli.vision.boundary import Boundary
from cwcli.vision.boundary_probability import (
    FIRST_FRAME_LOG_ODDS_WEIGHTS,
    PROBABILITY_OF_OTHER_LINE_IN_FIRST_FRAME,
    first_frame_probability_features,
)
from cwcli.vision.camera import Camera, Mounting, default_camera
from cwcli.vision.lane_detect import search_first_frame, search_first_frame_at_vanishing_points
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
from tests.studies.weather_pictures import WEATHER

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
WEATHER_SHARE, LABELLED_SHARE = 0.3, 0.2
"""Shares in the fit's weight of the real pictures in weather, and of those in other kinds."""
UPSIDE_DOWN = ("as it is", "gamma 1.6", "haze", "rain", "shadow stripes")
"""Kinds that are searched upside down as well."""
VARIED_SEEDS = ((7, 17), (11, 21))
"""Seeds that draw the weather of the pictures that are fitted on, and of those that are shown; the first of them draws
the damage."""
EDGES = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 1.001)


def drawn(name: str, n: int, seed: int) -> Iterator[RoadFrame]:
    """Frames of `complex` roads, `bare` of paint, `worn` as far as the renderer can, or with `dots`; `noise`; or of
    `hard` roads evenly in each `weather`."""
    names = sorted(DRAW_FUNCTION_BY_WEATHER)
    for index in range(n):
        rng = random_stream(seed, "road", name, str(index))
        spec = FRAME_SETS["hard" if name == "weather" else "complex"]
        scene = draw_scene(spec, names[index % len(names)], rng)

        def changed(marking: Marking, asphalt: float = scene.asphalt) -> Marking:
            match name:
                case "weather":
                    return marking
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
    for name in ("complex", "hard", "weather", "worn", "dots", *EMPTY):
        made = iter_set_frames(name, n, seed=seed) if name in FRAME_SETS else drawn(name, n, seed)
        for frame in made:
            for camera in (mounted, default_camera(320, 240, Mounting())):
                prior, votes = first_frame_prior(camera), 1.0
                if prior.is_mounting_known:
                    lanes, values, evidence = search_first_frame(frame.grey, camera, prior)
                else:
                    lanes, values, evidence, votes = search_first_frame_at_vanishing_points(frame.grey, camera, prior)
                u = _columns(fit_boundary_parabolas(lanes[0], camera))
                truth, low = frame.truth, np.arange(240) >= 90
                score = visual_standard_score(
                    BoundaryColumns(u[0], truth.left_u_px, truth.left_visible & low),
                    BoundaryColumns(u[1], truth.right_u_px, truth.right_visible & low),
                )
                for side, share in enumerate((score.left_share, score.right_share)):
                    if np.isnan(share):
                        continue
                    rows.append(first_frame_probability_features(evidence, lanes, values, votes, 240)[side])
                    right.append(float(share >= VISUAL_STANDARD_MIN_ROW_SHARE and name not in EMPTY))
                    empty.append(float(EMPTY.index(name) + 1 if name in EMPTY else 0))
    return np.array(rows), np.array(right), np.array(empty)


def _columns(parabolas: FloatArray) -> FloatArray:
    y = 240.0 - np.arange(240)
    return np.asarray((parabolas[:, :1] * y + parabolas[:, 1:2]) * y + parabolas[:, 2:] - 1.0)


def varied_samples(half: int, seed: int, kinds: Iterable[str]) -> tuple[FloatArray, FloatArray]:
    """Features (m, 5) of the boundaries of every second labelled picture in some kinds of `lane_variants` and whether
    each is right; of the pictures in `UPSIDE_DOWN` also upside down, where none is right.

    Args:
        half: 0: the pictures of even numbers, 1: the odd ones.
        seed: Draws the weather and the damage.
    """
    chosen = list(kinds)
    rows, right = [], []
    for number, (frame, lanes, rows_px) in enumerate(labelled(LOG, lambda width, height: (width, height))):
        if number % 2 != half:
            continue
        assert frame.image is not None
        picture = Picture(np.asarray(frame.image), lanes, np.asarray(rows_px, np.float64))
        for name in chosen:
            made = KINDS[name](picture, np.random.default_rng([number, sum(map(ord, name)), seed]))
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
    prior = first_frame_prior(camera)
    found, values, evidence, votes = search_first_frame_at_vanishing_points(grey, camera, prior)
    sides = [Boundary(a, b, c, 0.0, 1.0, True) for a, b, c in fit_boundary_parabolas(found[0], camera).tolist()]
    fit = LaneFit(
        sides[0],
        sides[1],
        pitch_rad=pitch_from_horizon_rad(found[0], camera),
        roads=boundary_road_curves(found[0], prior.pinhole),
    )
    features = first_frame_probability_features(evidence, found, values, votes, camera.height_px)
    return list(features), list(lines_of(fit, camera, rows_px, HEIGHT_PX))


def fitted(x: FloatArray, right: FloatArray, weight: FloatArray) -> FloatArray:
    """Coefficients, and behind them the lapse, of the greatest likelihood; the weights sum to one."""

    def loss(made: FloatArray) -> float:
        p = np.clip(chances(x, made), 1e-9, 1.0 - 1e-9)
        likelihood = weight @ (right * np.log(p) + (1.0 - right) * np.log1p(-p))
        return float(0.5 * SCALE * (made[:-1] @ made[:-1]) - likelihood)

    start = np.array([0.0, 0.0, 0.0, 0.0, 1.0, FIRST_LAPSE])
    limits = [(-MOST, MOST), (0.0, MOST), (-MOST, 0.0), (0.0, MOST), (1.0, 1.0), (0.0, 0.5)]
    return np.asarray(minimize(loss, start, method="L-BFGS-B", bounds=limits, options={"maxiter": 2000}).x)


def joined(parts: Iterable[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    """Several samples as one."""
    features, right = zip(*parts, strict=True)
    return np.concatenate(features), np.concatenate(right)


def varied_samples_of_half(half: int) -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
    """Samples of one half of the labelled pictures: in weather, and in the other kinds."""
    seeds = VARIED_SEEDS[half]
    weather = joined(varied_samples(half, seed, WEATHER) for seed in seeds)
    return weather, varied_samples(half, seeds[0], [name for name in KINDS if name not in WEATHER])


def fitted_on_groups(groups: list[tuple[tuple[FloatArray, FloatArray], float]]) -> FloatArray:
    """Coefficients and lapse from groups of boundaries (features, whether right), each with its share of the weight."""
    weight = np.concatenate([np.full(len(right), share / len(right)) for (_, right), share in groups])
    return fitted(*joined(sample for sample, _ in groups), weight)


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
    rendered = joined(samples(seed, n)[:2] for seed in FIT_SEEDS)
    weather, others = varied_samples_of_half(0)
    shares = (1.0 - WEATHER_SHARE - LABELLED_SHARE, WEATHER_SHARE, LABELLED_SHARE)
    made = fitted_on_groups(list(zip((rendered, weather, others), shares, strict=True)))
    in_use = np.array([*FIRST_FRAME_LOG_ODDS_WEIGHTS, PROBABILITY_OF_OTHER_LINE_IN_FIRST_FRAME])
    print("coefficients and lapse", np.round(made, 3).tolist(), "in use", in_use.tolist())
    for name, (real_x, real_right) in zip(("weather", "other kinds"), varied_samples_of_half(1), strict=True):
        print(f"pictures of the other half, {name}:")
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
