"""Figures 3 to 10 of zhang2011, and how the search converges: rendered frames with the boundaries that it found.

The paper's photographs are lost in the text; ours are rendered. Figures 3 to 8 show one frame each, a complex one in
the first phase, where the rates matter most; beside it stand the shares over many frames and the objective over the
generations.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.kernels import lane_search
from cwcli.lazy_dataclass import dataclass
from cwcli.metrics.intervals import proportion_interval
from cwcli.reproduction.classes import MeasuredNumber
from cwcli.reproduction.findings import Curve, Plot, StudyPart
from cwcli.reproduction.zhang2011.lane_drives import (
    N_FRAMES_BEFORE_STABLE_PHASE,
    boundary_columns_px,
    camera_for_lane_methods,
    is_fit_correct,
)
from cwcli.reproduction.zhang2011.lanes import HELD_OUT_SEED
from cwcli.signals.columns import FloatArray
from cwcli.simulation.road.drive import RoadDrive, iter_set_drives
from cwcli.simulation.road.render import RoadFrame
from cwcli.vision.boundary import BOUNDARY_NOT_FOUND, Boundary
from cwcli.vision.method import LaneFit, LaneFrame
from cwcli.vision.objective import PAPER_HEIGHT_PX, PAPER_WIDTH_PX, BlockResponses, compute_block_responses
from cwcli.vision.zhang2011 import (
    CROSSOVER_PROBABILITY,
    FIRST_PHASE,
    FIRST_SEARCH_RANGES_OF_LEFT_BOUNDARY,
    FIRST_SEARCH_RANGES_OF_RIGHT_BOUNDARY,
    METHOD,
    MUTATION_PROBABILITY,
    genetic_settings,
)

IMAGE_SIZE_PX = (PAPER_WIDTH_PX, PAPER_HEIGHT_PX)
"""Width and height of the paper's image, in pixels."""
N_FIRST_FRAMES_FOR_RATE_COMPARISON = 40
"""Number of first frames over which the rates are compared. Chosen by hand; not fitted."""
EXAMPLE_ROAD_SET = "complex"
"""The set of roads whose frames are searched. Chosen by hand; not fitted."""
HIGH_MUTATION_RATE = 0.9
"""A mutation rate that is too high; the paper shows one without printing it. Chosen by hand; not fitted."""
CROSSOVER_AND_MUTATION_RATES_BY_FIGURE: dict[str, tuple[float, float]] = {
    "fig 3": (0.4, MUTATION_PROBABILITY),
    "fig 4": (CROSSOVER_PROBABILITY, MUTATION_PROBABILITY),
    "fig 5": (0.5, MUTATION_PROBABILITY),
    "fig 6": (0.8, MUTATION_PROBABILITY),
    "fig 7": (CROSSOVER_PROBABILITY, HIGH_MUTATION_RATE),
    "fig 8": (CROSSOVER_PROBABILITY, MUTATION_PROBABILITY),
}
"""Figure -> rates of crossover and of mutation; the paper's but for `HIGH_MUTATION_RATE`."""
SHOWN_GENERATIONS = (1, 2, 5, 10, 20, 40, 60, 90, 120, 150, 180)
"""Generations at which the convergence is plotted. Chosen by hand; not fitted."""
MIN_GAP_BETWEEN_DRAWN_LANE_BOUNDARIES_PX = 4.0
"""Both boundaries end where they come nearer to each other, in pixels. Chosen by hand; not fitted."""
ROAD_STATIONS_FOR_TELLING_BEND_FROM_STRAIGHT_M = np.arange(0.0, 61.0, 5.0)
"""Stations of the road, in m, that tell a bend from a straight: as far as a frame shows the curvature well. Chosen
by hand."""
N_DRIVES_SEARCHED_FOR_EXAMPLE_BEND_AND_STRAIGHT = 20
"""Number of drives among which the bend and the straight of figures 9 and 10 are chosen. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class PreparedFrame:
    """One frame with its block responses, ready for the search."""

    frame: RoadFrame
    responses: BlockResponses


def crossover_and_mutation_rates_part() -> StudyPart:
    """Compute figures 3 to 8, and plot the objective over the generations for all of their rates."""
    drives = iter_set_drives(EXAMPLE_ROAD_SET, N_FIRST_FRAMES_FOR_RATE_COMPARISON, seed=HELD_OUT_SEED, n_frames=2)
    prepared_frames = [
        PreparedFrame(frame, compute_block_responses(frame.grey))
        for frame in (drive.render_frame_at(0) for drive in drives)
    ]
    measured, plots = [], []
    shares: dict[str, float] = {}
    for figure, rates in CROSSOVER_AND_MUTATION_RATES_BY_FIGURE.items():
        fits = [
            _search_both_boundaries(each, k, rates, FIRST_PHASE.generations)[0]
            for k, each in enumerate(prepared_frames)
        ]
        n_right = sum(
            is_fit_correct(each.frame, fit, IMAGE_SIZE_PX, by_stripe=True)
            for each, fit in zip(prepared_frames, fits, strict=True)
        )
        low, high = proportion_interval(n_right, len(prepared_frames))
        what = "first frames with both boundaries right"
        shares[figure] = n_right / len(prepared_frames)
        measured.append(MeasuredNumber(figure, what, 100.0 * shares[figure], 100.0 * low, 100.0 * high))
        title = f"crossover {rates[0]:g}, mutation {rates[1]:g}: a first frame of '{EXAMPLE_ROAD_SET}'"
        plots.append(frame_with_boundaries_plot(figure, title, prepared_frames[0].frame, fits[0]))
    is_best = shares["fig 4"] > max(shares[figure] for figure in ("fig 3", "fig 5", "fig 6"))
    what = "more first frames right than with crossover 0.4, 0.5 and 0.8"
    measured.append(MeasuredNumber("fig 4", what, float(is_best)))
    what = "more first frames right than with the high mutation rate"
    measured.append(MeasuredNumber("fig 8", what, float(shares["fig 8"] > shares["fig 7"])))
    plots += [
        _best_objective_by_generation_plot(
            "crossover rates",
            prepared_frames,
            {
                f"crossover {CROSSOVER_AND_MUTATION_RATES_BY_FIGURE[f][0]:g}": CROSSOVER_AND_MUTATION_RATES_BY_FIGURE[f]
                for f in tuple(CROSSOVER_AND_MUTATION_RATES_BY_FIGURE)[:4]
            },
        ),
        _best_objective_by_generation_plot(
            "mutation rates",
            prepared_frames,
            {
                f"mutation {CROSSOVER_AND_MUTATION_RATES_BY_FIGURE[f][1]:g}": CROSSOVER_AND_MUTATION_RATES_BY_FIGURE[f]
                for f in tuple(CROSSOVER_AND_MUTATION_RATES_BY_FIGURE)[4:]
            },
        ),
    ]
    return StudyPart(tuple(measured), tuple(plots))


def bend_and_straight_part() -> StudyPart:
    """Plot figures 9 and 10: a bend and a straight, followed as in a video until the third phase."""
    n_frames = N_FRAMES_BEFORE_STABLE_PHASE + 1
    drives = list(
        iter_set_drives("good", N_DRIVES_SEARCHED_FOR_EXAMPLE_BEND_AND_STRAIGHT, seed=HELD_OUT_SEED, n_frames=n_frames)
    )
    curvatures_1pm = [
        np.interp(ROAD_STATIONS_FOR_TELLING_BEND_FROM_STRAIGHT_M, drive.knots_m, drive.curvature_1pm)
        for drive in drives
    ]
    bend = int(np.argmax([abs(float(curvature_1pm.mean())) for curvature_1pm in curvatures_1pm]))
    straight = int(np.argmin([float(np.abs(curvature_1pm).max()) for curvature_1pm in curvatures_1pm]))
    chosen = {"fig 9": ("a bend", bend), "fig 10": ("a straight", straight)}
    return StudyPart(
        (), tuple(_followed_drive_plot(figure, text, drives[k], k) for figure, (text, k) in chosen.items())
    )


def frame_with_boundaries_plot(
    figure: str, title: str, frame: RoadFrame, fit: LaneFit, curves: tuple[Curve, ...] = ()
) -> Plot:
    """Plot a frame with the boundaries of a fit and other curves, in the paper's axes: x right, y up."""
    y = np.arange(0.5, 150.0)
    lines = []
    both = [
        boundary_columns_px(boundary, IMAGE_SIZE_PX, IMAGE_SIZE_PX)[::-1][: len(y)]
        for boundary in (fit.left, fit.right)
    ]
    meet = np.maximum.accumulate(both[1] - both[0] < MIN_GAP_BETWEEN_DRAWN_LANE_BOUNDARIES_PX)
    for label, columns in zip(("left", "right"), both, strict=True):
        inside = (columns >= 0.0) & (columns < PAPER_WIDTH_PX) & ~meet
        lines.append(Curve(label, np.where(inside, columns + 0.5, np.nan), y))
    return Plot(
        figure, title, "x [pixel]", "y [pixel]", (*lines, *curves),
        x_range=(0.0, PAPER_WIDTH_PX), y_range=(0.0, PAPER_HEIGHT_PX), image=frame.grey, is_map=True,
    )  # fmt: skip


