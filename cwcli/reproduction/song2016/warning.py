"""Figures 9 and 11: when each family warns, against the ideal moment; and our default beside them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from cwcli.estimation.song2016 import SAMPLING_TIME_S
from cwcli.lazy_dataclass import dataclass
from cwcli.metrics.intervals import poisson_interval
from cwcli.prediction.models import DEFAULT_MODEL
from cwcli.reproduction.classes import MeasuredNumber
from cwcli.reproduction.expectations import printed_number_or_nan
from cwcli.reproduction.findings import Curve, Plot, StudyPart, is_strictly_increasing, median_and_interval_bounds
from cwcli.reproduction.song2016.methods import (
    MODEL_BY_FAMILY,
    PREDICTION_HORIZON_S,
    KnownVehicle,
    host_and_received_vehicles,
    measure_vehicle,
    paper_filter_states_with_derivatives,
    paper_predicted_points_m,
    vehicle_known_without_delay,
)
from cwcli.signals.columns import FloatArray
from cwcli.simulation.drive import simulate_scenario
from cwcli.simulation.scenario import EGO_VEHICLE_KEY, Scenario, load_scenario
from cwcli.warning.evaluate import find_warnings
from cwcli.warning.rules import RULES
from cwcli.warning.types import WarningConfig

COLLISION_CENTRE_DISTANCE_M = 2.5
"""Centres nearer than this count as a collision, in m: the threshold of the paper's rule (figures 9 and 11)."""
COLLISION_SEARCH_STEP_S = 0.001
"""Time step of the search for the true collision, in s. Chosen by hand; not fitted."""
FIGURE_BY_SCENARIO = {"rear-end": "fig 9", "intersection": "fig 11"}
"""Scenario -> the paper's figure of predicted distances."""
MAP_FIGURE_BY_SCENARIO = {"rear-end": "fig 8", "intersection": "fig 10"}
"""Scenario -> the paper's figure of the paths from above."""
HALF_PLOTTED_TIME_AROUND_IDEAL_MOMENT_BY_SCENARIO_S = {"rear-end": 2.5, "intersection": 1.0}
"""Scenario -> half of the time that is drawn around the ideal moment, in s, so that the moments, printed 0.4 and 0.08 s
apart, can be told from each other. Chosen by hand."""
OUR_METHOD = "cwcli"
"""Key of our default chain with the paper's knowledge among the methods."""
OUR_METHOD_ON_V2X = "cwcli-v2x"
"""Key of our default chain on V2X messages among the methods."""
COLLISION_FREE_SCENARIOS_THAT_MUST_NOT_WARN = ("brake-and-release", "parallel-lanes", "near-miss-crossing", "following")
"""Scenarios without a collision in which our default must not warn."""


@dataclass(frozen=True)
class WarningMoments:
    """Warning moments of one scenario over all seeds.

    Attributes:
        ideal_s: `HORIZON_S` before the cars are nearer than `COLLISION_CENTRE_DISTANCE_M`.
        warned_s_by_method: Method -> shape (seeds,), NaN where it never warned. Methods: the families of the paper;
            `cwcli`, our
            default, which knows what the paper's chain knows when it knows it; `cwcli-v2x`, our default on messages.
        distance_m: Family -> predicted distance over time, shape (seeds, n).
        time_s: Shape (n,).
    """

    scenario: Scenario
    other: str
    ideal_s: float
    warned_s_by_method: dict[str, FloatArray]
    distance_m: dict[str, FloatArray]
    time_s: FloatArray


def simulate_warning_moments(name: str, n_seeds: int, tick: Callable[[], None]) -> WarningMoments:
    """Simulate a two-car scenario over seeds 0 to n_seeds - 1; `tick` is called after each seed."""
    scenario = load_scenario(name)
    other = next(vehicle for vehicle in scenario.vehicles if vehicle != EGO_VEHICLE_KEY)
    moments: dict[str, list[float]] = {method: [] for method in (*MODEL_BY_FAMILY, OUR_METHOD, OUR_METHOD_ON_V2X)}
    distances: dict[str, list[FloatArray]] = {family: [] for family in MODEL_BY_FAMILY}
    time_s = np.zeros(0)
    for seed in range(n_seeds):
        runs = [measure_vehicle(scenario, vehicle, seed) for vehicle in (EGO_VEHICLE_KEY, other)]
        states = [paper_filter_states_with_derivatives(run) for run in runs]
        time_s = runs[0].time_s
        for family in MODEL_BY_FAMILY:
            host_xy, other_xy = (paper_predicted_points_m(own, family, PREDICTION_HORIZON_S) for own in states)
            distance_m = np.hypot(*(host_xy - other_xy).T)
            distances[family].append(distance_m)
            moments[family].append(first_time_below_s(time_s, distance_m, COLLISION_CENTRE_DISTANCE_M))
        host, partner = (
            vehicle_known_without_delay(run, vehicle)
            for vehicle, run in zip((EGO_VEHICLE_KEY, other), runs, strict=True)
        )
        moments[OUR_METHOD].append(_first_default_warning_s(host, [partner], 0))
        host, others = host_and_received_vehicles(simulate_scenario(scenario, seed))
        moments[OUR_METHOD_ON_V2X].append(_first_default_warning_s(host, others, scenario.start_ns))
        tick()
    arrays = {method: np.array(values) for method, values in moments.items()}
    distance_m = {family: np.array(values) for family, values in distances.items()}
    return WarningMoments(
        scenario, other, collision_time_s(scenario, other) - PREDICTION_HORIZON_S, arrays, distance_m, time_s
    )


