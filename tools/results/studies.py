"""The studies behind the numbers of the docs: one entry each. Each runs whole or with a small seed set."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from tools.results import page_studies
from tools.results.conformance import (
    FALSE_ACTIVATION_SEEDS,
    SEEDS_BY_CLAUSE,
    run_clause_over_seeds,
    run_trials_without_danger,
    values_of_false_activations,
    values_of_runs,
)
from tools.results.page_studies import DEVELOPMENT_LOGS, NOT_RANDOM, Numbers, call_cwcli
from tools.results.papers import more_of_reproduction, values_of_reproduction


@dataclass(frozen=True)
class Measured:
    """What one run of a study gave.

    Attributes:
        values: Key -> number with its interval (value, low, high), or a text.
        more: What a page needs besides.
        plots: Pictures of the page of a paper.
    """

    values: Mapping[str, tuple[float, float, float] | str]
    more: Mapping[str, Any] = field(default_factory=dict)
    plots: tuple[Any, ...] = ()


@dataclass(frozen=True)
class Study:
    """A study.

    Attributes:
        command: What a reader runs to get the same numbers.
        run: Runs it with a number of seeds.
        seeds, small_seeds: Of the whole run and of the small one; equal where nothing is random.
        needs_logs: It reads the development logs, which are not part of the repository.
    """

    command: str
    run: Callable[[int], Measured]
    seeds: int
    small_seeds: int
    needs_logs: bool = False

    @property
    def can_run(self) -> bool:
        """Whether the logs that it needs are at hand."""
        return not self.needs_logs or DEVELOPMENT_LOGS.is_dir()


def _run_song2016(seeds: int) -> Measured:
    from cwcli.reproduction.request import ReproductionRequest
    from cwcli.reproduction.song2016.reproduce import reproduce_song2016

    return _measured_of(reproduce_song2016(ReproductionRequest(seeds)))


def _run_xiang2019(seeds: int) -> Measured:
    from cwcli.reproduction.request import ReproductionRequest
    from cwcli.reproduction.xiang2019.report import reproduce_xiang2019

    return _measured_of(reproduce_xiang2019(ReproductionRequest(seeds)))


def _run_zhang2011(seeds: int) -> Measured:
    """Twenty seeds stand for 500 frames of each set, fewer for fewer."""
    from cwcli.reproduction.request import ReproductionRequest
    from cwcli.reproduction.zhang2011.reproduce import reproduce_zhang2011

    return _measured_of(reproduce_zhang2011(ReproductionRequest(seeds, frames=25 * seeds)))


def _measured_of(made: Any) -> Measured:
    numbers = values_of_reproduction(made)
    values = {key: each.text or (each.ours, each.low, each.high) for key, each in numbers.items()}
    return Measured(values, more_of_reproduction(made, made.summary.notes[1]), made.plots)


def _run_lead_profiles(seeds: int) -> Measured:
    """The seeds are the hundredths of the grid that are taken."""
    from tests.studies.lead_profiles import bound

    return Measured({key: (value, *NOT_RANDOM) for key, value in bound(100 // seeds).items()})


def _run_true_states(_: int) -> Measured:
    from cwcli.simulation.scenario import EGO_VEHICLE_KEY, load_scenario
    from tests.scenarios.song2016_moments import moments

    values = {}
    for name in ("rear-end", "intersection"):
        scenario = load_scenario(name)
        other = next(each for each in scenario.vehicles if each != EGO_VEHICLE_KEY)
        for model, when_s in moments(scenario, other).items():
            values[f"{name}: {model}"] = (when_s, *NOT_RANDOM)
    return Measured(values)


BUNDLED_CONFLICTS = ("rear-end", "intersection", "cut-in", "oncoming-left-turn", "stopped-behind-curve")
"""Scenarios with one conflict each."""
SENSOR_TRANSPORT_S = 0.005
"""Transport of the sensors in these scenarios: a warning can be known that much after its stamp."""


def _run_bundled(_: int) -> Measured:
    """Lead times of `cwcli run`, and least distances of `cwcli control`, on the bundled scenarios with seed 1."""
    values: Numbers = {}
    with tempfile.TemporaryDirectory() as folder:
        for name in BUNDLED_CONFLICTS:
            call_cwcli(folder, "simulate", name, "--seed", "1", "-o", f"{name}.mcap")
            printed = call_cwcli(folder, "run", f"{name}.mcap", "--json")
            (event,) = json.loads(printed)["stages"]["warn"]["sections"]["events"]
            values[f"{name}: lead time, known"] = (event["lead_s"], *NOT_RANDOM)
            values[f"{name}: lead time, stamp"] = (event["lead_s"] + SENSOR_TRANSPORT_S, *NOT_RANDOM)
        for name in ("rear-end", "intersection"):
            printed = call_cwcli(folder, "control", f"{name}.mcap", "--predictor", "cj-cya", "--json")
            document = json.loads(printed)["stages"]["control"]["sections"]
            values[f"{name}: warning"] = (document["warnings"][0]["at_s"], *NOT_RANDOM)
            for row in document["control"]:
                values[f"{name}: {row['policy']}, least distance"] = (row["least_m"], *NOT_RANDOM)
                if row["at_mps"] is not None:
                    values[f"{name}: {row['policy']}, speed at the collision"] = (row["at_mps"], *NOT_RANDOM)
    return Measured(values)


def _run_walking_targets(_: int) -> Measured:
    """The paper's tracker on the logs of xiang2019's four manoeuvres: mean square errors, in m^2."""
    options = "--model cv --filter ukf --gate 1 --no-tune --causal --cartesian-below 0 --targets one --json"
    values: Numbers = {}
    with tempfile.TemporaryDirectory() as folder:
        for name in ("line", "arc", "weave", "turn"):
            call_cwcli(folder, "simulate", f"xiang2019-{name}", "-o", f"{name}.mcap")
            printed = call_cwcli(folder, "track", f"{name}.mcap", *options.split())
            (row,) = json.loads(printed)["stages"]["track"]["sections"]["errors"]
            values |= {f"{name}: {axis}": (row[f"{axis}_m"] ** 2, *NOT_RANDOM) for axis in "xy"}
    return Measured(values)


def _run_clause(name: str, seeds: int) -> Measured:
    return Measured(values_of_runs(run_clause_over_seeds(name, seeds)))


def _run_latency(seeds: int) -> Measured:
    """Planted latencies of city drives."""
    from tests.studies.latency import SOURCES, TOLERANCE_S, one_run

    runs = [one_run(seed, 300.0) for seed in range(seeds)]
    values: Numbers = {}
    rng = np.random.default_rng(0)
    for source in SOURCES:
        errors, left, sigmas, bounds = (
            np.array([getattr(run, name)[source] for run in runs])
            for name in ("error_s", "left_s", "sigma_s", "bound_s")
        )
        drawn = rng.integers(0, seeds, (400, seeds))
        inside = (np.abs(errors) <= TOLERANCE_S).astype(np.float64)
        kinds: dict[str, tuple[Any, Callable[..., Any]]] = {
            "error": (errors, np.std),
            "within 10 ms": (inside, np.mean),
            "stated sigma": (sigmas, _root_mean_square),
            "bound": (bounds, _root_mean_square),
        }
        for kind, (each, statistic) in kinds.items():
            values[f"{source}: {kind}"] = (float(statistic(each)), *_ends(statistic(each[drawn], axis=-1)))
        if seeds > 10:  # of few runs the worst is another quantity
            values[f"{source}: worst left"] = (float(np.abs(left).max()), *NOT_RANDOM)
    return Measured(values)


def _root_mean_square(values: Any, axis: int | None = None) -> Any:
    """Return the root of the mean square along an axis."""
    return np.sqrt(np.mean(np.square(values), axis=axis))


def _measured_by(measure: Callable[[int], Numbers]) -> Callable[[int], Measured]:
    """Return the run of a study that gives numbers alone."""
    return lambda seeds: Measured(measure(seeds))


def _ends(samples: Any) -> tuple[float, float]:
    """Return the ends of the 95 % interval of bootstrap samples."""
    low, high = np.percentile(samples, [2.5, 97.5])
    return float(low), float(high)


STUDIES: dict[str, Study] = {
    "song2016": Study("cwcli reproduce song2016", _run_song2016, 100, 5),
    "xiang2019": Study("cwcli reproduce xiang2019", _run_xiang2019, 1000, 20),
    "zhang2011": Study("cwcli reproduce zhang2011", _run_zhang2011, 20, 2),
    "lead-profiles": Study("python -m tests.studies.lead_profiles", _run_lead_profiles, 100, 1),
    "true-states": Study("python -m tests.scenarios.song2016_moments rear-end", _run_true_states, 1, 1),
    "bundled": Study("cwcli simulate rear-end --seed 1 | cwcli run - --json", _run_bundled, 1, 1),
    "walking-targets": Study("cwcli simulate xiang2019-turn | cwcli track", _run_walking_targets, 1, 1),
    "latency": Study("python -m tests.studies.latency --runs 40", _run_latency, 40, 2),
    **{
        f"conform-{name}": Study(f"cwcli conform {name} --seeds {seeds}", partial(_run_clause, name), seeds, 2)
        for name, seeds in SEEDS_BY_CLAUSE.items()
    },
    "conform-false-activations": Study(
        "python -m tools.results --only conform-false-activations",
        lambda seeds: Measured(values_of_false_activations(run_trials_without_danger(seeds))),
        FALSE_ACTIVATION_SEEDS,
        1,
    ),
    "departure": Study(
        "cwcli simulate departure | cwcli run - --stage lanes,observe,predict-lane,warn-lane",
        _measured_by(page_studies.measure_departure),
        1,
        1,
    ),
    "observer": Study(
        "python -m tests.studies.rendered_motion drives", _measured_by(page_studies.measure_observer_drives), 8, 1
    ),
    "lane-drives": Study(
        "python -m tests.studies.lane_drives --seeds 200-201", _measured_by(page_studies.measure_lane_drives), 2, 1
    ),
    "crossing-targets": Study(
        "python tests/bench/bench_tracking.py --seeds 100",
        _measured_by(page_studies.measure_crossing_targets),
        100,
        10,
    ),
    "planted-events": Study(
        "python -m tests.studies.planted_events --drives 200 --hours 10",
        _measured_by(page_studies.measure_planted_events),
        200,
        20,
    ),
    "labelled-lanes": Study(
        "cwcli lanes tusimple-0313-dev.mcap -o lanes.mcap; cwcli evaluate lanes.mcap",
        _measured_by(page_studies.measure_labelled_lanes),
        1,
        1,
        needs_logs=True,
    ),
    "prediction": Study(
        "python -m tests.studies.prediction_bounds",
        _measured_by(page_studies.measure_prediction),
        1,
        1,
        needs_logs=True,
    ),
    "tracking": Study(
        "cwcli track udacity-obj-pose.ros2.mcap --causal",
        _measured_by(page_studies.measure_tracking),
        1,
        1,
        needs_logs=True,
    ),
}
"""Name of a result file -> its study."""
