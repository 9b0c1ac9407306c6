"""Dense traffic with poor derivatives, made up: what the development logs do not vary. For `prediction_bounds`.

Lanes of cars behind each other (intelligent driver model: Treiber, Hennecke, Helbing 2000) behind a leader that slows
down and stops now and then; cars keep their lane with a weave and change it once in a while. Each is seen for 8 to
45 s. Its states are

- `sent`: the truth with first-order Gauss-Markov errors of every quantity, or
- `fitted`: second-order polynomials through the last 1.2 s of noisy positions, as a filter without other sensors
  would: the errors of speed and acceleration, of heading and yaw rate then belong together,

and their covariance says less of acceleration and yaw rate than is true, by the factor of the variant. The truth is
judged nowhere: outcomes are the vehicle's own later positions, as on logs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cwcli.channels.vehicle_state import VehicleStates
from cwcli.signals.columns import FloatArray, Strings
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import ACCEL, HEADING, N_STATES, SPEED, YAW_RATE, X, Y

STEP_S = 0.1
DURATION_S = 90.0
SEEN_S = (8.0, 45.0)
LANES, CARS, LANE_M = 3, 12, 3.5
FIT_POINTS = 13


@dataclass(frozen=True)
class Variant:
    """One kind of traffic and of sensing.

    Attributes:
        name: In tables.
        speed_mps: Wanted by the drivers.
        stop_every_s: Mean time between the leader's slow-downs.
        curvature_1pm: Of the road.
        is_fitted: States from positions alone.
        accel_sigma_mps2, yaw_rate_sigma_radps: True errors of sent states.
        too_sure: True sigma over the stated one.
    """

    name: str
    speed_mps: float
    stop_every_s: float
    curvature_1pm: float = 0.0
    is_fitted: bool = False
    accel_sigma_mps2: float = 2.0
    yaw_rate_sigma_radps: float = 0.116
    too_sure: float = 2.35


VARIANTS = (
    Variant("jam sent", 8.0, 12.0),
    Variant("jam fitted", 8.0, 12.0, is_fitted=True),
    Variant("jam good", 8.0, 12.0, accel_sigma_mps2=0.2, yaw_rate_sigma_radps=0.01, too_sure=1.0),
    Variant("dense sent", 14.0, 25.0),
    Variant("dense sent x4", 14.0, 25.0, too_sure=4.0),
    Variant("dense fitted", 14.0, 25.0, is_fitted=True),
    Variant("dense fitted x4", 14.0, 25.0, is_fitted=True, too_sure=4.0),
    Variant("dense bend", 14.0, 25.0, curvature_1pm=1.0 / 150.0, accel_sigma_mps2=0.5, yaw_rate_sigma_radps=0.03),
    Variant("free sent", 30.0, 60.0, accel_sigma_mps2=0.7, yaw_rate_sigma_radps=0.03),
    Variant("free fitted", 30.0, 60.0, is_fitted=True),
)


def dense_states(variant: Variant, seed: int) -> VehicleStates:
    """The states of all cars of a variant, known at their stamps, in the order of time."""
    rng = np.random.default_rng([seed, VARIANTS.index(variant) if variant in VARIANTS else len(VARIANTS)])
    tables = []
    for car, truth in enumerate(_drives(variant, rng)):
        seen_s = rng.uniform(*SEEN_S)
        first = int(rng.uniform(0.0, DURATION_S - seen_s) / STEP_S)
        rows = slice(first, first + int(seen_s / STEP_S))
        state, sigma = _sensed(variant, truth[rows], rng)
        stamp_ns = np.rint(np.arange(rows.start, rows.stop)[-len(state) :] * STEP_S * NS_PER_S).astype(np.int64)
        tables.append((np.full(len(state), car), stamp_ns, state, np.tile(sigma, (len(state), 1))))
    code, stamp_ns, state, sigma = (np.concatenate(parts) for parts in zip(*tables, strict=True))
    order = np.argsort(stamp_ns, kind="stable")
    n = len(order)
    covariance = np.zeros((n, N_STATES, N_STATES))
    covariance[:, np.arange(N_STATES), np.arange(N_STATES)] = sigma[order] ** 2
    ids = Strings(code[order].astype(np.int32), tuple(f"car-{i}" for i in range(len(tables))))
    unknown = np.full(n, np.nan)
    stamps = stamp_ns[order]
    return VehicleStates(ids, stamps, stamps, state[order], covariance, unknown, unknown, np.zeros(n, np.uint8))


def _drives(variant: Variant, rng: np.random.Generator) -> Iterator[FloatArray]:
    """True states of each car over the whole time, (n, 8)."""
    n = int(DURATION_S / STEP_S)
    for _ in range(LANES):
        speed = np.full(CARS, variant.speed_mps * 0.8)
        place = -np.arange(CARS) * (2.0 * variant.speed_mps + 7.0)
        wanted = variant.speed_mps * rng.uniform(0.85, 1.15, CARS)
        history = np.empty((n, CARS, 3))
        slow_until, slow_mps, brake_mps2 = -1.0, 0.0, 0.0
        for i in range(n):
            t = i * STEP_S
            if t > slow_until and rng.uniform() < STEP_S / variant.stop_every_s:
                slow_until = t + rng.uniform(3.0, 10.0)
                slow_mps, brake_mps2 = rng.uniform(0.0, 0.7) * variant.speed_mps, rng.uniform(0.8, 4.0)
            accel = _following(place, speed, wanted)
            if t <= slow_until:
                accel[0] = np.clip((slow_mps - speed[0]) / 1.0, -brake_mps2, 0.5)
            accel = np.maximum(accel, -speed / STEP_S)
            history[i] = np.stack([place, speed, accel], axis=1)
            place = place + speed * STEP_S + accel * STEP_S**2 / 2.0
            speed = np.maximum(speed + accel * STEP_S, 0.0)
        for car in range(CARS):
            yield _on_road(history[:, car], variant.curvature_1pm, rng)


def _following(place_m: FloatArray, speed_mps: FloatArray, wanted_mps: FloatArray) -> FloatArray:
    """The intelligent driver model's acceleration of each car behind the one before it, (cars,)."""
    gap = np.concatenate([[1e6], place_m[:-1] - place_m[1:] - 5.0])
    closing = speed_mps - np.concatenate([speed_mps[:1], speed_mps[:-1]])
    asked = 2.0 + speed_mps * 1.2 + speed_mps * closing / (2.0 * np.sqrt(1.4 * 2.0))
    accel = 1.4 * (1.0 - (speed_mps / wanted_mps) ** 4 - (np.maximum(asked, 0.0) / np.maximum(gap, 0.5)) ** 2)
    return np.asarray(np.clip(accel, -7.0, 1.4))