def _followed_drive_plot(figure: str, text: str, drive: RoadDrive, seed: int) -> Plot:
    """Follow the lane along a drive and plot its last frame."""
    search = METHOD.make(seed)
    fit = LaneFit(BOUNDARY_NOT_FOUND, BOUNDARY_NOT_FOUND)
    frame = drive.render_frame_at(0)
    for k, frame in enumerate(drive.iter_rendered_frames()):
        stamp_ns = round(float(drive.time_s[k]) * 1e9)
        prepared = compute_block_responses(frame.grey)
        fit = search.step(
            LaneFrame(frame.grey, camera_for_lane_methods(*IMAGE_SIZE_PX), stamp_ns, k, prepared=prepared)
        )
    return frame_with_boundaries_plot(figure, f"{text}, the paper's search, frame {len(drive)}", frame, fit)


def _search_both_boundaries(
    frame: PreparedFrame, seed: int, rates: tuple[float, float], generations: int
) -> tuple[LaneFit, float]:
    """Search both boundaries in a first frame; return them and the sum of their objectives, grey levels."""
    genetic = genetic_settings(FIRST_PHASE)
    genetic["crossover_rate"], genetic["mutation_rate"] = rates
    genetic["generations"] = generations
    found, total = [], 0.0
    for side, (responses, region) in enumerate(
        (
            (frame.responses.left, FIRST_SEARCH_RANGES_OF_LEFT_BOUNDARY),
            (frame.responses.right, FIRST_SEARCH_RANGES_OF_RIGHT_BOUNDARY),
        )
    ):
        bounds: npt.NDArray[np.float64] = np.array(region)
        low, high = np.ascontiguousarray(bounds[:, 0]), np.ascontiguousarray(bounds[:, 1])
        abc, score = lane_search.search(
            responses, low, high, genetic, is_left=side == 0, seed_state=seed, seed_stream=side
        )
        found.append(Boundary(*abc, score, np.nan, score > 0.0))
        total += score
    return LaneFit(found[0], found[1]), total


def _best_objective_by_generation_plot(
    name: str, frames: list[PreparedFrame], crossover_and_mutation_rates: dict[str, tuple[float, float]]
) -> Plot:
    """Plot the best objective over the generations, mean over the frames, from the same random numbers."""
    curves = []
    for label, each in crossover_and_mutation_rates.items():
        means: FloatArray = np.array(
            [
                np.mean([_search_both_boundaries(one, k, each, stop)[1] for k, one in enumerate(frames)])
                for stop in SHOWN_GENERATIONS
            ]
        )
        curves.append(Curve(label, np.array(SHOWN_GENERATIONS, np.float64), means))
    title = f"best objective, mean of {len(frames)} first frames of '{EXAMPLE_ROAD_SET}'"
    return Plot(name, title, "generation", "F, left and right [grey levels]", curves)
