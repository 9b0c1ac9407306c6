"""What the sensor model finds of a phone's drive: `python -m tests.studies.sensor_model --seeds 10`.

The scenario `phone` plants gravity through a pitch of 2 degrees, a lever arm of 1.2 m and a scale of -1 % at the wheel
speed, slow errors of the fixes (1.5 m, 15 s) and latencies. Each seed is estimated with these latencies given
(`--latency auto`: found; `none`: the stamps trusted). Printed are the errors, the NEES per degree of freedom, and what
was found against what was planted. The exit code is 1 where a bound is missed.

`--ahead 1.5 --imu-ahead 0.8` does the same with `city` (or `--scenario`) and sensors ahead of the car's point
(0: none does); the errors of the position are those of the antenna, which is what is published.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cwcli.estimation import EstimatorConfig, Kind, Measurements, Track, estimate_track
from cwcli.estimation.config import LatencyOption
from cwcli.estimation.consistency import nees
from cwcli.signals.angles import wrap_angle
from cwcli.simulation.drive import SimulatedDrive, simulate_scenario
from cwcli.simulation.scenario import EGO_VEHICLE_KEY, load_scenario
from tests.drive_truth import true_states_of_vehicle, truth_stamps_ns

SPEED_BOUND_MPS = 0.03
NEES_BOUNDS = (0.5, 2.0)
WORSE, MAX_SHARE = 1.02, 0.05
KINDS = {"gnss": Kind.POSITION, "gnss_heading": Kind.HEADING, "speed": Kind.SPEED, "imu": Kind.IMU}
COLUMNS = {"position": [0, 1], "speed": [2], "heading": [3]}


def measurements_of(drive: SimulatedDrive) -> list[Measurements]:
    """The drive's sensors as the estimator takes them; noise is not stated."""
    found = []
    for sensor, data in drive.sensors.items():
        order = np.argsort(data.stamp_ns, kind="stable")
        values = data.values[order, :2] if sensor == "gnss" else data.values[order]
        found.append(Measurements(sensor, KINDS[sensor], data.stamp_ns[order], values))
    return found


@dataclass(frozen=True)
class Run:
    """One seed.

    Attributes:
        rms: Quantity -> error, m, m/s, rad (root mean square; of the position over both axes).
        nees: Quantity -> NEES per degree of freedom.
        track: What was estimated.
    """

    rms: Mapping[str, float]
    nees: Mapping[str, float]
    track: Track


def one_run(
    scenario: str, seed: int, latency: str, ahead_m: float = 0.0, imu_ahead_m: float = 0.0, **config: object
) -> Run:
    """Simulate a drive with the GNSS and the IMU that far ahead, estimate it, compare at the antenna."""
    made = load_scenario(scenario)
    planted = {"gnss": {"ahead_m": ahead_m}, "imu": {"ahead_m": imu_ahead_m}}
    sensors = {name: {**own, **planted.get(name, {})} for name, own in made.sensors.items()}
    drive = simulate_scenario(replace(made, sensors=sensors), seed)
    given: LatencyOption = {s: float(v["latency_s"]) for s, v in drive.scenario.sensors.items()}
    if latency in ("auto", "none"):
        given = latency  # type: ignore[assignment]
    stamp_ns = truth_stamps_ns(drive)[::50]
    truth = true_states_of_vehicle(drive, EGO_VEHICLE_KEY)[::50].copy()
    truth[:, :2] += ahead_m * np.column_stack([np.cos(truth[:, 3]), np.sin(truth[:, 3])])
    track = estimate_track(measurements_of(drive), EstimatorConfig(latency=given, **config), stamp_ns)  # type: ignore[arg-type]
    error = track.state - truth
    error[:, 3] = wrap_angle(error[:, 3])
    rms, consistency = {}, {}
    for name, columns in COLUMNS.items():
        rms[name] = float(np.sqrt((error[:, columns] ** 2).sum(axis=1).mean()))
        covariance = track.covariance[:, columns][:, :, columns]
        consistency[name] = float(nees(error[:, columns], covariance).mean()) / len(columns)
    return Run(rms, consistency, track)


def summary(values: Sequence[float]) -> str:
    """Median and extremes."""
    return f"{np.median(values):.3f} ({min(values):.3f} to {max(values):.3f})"


