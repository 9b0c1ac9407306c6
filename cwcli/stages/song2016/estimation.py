"""Table 1 and figures 1 and 2: the error of the measurements and of the estimates."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cwcli.metrics.intervals import normal_interval
from cwcli.signals.angles import wrap_angle
from cwcli.signals.columns import FloatArray
from cwcli.simulation.scenario import HOST, load_scenario
from cwcli.stages.findings import NOT_PRINTED, Curve, Finding, Part, Plot
from cwcli.stages.song2016.methods import our_track, paper_states, sense

STANDARD_GRAVITY_MPS2 = 9.80665
RADIAN_DEG = 180.0 / math.pi
QUANTITIES = {
    "position": ((0, 1), 1.0, "m"),
    "speed": ((2,), 1.0, "m/s"),
    "heading": ((3,), RADIAN_DEG, "deg"),
    "acceleration": ((4,), 100.0 / STANDARD_GRAVITY_MPS2, "% of g"),
    "yaw rate": ((5,), RADIAN_DEG, "deg/s"),
}
"""Rows of table 1: columns of the state, factor to the printed unit, unit. "0.5 %" is read as 0.5 % of g."""
PAPER_CHANGE_PERCENT = {
    "position": -75.0,
    "speed": -80.0,
    "heading": -79.0,
    "acceleration": -46.0,
    "yaw rate": -57.0,
}
METHODS = ("smoothed", "causal", "song2016")
LABELS = {"smoothed": "our smoother", "causal": "our filter", "song2016": "the paper's filter"}


def table1_part(name: str, n_seeds: int, tick: Callable[[], None]) -> Part:
    """Table 1 on one scenario: change of the 1-sigma error against the measurement, for three estimators.

    Only our smoother on the straight scenario must reach the paper's reductions: a causal filter can't, whatever its
    tuning, with the acceleration profile of that drive (docs/papers/song2016.md).
    """
    scenario = load_scenario(name)
    changes: dict[tuple[str, str], list[float]] = {(m, q): [] for m in METHODS for q in QUANTITIES}
    plots: tuple[Plot, ...] = ()
    for seed in range(n_seeds):
        run = sense(scenario, HOST, seed)
        estimates = {
            "smoothed": our_track(run, causal=False).state,
            "causal": our_track(run).state,
            "song2016": paper_states(run),
        }
        measured = _errors(run.vectors, run.truth)
        for method, state in estimates.items():
            estimated = _errors(state, run.truth)
            for quantity in QUANTITIES:
                ratio = _rms(estimated[quantity]) / _rms(measured[quantity])
                changes[method, quantity].append(100.0 * (ratio - 1.0))
        if seed == 0 and name == "straight":
            plots = _traces(run.time_s, measured, {m: _errors(s, run.truth) for m, s in estimates.items()})
        tick()
    findings = []
    for quantity, paper in PAPER_CHANGE_PERCENT.items():
        for method in METHODS:
            values = np.array(changes[method, quantity])
            low, high = normal_interval(values)
            ours = float(values.mean())
            is_required = method == "smoothed" and name == "straight"
            verdict = "better" if ours <= paper else "worse"
            what = f"{name}: change of the {quantity} error, {LABELS[method]}"
            printed = paper if name == "straight" else NOT_PRINTED
            findings.append(
                Finding(
                    "table 1",
                    what,
                    "%",
                    printed,
                    ours,
                    low,
                    high,
                    verdict if name == "straight" else "reported",
                    is_required=is_required,
                )
            )
    return Part(tuple(findings), plots)


def _errors(state: FloatArray, truth: FloatArray) -> dict[str, FloatArray]:
    """Quantity -> shape (n, axes) in the unit of table 1."""
    errors = {}
    for quantity, (columns, factor, _) in QUANTITIES.items():
        own = list(columns)
        error = state[:, own] - truth[:, own]
        errors[quantity] = factor * (wrap_angle(error) if quantity == "heading" else error)
    return errors


def _rms(error: FloatArray) -> float:
    return float(np.sqrt(np.mean(error**2)))


def _traces(
    time_s: FloatArray, measured: dict[str, FloatArray], estimated: dict[str, dict[str, FloatArray]]
) -> tuple[Plot, ...]:
    """Figures 1 and 2: error over time, position (its east part) and speed."""
    plots = []
    for figure, quantity in (("fig 1", "position"), ("fig 2", "speed")):
        curves = [Curve("measured", time_s, measured[quantity][:, 0])]
        curves += [Curve(LABELS[method], time_s, errors[quantity][:, 0]) for method, errors in estimated.items()]
        unit = QUANTITIES[quantity][2]
        what = "east position" if quantity == "position" else quantity
        title = f"straight: error of the {what} (first seed)"
        plots.append(Plot(figure, title, "time [s]", f"error [{unit}]", curves))
    return tuple(plots)
