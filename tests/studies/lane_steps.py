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
from cwcli.vision.lane_tracker import LaneTracker
from cwcli.vision.line_classifier import LineClassifier

STEPS = {
    "search": (
        "find_vanishing_points",
        "best_lanes_of_grid",
        "refine_lanes",
        "lane_objectives",
        "best_lane_on_wide_evidence",
        "weighted_mean_lane",
    ),
    "placement": (
        "move_to_inner_stripes",
        "fit_boundary_parabolas",
        "boundary_road_curves",
        "covariance_of_first_five_lane_numbers",
    ),
    "probability": ("boundary_probabilities", "share_probability_with_rivals", "probabilities_with_scene_votes"),
    "following": (
        "predict_lane",
        "following_prior",
        "narrow_prior_table",
        "pitch_candidates",
        "curvature_candidates",
        "update_lane_and_line_state",
        "refine_predicted_lane",
        "choose_tight_or_gentle_bend",
        "find_tight_bend_hypothesis",
    ),
}
"""Functions of `cwcli.vision` in each of the steps behind the evidence, whose kernel is measured itself."""
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
    for step, names in STEPS.items():
        for name in names:
            original = next(getattr(module, name) for module in modules if hasattr(module, name))
            timed = clock.measured(original, step)
            for module in modules:
                if getattr(module, name, None) is original:
                    setattr(module, name, timed)
    lane_detect.lane_stripes = SimpleNamespace(stripes=clock.measured(lane_stripes.stripes, EVIDENCE))  # type: ignore[attr-defined, assignment]
    classify = clock.measured(LineClassifier.fit_with_kinds_and_colours, KINDS)
    LineClassifier.fit_with_kinds_and_colours = classify  # type: ignore[method-assign]
    LaneTracker.step = clock.measured(LaneTracker.step, GLUE)  # type: ignore[method-assign]
    with Log.open(path) as log:
        lanes(log, LanesConfig())
    return clock


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("log", type=Path)
    clock = measure_steps(parser.parse_args().log)
    total_s = sum(clock.seconds.values())
    print(f"{clock.n_frames} frames searched, {1e3 * total_s / clock.n_frames:.2f} ms of processor time each\n")
    print("| step | share |\n|---|---|")
    for step in (EVIDENCE, *STEPS, KINDS, GLUE):
        print(f"| {step} | {100.0 * clock.seconds[step] / total_s:.0f} % |")


if __name__ == "__main__":
    main()
