"""How far figures 9, 11 and 12 depend on what was chosen: the moments and collisions when one choice is moved.

The paper's chain alone (its filter, its three families, its rule, its controller), over the first seeds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cwcli.control.car import CarResponse
from cwcli.control.closed_loop import fuzzy_policy, replay
from cwcli.pipeline.result import Section
from cwcli.reproduction.classes import Measured
from cwcli.reproduction.expectations import load_expectations
from cwcli.reproduction.findings import Part
from cwcli.reproduction.song2016.control import true_motion
from cwcli.reproduction.song2016.methods import FAMILIES, HORIZON_S, paper_points, paper_states, sense
from cwcli.reproduction.song2016.warning import COLLISION_M, FIGURES, collision_time_s, first_below
from cwcli.signals.columns import FloatArray
from cwcli.signals.units import STANDARD_GRAVITY_MPS2
from cwcli.simulation.scenario import HOST, Scenario, load_scenario

MAX_SEEDS = 10
"""The greatest number of seeds of each variant. Chosen by hand; not fitted."""
BRAKES = "lead.longitudinal.2"
"""Key of the scenario's segment in which the lead brakes."""
STOPS = "lead.longitudinal.3"
"""Key of the scenario's segment in which the lead comes to rest."""
SOONER = (f"{BRAKES}.to_s=6.2", f"{STOPS}.from_s=6.2")
"""Overrides that begin the lead's last segment earlier, as a lead that brakes earlier or harder is slow earlier."""
TURN_S = (4.4, 4.6)
"""Moved starts of the turn at the intersection, in s. Chosen by hand; not fitted."""
BRAKING_S = (3.35, 3.55)
"""Moved starts of the braking, in s. Chosen by hand; not fitted."""
JERKS_MPS3 = (2.5, 3.5)
"""Moved jerks at the beginning of the braking, in m/s^3. Chosen by hand; not fitted."""
FRICTIONS = (0.7, 0.8, 0.9)
"""Moved friction coefficients, around the 0.8 and 0.9 of docs/papers/song2016-choices.md."""
DECELERATION_MPS2 = 8.0
"""The lead's deceleration where the friction allows it, in m/s^2, as in the scenario."""
MOMENTS = ("ideal", "jerk", "acceleration", "speed")
"""Names of the compared moments: the ideal one and the warnings of the three families."""


@dataclass(frozen=True)
class Variant:
    """One variant of the study, in which one choice is moved.

    Attributes:
        name: What is moved, and where to.
        overrides: Of the scenario.
        friction: Limits the lead's braking and the host's; None: as the scenario and the car have it.
    """

    name: str
    overrides: tuple[str, ...] = ()
    friction: float | None = None


def _braking(at_s: float) -> Variant:
    """Return the variant in which the lead begins to brake at another time."""
    sooner = SOONER if at_s < max(BRAKING_S) else ()
    overrides = (f"lead.longitudinal.1.to_s={at_s}", f"{BRAKES}.from_s={at_s}", *sooner)
    return Variant(f"braking begins at {at_s:g} s", overrides)


def _jerk(jerk_mps3: float) -> Variant:
    """Return the variant in which the lead's braking grows with another jerk."""
    sooner = SOONER if jerk_mps3 > min(JERKS_MPS3) else ()
    return Variant(f"braking grows by {jerk_mps3:g} m/s^3", (f"{BRAKES}.jerk_mps3={jerk_mps3}", *sooner))


def _friction(friction: float) -> Variant:
    """Return the variant with another friction."""
    braking_mps2 = min(DECELERATION_MPS2, friction * STANDARD_GRAVITY_MPS2)
    overrides = (f"{BRAKES}.accel_mps2={-braking_mps2}", f"{STOPS}.limit_mps2={braking_mps2}")
    return Variant(f"friction {friction:g}", overrides, friction)


def _turn(at_s: float) -> Variant:
    """Return the variant in which the turn begins at another time."""
    overrides = (f"other.lateral.0.to_s={at_s}", f"other.lateral.1.from_s={at_s}")
    return Variant(f"the turn begins at {at_s:g} s", overrides)


