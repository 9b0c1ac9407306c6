"""Does a calibration of ten drives pay? `python -m tests.studies.calibrate`.

Ten simulated drives of one car are estimated and pooled. The pooled intervals must be narrower than those of a single
drive by the square root of ten, within 30 %; the pooled constants must lie within three sigma of the truth (noise
within 3 % of it: matching cuts outliers off, and finds one or two per cent too little); and on further drives the
causal estimate with the calibration must be as good as the one with the true constants, within 5 %. The exit code is 1
where a bound is missed.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass

import numpy as np

from cwcli.estimation import EstimatorConfig, Kind, estimate_track
from cwcli.estimation.calibration import Calibration, Constant, ConstantStatus
from cwcli.estimation.pooling import DriveEvidence, calibrate_from_drives
from cwcli.signals.angles import wrap_angle
from cwcli.signals.vehicle_state import HEADING, SPEED
from tests.studies.city_drive import EPOCH_NS, Sensors, city_drive, measure

LATENCY_S = {"gnss": 0.12, "speed": 0.04, "heading": 0.2}
KINDS = {"gnss": Kind.POSITION, "speed": Kind.SPEED, "heading": Kind.HEADING}
N_LOGS = 10
NARROWER = 0.3
NOISE_PART = 0.03
AS_GOOD = 1.05
SETTLED_S = 10.0
QUANTITIES = ("position [m]", "speed [m/s]", "heading [deg]")


@dataclass(frozen=True)
class Row:
    """One constant.

    Attributes:
        source, kind, name: Which.
        truth: Its value.
    """

    source: str
    kind: Kind
    name: str
    truth: float


def constants() -> list[Row]:
    """What the simulated car has."""
    sensors = Sensors()
    noise = {"gnss": sensors.position_m, "speed": sensors.speed_mps, "heading": sensors.heading_rad}
    return [
        *(Row(source, KINDS[source], "latency_s", value) for source, value in LATENCY_S.items()),
        *(Row(source, KINDS[source], "noise_sigma", value) for source, value in noise.items()),
        Row("imu", Kind.ACCEL, "bias", sensors.accel_bias_mps2),
        Row("imu", Kind.YAW_RATE, "bias", sensors.yaw_rate_bias_radps),
    ]


def with_truth(found: Calibration) -> Calibration:
    """The calibration with the constants of the simulated car in the place of those that were found."""
    sensors = {source: {quantity: dict(own) for quantity, own in of.items()} for source, of in found.sensors.items()}
    for row in constants():
        sensors[row.source][row.kind.name.lower()][row.name] = Constant(ConstantStatus.FOUND, row.truth, 0.0)
    true = Sensors()
    for kind, value in ((Kind.ACCEL, true.accel_mps2), (Kind.YAW_RATE, true.yaw_rate_radps)):
        sensors["imu"][kind.name.lower()]["noise_sigma"] = Constant(ConstantStatus.FOUND, value, 0.0)
        sensors["imu"][kind.name.lower()]["latency_s"] = Constant(ConstantStatus.FOUND, 0.0, 0.0)
    for angle in ("nose_up_rad", "left_up_rad"):
        sensors["imu"]["imu"][angle] = Constant(ConstantStatus.FOUND, 0.0, 0.0)
    return Calibration("truth", sensors, found.motion)


def errors(seed: int, duration_s: float, config: EstimatorConfig) -> list[float]:
    """Root mean square errors of a further drive: position, speed, heading."""
    drive = city_drive(seed, duration_s)
    output_ns = EPOCH_NS + (np.arange(SETTLED_S, duration_s - 1.0, 0.05) * 1e9).astype(np.int64)
    track = estimate_track(measure(drive, seed, LATENCY_S), config, output_ns)
    truth = drive.at((output_ns - EPOCH_NS) / 1e9)
    off = (
        np.hypot(track.state[:, 0] - truth["x_m"], track.state[:, 1] - truth["y_m"]),
        track.state[:, SPEED] - truth["speed_mps"],
        np.degrees(wrap_angle(track.state[:, HEADING] - truth["heading_rad"])),
    )
    return [float(np.sqrt(np.mean(each**2))) for each in off]


def intervals(drives: list[DriveEvidence], pooled: Calibration) -> bool:
    """Print the table of the constants; whether the bounds hold."""
    single = [calibrate_from_drives([drive]) for drive in drives]
    print("| constant | truth | pooled | interval | a single log's (median) | narrower by | chi-square |")
    print("|---|---|---|---|---|---|---|")
    holds = True
    for row in constants():
        found = pooled.find_constant_or_unknown(row.source, row.kind, row.name)
        one = float(
            np.median([1.96 * each.find_constant_or_unknown(row.source, row.kind, row.name).sigma for each in single])
        )
        narrower = one / (1.96 * found.sigma)
        allowed = NOISE_PART * row.truth if row.name == "noise_sigma" else 3.0 * found.sigma
        is_right = abs(found.value - row.truth) < allowed
        is_narrower = abs(narrower / np.sqrt(len(drives)) - 1.0) <= NARROWER
        holds &= is_right and is_narrower
        print(
            f"| {row.source} {row.kind.name.lower()} {row.name} | {row.truth:.4g} | {found.value:.4g} "
            f"| +- {1.96 * found.sigma:.2g} | +- {one:.2g} "
            f"| {narrower:.2f} | {found.chi_square:.2f} |{'' if is_right else ' wrong'}"
            f"{'' if is_narrower else ' missed'}"
        )
    return holds


def main() -> int:
    """Print the tables; 1 when a bound is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--duration", type=float, default=150.0, help="seconds of each drive")
    parser.add_argument("--drives", type=int, default=10, help="further drives, on which it is tried")
    arguments = parser.parse_args()
    drives = [
        DriveEvidence(
            f"drive {seed}",
            estimate_track(measure(city_drive(seed, arguments.duration), seed, LATENCY_S), EstimatorConfig()),
        )
        for seed in range(N_LOGS)
    ]
    pooled = calibrate_from_drives(drives, "car.toml")
    holds = intervals(drives, pooled)
    print("\n| causal, further drives (root mean square) | " + " | ".join(QUANTITIES) + " |\n|---|---|---|---|")
    ways = {
        "true constants": EstimatorConfig(causal=True, calibration=with_truth(pooled)),
        "calibration": EstimatorConfig(causal=True, calibration=pooled),
        "from the whole log itself": EstimatorConfig(causal=True),
        "`--latency none`": EstimatorConfig(causal=True, latency="none"),
    }
    found = {}
    for name, config in ways.items():
        each = [errors(1000 + k, arguments.duration, config) for k in range(arguments.drives)]
        found[name] = np.sqrt(np.mean(np.square(each), axis=0))
        print(f"| {name} | " + " | ".join(f"{value:.4f}" for value in found[name]) + " |")
    ratio = found["calibration"] / found["true constants"]
    print("| calibration / true constants | " + " | ".join(f"{value:.3f}" for value in ratio) + " |")
    return 0 if holds and (ratio <= AS_GOOD).all() else 1


if __name__ == "__main__":
    sys.exit(main())
