"""How far figures 9, 11 and 12 depend on what was chosen: the moments and collisions when one choice is moved.

The paper's chain alone (its filter, its three families, its rule, its controller), over the first seeds.
"""

from __future__ import annotations

import numpy as np

from cwcli.control.car import CarResponse
from cwcli.control.closed_loop import fuzzy_controller_throttle_and_pressure, replay_with_policy
from cwcli.lazy_dataclass import dataclass
from cwcli.pipeline.result import SummaryTable
from cwcli.reproduction.classes import MeasuredNumber
from cwcli.reproduction.expectations import load_expectations
from cwcli.reproduction.findings import StudyPart
from cwcli.reproduction.song2016.control import true_recorded_motion
from cwcli.reproduction.song2016.methods import (
    MODEL_BY_FAMILY,
    PREDICTION_HORIZON_S,
    measure_vehicle,
    paper_filter_states_with_derivatives,
    paper_predicted_points_m,
)
from cwcli.reproduction.song2016.warning import (
    COLLISION_CENTRE_DISTANCE_M,
    FIGURE_BY_SCENARIO,
    collision_time_s,
    first_time_below_s,
)
from cwcli.signals.columns import FloatArray
from cwcli.signals.units import STANDARD_GRAVITY_MPS2
from cwcli.simulation.scenario import EGO_VEHICLE_KEY, Scenario, load_scenario

MAX_SENSITIVITY_SEEDS = 10
"""The greatest number of seeds of each variant. Chosen by hand; not fitted."""
BRAKING_SEGMENT_KEY = "lead.longitudinal.2"
"""Key of the scenario's segment in which the lead brakes."""
STOPPING_SEGMENT_KEY = "lead.longitudinal.3"
"""Key of the scenario's segment in which the lead comes to rest."""
EARLIER_STOP_OVERRIDES = (f"{BRAKING_SEGMENT_KEY}.to_s=6.2", f"{STOPPING_SEGMENT_KEY}.from_s=6.2")
"""Overrides that begin the lead's last segment earlier, as a lead that brakes earlier or harder is slow earlier."""
TURN_STARTS_S = (4.4, 4.6)
"""Moved starts of the turn at the intersection, in s. Chosen by hand; not fitted."""
BRAKING_STARTS_S = (3.35, 3.55)
"""Moved starts of the braking, in s. Chosen by hand; not fitted."""
BRAKING_JERKS_MPS3 = (2.5, 3.5)
"""Moved jerks at the beginning of the braking, in m/s^3. Chosen by hand; not fitted."""
FRICTION_COEFFICIENTS = (0.7, 0.8, 0.9)
"""Friction coefficients (1) with which the study is repeated: those of docs/papers/song2016-choices.md, 0.8 and 0.9,
and one below."""
MAX_LEAD_DECELERATION_MPS2 = 8.0
"""The lead's deceleration where the friction allows it, in m/s^2, as in the scenario."""
COMPARED_WARNING_MOMENT_NAMES = ("ideal", "jerk", "acceleration", "speed")
"""Names of the compared moments: the ideal one and the warnings of the three families."""


@dataclass(frozen=True)
class ChoiceVariant:
    """One variant of the study, in which one choice is moved.

    Attributes:
        name: What is moved, and where to.
        overrides: Of the scenario.
        friction: Limits the lead's braking and the host's; None: as the scenario and the car have it.
    """

    name: str
    overrides: tuple[str, ...] = ()
    friction: float | None = None


def _braking_start_variant(at_s: float) -> ChoiceVariant:
    """Return the variant in which the lead begins to brake at another time."""
    sooner = EARLIER_STOP_OVERRIDES if at_s < max(BRAKING_STARTS_S) else ()
    overrides = (f"lead.longitudinal.1.to_s={at_s}", f"{BRAKING_SEGMENT_KEY}.from_s={at_s}", *sooner)
    return ChoiceVariant(f"braking begins at {at_s:g} s", overrides)


def _braking_jerk_variant(jerk_mps3: float) -> ChoiceVariant:
    """Return the variant in which the lead's braking grows with another jerk."""
    sooner = EARLIER_STOP_OVERRIDES if jerk_mps3 > min(BRAKING_JERKS_MPS3) else ()
    return ChoiceVariant(
        f"braking grows by {jerk_mps3:g} m/s^3", (f"{BRAKING_SEGMENT_KEY}.jerk_mps3={jerk_mps3}", *sooner)
    )


def _variant_with_friction(friction: float) -> ChoiceVariant:
    """Return the variant with another friction."""
    braking_mps2 = min(MAX_LEAD_DECELERATION_MPS2, friction * STANDARD_GRAVITY_MPS2)
    overrides = (
        f"{BRAKING_SEGMENT_KEY}.accel_mps2={-braking_mps2}",
        f"{STOPPING_SEGMENT_KEY}.limit_mps2={braking_mps2}",
    )
    return ChoiceVariant(f"friction {friction:g}", overrides, friction)


def _turn_start_variant(at_s: float) -> ChoiceVariant:
    """Return the variant in which the turn begins at another time."""
    overrides = (f"other.lateral.0.to_s={at_s}", f"other.lateral.1.from_s={at_s}")
    return ChoiceVariant(f"the turn begins at {at_s:g} s", overrides)


