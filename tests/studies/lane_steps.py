"""Processor time of `cwcli lanes` by step: shares of the time that the default method's search takes.

    cwcli simulate road -o road.mcap --seed 1 --set size=1280x720 --set rate_hz=30 --set duration_s=12
    python -m tests.studies.lane_steps road.mcap

A function's time is its own, without that of other functions in `STEPS`. What no function of `STEPS` takes is glue:
copies of hypotheses and priors, and the choice between them. The measuring itself takes some of every share.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from cwcli.kernels import lane_stripes
from cwcli.logs.read.reader import Log
from cwcli.stages.lanes import LanesConfig, lanes
from cwcli.vision import lane_detect
from cwcli.vision.boundary_probability import boundary_probabilities, first_frame_boundary_probabilities
from cwcli.vision.lane_covariance import covariance_of_first_five_lane_numbers, propagate_covariance_to_fit
from cwcli.vision.lane_detect import (
    best_lane_on_wide_evidence,
    best_lanes_of_grid,
    first_distinct_lanes,
    lane_objectives,
    move_to_inner_stripes,
    refine_lanes,
)
from cwcli.vision.lane_following import (
    curvature_candidates,
    narrow_prior_table,
    pitch_candidates,
    predict_lane_at_next_frame,
    prior_of_followed_lane,
)
from cwcli.vision.lane_hypotheses import (
    add_or_merge_hypothesis,
    choose_tight_or_gentle_bend,
    find_tight_bend_hypothesis,
    refine_predicted_lane,
    share_probability_with_rivals,
)
from cwcli.vision.lane_mean import weighted_mean_lane
from cwcli.vision.lane_model import boundary_road_curves, fit_boundary_parabolas
from cwcli.vision.lane_sides import update_lane_and_line_state
from cwcli.vision.lane_tracker import LaneTracker
from cwcli.vision.line_classifier import LineClassifier
from cwcli.vision.vanishing import find_vanishing_points

STEPS: dict[str, tuple[Callable[..., Any], ...]] = {
    "search": (
        find_vanishing_points,
        best_lanes_of_grid,
        first_distinct_lanes,
        refine_lanes,
        lane_objectives,
        best_lane_on_wide_evidence,
        weighted_mean_lane,
    ),
    "placement": (
        move_to_inner_stripes,
        fit_boundary_parabolas,
        boundary_road_curves,
        covariance_of_first_five_lane_numbers,
        propagate_covariance_to_fit,
    ),
    "probability": (boundary_probabilities, share_probability_with_rivals, first_frame_boundary_probabilities),
    "following": (
        predict_lane_at_next_frame,
        prior_of_followed_lane,
        narrow_prior_table,
        pitch_candidates,
        curvature_candidates,
        update_lane_and_line_state,
        refine_predicted_lane,
        choose_tight_or_gentle_bend,
        find_tight_bend_hypothesis,
        add_or_merge_hypothesis,
    ),
}
"""Functions of each of the steps behind the evidence, whose kernel is measured itself."""
EVIDENCE, KINDS, GLUE = "evidence", "kinds of lines", "glue"


class StepClock:
    """Sums the thread's processor time by the innermost step that is running."""

    def __init__(self) -> None:
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self.n_frames = 0
        self._running: list[str] = []
        self._since_s = 0.0

    def measured(self, function: Callable[..., Any], step: str) -> Callable[..., Any]:
        """The function, whose time is added to a step."""

        def timed(*arguments: Any, **named: Any) -> Any:
            self.n_frames += step == GLUE
            self._switch()
            self._running.append(step)
            try:
                return function(*arguments, **named)
            finally:
                self._switch()
                self._running.pop()

        return timed

    def _switch(self) -> None:
        now_s = time.thread_time()
        if self._running:
            self.seconds[self._running[-1]] += now_s - self._since_s
        self._since_s = now_s


def measure_steps(path: Path) -> StepClock:
    """Search the frames of a log with every function of `STEPS` replaced by a measured one, in all modules."""
    clock = StepClock()
    modules = [module for name, module in sys.modules.items() if name.startswith("cwcli.vision.")]
    for step, functions in STEPS.items():
        for function in functions:
            timed = clock.measured(function, step)
            places = [module for module in modules if vars(module).get(function.__name__) is function]
            assert places, f"{function.__name__} is called by no name of its own"
            for module in places:
                setattr(module, function.__name__, timed)
    lane_detect.lane_stripes = SimpleNamespace(stripes=clock.measured(lane_stripes.stripes, EVIDENCE))  # type: ignore[attr-defined, assignment]
    classify = clock.measured(LineClassifier.fit_with_kinds_and_colours, KINDS)
    LineClassifier.fit_with_kinds_and_colours = classify  # type: ignore[method-assign]
    LaneTracker.step = clock.measured(LaneTracker.step, GLUE)  # type: ignore[method-assign]
    LaneTracker.carry = clock.measured(LaneTracker.carry, "following")  # type: ignore[method-assign]
    with Log.open(path) as log:
        lanes(log, LanesConfig())
    return clock


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("log", type=Path)
    log, before_s = parser.parse_args().log, time.process_time()
    clock = measure_steps(log)
    total_s, whole_s = sum(clock.seconds.values()), time.process_time() - before_s
    print(f"{clock.n_frames} frames searched, {1e3 * total_s / clock.n_frames:.2f} ms of processor time each,")
    print(f"{100.0 * total_s / whole_s:.0f} % of the stage's; most of the rest is decoding\n")
    print("| step | share |\n|---|---|")
    for step in (EVIDENCE, *STEPS, KINDS, GLUE):
        print(f"| {step} | {100.0 * clock.seconds[step] / total_s:.0f} % |")


if __name__ == "__main__":
    main()
