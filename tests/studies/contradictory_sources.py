"""Are wrong sensors named, and right ones never? `python -m tests.studies.contradictory_sources [--seeds N]`.

Every scenario is simulated with several seeds and compared without a fault, full (all sensors) and lean (fixes and an
IMU): no contradiction may be found. Then each fault of the list is put into a drive, and the table tells which source
was named and the position's error beside that of the drive without the fault. With `--logs FOLDER` real logs take part
in the first half. The exit code is 1 where a right source is named, or where a fault is neither named nor harmless.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cwcli.errors import CwcliError
from cwcli.estimation import EstimatorConfig, Kind, Measurements, Track, estimate_track
from cwcli.estimation.contradiction import Contradiction
from cwcli.estimation.prepare import earliest_stamp_ns, clean_measurements
from cwcli.estimation.source_vote import leave_out_outvoted_sources
from cwcli.logs.read.reader import Log
from cwcli.signals.role import Role
from cwcli.simulation.catalogue import scenario_names
from cwcli.simulation.drive import SimulatedDrive, simulate_scenario
from cwcli.simulation.scenario import HOST_NAME, load_scenario
from cwcli.stages.estimate import EGO_SENSOR_ROLES, _collect_ego_measurements, _map_at_first_fix
from cwcli.stages.inputs.sources import SourceConfig, read_sensor_signals
from tests.studies.sensor_model import measurements_of

LEAN = (Kind.POSITION, Kind.IMU)
FIRST_SEED = 9300
HARMLESS = 1.2
Fault = Callable[[Measurements], Measurements]


def scaled(kind: Kind, factor: float) -> Fault:
    """A quantity in another unit or with another sign."""
    return lambda m: replace(m, values=m.values * factor, covariance=None) if m.kind is kind else m


def turned_imu(*rows: Sequence[float], gyro: float = 1.0) -> Fault:
    """An IMU with other axes: what is read is this matrix times what should be."""
    matrix = np.array(rows, float)

    def fault(m: Measurements) -> Measurements:
        if m.kind is not Kind.IMU:
            return m
        values = np.column_stack([m.values[:, :3] @ matrix.T, gyro * m.values[:, 3:] @ matrix.T])
        return replace(m, values=values, covariance=None)

    return fault


def heading(change: Callable[[np.ndarray], np.ndarray]) -> Fault:
    """Another convention of the heading."""
    return lambda m: replace(m, values=change(m.values)) if m.kind is Kind.HEADING else m


EYE = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
FAULTS: Mapping[str, tuple[Kind, Fault]] = {
    "speed in km/h": (Kind.SPEED, scaled(Kind.SPEED, 3.6)),
    "speed divided by 3.6": (Kind.SPEED, scaled(Kind.SPEED, 1 / 3.6)),
    "speed in miles/h": (Kind.SPEED, scaled(Kind.SPEED, 2.23694)),
    "speed in knots": (Kind.SPEED, scaled(Kind.SPEED, 1.94384)),
    "speed times -1": (Kind.SPEED, scaled(Kind.SPEED, -1.0)),
    "speed always 0": (Kind.SPEED, scaled(Kind.SPEED, 0.0)),
    "gyroscope times -1": (Kind.IMU, turned_imu(*EYE, gyro=-1.0)),
    "gyroscope halved": (Kind.IMU, turned_imu(*EYE, gyro=0.5)),
    "gyroscope always 0": (Kind.IMU, turned_imu(*EYE, gyro=0.0)),
    "IMU upright, x up": (Kind.IMU, turned_imu((0, 0, 1), (0, 1, 0), (-1, 0, 0))),
    "IMU upright, x down": (Kind.IMU, turned_imu((0, 0, -1), (0, 1, 0), (1, 0, 0))),
    "IMU on its side": (Kind.IMU, turned_imu((1, 0, 0), (0, 0, 1), (0, -1, 0))),
    "IMU backwards": (Kind.IMU, turned_imu((-1, 0, 0), (0, -1, 0), (0, 0, 1))),
    "IMU x left": (Kind.IMU, turned_imu((0, 1, 0), (-1, 0, 0), (0, 0, 1))),
    "IMU pitched 30 degrees": (
        Kind.IMU, turned_imu((0.866, 0, 0.5), (0, 1, 0), (-0.5, 0, 0.866))),
    "heading clockwise from north": (Kind.HEADING, heading(lambda h: np.pi / 2 - h)),
    "heading times -1": (Kind.HEADING, heading(lambda h: -h)),
    "heading + 90 degrees": (Kind.HEADING, heading(lambda h: h + np.pi / 2)),
    "heading + 180 degrees": (Kind.HEADING, heading(lambda h: h + np.pi)),
    "heading - 90 degrees": (Kind.HEADING, heading(lambda h: h - np.pi / 2)),
    "heading always 0": (Kind.HEADING, heading(lambda h: 0 * h)),
}  # fmt: skip
"""Name -> the kind of what is wrong, and the fault."""


def contradictions_of(measurements: Sequence[Measurements]) -> tuple[Contradiction, ...]:
    """What the comparison alone says."""
    prepared, _ = clean_measurements(measurements, earliest_stamp_ns(measurements))
    return leave_out_outvoted_sources(prepared).contradictions


def variants(measurements: Sequence[Measurements]) -> dict[str, list[Measurements]]:
    """All sensors, and fixes with an IMU alone."""
    return {"full": list(measurements), "lean": [m for m in measurements if m.kind in LEAN]}


def read_log(path: Path) -> list[Measurements]:
    """The ego's measurements of a log, as `cwcli estimate` takes them; none where it has no position."""
    with Log.open(path) as log:
        try:
            sources = read_sensor_signals(
                log, SourceConfig(), command="estimate", required=(Role.EGO_POSITION,), optional=EGO_SENSOR_ROLES[1:]
            )
        except CwcliError:
            return []
        return _collect_ego_measurements(sources, _map_at_first_fix(sources))


