"""A car that a driver keeps in a lane, or lets drift out of it, as plain arrays.

The car is the single-track model; its place in the lane is exact geometry (not the linear eq. 20). Many runs on one
road are computed at once. Its sensors are those of `lane_camera`.
"""

from __future__ import annotations

from dataclasses import field

import numpy as np

from cwcli.dynamics.single_track import (
    MIN_MODEL_SPEED_MPS,
    lateral_accel_mps2_and_yaw_accel_radps2,
    understeer_gradient_rad_per_mps2,
)
from cwcli.dynamics.vehicle import Vehicle
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.simulation.drivers import TargetLineDriver
from cwcli.simulation.streams import random_stream

INTEGRATION_STEP_S = 0.01
"""Time step of the integration and of the truth, s. Chosen by hand; not fitted."""
CENTRE_LINE_STEP_M = 0.5
"""Distance of the points of the tabulated centre line, m. Chosen by hand; not fitted."""
CENTRE_LINE_LENGTH_BEFORE_START_M = 50.0
"""Length of the tabulated centre line before the start, m. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class Road:
    """A lane of constant width; the curvature is linear between stations.

    Attributes:
        station_m, curvature_1pm: Shape (k,): left bend positive; constant beyond both ends.
        lane_width_m: Distance of the boundaries.
    """

    station_m: FloatArray = field(default_factory=lambda: np.array([0.0]))
    curvature_1pm: FloatArray = field(default_factory=lambda: np.array([0.0]))
    lane_width_m: float = 3.6

    def curvature_at_1pm(self, station_m: FloatArray) -> FloatArray:
        """Curvature of the lane's centre line at the given stations, 1/m, left positive."""
        return np.interp(station_m, self.station_m, self.curvature_1pm)

    def centre_line_table(self, length_m: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Station, x, y (m) and direction (rad) of the centre line, (k,) each; station 0 is the origin, eastward."""
        station = np.arange(-CENTRE_LINE_LENGTH_BEFORE_START_M, length_m + CENTRE_LINE_STEP_M, CENTRE_LINE_STEP_M)
        middle = self.curvature_at_1pm(0.5 * (station[1:] + station[:-1]))
        direction = np.concatenate([[0.0], np.cumsum(middle * CENTRE_LINE_STEP_M)])
        direction -= np.interp(0.0, station, direction)
        half = 0.5 * (direction[1:] + direction[:-1])
        x = np.concatenate([[0.0], np.cumsum(np.cos(half) * CENTRE_LINE_STEP_M)])
        y = np.concatenate([[0.0], np.cumsum(np.sin(half) * CENTRE_LINE_STEP_M)])
        return station, x - np.interp(0.0, station, x), y - np.interp(0.0, station, y), direction


@dataclass(frozen=True)
class LaneRuns:
    """m drives on one road.

    Attributes:
        speed_mps: Shape (m,): speed at the start.
        drift_mps: Shape (m,): lateral speed of the target line, left positive; reached within 1 s.
        drift_start_s: Shape (m,): time at which the target line starts to drift.
        accel_mps2: Acceleration of all runs.
        duration_s: Duration of all runs.
    """

    speed_mps: FloatArray
    drift_mps: FloatArray
    drift_start_s: FloatArray
    accel_mps2: float = 0.0
    duration_s: float = 20.0


@dataclass(frozen=True)
class LaneDriveTruth:
    """The true motion of m runs at every step (10 ms), shapes (k,) and (k, m).

    Attributes:
        time_s: Shape (k,).
        lateral_speed_mps, yaw_rate_radps, steer_rad: Body frame, left positive.
        speed_mps: Forward.
        station_m, offset_m, heading_rad: In the lane, of the centre of gravity; offset left positive.
        x_m, y_m, yaw_rad: Map frame.
        left_gap_m, right_gap_m: From the outside of the nearer front tyre to the boundary; negative beyond it.
        approach_mps: Speed of the front axle across the lane, left positive; in a bend the lane turns under it, too.
    """

    time_s: FloatArray
    lateral_speed_mps: FloatArray
    yaw_rate_radps: FloatArray
    steer_rad: FloatArray
    speed_mps: FloatArray
    station_m: FloatArray
    offset_m: FloatArray
    heading_rad: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    yaw_rad: FloatArray
    left_gap_m: FloatArray
    right_gap_m: FloatArray
    approach_mps: FloatArray


def simulate_lane_runs(
    road: Road, vehicle: Vehicle, runs: LaneRuns, *, driver: TargetLineDriver | None = None, seed: int = 0
) -> LaneDriveTruth:
    """Simulate all runs by Runge-Kutta steps of 10 ms; the driver's unrest is held over each."""
    driver = driver or TargetLineDriver()
    m = len(runs.speed_mps)
    n = round(runs.duration_s / INTEGRATION_STEP_S) + 1
    time_s = np.arange(n, dtype=np.float64) * INTEGRATION_STEP_S
    unrest = _draw_driver_unrest_mps2(driver, n, m, seed)
    states = np.zeros((n, 6, m))  # v_y, gamma, delta, station, offset, heading in the lane
    states[0] = _steady_start_states(road, vehicle, runs)
    for i in range(n - 1):
        t, x, a = float(time_s[i]), states[i], unrest[i]

        def state_derivative(dt: float, moved: FloatArray, t: float = t, a: FloatArray = a) -> FloatArray:
            return _state_derivative(t + dt, moved, a, road, vehicle, runs, driver)

        k1 = state_derivative(0.0, x)
        k2 = state_derivative(INTEGRATION_STEP_S / 2, x + INTEGRATION_STEP_S / 2 * k1)
        k3 = state_derivative(INTEGRATION_STEP_S / 2, x + INTEGRATION_STEP_S / 2 * k2)
        k4 = state_derivative(INTEGRATION_STEP_S, x + INTEGRATION_STEP_S * k3)
        states[i + 1] = x + INTEGRATION_STEP_S / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return _build_lane_drive_truth(time_s, states, road, vehicle, runs)


def _draw_driver_unrest_mps2(driver: TargetLineDriver, n: int, m: int, seed: int) -> FloatArray:
    """Draw the unwanted lateral acceleration of m drivers at n steps, shape (n, m), m/s^2 (Gauss-Markov)."""
    noise = random_stream(seed, "lane", "unrest").standard_normal((n, m))
    keep = float(np.exp(-INTEGRATION_STEP_S / driver.unrest_s))
    values = np.empty((n, m))
    values[0] = noise[0]
    for i in range(1, n):
        values[i] = keep * values[i - 1] + np.sqrt(1.0 - keep**2) * noise[i]
    return driver.unrest_mps2 * values


def _steady_start_states(road: Road, vehicle: Vehicle, runs: LaneRuns) -> FloatArray:
    """The states (6, m) at the start: a car that follows the lane steadily."""
    v = runs.speed_mps
    curvature = np.broadcast_to(road.curvature_at_1pm(np.zeros(1)), v.shape)
    slip = vehicle.mass_kg * vehicle.front_axle_m / (vehicle.rear_stiffness_nprad * vehicle.wheelbase_m)
    lateral = (vehicle.rear_axle_m - slip * v**2) * v * curvature
    steer = (vehicle.wheelbase_m + understeer_gradient_rad_per_mps2(vehicle) * v**2) * curvature
    zero = np.zeros_like(v)
    heading = -np.arctan2(lateral, np.maximum(v, MIN_MODEL_SPEED_MPS))
    return np.stack([lateral, v * curvature, steer, zero, zero, heading])


def _state_derivative(
    t: float, x: FloatArray, unrest: FloatArray, road: Road, vehicle: Vehicle, runs: LaneRuns, driver: TargetLineDriver
) -> FloatArray:
    """Time derivative (6, m) of the states x (6, m): v_y, yaw rate, steering angle, station, offset, heading."""
    lateral, yaw_rate, steer, station, offset, heading = x
    v = np.maximum(runs.speed_mps + runs.accel_mps2 * t, 0.0)
    ve = np.maximum(v, MIN_MODEL_SPEED_MPS)
    target, rate = _target_line_offset_and_speed(t, runs)
    course = heading + lateral / ve
    ahead = road.curvature_at_1pm(station + v * driver.look_ahead_s)
    correct = driver.correcting_curvature_1pm(ve, offset - target, course - rate / ve)
    steering_rad = (vehicle.wheelbase_m + understeer_gradient_rad_per_mps2(vehicle) * v**2) * (
        ahead + correct + unrest / ve**2
    )
    along = (v * np.cos(heading) - lateral * np.sin(heading)) / (1.0 - offset * road.curvature_at_1pm(station))
    return np.stack(
        [
            *lateral_accel_mps2_and_yaw_accel_radps2(vehicle, v, lateral, yaw_rate, steer),
            (steering_rad - steer) / driver.lag_s,
            along,
            v * np.sin(heading) + lateral * np.cos(heading),
            yaw_rate - road.curvature_at_1pm(station) * along,
        ]
    )


def _target_line_offset_and_speed(time_s: float, runs: LaneRuns) -> tuple[FloatArray, FloatArray]:
    """Offset (m) and lateral speed (m/s) of the target line at a time, (m,) each; the speed is reached within 1 s."""
    since = np.maximum(time_s - runs.drift_start_s, 0.0)
    eased = np.minimum(since, 1.0)
    return runs.drift_mps * (0.5 * eased**2 + (since - eased)), runs.drift_mps * eased


def _build_lane_drive_truth(
    time_s: FloatArray, states: FloatArray, road: Road, vehicle: Vehicle, runs: LaneRuns
) -> LaneDriveTruth:
    """Add positions and gaps to the boundaries to the states (k, 6, m) of all runs."""
    lateral, yaw_rate, steer, station, offset, heading = np.moveaxis(states, 1, 0)
    speed = np.maximum(runs.speed_mps + runs.accel_mps2 * time_s[:, None], 0.0)
    table, x, y, direction = road.centre_line_table(float(station.max()) + 100.0)
    along = np.interp(station, table, direction)
    at_front = offset + vehicle.front_axle_m * np.sin(heading)
    half = 0.5 * vehicle.width_m * np.cos(heading)
    return LaneDriveTruth(
        time_s=time_s,
        lateral_speed_mps=lateral,
        yaw_rate_radps=yaw_rate,
        steer_rad=steer,
        speed_mps=speed,
        station_m=station,
        offset_m=offset,
        heading_rad=heading,
        x_m=np.interp(station, table, x) - offset * np.sin(along),
        y_m=np.interp(station, table, y) + offset * np.cos(along),
        yaw_rad=along + heading,
        left_gap_m=0.5 * road.lane_width_m - (at_front + half),
        right_gap_m=0.5 * road.lane_width_m + (at_front - half),
        approach_mps=np.gradient(at_front, INTEGRATION_STEP_S, axis=0),
    )
