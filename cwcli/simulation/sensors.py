"""The host's sensors: the values that each one reports of the truth, and when.

Each message stamped t reports the truth at t - latency_s (a lag that the stamp doesn't show) with noise and bias, and
is logged at t + delay_s + jitter. Noise is white and Gaussian, but for the slow error of a GNSS.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.units import STANDARD_GRAVITY_MPS2
from cwcli.simulation.attitude import LEVEL_ATTITUDE, Attitude
from cwcli.simulation.streams import RunSpan, draw_message_schedule, random_stream
from cwcli.simulation.truth import Motion


@dataclass(frozen=True)
class SensorData:
    """The messages of one sensor, in the order of their log times.

    Attributes:
        sensor: Name of the sensor: gnss, gnss_heading, speed or imu.
        stamp_ns: Shape (n,): the time that the sensor states, ns since 1970.
        log_time_ns: Shape (n,).
        values: Shape (n, k), see the sensor's function.
        sigma: Shape (k,): standard deviation of each value's noise.
        n_lost: Number of messages that were lost.
    """

    sensor: str
    stamp_ns: Int64Array
    log_time_ns: Int64Array
    values: FloatArray
    sigma: FloatArray
    n_lost: int


SLOW_ERROR_TIME_CONSTANT_S = 20.0
"""Time constant of a slow error of which only the sigma is given, s: that of multipath on a drive. Chosen by hand; not
fitted."""

SensorModel = Callable[[FloatArray, FloatArray, Mapping[str, Any]], tuple[FloatArray, FloatArray]]
"""A function of true states (n, 8), tilt (n, 3), and settings that returns noise-free values (n, k)
and the sigma of their noise (k,)."""


def gnss_position_and_sigma_m(
    state: FloatArray, _: FloatArray, settings: Mapping[str, Any]
) -> tuple[FloatArray, FloatArray]:
    """Position of the antenna: east, north, up (n, 3) in the map frame, m, and its sigma (3,)."""
    bias = np.array([settings["bias_east_m"], settings["bias_north_m"], 0.0])
    ahead, left = settings["ahead_m"] or 0.0, settings["left_m"] or 0.0
    c, s = np.cos(state[:, 3]), np.sin(state[:, 3])
    x, y = state[:, 0] + ahead * c - left * s, state[:, 1] + ahead * s + left * c
    position = np.column_stack([x, y, np.zeros(len(state))])
    return position + bias, np.full(3, settings["sigma_m"])


def gnss_heading_and_sigma_rad(
    state: FloatArray, _: FloatArray, settings: Mapping[str, Any]
) -> tuple[FloatArray, FloatArray]:
    """Heading (n, 1), rad, counter-clockwise from east, not wrapped, and its sigma (1,)."""
    return state[:, 3:4] + np.radians(settings["bias_deg"]), np.radians([settings["sigma_deg"]])


def wheel_speed_and_sigma_mps(
    state: FloatArray, tilt: FloatArray, settings: Mapping[str, Any]
) -> tuple[FloatArray, FloatArray]:
    """Wheel speed along the heading (n, 1), m/s, and its sigma (1,).

    Wheels that a lever arm l below the host's point turn with are slower than it by l times the pitch rate.
    """
    value = state[:, 2:3]
    if settings["lever_arm_m"] is not None:
        value = value - settings["lever_arm_m"] * tilt[:, 2:3]
    if settings["scale"] is not None:
        value = value * settings["scale"]
    return value + settings["bias_mps"], np.array([settings["sigma_mps"]])


def imu_values_and_sigma(
    state: FloatArray, tilt: FloatArray, settings: Mapping[str, Any]
) -> tuple[FloatArray, FloatArray]:
    """Specific force (forward, left, up, m/s^2; g on up at rest) and angular rate (rad/s), (n, 6), and sigma (6,).

    A mount that is pitched nose down by p about the left axis reads f cos p - u sin p forward and f sin p + u cos p up,
    where f and u are the level forces, and the yaw rate on its forward and up axes alike. The car's own pitch adds to
    the mount's, and its roll shows on the left axis. At (a, b) ahead and to the left of the host's point the turning
    adds -w^2 a - w' b forward and w' a - w^2 b to the left, with the yaw rate w.
    """
    ahead, side = settings["ahead_m"] or 0.0, settings["left_m"] or 0.0
    mount = np.radians(settings["mount_pitch_deg"])
    pitch = mount + tilt[:, 0]
    forward, yaw_rate = state[:, 4], state[:, 5]
    left = state[:, 2] * yaw_rate + STANDARD_GRAVITY_MPS2 * tilt[:, 1]
    forward = forward - yaw_rate**2 * ahead - state[:, 7] * side
    left = left + state[:, 7] * ahead - yaw_rate**2 * side
    values = np.column_stack(
        [
            forward * np.cos(pitch) - STANDARD_GRAVITY_MPS2 * np.sin(pitch) + settings["accel_bias_mps2"],
            left,
            forward * np.sin(pitch) + STANDARD_GRAVITY_MPS2 * np.cos(pitch),
            -yaw_rate * np.sin(mount),
            tilt[:, 2] + np.radians(settings["pitch_rate_bias_dps"] or 0.0),
            yaw_rate * np.cos(mount) + np.radians(settings["yaw_rate_bias_dps"]),
        ]
    )
    sigma_gyro = float(np.radians(settings["yaw_rate_sigma_dps"]))
    return values, np.array([settings["accel_sigma_mps2"]] * 3 + [sigma_gyro] * 3)


def draw_gauss_markov_pairs(time_s: FloatArray, decay_s: float, rng: np.random.Generator) -> FloatArray:
    """Draw two Gauss-Markov processes of unit sigma at times (n,), shape (n, 2); autocorrelation exp(-t / decay_s)."""
    keep = np.exp(-np.diff(time_s) / decay_s)
    drawn = rng.standard_normal((len(time_s), 2))
    drawn[1:] *= np.sqrt(1.0 - keep**2)[:, None]
    for k in range(1, len(drawn)):
        drawn[k] += keep[k - 1] * drawn[k - 1]
    return drawn


SENSOR_MODELS: Mapping[str, SensorModel] = {
    "gnss": gnss_position_and_sigma_m,
    "gnss_heading": gnss_heading_and_sigma_rad,
    "speed": wheel_speed_and_sigma_mps,
    "imu": imu_values_and_sigma,
}
"""The sensor models by the sensor's name in a scenario."""


