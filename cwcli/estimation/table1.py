"""Table 1 of song2016, reproduced on its own noise: measured against estimated error, over many seeds.

The truth is the paper's: straight, "from rest, two accelerations to 15 m/s"; curve, "10 m/s, radius 40 m", in at about
15 s and out at about 30 s. The paper's simulator is not published, so the profiles below are ours: smooth ramps of the
acceleration and of the curvature, as a driver makes them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cwcli.estimation.config import EstimatorConfig
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.song2016 import filter_vectors
from cwcli.estimation.track import estimate_track
from cwcli.signals.angles import wrap_angle
from cwcli.signals.columns import FloatArray

STEP_S = 0.05
GRAVITY_MPS2 = 9.81
SIGMA = (0.6, 0.6, 0.5, np.radians(1.0), 0.005 * GRAVITY_MPS2, np.radians(0.1))
"""One sigma of x, y, v, heading, a and yaw rate. The paper's "0.5 %" of acceleration is read as 0.5 % of g."""
PAPER_CHANGE_PERCENT = {"position": -75.0, "speed": -80.0, "heading": -79.0, "accel": -46.0, "yaw_rate": -57.0}
ROWS = {"position": (0, 1), "speed": (2,), "heading": (3,), "accel": (4,), "yaw_rate": (5,)}
UNITS = {"position": "m", "speed": "m/s", "heading": "deg", "accel": "% of g", "yaw_rate": "deg/s"}
SCALE = {
    "position": 1.0,
    "speed": 1.0,
    "heading": 180.0 / np.pi,
    "accel": 100.0 / GRAVITY_MPS2,
    "yaw_rate": 180.0 / np.pi,
}

Scenario = Literal["straight", "curve"]
Method = Literal["smoothed", "causal", "song2016"]


@dataclass(frozen=True)
class Table1Row:
    """One row: means over the seeds, with the half width of the 95 % interval of the mean.

    Attributes:
        quantity, unit: What and in which unit.
        measured, estimated: One-sigma error (root mean square over the drive; position per axis).
        change_percent: 100 (estimated / measured - 1).
        change_half_width: Of the 95 % interval of the mean change over seeds.
        paper_change_percent: The paper's value.
    """

    quantity: str
    unit: str
    measured: float
    estimated: float
    change_percent: float
    change_half_width: float
    paper_change_percent: float


def truth(scenario: Scenario) -> FloatArray:
    """Return the true states each 0.05 s, shape (n, 6): x, y, v, heading, a, yaw rate."""
    fine = 0.001
    if scenario == "straight":
        time = np.arange(0.0, 30.0, fine)
        accel = 2.0 * (_pulse(time, 3.0, 7.0, 1.0) + 0.875 * _pulse(time, 14.0, 18.0, 1.0))
        yaw_rate = np.zeros_like(time)
        speed = _integral(accel, fine)
    else:
        time = np.arange(0.0, 45.0, fine)
        accel = np.zeros_like(time)
        speed = np.full_like(time, 10.0)
        yaw_rate = 10.0 / 40.0 * _pulse(time, 15.0, 30.0, 1.0)
    heading = _integral(yaw_rate, fine)
    x, y = _integral(speed * np.cos(heading), fine), _integral(speed * np.sin(heading), fine)
    return np.stack([x, y, speed, heading, accel, yaw_rate], axis=1)[:: round(STEP_S / fine)]


def _pulse(time: FloatArray, begin: float, end: float, ramp: float) -> FloatArray:
    """1 between begin and end, with half-cosine ramps of `ramp` seconds centred on both."""

    def edge(at: float) -> FloatArray:
        return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.clip((time - at) / ramp + 0.5, 0.0, 1.0)))

    return edge(begin) - edge(end)


def _integral(rate: FloatArray, step: float) -> FloatArray:
    return np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1])) * step))


def measure(true: FloatArray, seed: int) -> FloatArray:
    """Add the paper's white noise, shape (n, 6)."""
    return true + np.array(SIGMA) * np.random.default_rng(seed).standard_normal(true.shape)


def estimate(z: FloatArray, method: Method) -> FloatArray:
    """Estimate the states from the measurement matrix z (n, 6); returns (n, 6).

    "song2016" is the paper's causal filter; the others are the default estimator with and without smoother. It gets the
    sensors' noise as the paper's R does, and no latency is searched, because the vector has one stamp.
    """
    if method == "song2016":
        return filter_vectors(z, SIGMA)[0]
    stamp_ns = np.arange(len(z), dtype=np.int64) * round(STEP_S * 1e9)
    variance = np.square(SIGMA)
    columns = (
        (Kind.POSITION, [0, 1]), (Kind.SPEED, [2]), (Kind.HEADING, [3]), (Kind.ACCEL, [4]), (Kind.YAW_RATE, [5]),
    )  # fmt: skip
    measurements = [
        Measurements(kind.name.lower(), kind, stamp_ns, z[:, c], np.tile(variance[c], (len(z), 1)))
        for kind, c in columns
    ]
    config = EstimatorConfig(latency="none", causal=method == "causal")
    return estimate_track(measurements, config, stamp_ns).state[:, :6]


def table1(
    seeds: Iterable[int] = range(20),
    scenario: Scenario = "straight",
    method: Method = "smoothed",
    estimator: Callable[[FloatArray], FloatArray] | None = None,
) -> list[Table1Row]:
    """Return song2016's table 1 for one scenario and one method.

    Args:
        seeds: One drive's noise each.
        scenario: "straight" (the paper's table) or "curve".
        method: See `estimate`.
        estimator: Another function of z (n, 6) -> (n, 6) instead of `method`.
    """
    true = truth(scenario)
    before: dict[str, list[float]] = {name: [] for name in ROWS}
    after: dict[str, list[float]] = {name: [] for name in ROWS}
    for seed in seeds:
        z = measure(true, seed)
        x = estimator(z) if estimator is not None else estimate(z, method)
        for name, columns in ROWS.items():
            before[name].append(_sigma(name, z[:, columns] - true[:, columns]))
            after[name].append(_sigma(name, x[:, columns] - true[:, columns]))
    rows = []
    for name in ROWS:
        change = 100.0 * (np.array(after[name]) / np.array(before[name]) - 1.0)
        half = 1.96 * float(change.std(ddof=1)) / np.sqrt(len(change)) if len(change) > 1 else float("nan")
        rows.append(
            Table1Row(
                name, UNITS[name], float(np.mean(before[name])), float(np.mean(after[name])), float(change.mean()),
                float(half), PAPER_CHANGE_PERCENT[name],
            )
        )  # fmt: skip
    return rows


def _sigma(name: str, error: FloatArray) -> float:
    if name == "heading":
        error = wrap_angle(error)
    return SCALE[name] * float(np.sqrt((error**2).mean()))
