"""Trials of leaving the lane: a drift over a boundary, seen by a camera, and the lane-departure rule on it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property

import numpy as np

from cwcli.conformance.verdict import RaisedWarning
from cwcli.dynamics.observer import observe_lateral_motion
from cwcli.dynamics.vehicle import Vehicle, load_vehicle
from cwcli.lazy_dataclass import dataclass
from cwcli.prediction.lateral import predict_paths_from_observer
from cwcli.signals.columns import FloatArray
from cwcli.signals.units import NS_PER_S
from cwcli.simulation.lane_camera import simulate_lane_sensors_of_run
from cwcli.simulation.lane_drive import LaneDriveTruth, LaneRuns, Road, simulate_lane_runs
from cwcli.warning.lane_departure import FrontAxle, LaneBoundaries, evaluate_lane_departure

DRIFT_START_S = 3.0
"""Time at which the drift begins, s. Chosen by hand: the observer settles within 1 s."""
TRIAL_END_BEYOND_BOUNDARY_M = 1.0
"""Distance of the drift beyond the boundary at which a trial ends, m. Chosen by hand: more than every latest line."""
DURATION_OF_DRIVE_WITHOUT_DRIFT_S = 60.0
"""Duration of a drive without a drift, s. Chosen by hand."""


@dataclass(frozen=True)
class LaneDrift:
    """The true motion of one drive in a lane, from the outside of the nearer front tyre.

    Attributes:
        time_s: Shape (k,).
        tyre_gap_m: Shape (k,): to the boundary that it drifts to; negative beyond it.
        rate_mps: Shape (k,): speed towards it.
        other_id: The boundary, as warnings name it; "" where there is no drift.
    """

    time_s: FloatArray
    tyre_gap_m: FloatArray
    rate_mps: FloatArray
    other_id: str
    event_s: float = DRIFT_START_S

    @cached_property
    def contact_s(self) -> float:
        """When the tyre is first on the boundary, s; NaN if it never is."""
        over = np.flatnonzero(self.tyre_gap_m <= 0.0)
        return float(self.time_s[over[0]]) if len(over) else math.nan

    def first_time_within_s(self, distance_m: float) -> float:
        """When the tyre is first within a distance of the boundary (negative: beyond it), s; NaN if it never is."""
        within = np.flatnonzero(self.tyre_gap_m <= distance_m)
        return float(self.time_s[within[0]]) if len(within) else math.nan

    def values_at(self, time_s: float) -> dict[str, float]:
        """Distance and rate at a time."""
        return {
            "tyre_gap_m": float(np.interp(time_s, self.time_s, self.tyre_gap_m)),
            "rate_mps": float(np.interp(time_s, self.time_s, self.rate_mps)),
        }

    def warning_text(self, values: Mapping[str, float]) -> str:
        """Where a warning came, in words."""
        gap_m = values["tyre_gap_m"]
        return f"warned {abs(gap_m):.2f} m {'inside' if gap_m >= 0.0 else 'outside'} the line"


@dataclass(frozen=True)
class LaneTrial:
    """One drive in a lane."""

    truth: LaneDriveTruth
    road: Road
    car: Vehicle
    drift: LaneDrift
    seed: int


def simulate_lane_trial(trial_numbers: Mapping[str, float], seed: int) -> LaneTrial:
    """Simulate a drive that drifts at `drift_rate` (left positive, 0: not at all) at `host_speed`, m/s.

    `radius` (m, left positive) bends the road; without it the road is straight.
    """
    speed, rate = trial_numbers["host_speed"], trial_numbers["drift_rate"]
    radius_m = trial_numbers.get("radius")
    bend = 0.0 if radius_m is None else 1.0 / radius_m
    road = Road() if radius_m is None else Road(np.array([0.0, 50.0, 150.0]), np.array([0.0, 0.0, bend]))
    car = load_vehicle()
    half_m = 0.5 * (road.lane_width_m - car.width_m)
    duration_s = (
        DURATION_OF_DRIVE_WITHOUT_DRIFT_S
        if rate == 0.0
        else DRIFT_START_S + 2.0 + (half_m + TRIAL_END_BEYOND_BOUNDARY_M) / abs(rate)
    )
    start_s = math.inf if rate == 0.0 else DRIFT_START_S
    runs = LaneRuns(np.array([speed]), np.array([rate]), np.array([start_s]), 0.0, duration_s)
    truth = simulate_lane_runs(road, car, runs, seed=seed)
    gap = truth.left_gap_m if rate > 0.0 else truth.right_gap_m
    side = "" if rate == 0.0 else ("left boundary" if rate > 0.0 else "right boundary")
    drift = LaneDrift(truth.time_s, gap[:, 0], math.copysign(1.0, rate) * truth.approach_mps[:, 0], side)
    return LaneTrial(truth, road, car, drift, seed)


def warn_of_lane_departure(trial: LaneTrial) -> tuple[RaisedWarning, ...]:
    """The warnings of the lane-departure rule, from camera and speed alone, online."""
    car = trial.car
    sensed = simulate_lane_sensors_of_run(trial.truth, 0, trial.road, car, seed=trial.seed)
    track = observe_lateral_motion(sensed.lanes, sensed.speed, car)
    result = evaluate_lane_departure(
        sensed.stamp_ns,
        sensed.stamp_ns,
        predict_paths_from_observer(track, car),
        LaneBoundaries(sensed.left_body, sensed.right_body, car.camera_forward_m),
        track.speed_mps,
        host=FrontAxle(car.width_m, car.front_axle_m),
    )
    events = result.events.rows_as_dicts()
    raised = sorted((int(row["raised_stamp_ns"]), f"{row['side']} boundary") for row in events)
    return tuple(RaisedWarning(at / NS_PER_S, side) for at, side in raised)
