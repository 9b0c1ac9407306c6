"""zhang2011, second half: the simulated runs of figures 14 to 16."""

from __future__ import annotations

import math

import numpy as np

from cwcli.dynamics.config import FilterNoise, ObserverConfig
from cwcli.dynamics.observer import observe_lateral_motion
from cwcli.dynamics.samples import LateralTrack
from cwcli.dynamics.vehicle import Vehicle, load_vehicle
from cwcli.lazy_dataclass import dataclass
from cwcli.reproduction.classes import MeasuredNumber
from cwcli.reproduction.findings import Curve, Plot, StudyPart
from cwcli.simulation.single_track import PAPER_RUNS, LinearRun, PaperRun, simulate_zhang2011_run

MAX_ERROR_OF_CONVERGED_OBSERVER_PERCENT = 10.0
"""An observer has converged where its error stays below this, in per cent of the true value, the bound of zhang2011."""
STATIC_ERROR_WINDOW_S = 1.0
"""Length of the last part of a run, s, whose largest error is the static error. Chosen by hand; not fitted."""
MAX_STATIC_ERROR_TREATED_AS_ZERO_PERCENT = 0.05
"""Static errors below this, in per cent, count as equal, as both are practically zero. Chosen by hand; not fitted."""

FILTER_NOISE_FOR_NOISE_FREE_RUNS = FilterNoise(
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
"""Noise that the default filter gets for the noise-free runs: 1 cm, 1 mrad, an exactly mounted camera."""

UNIT_BY_STATE = {"v_y": "m/s", "gamma": "rad/s"}
"""Name of a state -> its unit."""


@dataclass(frozen=True)
class ObserverErrors:
    """Errors of an observer in one run, of v_y and gamma in this order.

    Attributes:
        static_percent: Largest error of the last second, of the true value.
        converged_s: From then on the error stays below the paper's bound; NaN: never.
    """

    static_percent: tuple[float, float]
    converged_s: tuple[float, float]


def compute_observer_errors(run: LinearRun, track: LateralTrack) -> ObserverErrors:
    """Compute static error and convergence time; both start from the first frame."""
    percent = 100.0 * np.abs(track.state[:, :2] - run.state[:, :2]) / np.maximum(np.abs(run.state[:, :2]), 1e-9)
    last = run.time_s >= run.time_s[-1] - STATIC_ERROR_WINDOW_S - 1e-9
    static = percent[last].max(axis=0)
    converged = []
    for column in percent.T:
        bad = np.flatnonzero(~(column < MAX_ERROR_OF_CONVERGED_OBSERVER_PERCENT))
        first = 0 if not len(bad) else int(bad[-1]) + 1
        converged.append(float(run.time_s[first]) if first < len(column) else math.nan)
    return ObserverErrors((float(static[0]), float(static[1])), (converged[0], converged[1]))


def observer_setups_for_run(run: PaperRun, vehicle: Vehicle) -> dict[str, tuple[Vehicle, ObserverConfig]]:
    """Return name -> the car that the observer assumes and its options, for one run."""
    car = vehicle.with_load(run.load)
    ours = ObserverConfig(noise=FILTER_NOISE_FOR_NOISE_FREE_RUNS)
    chosen = {"zhang2011": (car, ObserverConfig("zhang2011")), "cwcli": (car, ours)}
    if car.mass_kg != vehicle.mass_kg:
        chosen |= {
            "zhang2011, told half load": (vehicle, ObserverConfig("zhang2011")),
            "cwcli, told half load": (vehicle, ours),
            "cwcli, told half load, estimates the load": (
                vehicle,
                ObserverConfig(noise=FILTER_NOISE_FOR_NOISE_FREE_RUNS, estimate_load=True),
            ),
        }
    return chosen


def simulated_run_part(figure: str, vehicle: Vehicle | None = None) -> StudyPart:
    """Compute figure 14, 15 or 16: observers that start at v_y = gamma = 0 while the car already turns."""
    half = vehicle or load_vehicle()
    settings = PAPER_RUNS[figure]
    run = simulate_zhang2011_run(settings, half)
    errors: dict[str, ObserverErrors] = {}
    # The paper counts both positive to the right.
    curves = [Curve("car, yaw rate", run.time_s, -run.state[:, 1]), Curve("car, v_y", run.time_s, -run.state[:, 0])]
    for name, (car, config) in observer_setups_for_run(settings, half).items():
        track = observe_lateral_motion(run.lanes, run.speed, car, config)
        errors[name] = compute_observer_errors(run, track)
        if name in ("zhang2011", "cwcli"):
            curves += [
                Curve(f"{name}, yaw rate", run.time_s, -track.state[:, 1]),
                Curve(f"{name}, v_y", run.time_s, -track.state[:, 0]),
            ]
    measured: list[MeasuredNumber] = []
    for k, name in enumerate(UNIT_BY_STATE):
        for other, found in errors.items():
            measured.append(MeasuredNumber(figure, f"{other}: static error of {name}", found.static_percent[k]))
            if other in ("zhang2011", "cwcli"):
                measured.append(MeasuredNumber(figure, f"{other}: {name} converged", found.converged_s[k]))
        allowed = max(errors["zhang2011"].static_percent[k], MAX_STATIC_ERROR_TREATED_AS_ZERO_PERCENT)
        what = (
            f"cwcli: static error of {name} above zhang2011's, or above {MAX_STATIC_ERROR_TREATED_AS_ZERO_PERCENT:g} %"
        )
        measured.append(MeasuredNumber(figure, what, errors["cwcli"].static_percent[k] - allowed))
    if figure == "fig 16":
        curves.append(
            Curve(
                "printed bound of v_y, 10 %",
                run.time_s,
                -0.01 * (100.0 - MAX_ERROR_OF_CONVERGED_OBSERVER_PERCENT) * run.state[:, 0],
            )
        )
    speed = f"{settings.start_kmh:g} km/h"
    if settings.accel_mps2:
        speed += f" to {settings.end_kmh:g} km/h at {settings.accel_mps2:g} m/s^2"
    title = f"{settings.load} load, {-settings.steer_rad:g} rad to the right, {speed}"
    return StudyPart(tuple(measured), (Plot(figure, title, "time [s]", "yaw rate [rad/s], v_y [m/s]", curves),))
