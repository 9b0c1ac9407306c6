"""Trials of leaving the lane: a drift over a boundary, seen by a camera, and the lane-departure rule on it.

No driver holds a rate of departure exactly, so a drift is driven many times, and the drives that hold it best count.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from functools import cached_property, lru_cache

import numpy as np

from cwcli.conformance.verdict import RaisedWarning
from cwcli.dynamics.observer import observe_lateral_motion
from cwcli.dynamics.vehicle import Vehicle, load_vehicle
from cwcli.errors import UsageError
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
STEERED_LATERAL_SPEED_TO_PRESCRIBED_RATE_RATIOS = np.linspace(0.5, 1.1, 512)
"""Lateral speed that each drive of a batch steers for, as a share of the prescribed rate; a driver overshoots. Chosen
by hand."""
N_SEEDS_PER_BATCH = 8
"""Number of seeds that share a batch of drives, each with its own drive. Chosen by hand."""
MAX_DRAWS_OF_BATCH = 4
"""Number of times a batch is drawn anew where not enough of its drives hold the rate. Chosen by hand."""
MAX_BATCHES = 1000
"""More than the number of batches of the most seeds that a trial can have."""
MAX_DURATION_OF_DRIFT_S = 45.0
"""Longest drive with a drift, s. Chosen by hand: 0.05 m/s; all drives of a batch are kept in memory together."""
RATE_TOLERANCE_AT_LINE_MPS = 0.02
"""How far the rate may be off on the boundary, m/s. Chosen by hand: a fifth of R130's slowest drift."""
RATE_TOLERANCE_NEAR_LINE_MPS = 0.1
"""How far it may be off within `MAX_BOUNDARY_DISTANCE_OF_CHECKED_DRIFT_RATE_M` of the boundary, m/s. Chosen by hand."""
MAX_BOUNDARY_DISTANCE_OF_CHECKED_DRIFT_RATE_M = 0.3
"""Distance from the boundary, on both sides, within which the rate is checked, m. The latest line of ISO and R130."""


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
    """One drive in a lane: the run `index` of `truth`."""

    truth: LaneDriveTruth
    index: int
    road: Road
    car: Vehicle
    drift: LaneDrift
    seed: int


def simulate_lane_trial(trial_numbers: Mapping[str, float], seed: int) -> LaneTrial:
    """Simulate a drive that crosses a boundary at `drift_rate` (left positive, 0: no drift) at `host_speed`, m/s.

    `radius` (m, left positive) bends the road; without it the road is straight.

    Raises:
        UsageError: The drift is too slow, or not enough drives hold its rate within the tolerances.
    """
    speed, rate = trial_numbers["host_speed"], trial_numbers["drift_rate"]
    road, car = _build_road(trial_numbers.get("radius")), load_vehicle()
    if rate == 0.0:
        start_s, duration_s = np.array([math.inf]), DURATION_OF_DRIVE_WITHOUT_DRIFT_S
        truth = simulate_lane_runs(
            road, car, LaneRuns(np.array([speed]), np.zeros(1), start_s, 0.0, duration_s), seed=seed
        )
        index, side = 0, ""
    else:
        batch, index = divmod(seed, N_SEEDS_PER_BATCH)
        truth = _simulate_steady_drifts(trial_numbers.get("radius"), speed, rate, batch)
        side = "left boundary" if rate > 0.0 else "right boundary"
    gap_m, rate_mps = _gap_and_rate(truth, rate)
    return LaneTrial(truth, index, road, car, LaneDrift(truth.time_s, gap_m[:, index], rate_mps[:, index], side), seed)


def _build_road(radius_m: float | None) -> Road:
    """A straight road, or one that becomes a bend."""
    if radius_m is None:
        return Road()
    return Road(np.array([0.0, 50.0, 150.0]), np.array([0.0, 0.0, 1.0 / radius_m]))


def _gap_and_rate(truth: LaneDriveTruth, rate: float) -> tuple[FloatArray, FloatArray]:
    """Distance of the tyre to the boundary that a drift is to (m), and speed towards it (m/s); (k, m) each."""
    return truth.left_gap_m if rate > 0.0 else truth.right_gap_m, math.copysign(1.0, rate) * truth.approach_mps


@lru_cache(maxsize=1)
def _simulate_steady_drifts(radius_m: float | None, speed: float, rate: float, batch: int) -> LaneDriveTruth:
    """Simulate many drives of a drift; return the `N_SEEDS_PER_BATCH` ones that hold its rate best, best first.

    They have the right rate on the boundary, and are off least within
    `MAX_BOUNDARY_DISTANCE_OF_CHECKED_DRIFT_RATE_M` of it.
    """
    road, car = _build_road(radius_m), load_vehicle()
    drifts = rate * STEERED_LATERAL_SPEED_TO_PRESCRIBED_RATE_RATIOS
    start_s = np.full(len(drifts), DRIFT_START_S)
    half_m = 0.5 * (road.lane_width_m - car.width_m)
    duration_s = DRIFT_START_S + 2.0 + (half_m + TRIAL_END_BEYOND_BOUNDARY_M) / abs(rate)
    if duration_s > MAX_DURATION_OF_DRIFT_S:
        raise UsageError(f"a drift of {abs(rate):g} m/s takes too long", hint="take at least 0.05 m/s")
    runs = LaneRuns(np.full(len(drifts), speed), drifts, start_s, 0.0, duration_s)
    for draw in range(MAX_DRAWS_OF_BATCH):
        truth = simulate_lane_runs(road, car, runs, seed=batch + MAX_BATCHES * draw)
        gap_m, rate_mps = _gap_and_rate(truth, rate)
        error_mps = np.abs(rate_mps - abs(rate))
        at_line_mps = error_mps[np.argmax(gap_m <= 0.0, axis=0), np.arange(len(drifts))]
        worst_mps = np.where(np.abs(gap_m) <= MAX_BOUNDARY_DISTANCE_OF_CHECKED_DRIFT_RATE_M, error_mps, 0.0).max(axis=0)
        is_held = (at_line_mps <= RATE_TOLERANCE_AT_LINE_MPS) & (worst_mps <= RATE_TOLERANCE_NEAR_LINE_MPS)
        is_held &= gap_m.min(axis=0) <= -MAX_BOUNDARY_DISTANCE_OF_CHECKED_DRIFT_RATE_M
        if np.count_nonzero(is_held) >= N_SEEDS_PER_BATCH:
            break
    else:
        raise UsageError(
            f"no driver leaves the lane steadily at {abs(rate):g} m/s",
            found=(
                f"of {len(drifts)} drives {np.count_nonzero(is_held)} hold the rate; {N_SEEDS_PER_BATCH} are needed",
            ),
            hint="take a slower drift, a lower speed or a wider bend",
        )
    best = np.argsort(np.where(is_held, worst_mps, math.inf), kind="stable")[:N_SEEDS_PER_BATCH]
    columns = {each.name: getattr(truth, each.name) for each in fields(truth)}
    return LaneDriveTruth(**{name: values[:, best] if values.ndim == 2 else values for name, values in columns.items()})


def warn_of_lane_departure(trial: LaneTrial) -> tuple[RaisedWarning, ...]:
    """The warnings of the lane-departure rule, from camera and speed alone, online."""
    car = trial.car
    sensed = simulate_lane_sensors_of_run(trial.truth, trial.index, trial.road, car, seed=trial.seed)
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
