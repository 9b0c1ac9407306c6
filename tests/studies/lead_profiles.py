"""song2016, figure 9: does any way in which the lead brakes give all four printed moments?

    python -m tests.studies.lead_profiles [--every N]

The paper prints four moments of one drive and no profile of the lead. Here the lead coasts from one moment and brakes
from another; starts, decelerations and rates are on a grid of 6,000 profiles. The paper's filter, families and rule
run on exact measurements, so that no noise hides the profile's effect.
"""

from __future__ import annotations

import argparse
import json
import sys
from itertools import product

import numpy as np

from cwcli.estimation.song2016 import (
    SAMPLING_TIME_S,
    filtered_states_and_covariances_of_matrix,
    least_squares_slope_of_last_samples,
)
from cwcli.reproduction.song2016.fitted_noise import PRINTED_MEASUREMENT_NOISE_SIGMAS
from cwcli.reproduction.song2016.methods import MODEL_BY_FAMILY, PREDICTION_HORIZON_S, paper_predicted_points_m
from cwcli.reproduction.song2016.warning import COLLISION_CENTRE_DISTANCE_M, first_time_below_s
from cwcli.signals.columns import FloatArray

PRINTED_S = {"ideal": 3.5, "jerk": 3.6, "acceleration": 4.0, "speed": 4.5}
"""The printed moments of figure 9, in s."""
COAST_STARTS_S = (0.8, 1.2, 1.6, 2.0, 2.4)
COAST_DECELERATIONS_MPS2 = (0.0, 0.5, 1.0, 1.5)
BRAKE_STARTS_S = tuple(np.round(np.arange(2.6, 3.59, 0.1), 2).tolist())
BRAKE_RATES_MPS3 = (2.0, 3.0, 4.0, 6.0, 8.0, 16.0)
BRAKE_DECELERATIONS_MPS2 = (4.0, 5.0, 6.0, 7.0, 8.0)
COAST_RATE_MPS3 = 2.0
"""How fast the coasting's deceleration grows, in m/s^3, as in the scenario `rear-end`."""
SPEED_MPS, GAP_M = 20.0, 20.0
"""Speed of both cars and distance of their centres, as printed."""
FINE_STEP_S = 0.005
"""Time step of the true motion, in s."""
LAST_S = 7.0
"""The moments are sought until here, in s."""


def lead_states(coast: tuple[float, float], brake: tuple[float, float, float]) -> FloatArray:
    """Return the lead's states (n, 6) each `FINE_STEP_S`: x, y, v, heading, a, yaw rate."""
    time_s = np.arange(0.0, LAST_S, FINE_STEP_S)
    coasting = np.clip(COAST_RATE_MPS3 * (time_s - coast[0]), 0.0, coast[1])
    braking = np.clip(brake[1] * (time_s - brake[0]), 0.0, None)
    deceleration = np.minimum(coasting + braking, max(brake[2], coast[1]))
    speed = np.maximum(SPEED_MPS - np.cumsum(deceleration) * FINE_STEP_S, 0.0)
    states = np.zeros((len(time_s), 6))
    states[:, 0] = GAP_M + np.cumsum(speed) * FINE_STEP_S
    states[:, 2], states[:, 4] = speed, np.where(speed > 0.0, -deceleration, 0.0)
    return states


def moments_s(coast: tuple[float, float], brake: tuple[float, float, float]) -> dict[str, float]:
    """Return the ideal moment and each family's warning, NaN where there is none.

    Args:
        coast: Start in s, deceleration in m/s^2.
        brake: Start in s, rate in m/s^3, deceleration in m/s^2.
    """
    lead = lead_states(coast, brake)
    fine_s: FloatArray = np.asarray(np.arange(len(lead)) * FINE_STEP_S, dtype=np.float64)
    host = np.zeros_like(lead)
    host[:, 0], host[:, 2] = SPEED_MPS * fine_s, SPEED_MPS
    step = round(SAMPLING_TIME_S / FINE_STEP_S)
    collision = first_time_below_s(fine_s, lead[:, 0] - host[:, 0], COLLISION_CENTRE_DISTANCE_M)
    found = {"ideal": collision - PREDICTION_HORIZON_S}
    states = [_filtered(each[::step]) for each in (host, lead)]
    for family in MODEL_BY_FAMILY:
        points = [paper_predicted_points_m(each, family, PREDICTION_HORIZON_S) for each in states]
        distance_m = np.hypot(*(points[0] - points[1]).T)
        found[family] = first_time_below_s(fine_s[::step], distance_m, COLLISION_CENTRE_DISTANCE_M)
    return found


def _filtered(truth: FloatArray) -> FloatArray:
    """Run the paper's filter on exact measurements and append its slopes, shape (n, 8)."""
    states, _ = filtered_states_and_covariances_of_matrix(truth, tuple(PRINTED_MEASUREMENT_NOISE_SIGMAS))
    return np.column_stack(
        [
            states[:, :6],
            least_squares_slope_of_last_samples(states[:, 4]),
            least_squares_slope_of_last_samples(states[:, 5]),
        ]
    )


def profiles() -> list[tuple[tuple[float, float], tuple[float, float, float]]]:
    """Return all profiles as (coast, brake)."""
    coasts = list(product(COAST_STARTS_S, COAST_DECELERATIONS_MPS2))
    brakes = list(product(BRAKE_STARTS_S, BRAKE_RATES_MPS3, BRAKE_DECELERATIONS_MPS2))
    return list(product(coasts, brakes))


def bound(every: int = 1) -> dict[str, float]:
    """Return what the profiles reach at best: the largest deviation of two moments and of four, in s."""
    chosen = profiles()[::every]
    rows = [moments_s(*profile) for profile in chosen]
    deviation = {name: np.array([abs(row[name] - value) for row in rows]) for name, value in PRINTED_S.items()}
    pair = np.maximum(deviation["jerk"], deviation["acceleration"])
    all_four = np.max(list(deviation.values()), axis=0)
    best = chosen[int(np.nanargmin(all_four))]
    names = ("coast_start_s", "coast_deceleration_mps2", "brake_start_s", "brake_rate_mps3", "brake_deceleration_mps2")
    return {
        "n_profiles": float(len(chosen)),
        "least_deviation_of_jerk_and_acceleration_s": float(np.nanmin(pair)),
        "least_deviation_of_all_four_s": float(np.nanmin(all_four)),
        **{f"best_{name}": float(value) for name, value in zip(names, (*best[0], *best[1]), strict=True)},
    }


def main() -> None:
    """Print the bound as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--every", type=int, default=1, help="take every Nth profile only")
    json.dump(bound(parser.parse_args().every), sys.stdout, indent=1)
    sys.stdout.write("\n")


if __name__ == "__main__":
    main()
