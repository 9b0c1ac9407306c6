"""Figures 9 and 11: when each family warns, against the ideal moment; and our default beside them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cwcli.metrics.intervals import poisson_interval
from cwcli.prediction.models import DEFAULT_MODEL
from cwcli.reproduction.findings import (
    NOT_PRINTED,
    Curve,
    Finding,
    Part,
    Plot,
    median_interval,
    ordered,
    within,
)
from cwcli.reproduction.song2016.methods import (
    FAMILIES,
    HORIZON_S,
    Known,
    known_exactly,
    known_vehicles,
    paper_points,
    paper_states,
    sense,
)
from cwcli.signals.columns import FloatArray
from cwcli.simulation.drive import simulate
from cwcli.simulation.scenario import HOST, Scenario, load_scenario
from cwcli.warning.evaluate import find_warnings
from cwcli.warning.rules import RULES
from cwcli.warning.types import WarningConfig

COLLISION_M = 2.5
TOLERANCE_S = 0.1
FINE_STEP_S = 0.001
PAPER_MOMENTS_S = {
    "rear-end": {"ideal": 3.5, "jerk": 3.6, "acceleration": 4.0, "speed": 4.5},
    "intersection": {"ideal": 4.62, "jerk": 4.72, "acceleration": 4.80, "speed": 4.88},
}
FIGURES = {"rear-end": "fig 9", "intersection": "fig 11"}
OURS, OURS_ON_LINK = "cwcli", "cwcli-v2x"
TRAPS = ("brake-and-release", "parallel-lanes", "near-miss-crossing", "following")


@dataclass(frozen=True)
class Moments:
    """Warning moments of one scenario.

    Attributes:
        scenario: The scenario.
        other: Name of the other vehicle.
        ideal_s: `HORIZON_S` before the cars are nearer than `COLLISION_M`.
        by_method: Method -> shape (seeds,), NaN where it never warned. Methods: the families of the paper; `cwcli`, our
            default, which knows what the paper's chain knows when it knows it; `cwcli-v2x`, our default on messages.
        example: Family -> predicted distance over time for the first seed, shape (n,).
        time_s: Shape (n,).
    """

    scenario: Scenario
    other: str
    ideal_s: float
    by_method: dict[str, FloatArray]
    example: dict[str, FloatArray]
    time_s: FloatArray


def warning_moments(name: str, n_seeds: int, tick: Callable[[], None]) -> Moments:
    """Run a two-car scenario over seeds 0 to n_seeds - 1; `tick` is called after each seed."""
    scenario = load_scenario(name)
    other = next(vehicle for vehicle in scenario.vehicles if vehicle != HOST)
    moments: dict[str, list[float]] = {method: [] for method in (*FAMILIES, OURS, OURS_ON_LINK)}
    example: dict[str, FloatArray] = {}
    time_s = np.zeros(0)
    for seed in range(n_seeds):
        runs = [sense(scenario, vehicle, seed) for vehicle in (HOST, other)]
        states = [paper_states(run) for run in runs]
        time_s = runs[0].time_s
        for family in FAMILIES:
            host_xy, other_xy = (paper_points(own, family, HORIZON_S) for own in states)
            distance_m = np.hypot(*(host_xy - other_xy).T)
            example.setdefault(family, distance_m)
            moments[family].append(first_below(time_s, distance_m, COLLISION_M))
        host, partner = (known_exactly(run, vehicle) for vehicle, run in zip((HOST, other), runs, strict=True))
        moments[OURS].append(_first_default_warning_s(host, [partner], 0))
        host, others = known_vehicles(simulate(scenario, seed))
        moments[OURS_ON_LINK].append(_first_default_warning_s(host, others, scenario.start_ns))
        tick()
    arrays = {method: np.array(values) for method, values in moments.items()}
    return Moments(scenario, other, collision_time_s(scenario, other) - HORIZON_S, arrays, example, time_s)


def first_below(time_s: FloatArray, distance_m: FloatArray, threshold_m: float) -> float:
    """The first time at which the distance is below the threshold, NaN if it never is."""
    below = np.flatnonzero(distance_m < threshold_m)
    return float(time_s[below[0]]) if len(below) else math.nan


def collision_time_s(scenario: Scenario, other: str) -> float:
    """When the true centres come nearer than `COLLISION_M`, NaN if they never do."""
    time_s = np.arange(int(scenario.duration_s / FINE_STEP_S) + 1, dtype=np.float64) * FINE_STEP_S
    host_state, other_state = (scenario.vehicles[vehicle].motion.at(time_s) for vehicle in (HOST, other))
    return first_below(time_s, np.hypot(*(host_state[:, :2] - other_state[:, :2]).T), COLLISION_M)


def false_warnings(name: str, n_seeds: int, tick: Callable[[], None]) -> dict[str, int]:
    """Warnings in a trap over all seeds: of our default, and of the paper's rule on the paper's model."""
    scenario = load_scenario(name)
    counts = {OURS: 0, "song2016": 0}
    for seed in range(n_seeds):
        host, others = known_vehicles(simulate(scenario, seed))
        counts[OURS] += len(_warnings_ns(host, others, DEFAULT_MODEL, WarningConfig()))
        counts["song2016"] += len(_warnings_ns(host, others, FAMILIES["jerk"], WarningConfig(rule="song2016")))
        tick()
    return counts


def figure_part(name: str, moments: Moments) -> Part:
    """Figure 9 or 11 as findings and a plot."""
    figure, paper = FIGURES[name], PAPER_MOMENTS_S[name]
    findings = [_ideal(figure, paper["ideal"], moments.ideal_s)]
    medians: dict[str, float] = {}
    for family in FAMILIES:
        median, low, high = median_interval(moments.by_method[family])
        medians[family] = median
        verdict = within(median, paper[family], TOLERANCE_S)
        what = f"{name}: warning, constant {family}, median"
        findings.append(Finding(figure, what, "s", paper[family], median, low, high, verdict, is_required=True))
        silent = 100.0 * float(np.isnan(moments.by_method[family]).mean())
        what = f"{name}: runs without a warning, constant {family}"
        findings.append(Finding(figure, what, "%", NOT_PRINTED, silent, math.nan, math.nan, "reported"))
    in_order = ordered([medians[family] for family in ("jerk", "acceleration", "speed")])
    findings.append(
        Finding(
            figure,
            f"{name}: jerk before acceleration before speed",
            "",
            1.0,
            float(in_order),
            math.nan,
            math.nan,
            "reproduced" if in_order else "differs",
            is_required=True,
        )
    )
    median, low, high = median_interval(moments.by_method[OURS])
    nearer_s = abs(medians["jerk"] - moments.ideal_s) - abs(median - moments.ideal_s)
    is_better, is_met = nearer_s > 1e-9, nearer_s >= -1e-9  # false for NaN
    findings.append(
        Finding(
            figure,
            f"{name}: warning, our default, median (bound: as near the ideal as jerk)",
            "s",
            NOT_PRINTED,
            median,
            low,
            high,
            "better" if is_better else "reproduced" if is_met else "worse",
            is_required=True,
        )
    )
    median, low, high = median_interval(moments.by_method[OURS_ON_LINK])
    what = f"{name}: warning, our default over the V2X link, median"
    findings.append(Finding(figure, what, "s", NOT_PRINTED, median, low, high, "reported"))
    plot = Plot(
        figure,
        f"{name}: distance predicted {HORIZON_S:g} s ahead (first seed)",
        "time [s]",
        "predicted distance [m]",
        [
            Curve(f"constant {family}", moments.time_s, values, float(moments.by_method[family][0]))
            for family, values in moments.example.items()
        ],
        {"ideal moment": moments.ideal_s},
        ("collision", COLLISION_M),
        x_range=(moments.ideal_s - 2.5, moments.ideal_s + 2.5),
        y_range=(0.0, 30.0),
    )
    return Part(tuple(findings), (plot,))


def trap_part(name: str, counts: dict[str, int], n_seeds: int) -> Part:
    """A trap as findings: our default must stay silent; it is better where the paper's rule does not."""
    is_better = counts["song2016"] > 0
    return Part(
        (
            Finding(
                "trap",
                f"{name}: warnings in {n_seeds} seeds, our default (bound 0)",
                "",
                NOT_PRINTED,
                float(counts[OURS]),
                *poisson_interval(counts[OURS]),
                "worse" if counts[OURS] else "better" if is_better else "reproduced",
                is_required=True,
            ),
            Finding(
                "trap",
                f"{name}: warnings in {n_seeds} seeds, the paper's rule",
                "",
                NOT_PRINTED,
                float(counts["song2016"]),
                *poisson_interval(counts["song2016"]),
                "reported",
            ),
        )
    )


def _ideal(figure: str, paper_s: float, ours_s: float) -> Finding:
    verdict = within(ours_s, paper_s, TOLERANCE_S)
    return Finding(figure, "ideal moment", "s", paper_s, ours_s, math.nan, math.nan, verdict, is_required=True)


def _first_default_warning_s(host: Known, others: Sequence[Known], start_ns: int) -> float:
    """When our default chain warns first, seconds from the start; NaN if it never does."""
    warnings_ns = _warnings_ns(host, others, DEFAULT_MODEL, WarningConfig())
    return (warnings_ns[0] - start_ns) * 1e-9 if warnings_ns else math.nan


def _warnings_ns(host: Known, others: Sequence[Known], model: str, config: WarningConfig) -> list[int]:
    """When the rule raises a warning on what the host knows on line, in order."""
    with_onset = RULES[config.rule].uses_onset
    partners = [other.predicted(model, with_onset=with_onset) for other in others]
    result = find_warnings(host.predicted(model), partners, config)
    return [int(event["raised_stamp_ns"]) for event in result.events.records()]
