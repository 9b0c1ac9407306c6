"""Figures 12 to 15: what the fuzzy controller makes of each family's warning moment."""

from __future__ import annotations

import numpy as np

from cwcli.control.closed_loop import COLLISION_DISTANCE_M, RecordedMotion, Replay, driver_policy, fuzzy_policy, replay
from cwcli.reproduction.classes import Measured
from cwcli.reproduction.findings import Curve, Part, Plot, median_interval
from cwcli.reproduction.song2016.methods import FAMILIES
from cwcli.reproduction.song2016.warning import OURS, Moments, typical_seed
from cwcli.simulation.scenario import HOST, Scenario

GRID_S = 0.01
"""Time step of the replayed motion, in s. Chosen by hand; not fitted."""
EXTRA_S = 6.0
"""Time after the scenario's end, the collision, in which the car comes to rest, in s. Chosen by hand; not fitted."""
FIGURES = {"rear-end": ("fig 12", "fig 13"), "intersection": ("fig 14", "fig 15")}
"""Scenario -> the paper's figures of its distance and of its speed."""
LARGEST = {
    "rear-end": "the jerk model leaves a larger gap than acceleration",
    "intersection": "the yaw-acceleration model keeps the largest distance",
}
"""Scenario -> what the paper says of the largest distance (figures 12 and 14)."""
LABELS = {family: f"constant {family}" for family in FAMILIES} | {OURS: "our default"}
"""Method -> its label in plots."""


def control_part(name: str, moments: Moments) -> Part:
    """Replay one scenario under control, for each family's warning moments over all seeds."""
    host = true_motion(moments.scenario, HOST)
    other = true_motion(moments.scenario, moments.other)
    outcomes = {
        method: replay(host, other, np.where(np.isnan(when), np.inf, when), fuzzy_policy)
        for method, when in moments.by_method.items()
        if method in LABELS
    }
    jerk = moments.by_method["jerk"]
    nothing = replay(host, other, np.array([np.inf]), fuzzy_policy)
    driver = replay(host, other, np.where(np.isnan(jerk), np.inf, jerk), driver_policy)
    figure = FIGURES[name][0]
    measured = [
        Measured(
            figure, f"{name}: runs that collide, constant {family}", 100.0 * float(outcomes[family].collided.mean())
        )
        for family in FAMILIES
    ]
    least = {f"constant {family}": outcomes[family].min_distance_m for family in FAMILIES}
    least |= {
        "our default": outcomes[OURS].min_distance_m,
        "no action": nothing.min_distance_m,
        "driver brakes 1.5 s after the jerk model's warning": driver.min_distance_m,
    }
    measured += [
        Measured(figure, f"{name}: {what}, least distance, median", *median_interval(values))
        for what, values in least.items()
    ]
    medians = {family: float(np.median(outcomes[family].min_distance_m)) for family in FAMILIES}
    others = [medians["acceleration"]] if name == "rear-end" else [medians["acceleration"], medians["speed"]]
    measured.append(Measured(figure, f"{name}: {LARGEST[name]}", float(medians["jerk"] > max(others))))
    return Part(tuple(measured), _plots(name, outcomes, moments))


def true_motion(scenario: Scenario, vehicle: str) -> RecordedMotion:
    """Return a vehicle's true motion; beyond the scenario's end at its last speed and yaw rate for `EXTRA_S`."""
    time_s = np.arange(round((scenario.duration_s + EXTRA_S) / GRID_S) + 1, dtype=np.float64) * GRID_S
    state = scenario.vehicles[vehicle].motion.at(np.minimum(time_s, scenario.duration_s))
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


def _plots(name: str, outcomes: dict[str, Replay], moments: Moments) -> tuple[Plot, ...]:
    """Plot distance and speed around the braking, in the seed whose warnings are nearest to the medians."""
    distance, speed = FIGURES[name]
    when = np.column_stack([moments.by_method[method] for method in outcomes])
    seed = typical_seed(when)
    shown = (moments.ideal_s - 1.0, moments.ideal_s + 6.0)
    first = next(iter(outcomes.values()))
    rows = (first.time_s >= shown[0]) & (first.time_s <= shown[1])
    farthest = max(float(outcome.distance_m[seed, rows].max()) for outcome in outcomes.values())
    dots = dict(zip(outcomes, when[seed].tolist(), strict=True))
    return (
        Plot(
            distance,
            f"{name}: distance under control, warnings as dots (seed {seed})",
            "time [s]",
            "distance [m]",
            [Curve(LABELS[m], o.time_s, o.distance_m[seed], dots[m]) for m, o in outcomes.items()],
            {},
            ("collision", COLLISION_DISTANCE_M),
            shown,
            (0.0, 1.05 * farthest),
        ),
        Plot(
            speed,
            f"{name}: speed of the host under control, warnings as dots (seed {seed})",
            "time [s]",
            "speed [m/s]",
            [Curve(LABELS[m], o.time_s, o.speed_mps[seed], dots[m]) for m, o in outcomes.items()],
            x_range=shown,
        ),
    )
