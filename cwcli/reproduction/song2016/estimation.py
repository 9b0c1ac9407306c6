"""Table 1 and figures 1 and 2: the error of the measurements and of the estimates.

The drives are the scenarios `straight` and `curve`, the noise is that of their sensors. The paper's "0.5 %" of
acceleration is read as 0.5 % of g.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cwcli.estimation.consistency import ErrorRow, error_rows
from cwcli.metrics.intervals import normal_interval
from cwcli.reproduction.classes import Measured
from cwcli.reproduction.findings import Curve, Part, Plot
from cwcli.reproduction.song2016.methods import Run, our_track, paper_states, sense
from cwcli.signals.columns import FloatArray
from cwcli.simulation.scenario import HOST, load_scenario

QUANTITIES = {
    "position": "position",
    "speed": "speed",
    "heading": "heading",
    "accel": "acceleration",
    "yaw_rate": "yaw rate",
}
"""Name of a quantity in `error_rows` -> its printed name in table 1."""
PAPERS_FILTER = "song2016"
"""Key of the paper's filter in `LABELS`."""
PERCENT_OF_G = 100.0 / 9.81
"""Per cent of g in 1 m/s^2: table 1 gives the acceleration in per cent, read as of g."""
LABELS = {
    "smoothed": "our smoother",
    "default": "our smoother as on the command line, latencies searched",
    "causal": "our filter",
    "song2016": "the paper's filter",
}
"""Key of an estimator -> its label in tables and plots."""


def estimates_of(run: Run) -> dict[str, FloatArray]:
    """Estimate states (n, 8) from the same measurements by every estimator: key of `LABELS` -> states."""
    return {
        "smoothed": our_track(run, causal=False).state,
        "default": our_track(run, causal=False, latency="auto").state,
        "causal": our_track(run).state,
        "song2016": paper_states(run),
    }


def table1_rows(run: Run, state: FloatArray) -> list[ErrorRow]:
    """Compute table 1 of one run: the errors of the measurements and of an estimate, shape (n, >= 6)."""
    return error_rows(_quantities(run.truth), _quantities(run.vectors), _quantities(state))


def table1_part(name: str, n_seeds: int, tick: Callable[[], None]) -> Part:
    """Compute table 1 on one scenario: errors measured and filtered, and the change by each estimator."""
    scenario = load_scenario(name)
    changes: dict[tuple[str, str], list[float]] = {(m, q): [] for q in QUANTITIES for m in LABELS}
    levels: dict[tuple[str, str], list[float]] = {(k, q): [] for k in ("measured", "estimated") for q in QUANTITIES}
    plots: tuple[Plot, ...] = ()
    for seed in range(n_seeds):
        run = sense(scenario, HOST, seed)
        estimates = estimates_of(run)
        for method, state in estimates.items():
            for row in table1_rows(run, state):
                changes[method, row.name].append(row.change_percent)
                if method == PAPERS_FILTER:
                    scale = PERCENT_OF_G if row.name == "accel" else 1.0
                    levels["measured", row.name].append(scale * row.measured_sigma)
                    levels["estimated", row.name].append(scale * row.estimated_sigma)
        if seed == 0 and name == "straight":
            plots = _traces(run, estimates)
        tick()
    measured = [
        _mean(
            f"{name}: {kind} {QUANTITIES[quantity]} error" + (", the paper's filter" if kind == "estimated" else ""),
            values,
        )
        for (kind, quantity), values in levels.items()
    ]
    measured += [
        _mean(f"{name}: change of the {QUANTITIES[quantity]} error, {LABELS[method]}", values)
        for (method, quantity), values in changes.items()
    ]
    return Part(tuple(measured), plots)


def _mean(what: str, values: list[float]) -> Measured:
    """Return the mean of values over the seeds, with its interval, as a number of table 1."""
    low, high = normal_interval(np.array(values))
    return Measured("table 1", what, float(np.mean(values)), low, high)


def _quantities(state: FloatArray) -> dict[str, FloatArray]:
    """Split columns x, y, v, heading, a, yaw rate into the rows of table 1, in the units of `error_rows`."""
    singles = {name: state[:, column] for column, name in enumerate(("speed", "heading", "accel", "yaw_rate"), start=2)}
    return {"position": state[:, :2], **singles}


def _traces(run: Run, estimates: dict[str, FloatArray]) -> tuple[Plot, ...]:
    """Plot figures 1 and 2: error over time of the position (its east part) and of the speed."""
    plots = []
    for figure, what, unit, column in (("fig 1", "east position", "m", 0), ("fig 2", "speed", "m/s", 2)):
        curves = [
            Curve(label, run.time_s, state[:, column] - run.truth[:, column])
            for label, state in (("measured", run.vectors), *((LABELS[m], state) for m, state in estimates.items()))
        ]
        title = f"straight: error of the {what} (first seed)"
        plots.append(Plot(figure, title, "time [s]", f"error [{unit}]", curves))
    return tuple(plots)