def check_right_sources(seeds: Sequence[int], logs: Sequence[Path]) -> bool:
    """Whether nothing is named in any drive without a fault."""
    n, wrong = 0, 0
    cases = [(f"{name} {seed}", name, seed) for name in scenario_names() for seed in seeds]
    for title, name, seed in cases:
        for variant, measurements in variants(measurements_of(simulate_scenario(load_scenario(name), seed))).items():
            n += 1
            for each in contradictions_of(measurements):
                wrong += 1
                print(f"{title} {variant}: {each.contradiction_sentence}")
    for path in logs:
        if not (measurements := read_log(path)):
            continue
        for variant, own in variants(measurements).items():
            n += 1
            for each in contradictions_of(own):
                wrong += 1
                print(f"{path.name} {variant}: {each.contradiction_sentence}")
    print(f"right sources: {wrong} wrongly named in {n} drives")
    return wrong == 0


def estimated(drive: SimulatedDrive, measurements: Sequence[Measurements]) -> tuple[float, Track]:
    """The position's root mean square error over both axes, m, and the track."""
    stamp_ns = drive.truth_stamp_ns[::50]
    track = estimate_track(measurements, EstimatorConfig(), stamp_ns)
    error = track.state[:, :2] - drive.true_states_by_vehicle[HOST_NAME][::50, :2]
    return float(np.sqrt((error**2).sum(axis=1).mean())), track


def check_faults(scenarios: Sequence[str], seeds: Sequence[int]) -> bool:
    """Whether each fault is named, or does no harm."""
    print("| scenario | fault | sensors | error without, with, and so many times | named |\n|---|---|---|---|---|")
    missed = n = 0
    for name in scenarios:
        for seed in seeds:
            drive = simulate_scenario(load_scenario(name), seed)
            for variant, right in variants(measurements_of(drive)).items():
                least_m, _ = estimated(drive, right)
                for title, (kind, fault) in FAULTS.items():
                    if all(m.kind is not kind for m in right):
                        continue
                    n += 1
                    error_m, track = estimated(drive, [fault(m) for m in right])
                    kinds = {Kind.IMU: (Kind.IMU, Kind.ACCEL, Kind.YAW_RATE)}.get(kind, (kind,))
                    named = any(each.who.kind in kinds for each in track.contradictions)
                    told = "; ".join(each.contradiction_sentence for each in track.contradictions)
                    is_missed = not named and error_m > HARMLESS * least_m
                    missed += is_missed
                    print(
                        f"| {name} {seed} | {title} | {variant} | {least_m:.2f} m, {error_m:.2f} m, "
                        f"{error_m / least_m:.1f} | {told}{' **missed**' if is_missed else ''} |", flush=True
                    )  # fmt: skip
    print(f"faults: {missed} missed of {n}")
    return missed == 0


def main() -> None:
    """Print the tables; exit code 1 where something is missed or wrongly named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument("--logs", type=Path, nargs="*", default=[])
    parser.add_argument("--quiet-only", action="store_true", help="Drives without a fault alone.")
    parser.add_argument("--scenario", nargs="*", default=["city", "intersection", "phone"])
    options = parser.parse_args()
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    good = check_right_sources(seeds, options.logs)
    if not options.quiet_only:
        good &= check_faults(options.scenario, seeds)
    sys.exit(0 if good else 1)


if __name__ == "__main__":
    main()
