"""Table 1 and figures 1 and 2: the error of the measurements and of the estimates.

The drives are the scenarios `straight` and `curve`, the noise is that of their sensors. The paper's "0.5 %" of
acceleration is read as 0.5 % of g.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cwcli.estimation.consistency import ErrorTableRow, compare_errors_with_truth
from cwcli.metrics.intervals import normal_interval
from cwcli.reproduction.classes import MeasuredNumber
from cwcli.reproduction.findings import Curve, Plot, StudyPart
from cwcli.reproduction.song2016.methods import (
    MeasuredRun,
    estimate_our_track,
    measure_vehicle,
    paper_filter_states_with_derivatives,
)
from cwcli.signals.columns import FloatArray
from cwcli.simulation.scenario import EGO_VEHICLE_KEY, load_scenario

QUANTITY_LABELS = {
    "position": "position",
    "speed": "speed",
    "heading": "heading",
    "accel": "acceleration",
    "yaw_rate": "yaw rate",
}
"""Name of a quantity in `compare_errors_with_truth` -> its printed name in table 1."""
PAPER_FILTER_KEY = "song2016"
"""Key of the paper's filter in `LABELS`."""
PERCENT_OF_G_PER_MPS2 = 100.0 / 9.81
"""Per cent of g in 1 m/s^2: table 1 gives the acceleration in per cent, read as of g."""
ESTIMATOR_LABELS = {
    "smoothed": "our smoother",
    "default": "our smoother as on the command line, latencies searched",
    "causal": "our filter",
    "song2016": "the paper's filter",
}
"""Key of an estimator -> its label in tables and plots."""


def estimate_with_all_methods(run: MeasuredRun) -> dict[str, FloatArray]:
    """Estimate states (n, 8) from the same measurements by every estimator: key of `LABELS` -> states."""
    return {
        "smoothed": estimate_our_track(run, causal=False).state,
        "default": estimate_our_track(run, causal=False, latency="auto").state,
        "causal": estimate_our_track(run).state,
        "song2016": paper_filter_states_with_derivatives(run),
    }


def table1_error_rows(run: MeasuredRun, state: FloatArray) -> list[ErrorTableRow]:
    """Compute table 1 of one run: the errors of the measurements and of an estimate, shape (n, >= 6)."""
    return compare_errors_with_truth(
        _split_into_quantities(run.truth), _split_into_quantities(run.vectors), _split_into_quantities(state)
    )


def reproduce_table_1_of_scenario(name: str, n_seeds: int, tick: Callable[[], None]) -> StudyPart:
    """Compute table 1 on one scenario: errors measured and filtered, and the change by each estimator."""
    scenario = load_scenario(name)
    changes: dict[tuple[str, str], list[float]] = {(m, q): [] for q in QUANTITY_LABELS for m in ESTIMATOR_LABELS}
    levels: dict[tuple[str, str], list[float]] = {
        (k, q): [] for k in ("measured", "estimated") for q in QUANTITY_LABELS
    }
    plots: tuple[Plot, ...] = ()
    for seed in range(n_seeds):
        run = measure_vehicle(scenario, EGO_VEHICLE_KEY, seed)
        estimates = estimate_with_all_methods(run)
        for method, state in estimates.items():
            for row in table1_error_rows(run, state):
                changes[method, row.name].append(row.change_percent)
                if method == PAPER_FILTER_KEY:
                    scale = PERCENT_OF_G_PER_MPS2 if row.name == "accel" else 1.0
                    levels["measured", row.name].append(scale * row.measured_sigma)
                    levels["estimated", row.name].append(scale * row.estimated_sigma)
        if seed == 0 and name == "straight":
            plots = _error_plots(run, estimates)
        tick()
    measured = [
        _mean_with_interval(
            f"{name}: {kind} {QUANTITY_LABELS[quantity]} error"
            + (", the paper's filter" if kind == "estimated" else ""),
            values,
        )
        for (kind, quantity), values in levels.items()
    ]
    measured += [
        _mean_with_interval(
            f"{name}: change of the {QUANTITY_LABELS[quantity]} error, {ESTIMATOR_LABELS[method]}", values
        )
        for (method, quantity), values in changes.items()
    ]
    return StudyPart(tuple(measured), plots)


def _mean_with_interval(what: str, values: list[float]) -> MeasuredNumber:
    """Return the mean of values over the seeds, with its interval, as a number of table 1."""
    low, high = normal_interval(np.array(values))
    return MeasuredNumber("table 1", what, float(np.mean(values)), low, high)


def _split_into_quantities(state: FloatArray) -> dict[str, FloatArray]:
    """Split columns x, y, v, heading, a, yaw rate into the rows of table 1, in the units of
    `compare_errors_with_truth`."""
    singles = {name: state[:, column] for column, name in enumerate(("speed", "heading", "accel", "yaw_rate"), start=2)}
    return {"position": state[:, :2], **singles}


def _error_plots(run: MeasuredRun, estimates: dict[str, FloatArray]) -> tuple[Plot, ...]:
    """Plot figures 1 and 2: error over time of the position (its east part) and of the speed."""
    plots = []
    for figure, what, unit, column, printed in (
        ("fig 1", "east position", "m", 0, 0.15),
        ("fig 2", "speed", "m/s", 2, 0.1),
    ):
        shown = (
            ("measured", run.vectors),
            *((ESTIMATOR_LABELS[name], estimates[name]) for name in ("causal", PAPER_FILTER_KEY)),
        )
        curves = [Curve(label, run.time_s, state[:, column] - run.truth[:, column]) for label, state in shown]
        ends_s, gap = run.time_s[[0, -1]], np.full(1, np.nan)
        curves.append(
            Curve(
                f"printed sigma, +-{printed:g} {unit}",
                np.concatenate([ends_s, gap, ends_s]),
                np.concatenate([np.full(2, printed), gap, np.full(2, -printed)]),
            )
        )
        title = f"straight: error of the {what} (first seed)"
        plots.append(Plot(figure, title, "time [s]", f"error [{unit}]", curves))
    return tuple(plots)
