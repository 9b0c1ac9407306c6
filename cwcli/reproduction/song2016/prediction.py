"""Figures 3, 5 and 7: the error of the predicted position for the three families and for three horizons."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cwcli.estimation.result import Track
from cwcli.estimation.song2016 import SAMPLING_TIME_S
from cwcli.lazy_dataclass import dataclass
from cwcli.prediction.models import DEFAULT_MODEL
from cwcli.prediction.rollout import RolloutSettings, roll_out_paths
from cwcli.reproduction.classes import MeasuredNumber
from cwcli.reproduction.expectations import printed_number_or_nan
from cwcli.reproduction.findings import Curve, Plot, StudyPart, is_strictly_increasing, median_and_interval_bounds
from cwcli.reproduction.song2016.methods import (
    MODEL_BY_FAMILY,
    PREDICTION_HORIZON_S,
    estimate_our_track,
    measure_vehicle,
    online_acting_durations_s,
    paper_filter_states_with_derivatives,
    paper_predicted_points_m,
)
from cwcli.signals.columns import FloatArray
from cwcli.simulation.scenario import EGO_VEHICLE_KEY, load_scenario

COMPARED_HORIZONS_S = (2.1, 2.5, 2.9)
"""The horizons that figure 7 compares, in s (song2016, figure 7)."""
FIGURE_BY_SCENARIO = {"straight": "fig 3", "curve": "fig 5"}
"""Scenario -> the paper's figure."""
OUR_METHOD = "cwcli"
"""Key of our default model among the methods."""
MIN_PREDICTION_START_S = 2.0
"""Earlier starts are left out, in s, because the filters have not settled. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class PredictionErrors:
    """Prediction errors of one scenario.

    Attributes:
        time_s: Shape (n,), of the starts.
        mean_m, max_m: Method -> shape (seeds,): over the starts.
        example_m: Method -> shape (n,), the first seed.
        horizon_max_m: Horizon -> shape (seeds,): largest error of the jerk model.
        horizon_example_m: Horizon -> time and error of the first seed.
    """

    time_s: FloatArray
    mean_m: dict[str, FloatArray]
    max_m: dict[str, FloatArray]
    example_m: dict[str, FloatArray]
    horizon_max_m: dict[float, FloatArray]
    horizon_example_m: dict[float, tuple[FloatArray, FloatArray]]


def compute_prediction_errors(name: str, n_seeds: int, tick: Callable[[], None]) -> PredictionErrors:
    """Predict from every state of the host, in every seed, and compare with the truth."""
    scenario = load_scenario(name)
    motion = scenario.vehicles[EGO_VEHICLE_KEY].motion
    means: dict[str, list[float]] = {method: [] for method in (*MODEL_BY_FAMILY, OUR_METHOD)}
    largest: dict[str, list[float]] = {method: [] for method in means}
    by_horizon: dict[float, list[float]] = {horizon: [] for horizon in COMPARED_HORIZONS_S}
    example: dict[str, FloatArray] = {}
    horizon_example: dict[float, tuple[FloatArray, FloatArray]] = {}
    start_s = np.zeros(0)
    for seed in range(n_seeds):
        run = measure_vehicle(scenario, EGO_VEHICLE_KEY, seed)
        states = paper_filter_states_with_derivatives(run)
        start_s, errors = starts_and_error_function(
            run.time_s, scenario.duration_s, PREDICTION_HORIZON_S, motion.states_at
        )
        for family in MODEL_BY_FAMILY:
            error_m = errors(paper_predicted_points_m(states, family, PREDICTION_HORIZON_S))
            example.setdefault(family, error_m)
            means[family].append(float(error_m.mean()))
            largest[family].append(float(error_m.max()))
        error_m = errors(_default_predicted_points_m(estimate_our_track(run)))
        example.setdefault(OUR_METHOD, error_m)
        means[OUR_METHOD].append(float(error_m.mean()))
        largest[OUR_METHOD].append(float(error_m.max()))
        for horizon in COMPARED_HORIZONS_S:
            at_s, at_horizon = starts_and_error_function(run.time_s, scenario.duration_s, horizon, motion.states_at)
            error_m = at_horizon(paper_predicted_points_m(states, "jerk", horizon))
            by_horizon[horizon].append(float(error_m.max()))
            horizon_example.setdefault(horizon, (at_s, error_m))
        tick()
    return PredictionErrors(
        start_s,
        {method: np.array(values) for method, values in means.items()},
        {method: np.array(values) for method, values in largest.items()},
        example,
        {horizon: np.array(values) for horizon, values in by_horizon.items()},
        horizon_example,
    )


def prediction_errors_part(name: str, errors: PredictionErrors) -> StudyPart:
    """Compute figure 3 or 5: the order of the families, in the mean and in the maximum, and our default."""
    figure = FIGURE_BY_SCENARIO[name]
    measured: list[MeasuredNumber] = []
    medians: dict[str, list[float]] = {"mean": [], "largest": []}
    for method in ("jerk", "acceleration", "speed", OUR_METHOD):
        label = "our default" if method == OUR_METHOD else f"constant {method}"
        for kind, values in (("mean", errors.mean_m[method]), ("largest", errors.max_m[method])):
            found = median_and_interval_bounds(values)
            measured.append(MeasuredNumber(figure, f"{name}: {kind} error, {label}", *found))
            if method != OUR_METHOD:
                medians[kind].append(found[0])
    for kind, values_m in medians.items():
        what = f"{name}: {kind} error: jerk below acceleration below speed"
        measured.append(MeasuredNumber(figure, what, float(is_strictly_increasing(values_m))))
    labels = {family: f"constant {family}" for family in MODEL_BY_FAMILY} | {OUR_METHOD: "our default"}
    marks = {}
    if name == "curve":
        marks = {
            f"curve {label}, printed": printed_number_or_nan(
                "song2016", "fig 4", f"curve: half of its curvature is {what} at"
            )
            for label, what in (("begins", "reached"), ("ends", "left"))
        }
    plot = Plot(
        figure,
        f"{name}: position error {PREDICTION_HORIZON_S:g} s ahead (first seed)",
        "time of the prediction [s]",
        "error [m]",
        [Curve(labels[method], errors.time_s, values) for method, values in errors.example_m.items()],
        marks,
    )
    return StudyPart(tuple(measured), (plot,))


def prediction_horizons_part(errors: PredictionErrors) -> StudyPart:
    """Compute figure 7: the jerk model at three horizons on the straight scenario."""
    measured = [
        MeasuredNumber(
            "fig 7",
            f"straight: largest error of constant jerk, {horizon:g} s ahead",
            *median_and_interval_bounds(values),
        )
        for horizon, values in errors.horizon_max_m.items()
    ]
    growth = errors.horizon_max_m[COMPARED_HORIZONS_S[-1]] / errors.horizon_max_m[PREDICTION_HORIZON_S]
    what = f"straight: largest error {COMPARED_HORIZONS_S[-1]:g} s ahead over that {PREDICTION_HORIZON_S:g} s ahead"
    measured.append(MeasuredNumber("fig 7", what, *median_and_interval_bounds(growth)))
    plot = Plot(
        "fig 7",
        "straight: position error of constant jerk at three horizons (first seed)",
        "time of the prediction [s]",
        "error [m]",
        [Curve(f"{h:g} s", time_s, error_m) for h, (time_s, error_m) in errors.horizon_example_m.items()],
        level=(
            "printed maximum, 2.9 s",
            printed_number_or_nan("song2016", "fig 7", "straight: largest error of constant jerk, 2.9 s ahead"),
        ),
    )
    return StudyPart(tuple(measured), (plot,))


def filtered_path_part() -> StudyPart:
    """Plot figure 4: the path of the car in the curve, true, measured and filtered (seed 0)."""
    run = measure_vehicle(load_scenario("curve"), EGO_VEHICLE_KEY, 0)
    states = paper_filter_states_with_derivatives(run)
    curves = [
        Curve("measured", run.vectors[:, 0], run.vectors[:, 1]),
        Curve("the paper's filter", states[:, 0], states[:, 1]),
        Curve("true", run.truth[:, 0], run.truth[:, 1]),
    ]
    radius_m = run.truth[:, 2] / np.maximum(run.truth[:, 5], 1e-9)
    curves.append(_printed_circle_curve(run.truth[radius_m.argmin()]))
    in_curve = run.time_s[radius_m < 2.0 * radius_m.min()]
    measured = (
        MeasuredNumber("fig 4", "curve: speed", float(run.truth[:, 2].mean())),
        MeasuredNumber("fig 4", "curve: radius", float(radius_m.min())),
        MeasuredNumber("fig 4", "curve: half of its curvature is reached at", float(in_curve[0])),
        MeasuredNumber("fig 4", "curve: half of its curvature is left at", float(in_curve[-1])),
    )
    title = "curve: the way of the car (first seed)"
    return StudyPart(measured, (Plot("fig 4", title, "east [m]", "north [m]", curves, is_map=True),))


def _printed_circle_curve(state: FloatArray) -> Curve:
    """Return the circle of the printed radius that touches the car's way, to its left, at a state (6,)."""
    radius_m = printed_number_or_nan("song2016", "fig 4", "curve: radius")
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    x_m = state[0] + radius_m * (np.cos(angle) - np.sin(state[3]))
    y_m = state[1] + radius_m * (np.sin(angle) + np.cos(state[3]))
    return Curve(f"circle of {radius_m:g} m, printed", x_m, y_m)


def starts_and_error_function(
    time_s: FloatArray, end_s: float, horizon_s: float, true_state: Callable[[FloatArray], FloatArray]
) -> tuple[FloatArray, Callable[[FloatArray], FloatArray]]:
    """Return the starts whose outcome is known, and a function from points (n, 2) of all starts to errors."""
    rows = np.flatnonzero((time_s >= MIN_PREDICTION_START_S) & (time_s + horizon_s <= end_s + 1e-9))
    actual = true_state(time_s[rows] + horizon_s)[:, :2]
    return time_s[rows], lambda points: np.asarray(np.hypot(*(points[rows] - actual).T))


def _default_predicted_points_m(track: Track) -> FloatArray:
    """Predict positions (n, 2) in m by our default model."""
    acted = online_acting_durations_s(track)
    paths = roll_out_paths(
        DEFAULT_MODEL,
        track.state,
        track.covariance,
        settings=RolloutSettings(horizon_s=PREDICTION_HORIZON_S, step_s=SAMPLING_TIME_S),
        acting_s=acted,
    )
    return np.column_stack([paths.x_m[:, -1], paths.y_m[:, -1]])
