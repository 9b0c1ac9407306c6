"""The simulated sensors of a car in a lane: boundaries on the ground, preview point, speed and yaw rate."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.dynamics.samples import DEFAULT_PREVIEW_POINT_DISTANCE_M, LaneSamples, ScalarSamples
from cwcli.dynamics.vehicle import Vehicle
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.simulation.lane_drive import INTEGRATION_STEP_S, LaneDriveTruth, Road
from cwcli.simulation.streams import random_stream, seconds_to_ns

BOUNDARY_SAMPLE_DISTANCES_M = np.geomspace(6.0, 50.0, 16)
"""Distances ahead at which the camera sees the boundaries, shape (16,), m. Chosen by hand; not fitted."""
PAPER_CAMERA_FOCAL_LENGTH_PX = 667.0
"""Focal length that turns an error in pixels into one on the road, px: that of the paper's camera."""
N_NEWTON_STEPS_TO_FIND_STATION = 4
"""Number of Newton steps that find the station at a distance ahead. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class LaneSensorNoise:
    """The errors and rates of the simulated sensors.

    Attributes:
        pixel_px: Error of each seen point of a boundary, at the paper's focal length of 667 pixels.
        frame_s: Mean time between frames.
        jitter_s: Each frame comes up to this much later.
        blind_s: (from, to) intervals without boundaries.
        speed_hz, speed_sigma_mps: Rate and noise of the speed sensor.
        yaw_rate_hz, yaw_rate_sigma_radps, yaw_rate_bias_radps: Rate, noise and bias of the gyroscope.
    """

    pixel_px: float = 1.0
    frame_s: float = 0.1
    jitter_s: float = 0.0
    blind_s: tuple[tuple[float, float], ...] = ()
    speed_hz: float = 50.0
    speed_sigma_mps: float = 0.05
    yaw_rate_hz: float = 50.0
    yaw_rate_sigma_radps: float = float(np.radians(0.1))
    yaw_rate_bias_radps: float = 0.0


@dataclass(frozen=True)
class SensedDrive:
    """The measurements of one run.

    Attributes:
        index: Shape (n,): the truth's row of each frame.
        left_body, right_body: Shape (n, 3): y0 (m), slope, curvature (1/m) before the camera; left positive, NaN
            where not found.
        lanes: At the preview point, with sigmas.
        speed, yaw_rate: Measurements on times of their own.
    """

    index: npt.NDArray[np.intp]
    left_body: FloatArray
    right_body: FloatArray
    lanes: LaneSamples
    speed: ScalarSamples
    yaw_rate: ScalarSamples

    @property
    def stamp_ns(self) -> Int64Array:
        """The stamps of the frames, shape (n,), ns."""
        return self.lanes.stamp_ns


def simulate_lane_sensors_of_run(
    truth_of_runs: LaneDriveTruth,
    run_index: int,
    road: Road,
    vehicle: Vehicle,
    *,
    noise: LaneSensorNoise | None = None,
    seed: int = 0,
) -> SensedDrive:
    """Simulate the sensors over one run of a drive, which is a column of the truth."""
    noise = noise or LaneSensorNoise()
    names = ("lane", str(run_index))
    index = _truth_rows_of_frames(truth_of_runs, noise, random_stream(seed, *names, "jitter"))
    left, right = (
        _sample_line_from_camera(
            truth_of_runs,
            run_index,
            index,
            road,
            vehicle,
            sign * 0.5 * road.lane_width_m,
            DEFAULT_PREVIEW_POINT_DISTANCE_M,
        )[0]
        for sign in (1.0, -1.0)
    )
    fit = _boundary_fit_matrix()
    error = noise.pixel_px * BOUNDARY_SAMPLE_DISTANCES_M / PAPER_CAMERA_FOCAL_LENGTH_PX
    draws = random_stream(seed, *names, "pixels").standard_normal((2, len(index), len(BOUNDARY_SAMPLE_DISTANCES_M)))
    bodies = [(seen + draw * error) @ fit.T for seen, draw in zip((left, right), draws, strict=True)]
    time_s = truth_of_runs.time_s[index]
    for start, end in noise.blind_s:
        for body in bodies:
            body[(time_s >= start) & (time_s < end)] = np.nan
    covariance = (fit * error**2) @ fit.T
    stamp_ns = seconds_to_ns(time_s)
    return SensedDrive(
        index=index,
        left_body=bodies[0],
        right_body=bodies[1],
        lanes=lane_samples_from_boundaries(
            stamp_ns, bodies[0], bodies[1], covariance, DEFAULT_PREVIEW_POINT_DISTANCE_M
        ),
        speed=_sample_with_noise(
            truth_of_runs,
            truth_of_runs.speed_mps[:, run_index],
            noise.speed_hz,
            noise.speed_sigma_mps,
            0.0,
            seed,
            (*names, "v"),
        ),
        yaw_rate=_sample_with_noise(
            truth_of_runs,
            truth_of_runs.yaw_rate_radps[:, run_index],
            noise.yaw_rate_hz,
            noise.yaw_rate_sigma_radps,
            noise.yaw_rate_bias_radps,
            seed,
            (*names, "gyro"),
        ),
    )


def lane_samples_from_boundaries(
    stamp_ns: Int64Array, left_body: FloatArray, right_body: FloatArray, covariance: FloatArray, preview_m: float
) -> LaneSamples:
    """y_L, e_L, K_L at the preview point from both boundaries, as `cwcli.vision.ground` defines them.

    Args:
        covariance: Shape (3, 3): covariance of each boundary's fit.
        preview_m: Distance of the preview point ahead of the camera.
    """
    y0, slope0, curve = (0.5 * (left_body + right_body)).T
    slope = slope0 + curve * preview_m
    at = np.array([[1.0, preview_m, 0.5 * preview_m**2], [0.0, 1.0, preview_m], [0.0, 0.0, 1.0]])
    sigma = np.sqrt(np.diag(at @ (0.5 * covariance) @ at.T))
    n = len(stamp_ns)
    return LaneSamples(
        stamp_ns=stamp_ns,
        lateral_deviation_m=-(y0 + (slope0 + 0.5 * curve * preview_m) * preview_m),
        heading_deviation_rad=-np.arctan(slope),
        curvature_1pm=-curve / (1.0 + slope**2) ** 1.5,
        lateral_sigma_m=np.full(n, sigma[0]),
        heading_sigma_rad=np.full(n, sigma[1]),
        curvature_sigma_1pm=np.full(n, sigma[2]),
    )


def _truth_rows_of_frames(
    truth: LaneDriveTruth, noise: LaneSensorNoise, random: np.random.Generator
) -> npt.NDArray[np.intp]:
    """Rows of the truth at which frames are taken, shape (n,), with their jitter."""
    step = round(noise.frame_s / INTEGRATION_STEP_S)
    index = np.arange(0, len(truth.time_s), step)
    late = random.integers(0, round(noise.jitter_s / INTEGRATION_STEP_S) + 1, len(index))
    return np.asarray(np.minimum(index + late, len(truth.time_s) - 1), dtype=np.intp)


def _sample_line_from_camera(
    truth: LaneDriveTruth,
    run: int,
    index: npt.NDArray[np.intp],
    road: Road,
    vehicle: Vehicle,
    offset_m: float,
    preview_m: float,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Sample the line at an offset (m, left positive) from the lane's centre, as the camera sees it in the frames.

    Returns:
        Lateral place at the sample distances, (n, 16); lateral place, direction and station at the preview point, (n,).
    """
    station = truth.station_m[index, run][:, None]
    table, xs, ys, directions = road.centre_line_table(float(station.max()) + 200.0)
    yaw = truth.yaw_rad[index, run][:, None]
    cos, sin = np.cos(yaw), np.sin(yaw)
    x0 = truth.x_m[index, run][:, None] + vehicle.camera_forward_m * cos
    y0 = truth.y_m[index, run][:, None] + vehicle.camera_forward_m * sin
    distances_m = np.concatenate([BOUNDARY_SAMPLE_DISTANCES_M, [preview_m]])
    s = station + distances_m
    for _ in range(N_NEWTON_STEPS_TO_FIND_STATION):
        direction = np.interp(s, table, directions)
        dx = np.interp(s, table, xs) - offset_m * np.sin(direction) - x0
        dy = np.interp(s, table, ys) + offset_m * np.cos(direction) - y0
        forward, left = dx * cos + dy * sin, -dx * sin + dy * cos
        s = s + (distances_m - forward) / np.maximum(np.cos(direction - yaw), 0.1)
    direction_rad = np.interp(s, table, directions) - yaw
    return left[:, :-1], left[:, -1], direction_rad[:, -1], s[:, -1]


def _boundary_fit_matrix() -> FloatArray:
    """The matrix (3, 16) that fits y0, slope and curvature to a boundary, weighted by the inverse error of a pixel."""
    design = np.column_stack(
        [np.ones_like(BOUNDARY_SAMPLE_DISTANCES_M), BOUNDARY_SAMPLE_DISTANCES_M, 0.5 * BOUNDARY_SAMPLE_DISTANCES_M**2]
    )
    weight = 1.0 / BOUNDARY_SAMPLE_DISTANCES_M
    return np.asarray(np.linalg.pinv(design * weight[:, None]) * weight)


def _sample_with_noise(
    truth: LaneDriveTruth,
    true_values: FloatArray,
    rate_hz: float,
    sigma: float,
    bias: float,
    seed: int,
    stream_names: tuple[str, ...],
) -> ScalarSamples:
    """Sample a true value (k,) at a rate, with bias and noise."""
    index = np.arange(0, len(truth.time_s), max(1, round(1.0 / (rate_hz * INTEGRATION_STEP_S))))
    noisy = true_values[index] + bias + sigma * random_stream(seed, *stream_names).standard_normal(len(index))
    return ScalarSamples(seconds_to_ns(truth.time_s[index]), noisy, sigma)