def simulate_sensor_messages(
    sensor: str,
    motion: Motion,
    settings: Mapping[str, Any],
    run: RunSpan,
    *,
    vehicle: str,
    attitude: Attitude = LEVEL_ATTITUDE,
) -> SensorData:
    """Simulate the messages of one sensor over the drive.

    Args:
        settings: As checked by `spec.SENSOR_KEYS`.
        vehicle: Name of the vehicle, which selects the random streams with the seed.
    """
    seed, start_ns = run.seed, run.start_ns
    plan = draw_message_schedule(settings, end_s=run.end_s, seed=seed, names=(vehicle, sensor))
    true_s = plan.time_s - settings["latency_s"]
    state = motion.states_at(true_s)
    exact, sigma = SENSOR_MODELS[sensor](state, attitude.pitch_roll_and_pitch_rate_at(true_s, state), settings)
    values = exact + sigma * random_stream(seed, vehicle, sensor, "noise").standard_normal(exact.shape)
    if settings.get("slow_sigma_m"):
        rng = random_stream(seed, vehicle, sensor, "slow")
        values[:, :2] += settings["slow_sigma_m"] * draw_gauss_markov_pairs(
            plan.time_s, settings["slow_time_s"] or SLOW_ERROR_TIME_CONSTANT_S, rng
        )
    order = np.argsort(plan.arrival_ns, kind="stable")
    order = order[plan.is_heard[order]]
    return SensorData(
        sensor=sensor,
        stamp_ns=start_ns + plan.stamp_ns[order],
        log_time_ns=start_ns + plan.arrival_ns[order],
        values=values[order],
        sigma=sigma,
        n_lost=int(np.count_nonzero(~plan.is_heard)),
    )
