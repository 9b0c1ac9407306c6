"""How well planted latencies are found: `python -m tests.studies.latency --runs 100`.

Each run simulates a city drive with song2016's sensor noise, plants a latency of -50 to 300 ms in every source but the
IMU, and estimates. Beside the errors stands the Cramer-Rao bound: the one sigma of the latency when everything else
(noise, the other latencies, a start near the truth) is known and only the motion and the biases are not, from the
filter's information along the drive.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cwcli.estimation import EstimatorConfig, Latency, LatencyStatus, estimate_track
from cwcli.estimation.latency_search import (
    IMU_REFERENCE_JERK_SIGMA_MPS3,
    IMU_REFERENCE_YAW_ACCEL_SIGMA_RADPS2,
    SEARCH_POSITION_NOISE_M_PER_ROOT_S,
)
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.model import MotionParameters
from cwcli.estimation.passes import run_filter_pass
from cwcli.estimation.prepare import earliest_stamp_ns, clean_and_sort_measurements_and_note
from cwcli.estimation.start import find_full_filter_start
from cwcli.estimation.tune import add_bias_states_and_their_variances
from tests.studies.city_drive import Sensors, city_drive, measure

FOUND = (LatencyStatus.APPLIED, LatencyStatus.DRIFTS, LatencyStatus.NOT_SIGNIFICANT)
SOURCES = ("gnss", "speed", "heading")
TOLERANCE_S = 0.010
PRIOR_S = 0.2


@dataclass(frozen=True)
class Run:
    """One run, per source, seconds.

    Attributes:
        error_s: Of what was found.
        left_s: What the correction leaves: a latency that is not significant is not corrected.
        sigma_s: The estimator's own sigma.
        bound_s: The Cramer-Rao bound.
    """

    error_s: dict[str, float]
    left_s: dict[str, float]
    sigma_s: dict[str, float]
    bound_s: dict[str, float]


def one_run(seed: int, duration_s: float, slow: tuple[float, float] = (0.0, 1.0)) -> Run:
    """Simulate, plant, estimate, compare; slow: sigma (m) and time constant (s) of the fixes' slow error."""
    rng = np.random.default_rng([seed, 99])
    planted = {source: float(rng.uniform(-0.05, 0.3)) for source in SOURCES}
    measurements = measure(city_drive(seed, duration_s), seed, planted)
    measurements = [with_slow_error(m, *slow, seed) if m.kind is Kind.POSITION else m for m in measurements]
    track = estimate_track(measurements, EstimatorConfig())
    told = {r.source: r.latency for r in track.sources}  # of the IMU the yaw rate's
    found = {s: against(told[s], told["imu"]) for s in SOURCES}
    return Run(
        {s: found[s].found_s - planted[s] for s in SOURCES},
        {s: planted[s] - (told[s].applied_s - told["imu"].applied_s) for s in SOURCES},
        {s: found[s].sigma_s for s in SOURCES},
        bound(measurements, planted),
    )


def against(one: Latency, other: Latency) -> Latency:
    """The latency between two sources, whichever clock the latencies count from; known where both are."""
    known = [told for told in (one, other) if told.status is not LatencyStatus.REFERENCE]
    return Latency(
        min((told.status for told in known), key=FOUND.__contains__, default=LatencyStatus.REFERENCE),
        sum(sign * told.found_s for sign, told in ((1.0, one), (-1.0, other)) if told in known),
        float(np.sqrt(sum(told.sigma_s**2 for told in known))),
        max((told.bound_s for told in known), default=float("nan")),
    )


def with_slow_error(positions: Measurements, sigma_m: float, time_s: float, seed: int) -> Measurements:
    """The positions with a Gauss-Markov error on each axis."""
    keep = np.exp(-np.diff(positions.stamp_ns) / 1e9 / time_s)
    drawn = np.random.default_rng([seed, 5]).standard_normal((len(positions), 2))
    error = np.zeros_like(drawn)
    error[0] = drawn[0]
    for k, kept in enumerate(keep):
        error[k + 1] = kept * error[k] + np.sqrt(1.0 - kept**2) * drawn[k + 1]
    return replace(positions, values=positions.values + sigma_m * error)


