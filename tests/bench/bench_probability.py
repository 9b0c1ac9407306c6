"""What the probability of contact takes of warnings in dense traffic. `python tests/bench/bench_probability.py`.

Twenty cars in three lanes, behind one another at a gap, whose states are off by 0.6 m and 0.5 m/s^2: most are near
enough that contact is not out of the question, though none is about to touch. Processor time, best of twelve.
The last column is what the lines through the errors would take alone, without anything around their kernel.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from cwcli.measures import collision_probability
from cwcli.prediction.rollout import RolloutSettings, roll_out_paths
from cwcli.warning import pair
from cwcli.warning.collision import PathPairs
from cwcli.warning.evaluate import FoundWarnings, find_warnings
from cwcli.warning.measures import Measures
from cwcli.warning.types import VehicleTrack

N_STAMPS, STEP_S = 400, 0.05
N_CARS, LANES, LANE_M = 20, 3, 3.5
HOST = 3
SIGMAS = np.array([0.6, 0.6, 0.3, 0.05, 0.5, 0.03, 0.3, 0.01])
ROUNDS = 12


def car(number: int, gap_m: float, rng: np.random.Generator) -> VehicleTrack:
    """One of them: 12 m/s, a little faster and slower, each later than the one ahead."""
    place, lane = divmod(number, LANES)
    time_s = np.arange(N_STAMPS) * STEP_S
    phase = 0.4 * (time_s - 1.5 * place) + lane
    state = np.zeros((N_STAMPS, 8))
    state[:, 0] = 12.0 * time_s - 2.5 * np.cos(phase) - (gap_m + 4.5) * place + 3.0 * lane
    state[:, 1], state[:, 2], state[:, 4] = LANE_M * lane, 12.0 + np.sin(phase), 0.4 * np.cos(phase)
    state += 0.2 * SIGMAS * rng.standard_normal(state.shape)
    covariance = np.tile(np.diag(SIGMAS**2), (N_STAMPS, 1, 1))
    stamp_ns = np.rint(time_s * 1e9).astype(np.int64)
    paths, onset = (
        roll_out_paths(model, state, covariance, settings=RolloutSettings(horizon_s=3.5)) for model in ("auto", "onset")
    )
    return VehicleTrack(str(number), stamp_ns, stamp_ns, state, paths, onset_paths=onset)


def without(measures: Measures, pairs: PathPairs, *args: Any, **named: Any) -> Measures:
    """In place of the probabilities: none."""
    none = np.zeros(len(measures.distance_m))
    return replace(measures, probability=none, late_probability=none.copy(), braked_probability=none * np.nan)


def seconds(cars: list[VehicleTrack]) -> tuple[float, FoundWarnings]:
    """Of the host's warnings, and these."""
    took = []
    for _ in range(ROUNDS):
        began = time.process_time()
        found = find_warnings(cars[HOST], [each for each in cars if each is not cars[HOST]])
        took.append(time.process_time() - began)
    return min(took), found


def kernel_seconds(cars: list[VehicleTrack]) -> float:
    """Return the processor seconds of the lines through the errors alone in one evaluation."""
    took = [0.0] * ROUNDS
    real = collision_probability.contact_probability  # type: ignore[attr-defined]
    for k in range(ROUNDS):

        def timed(*args: Any, k: int = k, **named: Any) -> Any:
            began = time.process_time()
            found = real(*args, **named)
            took[k] += time.process_time() - began
            return found

        collision_probability.contact_probability = timed  # type: ignore[attr-defined]
        find_warnings(cars[HOST], [each for each in cars if each is not cars[HOST]])
    collision_probability.contact_probability = real  # type: ignore[attr-defined]
    return min(took)


def main() -> None:
    """Print a table."""
    print("| gap | evaluations | contact above 0.1 % | above 10 % | times as long | by lines alone |")
    print("|---|---|---|---|---|---|")
    real = pair.add_contact_probabilities  # type: ignore[attr-defined]
    for gap_m in (4.0, 8.0, 17.0):
        rng = np.random.default_rng(0)
        cars = [car(number, gap_m, rng) for number in range(N_CARS)]
        with_s, found = seconds(cars)
        pair.add_contact_probabilities = without  # type: ignore[attr-defined, assignment]
        without_s, _ = seconds(cars)
        pair.add_contact_probabilities = real  # type: ignore[attr-defined]
        values = np.concatenate([own.measures.probability for own in found.pairs])
        some, much = (values > 0.001).mean(), (values > 0.1).mean()
        lines = 1.0 + kernel_seconds(cars) / without_s
        counts = f"{len(values)} | {some:.0%} | {much:.0%}"
        print(f"| {gap_m:g} m | {counts} | {with_s / without_s:.2f} | {lines:.2f} |", flush=True)


if __name__ == "__main__":
    main()