def _on_road(along: FloatArray, curvature_1pm: float, rng: np.random.Generator) -> FloatArray:
    """States (n, 8) of a car with place, speed and acceleration (n, 3) on a road of one curvature."""
    place, speed, accel = along.T
    n = len(along)
    offset = _gauss_markov(n, 0.15, 4.0, rng)
    offset = np.convolve(offset, np.hanning(21) / np.hanning(21).sum(), mode="same")
    for start in np.flatnonzero(rng.uniform(size=n) < STEP_S / 40.0):
        rows = np.arange(start, min(start + 50, n))
        if speed[rows].min() > 3.0:
            phase = (rows - start) / 50.0
            move = rng.choice([-1.0, 1.0]) * LANE_M
            offset[rows] += move * (1.0 - np.cos(np.pi * phase)) / 2.0
            offset[rows[-1] + 1 :] += move
    turn = place * curvature_1pm
    if curvature_1pm:
        radius = 1.0 / curvature_1pm - offset
        xy = np.stack([radius * np.sin(turn), 1.0 / curvature_1pm - radius * np.cos(turn)], axis=1)
    else:
        xy = np.stack([place, offset], axis=1)
    state = np.zeros((n, N_STATES))
    state[:, [X, Y]] = xy
    sideways = np.gradient(offset, STEP_S)
    state[:, HEADING] = turn + np.arctan2(sideways, np.maximum(speed, 2.0))
    state[:, SPEED], state[:, ACCEL] = speed, accel
    state[:, YAW_RATE] = np.gradient(state[:, HEADING], STEP_S)
    return state


def _gauss_markov(n: int, sigma: float, time_s: float, rng: np.random.Generator) -> FloatArray:
    decay = np.exp(-STEP_S / time_s)
    drive = rng.normal(scale=sigma * np.sqrt(1.0 - decay**2), size=n)
    out = np.empty(n)
    out[0] = rng.normal(scale=sigma)
    for i in range(1, n):
        out[i] = decay * out[i - 1] + drive[i]
    return out


def _sensed(variant: Variant, truth: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """States (m, 8), which begin once there is enough to see, and the sigmas that they state (8,)."""
    n = len(truth)
    sigma = np.array([0.3, 0.3, 0.4, 0.02, variant.accel_sigma_mps2, variant.yaw_rate_sigma_radps, 1.0, 0.5])
    said = sigma.copy()
    if not variant.is_fitted:
        state = truth.copy()
        for column, time_s in ((X, 2.0), (Y, 2.0), (SPEED, 1.0), (HEADING, 1.0), (ACCEL, 0.4), (YAW_RATE, 0.4)):
            state[:, column] += _gauss_markov(n, sigma[column], time_s, rng)
    else:
        state, said = _fitted(truth, rng)
    said[[ACCEL, YAW_RATE]] /= variant.too_sure
    return state, said


def _fitted(truth: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """States from polynomials through noisy positions, and their true sigmas."""
    noise = np.stack([_gauss_markov(len(truth), 0.2, 3.0, rng) + rng.normal(scale=0.1, size=len(truth)) for _ in "xy"])
    seen = np.lib.stride_tricks.sliding_window_view(truth[:, [X, Y]] + noise.T, FIT_POINTS, axis=0)
    time_s = (np.arange(FIT_POINTS) - FIT_POINTS + 1) * STEP_S
    weights = np.linalg.pinv(np.vander(time_s, 3, increasing=True))
    place, velocity, half_accel = np.moveaxis(np.einsum("cf,ndf->ndc", weights, seen), -1, 0)
    true = truth[FIT_POINTS - 1 :]
    state = np.zeros((len(place), N_STATES))
    state[:, [X, Y]] = place
    speed = np.hypot(*velocity.T)
    clear = np.maximum(speed, 2.0)  # a standing car keeps its heading
    aim = np.stack([np.cos(true[:, HEADING]), np.sin(true[:, HEADING])], axis=1)
    ahead, left = (velocity * aim).sum(axis=1), aim[:, 0] * velocity[:, 1] - aim[:, 1] * velocity[:, 0]
    state[:, SPEED] = ahead
    state[:, HEADING] = true[:, HEADING] + np.arctan2(left, clear)
    cosine, sine = np.cos(state[:, HEADING]), np.sin(state[:, HEADING])
    state[:, ACCEL] = 2.0 * (half_accel[:, 0] * cosine + half_accel[:, 1] * sine)
    state[:, YAW_RATE] = 2.0 * (half_accel[:, 1] * cosine - half_accel[:, 0] * sine) / clear
    error = np.sqrt(np.mean((state - true) ** 2, axis=0))
    return state, np.maximum(error, 0.01)
