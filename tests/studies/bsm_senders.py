"""Senders of BSMs that filter as SAE J2945/1 asks: `python -m tests.studies.bsm_senders [N_SEEDS]`.

A car ahead brakes with 6 m/s^2 (its messages: 10 a second, filtered acceleration, latched heading). Around the onset
its online states and the places predicted from them 1.5 s ahead are compared with the truth: senders taken for plain
ones, and for what they are.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cwcli.channels.vehicle_state import read_vehicle_states
from cwcli.estimation.config import EstimatorConfig, Senders
from cwcli.logs.read.reader import Log
from cwcli.prediction.rollout import RolloutSettings, roll_out_paths
from cwcli.signals.columns import FloatArray
from cwcli.signals.geodesy import LocalMap
from cwcli.simulate.sensor_log import write_simulated_log
from cwcli.simulation.drive import simulate_scenario
from cwcli.simulation.scenario import Scenario, parse_scenario
from cwcli.stages.estimate import EstimateConfig, estimate

BRAKES_S = 5.0
AROUND_S = (0.0, 1.5)
"""From the onset."""
AHEAD_S = 1.5
WAYS: tuple[Senders, ...] = ("plain", "j2945")


def scenario(**link: Any) -> Scenario:
    """The braking car, its link as given."""
    braking = [
        {"from_s": 0, "to_s": BRAKES_S, "accel_mps2": 0},
        {"from_s": BRAKES_S, "speed_mps": 0, "limit_mps2": 6, "jerk_mps3": 10},
    ]
    return parse_scenario(
        {
            "duration_s": 12,
            "vehicles": {
                "host": {"speed_mps": 5},
                "lead": {"x_m": 60, "speed_mps": 20, "station_id": "0a0b0c0d", "longitudinal": braking},
            },
            "sensors": {"gnss": {}, "gnss_heading": {}, "speed": {}, "imu": {}},
            "v2x": {"rate_hz": 10, "sender": "j2945"} | link,
        },
        name="senders",
    )


def errors(seed: int, senders: Senders, folder: Path, **link: Any) -> dict[str, float]:
    """Root mean squares around the onset, by quantity: speed, acceleration, and the place predicted."""
    made = scenario(**link)
    path = folder / f"{seed}-{'-'.join(map(str, link.values()))}.mcap"
    if not path.exists():
        write_simulated_log(simulate_scenario(made, seed), path)
    with Log.open(path) as log:
        result = estimate(log, EstimateConfig(estimator=EstimatorConfig(senders=senders)))
        states = read_vehicle_states(log.with_channels(result.channels).columns("/cwcli/remote/online"))
    assert result.evaluation_inputs.local_map is not None
    origin = made.origin
    true_map = LocalMap(*(origin[name] for name in ("latitude_deg", "longitude_deg", "altitude_m")))
    time_s = (states.stamp_ns - made.start_ns) * 1e-9
    rows = np.flatnonzero((time_s >= BRAKES_S + AROUND_S[0]) & (time_s <= BRAKES_S + AROUND_S[1]))
    motion = made.vehicles["lead"].motion
    truth, later = motion.states_at(time_s[rows]), motion.states_at(time_s[rows] + AHEAD_S)
    covariance = np.asarray(states.covariance[rows])
    paths = roll_out_paths(
        "auto", states.state[rows], covariance, settings=RolloutSettings(horizon_s=AHEAD_S, step_s=0.1)
    )
    # the map begins at the first fix, which is off by its noise
    shift = np.array(true_map.map_from_wgs84(*_origin_of(result.evaluation_inputs.local_map)))[:2, 0]
    found = np.column_stack([paths.x_m[:, -1], paths.y_m[:, -1]]) + shift
    state = states.state[rows]
    return {
        "speed_mps": _rms(state[:, 2] - truth[:, 2]),
        "accel_mps2": _rms(state[:, 4] - truth[:, 4]),
        "predicted_m": _rms(np.hypot(*(found - later[:, :2]).T)),
    }


def _origin_of(place: LocalMap) -> Iterator[FloatArray]:
    for value in (place.origin_lat_deg, place.origin_lon_deg, place.origin_alt_m):
        yield np.array([value])


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def compared(n_seeds: int, **link: Any) -> dict[str, FloatArray]:
    """Quantity -> shape (n_seeds, 2): its error with senders taken for plain, and for what they are."""
    with tempfile.TemporaryDirectory() as folder:
        found = [[errors(seed, way, Path(folder), **link) for way in WAYS] for seed in range(1, n_seeds + 1)]
    return {name: np.array([[each[name] for each in pair] for pair in found]) for name in found[0][0]}


def main() -> None:
    """Print the table."""
    n_seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    for link in ({}, {"accel_sigma_mps2": 0.003}, {"rate_hz": 20}, {"sender": "plain"}):
        print(f"{link or 'as J2945/1 asks, noise as in the scenarios'}")
        for name, values in compared(n_seeds, **link).items():
            better = int((values[:, 1] < values[:, 0]).sum())
            plain, taken = values.mean(axis=0)
            print(f"  {name}: plain {plain:.3f}, j2945 {taken:.3f}; better in {better} of {n_seeds}", flush=True)


if __name__ == "__main__":
    main()