VARIANTS_BY_SCENARIO: dict[str, tuple[ChoiceVariant, ...]] = {
    "rear-end": (
        ChoiceVariant("as chosen"),
        *map(_braking_start_variant, BRAKING_STARTS_S),
        *map(_braking_jerk_variant, BRAKING_JERKS_MPS3),
        *map(_variant_with_friction, FRICTION_COEFFICIENTS),
    ),
    "intersection": (ChoiceVariant("as chosen"), *map(_turn_start_variant, TURN_STARTS_S)),
}
"""Scenario -> the variants of its choices, the chosen one first."""


def moment_bands_over_variants(name: str, n_seeds: int) -> tuple[StudyPart, SummaryTable]:
    """Compute the bands of a scenario's moments over the variants, and their table, one row a variant."""
    figure = FIGURE_BY_SCENARIO[name]
    rows = [
        _moments_and_collision_percent(name, variant, min(n_seeds, MAX_SENSITIVITY_SEEDS))
        for variant in VARIANTS_BY_SCENARIO[name]
    ]
    moments = np.array([[row[key] for key in COMPARED_WARNING_MOMENT_NAMES] for row, _ in rows])
    counts = [_count_moments_within_tolerance(name, each) for each in moments]
    labels = {"ideal": "ideal moment"} | {f: f"warning, constant {f}, median" for f in MODEL_BY_FAMILY}
    measured = [
        MeasuredNumber(
            figure,
            f"{name}: band over the choices, {labels[key]}",
            float(each[0]),
            float(each.min()),
            float(each.max()),
        )
        for key, each in zip(COMPARED_WARNING_MOMENT_NAMES, moments.T, strict=True)
    ]
    measured.append(
        MeasuredNumber(
            figure,
            f"{name}: of the four moments within the tolerance, as chosen; over the choices",
            *(float(each) for each in (counts[0], min(counts), max(counts))),
        )
    )
    section = SummaryTable(
        f"sensitivity_{name}",
        f"{figure}: the moments when one choice is moved",
        (
            "choice",
            *(f"{key} [s]" for key in COMPARED_WARNING_MOMENT_NAMES),
            "within the tolerance",
            "constant speed collides [%]",
        ),
        tuple(
            (
                variant.name,
                *(round(float(value), 3) for value in each),
                f"{count} of {len(COMPARED_WARNING_MOMENT_NAMES)}",
                round(share, 1),
            )
            for variant, each, count, (_, share) in zip(VARIANTS_BY_SCENARIO[name], moments, counts, rows, strict=True)
        ),
    )
    return StudyPart(tuple(measured)), section


def _moments_and_collision_percent(name: str, variant: ChoiceVariant, n_seeds: int) -> tuple[dict[str, float], float]:
    """Return the ideal moment and the warnings' medians, and the per cent of runs in which constant speed collides."""
    scenario = load_scenario(name, variant.overrides)
    other = next(vehicle for vehicle in scenario.vehicles if vehicle != EGO_VEHICLE_KEY)
    found: dict[str, list[float]] = {family: [] for family in MODEL_BY_FAMILY}
    for seed in range(n_seeds):
        for family, when_s in paper_warning_times_s(scenario, other, seed).items():
            found[family].append(when_s)
    moments = {"ideal": collision_time_s(scenario, other) - PREDICTION_HORIZON_S}
    moments |= {family: float(np.nanmedian(values)) for family, values in found.items()}
    car = CarResponse() if variant.friction is None else CarResponse(friction=variant.friction)
    when = np.array(found["speed"])
    host, remote = true_recorded_motion(scenario, EGO_VEHICLE_KEY), true_recorded_motion(scenario, other)
    collided = replay_with_policy(
        host, remote, np.where(np.isnan(when), np.inf, when), fuzzy_controller_throttle_and_pressure, car=car
    ).collided
    return moments, 100.0 * float(collided.mean())


def paper_warning_times_s(scenario: Scenario, other: str, seed: int) -> dict[str, float]:
    """Return when each family first predicts a collision, in s, NaN if it never does."""
    runs = [measure_vehicle(scenario, vehicle, seed) for vehicle in (EGO_VEHICLE_KEY, other)]
    states = [paper_filter_states_with_derivatives(run) for run in runs]
    found = {}
    for family in MODEL_BY_FAMILY:
        host_xy, other_xy = (paper_predicted_points_m(own, family, PREDICTION_HORIZON_S) for own in states)
        found[family] = first_time_below_s(
            runs[0].time_s, np.hypot(*(host_xy - other_xy).T), COLLISION_CENTRE_DISTANCE_M
        )
    return found


def _count_moments_within_tolerance(name: str, moments_s: FloatArray) -> int:
    """Count the moments that are within the tolerance around the paper's."""
    figure = load_expectations("song2016").figures[FIGURE_BY_SCENARIO[name]]
    labels = (
        "ideal moment",
        *(f"{name}: warning, constant {family}, median" for family in COMPARED_WARNING_MOMENT_NAMES[1:]),
    )
    near = 0
    for label, moment in zip(labels, moments_s, strict=True):
        row = figure.expectation_by_number[label]
        near += row.paper_range is not None and abs(float(moment) - row.paper_range[0]) <= row.tolerance + 1e-9
    return near