VARIANTS: dict[str, tuple[Variant, ...]] = {
    "rear-end": (
        Variant("as chosen"),
        *map(_braking, BRAKING_S),
        *map(_jerk, JERKS_MPS3),
        *map(_friction, FRICTIONS),
    ),
    "intersection": (Variant("as chosen"), *map(_turn, TURN_S)),
}
"""Scenario -> the variants of its choices, the chosen one first."""


def sensitivity_part(name: str, n_seeds: int) -> tuple[Part, Section]:
    """Compute the bands of a scenario's moments over the variants, and their table, one row a variant."""
    figure = FIGURES[name]
    rows = [_moments(name, variant, min(n_seeds, MAX_SEEDS)) for variant in VARIANTS[name]]
    moments = np.array([[row[key] for key in MOMENTS] for row, _ in rows])
    counts = [_n_near(name, each) for each in moments]
    labels = {"ideal": "ideal moment"} | {f: f"warning, constant {f}, median" for f in FAMILIES}
    measured = [
        Measured(
            figure,
            f"{name}: band over the choices, {labels[key]}",
            float(each[0]),
            float(each.min()),
            float(each.max()),
        )
        for key, each in zip(MOMENTS, moments.T, strict=True)
    ]
    measured.append(
        Measured(
            figure,
            f"{name}: of the four moments within 0.1 s, as chosen; over the choices",
            *(float(each) for each in (counts[0], min(counts), max(counts))),
        )
    )
    section = Section(
        f"sensitivity_{name}",
        f"{figure}: the moments when one choice is moved",
        ("choice", *(f"{key} [s]" for key in MOMENTS), "within 0.1 s", "constant speed collides [%]"),
        tuple(
            (variant.name, *(round(float(value), 3) for value in each), f"{count} of {len(MOMENTS)}", round(share, 1))
            for variant, each, count, (_, share) in zip(VARIANTS[name], moments, counts, rows, strict=True)
        ),
    )
    return Part(tuple(measured)), section


def _moments(name: str, variant: Variant, n_seeds: int) -> tuple[dict[str, float], float]:
    """Return the ideal moment and the warnings' medians, and the per cent of runs in which constant speed collides."""
    scenario = load_scenario(name, variant.overrides)
    other = next(vehicle for vehicle in scenario.vehicles if vehicle != HOST)
    found: dict[str, list[float]] = {family: [] for family in FAMILIES}
    for seed in range(n_seeds):
        for family, when_s in paper_warnings(scenario, other, seed).items():
            found[family].append(when_s)
    moments = {"ideal": collision_time_s(scenario, other) - HORIZON_S}
    moments |= {family: float(np.nanmedian(values)) for family, values in found.items()}
    car = CarResponse() if variant.friction is None else CarResponse(friction=variant.friction)
    when = np.array(found["speed"])
    host, remote = true_motion(scenario, HOST), true_motion(scenario, other)
    collided = replay(host, remote, np.where(np.isnan(when), np.inf, when), fuzzy_policy, car=car).collided
    return moments, 100.0 * float(collided.mean())


def paper_warnings(scenario: Scenario, other: str, seed: int) -> dict[str, float]:
    """Return when each family first predicts a collision, in s, NaN if it never does."""
    runs = [sense(scenario, vehicle, seed) for vehicle in (HOST, other)]
    states = [paper_states(run) for run in runs]
    found = {}
    for family in FAMILIES:
        host_xy, other_xy = (paper_points(own, family, HORIZON_S) for own in states)
        found[family] = first_below(runs[0].time_s, np.hypot(*(host_xy - other_xy).T), COLLISION_M)
    return found


def _n_near(name: str, moments_s: FloatArray) -> int:
    """Count the moments that are within the tolerance around the paper's."""
    figure = load_expectations("song2016").figures[FIGURES[name]]
    labels = ("ideal moment", *(f"{name}: warning, constant {family}, median" for family in MOMENTS[1:]))
    near = 0
    for label, moment in zip(labels, moments_s, strict=True):
        row = figure.rows[label]
        near += row.paper is not None and abs(float(moment) - row.paper[0]) <= row.tolerance + 1e-9
    return near
