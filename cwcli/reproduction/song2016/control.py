"""Figures 12 to 15: what the fuzzy controller makes of each family's warning moment."""

from __future__ import annotations

import numpy as np

from cwcli.control.closed_loop import (
    COLLISION_DISTANCE_M,
    RecordedMotion,
    ReplayedRuns,
    fuzzy_controller_throttle_and_pressure,
    replay_with_policy,
    throttle_and_pressure_of_driver_braking_after_warning,
)
from cwcli.reproduction.classes import MeasuredNumber
from cwcli.reproduction.findings import Curve, Plot, StudyPart, median_and_interval_bounds
from cwcli.reproduction.song2016.methods import MODEL_BY_FAMILY
from cwcli.reproduction.song2016.warning import OUR_METHOD, WarningMoments, most_typical_seed_or_zero
from cwcli.simulation.scenario import EGO_VEHICLE_KEY, Scenario

MOTION_GRID_STEP_S = 0.01
"""Time step of the replayed motion, in s. Chosen by hand; not fitted."""
TIME_AFTER_COLLISION_S = 6.0
"""Time after the scenario's end, the collision, in which the car comes to rest, in s. Chosen by hand; not fitted."""
FIGURES_BY_SCENARIO = {"rear-end": ("fig 12", "fig 13"), "intersection": ("fig 14", "fig 15")}
"""Scenario -> the paper's figures of its distance and of its speed."""
LARGEST_DISTANCE_CLAIMS = {
    "rear-end": "the jerk model leaves a larger gap than acceleration",
    "intersection": "the yaw-acceleration model keeps the largest distance",
}
"""Scenario -> what the paper says of the largest distance (figures 12 and 14)."""
HALF_TIME_OF_ENLARGED_DETAIL_S, MAX_DISTANCE_SHARE_TO_ENLARGE = 0.8, 0.1
"""Half of the time that is drawn enlarged around the least distance, s, where the least distances differ by less than
this share of the plot's height. Chosen by hand."""
METHOD_LABELS = {family: f"constant {family}" for family in MODEL_BY_FAMILY} | {OUR_METHOD: "our default"}
"""Method -> its label in plots."""


def braking_control_part(name: str, moments: WarningMoments) -> StudyPart:
    """Replay one scenario under control, for each family's warning moments over all seeds."""
    host = true_recorded_motion(moments.scenario, EGO_VEHICLE_KEY)
    other = true_recorded_motion(moments.scenario, moments.other)
    outcomes = {
        method: replay_with_policy(
            host, other, np.where(np.isnan(when), np.inf, when), fuzzy_controller_throttle_and_pressure
        )
        for method, when in moments.warned_s_by_method.items()
        if method in METHOD_LABELS
    }
    jerk = moments.warned_s_by_method["jerk"]
    nothing = replay_with_policy(host, other, np.array([np.inf]), fuzzy_controller_throttle_and_pressure)
    driver = replay_with_policy(
        host, other, np.where(np.isnan(jerk), np.inf, jerk), throttle_and_pressure_of_driver_braking_after_warning
    )
    figure = FIGURES_BY_SCENARIO[name][0]
    measured = [
        MeasuredNumber(
            figure, f"{name}: runs that collide, constant {family}", 100.0 * float(outcomes[family].collided.mean())
        )
        for family in MODEL_BY_FAMILY
    ]
    least = {f"constant {family}": outcomes[family].min_distance_m for family in MODEL_BY_FAMILY}
    least |= {
        "our default": outcomes[OUR_METHOD].min_distance_m,
        "no action": nothing.min_distance_m,
        "driver brakes 1.5 s after the jerk model's warning": driver.min_distance_m,
    }
    measured += [
        MeasuredNumber(figure, f"{name}: {what}, least distance, median", *median_and_interval_bounds(values))
        for what, values in least.items()
    ]
    medians = {family: float(np.median(outcomes[family].min_distance_m)) for family in MODEL_BY_FAMILY}
    others = [medians["acceleration"]] if name == "rear-end" else [medians["acceleration"], medians["speed"]]
    measured.append(
        MeasuredNumber(figure, f"{name}: {LARGEST_DISTANCE_CLAIMS[name]}", float(medians["jerk"] > max(others)))
    )
    return StudyPart(tuple(measured), _control_plots(name, outcomes, moments))


def true_recorded_motion(scenario: Scenario, vehicle: str) -> RecordedMotion:
    """Return a vehicle's true motion; beyond the scenario's end at its last speed and yaw rate for
    `TIME_AFTER_COLLISION_S`."""
    time_s = (
        np.arange(round((scenario.duration_s + TIME_AFTER_COLLISION_S) / MOTION_GRID_STEP_S) + 1, dtype=np.float64)
        * MOTION_GRID_STEP_S
    )
    state = scenario.vehicles[vehicle].motion.states_at(np.minimum(time_s, scenario.duration_s))
    beyond_s = np.maximum(time_s - scenario.duration_s, 0.0)
    speed, heading, yaw_rate = np.maximum(state[:, 2], 0.0), state[:, 3], state[:, 5]
    half_turn = 0.5 * yaw_rate * beyond_s
    chord = speed * beyond_s * np.sinc(half_turn / np.pi)  # of the arc: 2 r sin(angle / 2)
    return RecordedMotion(
        time_s,
        state[:, 0] + chord * np.cos(heading + half_turn),
        state[:, 1] + chord * np.sin(heading + half_turn),
        heading + 2.0 * half_turn,
        speed,
    )


def _control_plots(name: str, outcomes: dict[str, ReplayedRuns], moments: WarningMoments) -> tuple[Plot, ...]:
    """Plot distance and speed around the braking, in the seed whose warnings are nearest to the medians."""
    distance, speed = FIGURES_BY_SCENARIO[name]
    seed = most_typical_seed_or_zero(moments)
    shown = (moments.ideal_s - 1.0, moments.ideal_s + 6.0)
    first = next(iter(outcomes.values()))
    rows = (first.time_s >= shown[0]) & (first.time_s <= shown[1])
    farthest = max(float(outcome.distance_m[seed, rows].max()) for outcome in outcomes.values())
    dots = {method: float(moments.warned_s_by_method[method][seed]) for method in outcomes}
    least_m = [float(outcome.distance_m[seed].min()) for outcome in outcomes.values()]
    nearest_s = float(first.time_s[first.distance_m[seed].argmin()])
    detail = (
        (nearest_s - HALF_TIME_OF_ENLARGED_DETAIL_S, nearest_s + HALF_TIME_OF_ENLARGED_DETAIL_S),
        (0.95 * min(least_m), 1.1 * max(least_m)),
    )
    return (
        Plot(
            distance,
            f"{name}: distance under control, warnings as dots (seed {seed})",
            "time [s]",
            "distance [m]",
            [Curve(METHOD_LABELS[m], o.time_s, o.distance_m[seed], dots[m]) for m, o in outcomes.items()],
            {},
            ("collision", COLLISION_DISTANCE_M),
            shown,
            (0.0, 1.05 * farthest),
            detail=detail if max(least_m) - min(least_m) < MAX_DISTANCE_SHARE_TO_ENLARGE * farthest else None,
        ),
        Plot(
            speed,
            f"{name}: speed of the host under control, warnings as dots (seed {seed})",
            "time [s]",
            "speed [m/s]",
            [Curve(METHOD_LABELS[m], o.time_s, o.speed_mps[seed], dots[m]) for m, o in outcomes.items()],
            x_range=shown,
        ),
    )