def first_time_below_s(time_s: FloatArray, distance_m: FloatArray, threshold_m: float) -> float:
    """Return the first time at which the distance is below the threshold, NaN if it never is."""
    below = np.flatnonzero(distance_m < threshold_m)
    return float(time_s[below[0]]) if len(below) else math.nan


def collision_time_s(scenario: Scenario, other: str) -> float:
    """Return when the true centres come nearer than `COLLISION_CENTRE_DISTANCE_M`, NaN if they never do."""
    time_s = (
        np.arange(int(scenario.duration_s / COLLISION_SEARCH_STEP_S) + 1, dtype=np.float64) * COLLISION_SEARCH_STEP_S
    )
    host_state, other_state = (
        scenario.vehicles[vehicle].motion.states_at(time_s) for vehicle in (EGO_VEHICLE_KEY, other)
    )
    return first_time_below_s(
        time_s, np.hypot(*(host_state[:, :2] - other_state[:, :2]).T), COLLISION_CENTRE_DISTANCE_M
    )


def count_false_warnings(name: str, n_seeds: int, tick: Callable[[], None]) -> dict[str, int]:
    """Count the warnings in a trap over all seeds: of our default, and of the paper's rule and model."""
    scenario = load_scenario(name)
    counts = {OUR_METHOD: 0, "song2016": 0}
    for seed in range(n_seeds):
        host, others = host_and_received_vehicles(simulate_scenario(scenario, seed))
        counts[OUR_METHOD] += len(_warning_times_ns(host, others, DEFAULT_MODEL, WarningConfig()))
        counts["song2016"] += len(
            _warning_times_ns(host, others, MODEL_BY_FAMILY["jerk"], WarningConfig(rule="song2016"))
        )
        tick()
    return counts


def warning_moments_part(name: str, moments: WarningMoments) -> StudyPart:
    """Compute figure 9 or 11: the moments, and the predicted distances in a typical seed."""
    figure = FIGURE_BY_SCENARIO[name]
    measured = [MeasuredNumber(figure, "ideal moment", moments.ideal_s)]
    medians: dict[str, float] = {}
    for family in MODEL_BY_FAMILY:
        found = median_and_interval_bounds(moments.warned_s_by_method[family])
        medians[family] = found[0]
        measured.append(MeasuredNumber(figure, f"{name}: warning, constant {family}, median", *found))
        silent = 100.0 * float(np.isnan(moments.warned_s_by_method[family]).mean())
        measured.append(MeasuredNumber(figure, f"{name}: runs without a warning, constant {family}", silent))
    in_order = is_strictly_increasing([medians[family] for family in ("jerk", "acceleration", "speed")])
    measured.append(MeasuredNumber(figure, f"{name}: jerk before acceleration before speed", float(in_order)))
    found = median_and_interval_bounds(moments.warned_s_by_method[OUR_METHOD])
    measured.append(MeasuredNumber(figure, f"{name}: warning, our default, median", *found))
    farther_s = abs(found[0] - moments.ideal_s) - abs(medians["jerk"] - moments.ideal_s)
    measured.append(
        MeasuredNumber(figure, f"{name}: our default farther from the ideal moment than jerk by", farther_s)
    )
    found = median_and_interval_bounds(moments.warned_s_by_method[OUR_METHOD_ON_V2X])
    measured.append(MeasuredNumber(figure, f"{name}: warning, our default over the V2X link, median", *found))
    seed = most_typical_seed_or_zero(moments)
    half_s = HALF_PLOTTED_TIME_AROUND_IDEAL_MOMENT_BY_SCENARIO_S[name]
    plot = Plot(
        figure,
        f"{name}: distance predicted {PREDICTION_HORIZON_S:g} s ahead; dots: warnings (seed {seed}), diamonds: printed",
        "time [s]",
        "predicted distance [m]",
        [
            Curve(
                f"constant {family}",
                moments.time_s,
                values[seed],
                float(moments.warned_s_by_method[family][seed]),
                printed_number_or_nan("song2016", figure, f"{name}: warning, constant {family}, median"),
            )
            for family, values in moments.distance_m.items()
        ],
        {
            "ideal moment": moments.ideal_s,
            "ideal moment, printed": printed_number_or_nan("song2016", figure, "ideal moment"),
        },
        ("collision", COLLISION_CENTRE_DISTANCE_M),
        x_range=(moments.ideal_s - half_s, moments.ideal_s + half_s),
        y_range=(0.0, 12.0 * half_s),
    )
    return StudyPart(tuple(measured), (plot, _plot_both_paths_until_collision(name, moments)))


