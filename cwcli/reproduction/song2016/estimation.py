"""Table 1 and figures 1 and 2: the error of the measurements and of the estimates.

The drives are the scenarios `straight` and `curve`, the noise is that of their sensors. The paper's "0.5 %" of
acceleration is read as 0.5 % of g.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cwcli.estimation.consistency import ErrorRow, error_rows
from cwcli.metrics.intervals import normal_interval
from cwcli.reproduction.findings import NOT_PRINTED, Curve, Finding, Part, Plot
from cwcli.reproduction.song2016.methods import Run, our_track, paper_states, sense
from cwcli.signals.columns import FloatArray
from cwcli.simulation.scenario import HOST, load_scenario

PAPER_CHANGE_PERCENT = {"position": -75.0, "speed": -80.0, "heading": -79.0, "accel": -46.0, "yaw_rate": -57.0}
"""Table 1: change of the one-sigma error from "measured" to "estimated"."""
PRINTED_NAMES = {"accel": "acceleration", "yaw_rate": "yaw rate"}
LABELS = {
    "smoothed": "our smoother",
    "default": "our smoother as on the command line, latencies searched",
    "causal": "our filter",
    "song2016": "the paper's filter",
}


def estimates_of(run: Run) -> dict[str, FloatArray]:
    """Key of `LABELS` -> states, shape (n, 8), from the same measurements."""
    return {
        "smoothed": our_track(run, causal=False).state,
        "default": our_track(run, causal=False, latency="auto").state,
        "causal": our_track(run).state,
        "song2016": paper_states(run),
    }


def table1_rows(run: Run, state: FloatArray) -> list[ErrorRow]:
    """Table 1 of one run: the errors of the measurements and of an estimate, shape (n, >= 6)."""
    return error_rows(_quantities(run.truth), _quantities(run.vectors), _quantities(state))


def table1_part(name: str, n_seeds: int, tick: Callable[[], None]) -> Part:
    """Table 1 on one scenario: change of the one-sigma error against the measurement, for four estimators.

    Only our smoother on the straight scenario must reach the paper's reductions: a causal filter can't, whatever its
    tuning, with the acceleration profile of that drive (docs/papers/song2016-estimation.md).
    """
    scenario = load_scenario(name)
    changes: dict[tuple[str, str], list[float]] = {(m, q): [] for m in LABELS for q in PAPER_CHANGE_PERCENT}
    plots: tuple[Plot, ...] = ()
    for seed in range(n_seeds):
        run = sense(scenario, HOST, seed)
        estimates = estimates_of(run)
        for method, state in estimates.items():
            for row in table1_rows(run, state):
                changes[method, row.name].append(row.change_percent)
        if seed == 0 and name == "straight":
            plots = _traces(run, estimates)
        tick()
    findings = []
    for quantity, paper in PAPER_CHANGE_PERCENT.items():
        for method, label in LABELS.items():
            values = np.array(changes[method, quantity])
            low, high = normal_interval(values)
            ours = float(values.mean())
            is_required = method == "smoothed" and name == "straight"
            verdict = "better" if ours <= paper else "worse"
            what = f"{name}: change of the {PRINTED_NAMES.get(quantity, quantity)} error, {label}"
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


def _quantities(state: FloatArray) -> dict[str, FloatArray]:
    """The rows of table 1 from columns x, y, v, heading, a, yaw rate, in the units of `error_rows`."""
    singles = {name: state[:, column] for column, name in enumerate(("speed", "heading", "accel", "yaw_rate"), start=2)}
    return {"position": state[:, :2], **singles}


def _traces(run: Run, estimates: dict[str, FloatArray]) -> tuple[Plot, ...]:
    """Figures 1 and 2: error over time, position (its east part) and speed."""
    plots = []
    for figure, what, unit, column in (("fig 1", "east position", "m", 0), ("fig 2", "speed", "m/s", 2)):
        curves = [
            Curve(label, run.time_s, state[:, column] - run.truth[:, column])
            for label, state in (("measured", run.vectors), *((LABELS[m], state) for m, state in estimates.items()))
        ]
        title = f"straight: error of the {what} (first seed)"
        plots.append(Plot(figure, title, "time [s]", f"error [{unit}]", curves))
    return tuple(plots)