def planted(seeds: Sequence[int], latency: str) -> bool:
    """Print the phone's table; whether the bounds hold."""
    sensors = load_scenario("phone").sensors
    runs = [one_run("phone", seed, latency) for seed in seeds]
    print(f"phone, {len(runs)} seeds, latency {latency}: median (least to largest)")
    print("| quantity | error (m, m/s, deg) | NEES per degree of freedom |\n|---|---|---|")
    for name in COLUMNS:
        rms = [np.degrees(r.rms[name]) if name == "heading" else r.rms[name] for r in runs]
        print(f"| {name} | {summary(rms)} | {summary([r.nees[name] for r in runs])} |")
    print("\n| found | planted | median (least to largest) | said sigma | errors over sigma (RMS) | used |")
    print("|---|---|---|---|---|---|")

    def row(name: str, true: float, found: Sequence[tuple[float, float, str]]) -> None:
        value, sigma = np.array([f[0] for f in found]), np.array([f[1] for f in found])
        pulls = np.sqrt(np.nanmean(((value - true) / sigma) ** 2)) if np.isfinite(sigma).any() else np.nan
        used = sum(f[2] == "used" or f[2] == "applied" for f in found)
        print(f"| {name} | {true:g} | {summary(value.tolist())} | {np.nanmedian(sigma):.4f} | {pulls:.2f} | {used} |")

    def of(kind: Kind) -> list:  # type: ignore[type-arg]
        return [next(s for s in r.track.sources if s.kind is kind) for r in runs]

    speed, fix, accel = of(Kind.SPEED), of(Kind.POSITION), of(Kind.ACCEL)
    row("scale", sensors["speed"]["scale"], [(s.scale.value, s.scale.sigma, s.scale.status) for s in speed])
    row("lever arm, m", sensors["speed"]["lever_arm_m"],
        [(s.lever_arm_m.value, s.lever_arm_m.sigma, s.lever_arm_m.status) for s in speed])  # fmt: skip
    row("fix: white noise, m", sensors["gnss"]["sigma_m"], [(s.sigma, np.nan, "used") for s in fix])
    for name, reports, true_sigma, true_s in (
        ("fix: slow error", fix, sensors["gnss"]["slow_sigma_m"], sensors["gnss"]["slow_time_s"]),
        ("grade", accel, np.nan, np.nan),
    ):
        row(f"{name}, sigma", true_sigma, [(s.slow_error.sigma, np.nan, s.slow_error.status) for s in reports])
        row(f"{name}, s", true_s, [(s.slow_error.time_s, np.nan, s.slow_error.status) for s in reports])
    for name, reports, sensor in (
        ("fix", fix, "gnss"), ("speed", speed, "speed"), ("heading", of(Kind.HEADING), "gnss_heading"),
    ):  # fmt: skip
        row(f"{name}: latency, s", sensors[sensor]["latency_s"],
            [(s.latency.found_s, s.latency.sigma_s, s.latency.status) for s in reports])  # fmt: skip
    inside = [all(NEES_BOUNDS[0] <= r.nees[name] <= NEES_BOUNDS[1] for name in COLUMNS) for r in runs]
    slow = [r.rms["speed"] <= SPEED_BOUND_MPS for r in runs]
    print(f"\nNEES of all three inside {NEES_BOUNDS}: {sum(inside)} of {len(runs)}; "
          f"speed within {SPEED_BOUND_MPS} m/s: {sum(slow)} of {len(runs)}")  # fmt: skip
    return all(inside) and all(slow)


def places(scenario: str, seeds: Sequence[int], latency: str, ahead_m: float, imu_ahead_m: float) -> bool:
    """Print what is found of sensors that stand ahead; whether the errors are as large as they say."""
    runs = [one_run(scenario, seed, latency, ahead_m, imu_ahead_m) for seed in seeds]
    print(f"{scenario}, {len(runs)} seeds, GNSS {ahead_m:g} m and IMU {imu_ahead_m:g} m ahead, latency {latency}")
    print("| quantity | error (m, m/s, deg) | NEES per degree of freedom |\n|---|---|---|")
    mean = {name: float(np.mean([r.nees[name] for r in runs])) for name in COLUMNS}
    for name in COLUMNS:
        rms = [np.degrees(r.rms[name]) if name == "heading" else r.rms[name] for r in runs]
        shown = f"{summary([r.nees[name] for r in runs])}, mean {mean[name]:.2f}"
        print(f"| {name} | {summary(rms)} | {shown} |")
    print("\n| found | planted | used | median (least to largest) | said sigma | errors over sigma (RMS) |")
    print("|---|---|---|---|---|---|")
    for name, kind, true in (("GNSS", Kind.POSITION, ahead_m), ("IMU", Kind.ACCEL, imu_ahead_m)):
        found = [next(s for s in r.track.sources if s.kind is kind).ahead_m for r in runs]
        own = [f for f in found if f.status == "used"]
        if not own:
            print(f"| {name} ahead, m | {true:g} | 0 of {len(runs)} | - | - | - |")
            continue
        pulls = np.sqrt(np.mean([((f.value - true) / f.sigma) ** 2 for f in own]))
        sigma = np.median([f.sigma for f in own])
        shown = f"{summary([f.value for f in own])} | {sigma:.3f} | {pulls:.2f}"
        print(f"| {name} ahead, m | {true:g} | {len(own)} of {len(runs)} | {shown} |")
    return all(NEES_BOUNDS[0] <= value <= NEES_BOUNDS[1] for value in mean.values())


def main() -> int:
    """Print the tables; 1 where a bound is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=1000)
    parser.add_argument("--latency", choices=("given", "auto", "none"), default="given")
    parser.add_argument("--scenario", default="city", help="With --ahead.")
    parser.add_argument("--ahead", type=float, metavar="M")
    parser.add_argument("--imu-ahead", type=float, metavar="M", default=0.0)
    options = parser.parse_args()
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    if options.ahead is not None:
        return 0 if places(options.scenario, seeds, options.latency, options.ahead, options.imu_ahead) else 1
    return 0 if planted(seeds, options.latency) else 1


if __name__ == "__main__":
    sys.exit(main())