def most_typical_seed_or_zero(moments: WarningMoments) -> int:
    """Return the seed in which all families and our default warn and are nearest to their medians; else 0."""
    when_s = np.column_stack([moments.warned_s_by_method[method] for method in (*MODEL_BY_FAMILY, OUR_METHOD)])
    everywhere = np.isfinite(when_s).all(axis=1)
    if not everywhere.any():
        return 0
    away_s = np.abs(when_s - np.nanmedian(when_s, axis=0)).sum(axis=1)
    return int(np.where(everywhere, away_s, np.inf).argmin())


def _plot_both_paths_until_collision(name: str, moments: WarningMoments) -> Plot:
    """Plot figure 8 or 10: the paths of both cars until they collide, with dots at the ideal moment."""
    time_s = np.arange(0.0, moments.ideal_s + PREDICTION_HORIZON_S, SAMPLING_TIME_S)
    curves = []
    for vehicle in (EGO_VEHICLE_KEY, moments.other):
        car = moments.scenario.vehicles[vehicle]
        path = car.motion.states_at(time_s)
        curves.append(Curve(f"path of {vehicle}", path[:, 0], path[:, 1]))
        shown = car.motion.states_at(np.array([0.0, moments.ideal_s]))
        x, y = np.concatenate([_closed_outline_m(state, car.length_m, car.width_m) for state in shown]).T
        curves.append(Curve(vehicle, x, y))
    title = f"{name}: both cars at the start and at the ideal moment, and their paths until they collide"
    return Plot(MAP_FIGURE_BY_SCENARIO[name], title, "east [m]", "north [m]", curves, is_map=True)


def _closed_outline_m(state: FloatArray, length_m: float, width_m: float) -> FloatArray:
    """Return a car's closed outline, shape (6, 2), m, that ends with a gap."""
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) * (length_m / 2.0, width_m / 2.0)
    cos, sin = np.cos(state[3]), np.sin(state[3])
    outline_in_map_m = corners @ np.array([[cos, sin], [-sin, cos]]) + state[:2]
    return np.concatenate([outline_in_map_m, np.full((1, 2), np.nan)])


def false_warning_trap_part(name: str, counts: dict[str, int], n_seeds: int) -> StudyPart:
    """Report the warnings in a trap of our default, which must stay silent, and of the paper's rule."""
    labels = {OUR_METHOD: "our default", "song2016": "the paper's rule"}
    return StudyPart(
        tuple(
            MeasuredNumber(
                "traps",
                f"{name}: warnings in a hundred runs, {label}",
                100.0 * counts[method] / n_seeds,
                *(100.0 * bound / n_seeds for bound in poisson_interval(counts[method])),
            )
            for method, label in labels.items()
        )
    )


def _first_default_warning_s(host: KnownVehicle, others: Sequence[KnownVehicle], start_ns: int) -> float:
    """Return when our default chain warns first, in s from the start; NaN if it never does.

    It looks as far ahead as the paper's rule, and not as far as braking needs: the figures compare with that moment.
    """
    warnings_ns = _warning_times_ns(host, others, DEFAULT_MODEL, WarningConfig(max_horizon_s=0.0))
    return (warnings_ns[0] - start_ns) * 1e-9 if warnings_ns else math.nan


def _warning_times_ns(
    host: KnownVehicle, others: Sequence[KnownVehicle], model: str, config: WarningConfig
) -> list[int]:
    """Return the stamps at which the rule raises a warning on what the host knows online, in order."""
    with_onset = RULES[config.rule].uses_onset
    partners = [other.with_predicted_paths(model, with_onset=with_onset) for other in others]
    result = find_warnings(host.with_predicted_paths(model), partners, config)
    return [int(event["raised_stamp_ns"]) for event in result.events_table.rows_as_dicts()]
