"""zhang2011, second half: the worked example, the simulated runs (figures 14-16) and the drives (figures 17-19)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cwcli.dynamics.config import FilterNoise, ObserverConfig
from cwcli.dynamics.observer import observe
from cwcli.dynamics.samples import LateralTrack
from cwcli.dynamics.single_track import steady_state, understeer_gradient
from cwcli.dynamics.vehicle import Vehicle, load_vehicle
from cwcli.metrics.table import ColumnDoc, Table
from cwcli.reproduction.findings import NOT_PRINTED, Curve, Finding, Part, Plot, within
from cwcli.signals.columns import FloatArray
from cwcli.signals.units import MPS_PER_KMH
from cwcli.simulation.single_track import PAPER_RUNS, LinearRun, PaperRun, simulate_paper_run

PAPER_BOUND_PERCENT = 10.0
HALF_LOAD_BOUND_PERCENT = 3.0
LOAD_BOUND_PERCENT = 5.0
CONVERGED_S = 1.0
STATIC_S = 1.0
"""The static error is the largest of the last second."""
EQUAL_PERCENT = 0.05
"""Static errors below this are equal: both are zero for any purpose."""

EXACT_SENSORS = FilterNoise(
    lateral_sigma_m=0.01,
    heading_sigma_rad=0.001,
    curvature_sigma_1pm=1e-5,
    lateral_floor_m=0.0,
    heading_floor_rad=0.0,
    curvature_floor_1pm=0.0,
    curvature_share=0.0,
    camera_yaw_rad=0.0,
    camera_yaw_walk_rad=0.0,
)
"""What the default filter is told of the noise-free runs: a centimetre, a milliradian, a camera mounted exactly."""

SPEEDS_KMH = (80.0, 90.0)
EXAMPLE_STEER_RAD = 0.05
PAPER_BLENDED = {"v_y": -1.872, "gamma": 0.4152}
PAPER_CAR = {"v_y": -1.88, "gamma": 0.415}
PAPER_OBSERVERS = {80.0: {"v_y": -1.417, "gamma": 0.4008}, 90.0: {"v_y": -1.996, "gamma": 0.418}}
"""As printed, with the labels 80 and 90 exchanged back."""
UNITS = {"v_y": "m/s", "gamma": "rad/s"}
EXAMPLE_TOLERANCE = {"v_y": 0.02, "gamma": 0.0015}


def example_part(vehicle: Vehicle | None = None) -> Part:
    """f(v) and the 88 km/h example of section 3.2, as steady states of eq. 11 (corrected)."""
    car = vehicle or load_vehicle()
    slope = understeer_gradient(car) / car.wheelbase_m
    findings = [_compared("eq 13", "f(v) - 1 over v^2, half load", "s^2/m^2", 0.000843, slope, 1e-6)]
    found: dict[float, dict[str, float]] = {}
    for kmh in (*SPEEDS_KMH, 88.0):
        found[kmh] = dict(zip(UNITS, steady_state(car, kmh * MPS_PER_KMH, EXAMPLE_STEER_RAD), strict=True))
    for kmh, printed in PAPER_OBSERVERS.items():
        for name, unit in UNITS.items():
            what = f"{name} of the {kmh:.0f} km/h observer (labels exchanged)"
            findings.append(_compared("eq 22", what, unit, printed[name], found[kmh][name], EXAMPLE_TOLERANCE[name]))
    for name, unit in UNITS.items():
        blended = 0.2 * found[80.0][name] + 0.8 * found[90.0][name]
        findings += [
            _compared(
                "eq 22", f"{name} blended at 88 km/h", unit, PAPER_BLENDED[name], blended, EXAMPLE_TOLERANCE[name]
            ),
            _compared("eq 22", f"{name} of the car", unit, PAPER_CAR[name], found[88.0][name], EXAMPLE_TOLERANCE[name]),
        ]
    return Part(tuple(findings))


@dataclass(frozen=True)
class RunErrors:
    """How an observer did in one run; of v_y and gamma, in this order.

    Attributes:
        static_percent: Largest error of the last second, of the true value.
        converged_s: From then on the error stays below the paper's bound; NaN: never.
    """

    static_percent: tuple[float, float]
    converged_s: tuple[float, float]


def run_errors(run: LinearRun, track: LateralTrack) -> RunErrors:
    """Static error and convergence time; both start from the first frame."""
    percent = 100.0 * np.abs(track.state[:, :2] - run.state[:, :2]) / np.maximum(np.abs(run.state[:, :2]), 1e-9)
    last = run.time_s >= run.time_s[-1] - STATIC_S - 1e-9
    static = percent[last].max(axis=0)
    converged = []
    for column in percent.T:
        bad = np.flatnonzero(~(column < PAPER_BOUND_PERCENT))
        first = 0 if not len(bad) else int(bad[-1]) + 1
        converged.append(float(run.time_s[first]) if first < len(column) else math.nan)
    return RunErrors((float(static[0]), float(static[1])), (converged[0], converged[1]))


def observers(run: PaperRun, vehicle: Vehicle) -> dict[str, tuple[Vehicle, ObserverConfig]]:
    """Name -> car that the observer believes in and its options, for one run."""
    car = vehicle.loaded(run.load)
    ours = ObserverConfig(noise=EXACT_SENSORS)
    chosen = {"zhang2011": (car, ObserverConfig("zhang2011")), "cwcli": (car, ours)}
    if car.mass_kg != vehicle.mass_kg:
        chosen |= {
            "zhang2011, told half load": (vehicle, ObserverConfig("zhang2011")),
            "cwcli, told half load": (vehicle, ours),
            "cwcli, told half load, estimates the load": (
                vehicle,
                ObserverConfig(noise=EXACT_SENSORS, estimate_load=True),
            ),
        }
    return chosen


def run_part(figure: str, vehicle: Vehicle | None = None) -> Part:
    """Figure 14, 15 or 16: the observers start at v_y = gamma = 0 while the car is already in its turn."""
    half = vehicle or load_vehicle()
    settings = PAPER_RUNS[figure]
    run = simulate_paper_run(settings, half)
    errors: dict[str, RunErrors] = {}
    curves = [Curve("car, yaw rate", run.time_s, run.state[:, 1]), Curve("car, v_y", run.time_s, run.state[:, 0])]
    for name, (car, config) in observers(settings, half).items():
        track = observe(run.lanes, run.speed, car, config)
        errors[name] = run_errors(run, track)
        if name in ("zhang2011", "cwcli"):
            curves += [
                Curve(f"{name}, yaw rate", run.time_s, track.state[:, 1]),
                Curve(f"{name}, v_y", run.time_s, track.state[:, 0]),
            ]
    bound = HALF_LOAD_BOUND_PERCENT if settings.load == "half" else PAPER_BOUND_PERCENT
    findings: list[Finding] = []
    for k, name in enumerate(UNITS):
        paper, ours = errors["zhang2011"], errors["cwcli"]
        findings += [
            _below(figure, f"zhang2011: static error of {name}", "%", paper.static_percent[k], bound),
            _below(figure, f"zhang2011: {name} converged", "s", paper.converged_s[k], CONVERGED_S),
            _below(
                figure,
                f"cwcli: static error of {name}",
                "%",
                ours.static_percent[k],
                max(paper.static_percent[k], EQUAL_PERCENT),
            ),
            _below(figure, f"cwcli: {name} converged", "s", ours.converged_s[k], CONVERGED_S),
        ]
        for other, found in errors.items():
            if other in ("zhang2011", "cwcli"):
                continue
            what = f"{other}: static error of {name}"
            if "estimates" in other:
                findings.append(_below(figure, what, "%", found.static_percent[k], LOAD_BOUND_PERCENT))
            else:
                findings.append(_reported(figure, what, "%", found.static_percent[k]))
    title = f"{settings.load} load, {settings.steer_rad:g} rad, from {settings.start_kmh:g} km/h"
    return Part(tuple(findings), (Plot(figure, title, "time [s]", "yaw rate [rad/s], v_y [m/s]", curves),))


def run_table(figure: str, vehicle: Vehicle | None = None) -> Table:
    """Figure 14, 15 or 16 as columns: one row a frame, true and observed."""
    half = vehicle or load_vehicle()
    settings = PAPER_RUNS[figure]
    run = simulate_paper_run(settings, half)
    columns: dict[str, FloatArray] = {
        "time_s": run.time_s,
        "speed_mps": run.speed_mps,
        "lateral_speed_mps": run.state[:, 0],
        "yaw_rate_radps": run.state[:, 1],
    }
    for name, (car, config) in observers(settings, half).items():
        if "," in name:
            continue
        track = observe(run.lanes, run.speed, car, config)
        columns[f"{name}_lateral_speed_mps"] = track.state[:, 0]
        columns[f"{name}_yaw_rate_radps"] = track.state[:, 1]
    docs = {
        "lateral_speed_mps": ColumnDoc(frame="body", doc="of the car"),
        "yaw_rate_radps": ColumnDoc(doc="of the car"),
    }
    return Table(figure.replace(" ", "_"), columns, docs)


def _compared(figure: str, what: str, unit: str, paper: float, ours: float, tolerance: float) -> Finding:
    verdict = within(ours, paper, tolerance)
    return Finding(figure, what, unit, paper, ours, math.nan, math.nan, verdict, is_required=True)


def _below(figure: str, what: str, unit: str, ours: float, bound: float) -> Finding:
    """A number that must not exceed a bound; the bound is part of the text."""
    is_below = ours <= bound  # false for NaN
    what = f"{what} (bound {bound:.3g} {unit})"
    verdict = "reproduced" if is_below else "worse"
    return Finding(figure, what, unit, NOT_PRINTED, ours, math.nan, math.nan, verdict, is_required=True)


def _reported(figure: str, what: str, unit: str, ours: float) -> Finding:
    return Finding(figure, what, unit, NOT_PRINTED, ours, math.nan, math.nan, "reported")
