"""Stamps of fixes that err: what is found, and what it is worth. `python -m tests.studies.stamp_noise --seeds 3`.

The fixes of simulated drives get stamps with a white error, uniform or normal, of 0, 10, 30 and 60 ms (one sigma).
Each drive is estimated from its fixes alone, or from all of its sensors, with the error of the stamps looked for and
not. Printed are what was found, the errors of position and speed in hindsight and online, and the NEES by degree of
freedom.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cwcli.estimation import EstimatorConfig, Kind, Measurements, Track, noise
from cwcli.estimation.consistency import nees
from cwcli.estimation.track import estimate_hindsight_and_online_tracks
from cwcli.signals.columns import FloatArray
from cwcli.signals.units import NS_PER_S
from cwcli.simulation.drive import simulate_scenario
from cwcli.simulation.scenario import EGO_VEHICLE_KEY, load_scenario
from tests.studies.sensor_model import measurements_of
from tests.drive_truth import true_states_of_vehicle, truth_stamps_ns

LEAD_IN_S = 10.0


def jittered(measurements: Sequence[Measurements], sigma_s: float, shape: str, seed: int) -> list[Measurements]:
    """The measurements, the fixes' stamps with an error; they are received in the order of their stamps."""
    rng = np.random.default_rng((seed, 7))
    found = []
    for m in measurements:
        n, wide = len(m), 3.0**0.5 * sigma_s
        error_s = rng.normal(0.0, sigma_s, n) if shape == "normal" else rng.uniform(-wide, wide, n)
        stamp_ns = m.stamp_ns + np.rint(error_s * NS_PER_S).astype(np.int64)
        found.append(replace(m, stamp_ns=stamp_ns) if m.kind is Kind.POSITION else m)
    return found


def judged(track: Track, truth: FloatArray) -> dict[str, float]:
    """Errors (m, m/s; root mean square) and NEES by degree of freedom, behind the start."""
    error = track.state - truth
    late = track.stamp_ns - track.stamp_ns[0] > LEAD_IN_S * NS_PER_S
    found = {}
    for name, columns in (("position", [0, 1]), ("speed", [2])):
        own, covariance = error[late][:, columns], track.covariance[late][:, columns][:, :, columns]
        found[name] = float(np.sqrt((own**2).sum(axis=1).mean()))
        found[f"{name} NEES"] = float(nees(own, covariance).mean()) / len(columns)
    return found


def one_run(
    scenario: str, seed: int, sigma_s: float, shape: str, *, alone: bool, fix_m: float | None
) -> tuple[float, Mapping[str, float]]:
    """Sigma that is found, and the judgement of the states in hindsight and online."""
    made = load_scenario(scenario)
    if fix_m is not None:
        made = replace(made, sensors={**made.sensors, "gnss": {**made.sensors["gnss"], "sigma_m": fix_m}})
    drive = simulate_scenario(made, seed)
    measurements = jittered(measurements_of(drive), sigma_s, shape, seed)
    if alone:
        measurements = [m for m in measurements if m.kind is Kind.POSITION]
    first = max(int(m.stamp_ns.min()) for m in measurements)
    last = min(int(m.stamp_ns.max()) for m in measurements)
    rows = np.flatnonzero((truth_stamps_ns(drive) >= first) & (truth_stamps_ns(drive) <= last))[::50]
    tracks = estimate_hindsight_and_online_tracks(
        measurements, EstimatorConfig(), truth_stamps_ns(drive)[rows], blind=False
    )
    truth = true_states_of_vehicle(drive, EGO_VEHICLE_KEY)[rows]
    found = {
        f"{when} {name}": value
        for when, track in zip(("hindsight", "online"), tracks, strict=True)
        for name, value in judged(track, truth).items()
    }
    report = next(s for s in tracks[0].sources if s.kind is Kind.POSITION)
    return report.stamp_error.value, found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--sigma-ms", type=float, nargs="+", default=[0.0, 10.0, 30.0, 60.0])
    parser.add_argument("--shapes", nargs="+", default=["normal", "uniform"])
    parser.add_argument("--scenarios", nargs="+", default=["straight", "curve", "city"])
    parser.add_argument("--fix-m", type=float, default=None, help="noise of the fixes, else the scenario's")
    parser.add_argument("--alone", action="store_true", help="the fixes alone")
    arguments = parser.parse_args()
    look = noise.fit_stamp_errors  # type: ignore[attr-defined]
    print(
        "| scenario | stamps [ms] | shape | found [ms] | position, m: hindsight | online | speed, m/s | NEES | online |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for scenario in arguments.scenarios:
        for sigma_ms in arguments.sigma_ms:
            for shape in arguments.shapes if sigma_ms else arguments.shapes[:1]:
                found: list[list[tuple[float, Mapping[str, float]]]] = []
                for looks in (False, True):
                    noise.fit_stamp_errors = look if looks else lambda fit, *_: fit  # type: ignore[attr-defined, assignment]
                    found.append(
                        [
                            one_run(scenario, seed, sigma_ms / 1e3, shape, alone=arguments.alone, fix_m=arguments.fix_m)
                            for seed in range(arguments.seeds)
                        ]
                    )
                noise.fit_stamp_errors = look  # type: ignore[attr-defined]

                def of(name: str, both: list[list[tuple[float, Mapping[str, float]]]] = found) -> str:
                    return " to ".join(f"{np.mean([values[name] for _, values in each]):.3g}" for each in both)

                sigmas = ", ".join(f"{1e3 * sigma_s:.0f}" for sigma_s, _ in found[1])
                names = ("hindsight position", "online position", "hindsight speed", "hindsight position NEES")
                cells = " | ".join(of(name) for name in (*names, "online position NEES"))
                print(f"| {scenario} | {sigma_ms:g} | {shape} | {sigmas} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