def bound(measurements: Sequence[Measurements], planted: dict[str, float]) -> dict[str, float]:
    """Return the Cramer-Rao bound of each source's latency against the IMU alone, seconds."""
    sensors = Sensors()
    sigma = {
        Kind.POSITION: sensors.position_m, Kind.SPEED: sensors.speed_mps, Kind.HEADING: sensors.heading_rad,
        Kind.ACCEL: sensors.accel_mps2, Kind.YAW_RATE: sensors.yaw_rate_radps,
    }  # fmt: skip
    parameters = MotionParameters(
        jerk_sigma_mps3=IMU_REFERENCE_JERK_SIGMA_MPS3,
        yaw_accel_sigma_radps2=IMU_REFERENCE_YAW_ACCEL_SIGMA_RADPS2,
        side_slip_m=SEARCH_POSITION_NOISE_M_PER_ROOT_S,
    )
    prepared, _ = clean_and_sort_measurements_and_note(measurements, earliest_stamp_ns(measurements))
    series, walk, prior = add_bias_states_and_their_variances(prepared, parameters)
    series = [
        replace(
            s,
            latency_s=planted.get(s.source, 0.0),
            noise=np.tile([sigma[s.kind] ** 2, 0.0, sigma[s.kind] ** 2 * (s.n_values_per_row == 2)], (len(s), 1)),
        )
        for s in series
    ]
    n = len(walk)
    found = {}
    for s in series:
        if s.source not in SOURCES:
            continue
        used = [replace(s, latency_state=n), *(other for other in series if other.source == "imu")]
        start = find_full_filter_start(used, np.append(prior, PRIOR_S**2), causal=False)
        result = run_filter_pass(
            used, start, parameters.to_process_model(np.append(walk, 0.0)), np.zeros(0), smooth=False, reset_after=50
        )
        found[s.source] = float(np.sqrt(result.last_covariance[n, n]))
    return found


def main() -> None:
    """Print the study's table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--duration", type=float, default=300.0, help="seconds of driving")
    parser.add_argument("--slow-m", type=float, default=0.0, help="slow error of the fixes, metres")
    parser.add_argument("--slow-s", type=float, default=3.0, help="its time constant, seconds")
    arguments = parser.parse_args()
    slow = (arguments.slow_m, arguments.slow_s)
    runs = [one_run(seed, arguments.duration, slow) for seed in range(arguments.runs)]
    print(f"{arguments.runs} runs of {arguments.duration:.0f} s, planted latencies -50 to 300 ms")
    print(
        f"{'source':8} {'within 10 ms':>12} {'bias ms':>8} {'sigma ms':>9} {'said ms':>8} {'bound ms':>9} {'worst':>8} "
        f"{'left: worst':>11} {'error / said':>12} {'beyond 2':>8}"
    )
    for source in SOURCES:
        error = 1e3 * np.array([r.error_s[source] for r in runs])
        said = 1e3 * np.array([r.sigma_s[source] for r in runs])
        reachable = 1e3 * np.array([r.bound_s[source] for r in runs])
        left = 1e3 * np.array([r.left_s[source] for r in runs])
        error, said = error[np.isfinite(error)], said[np.isfinite(error)]  # where nothing is observable
        if not len(error):
            print(f"{source:8} not observable")
            continue
        ratio = error / said
        inside = 100.0 * float((np.abs(error) <= 1e3 * TOLERANCE_S).mean())
        print(
            f"{source:8} {inside:11.0f}% {error.mean():8.2f} {error.std():9.2f} {np.sqrt((said**2).mean()):8.2f} "
            f"{np.sqrt((reachable**2).mean()):9.2f} {np.abs(error).max():8.2f} {np.abs(left).max():11.2f} "
            f"{np.sqrt((ratio**2).mean()):12.2f} {np.mean(np.abs(ratio) > 2.0):8.2f}"
        )


if __name__ == "__main__":
    main()
