"""Lane departure over the whole chain, from camera and speed alone: 200 drifts and 30 minutes without one."""

import numpy as np
import pytest

from cwcli.dynamics.observer import observe_lateral_motion
from cwcli.dynamics.vehicle import load_vehicle
from cwcli.prediction.lateral import predict_paths_from_observer
from cwcli.simulation.lane_camera import simulate_lane_sensors_of_run
from cwcli.simulation.lane_drive import LaneDriveTruth, LaneRuns, Road, simulate_lane_runs
from cwcli.warning.lane_departure import (
    FrontAxle,
    LaneBoundaries,
    LaneDepartureResult,
    earliest_warning_line_m,
    evaluate_lane_departure,
)

CAR = load_vehicle()
ROADS = {
    "straight": Road(),
    "curve of 500 m": Road(np.array([0.0, 50.0, 150.0]), np.array([0.0, 0.0, 0.002])),
}
NS_PER_STEP = 10_000_000
DRIFT_START_S = 3.0


def warn(truth: LaneDriveTruth, run: int, road: Road, seed: int) -> LaneDepartureResult:
    sensed = simulate_lane_sensors_of_run(truth, run, road, CAR, seed=seed)
    track = observe_lateral_motion(sensed.lanes, sensed.speed, CAR)
    return evaluate_lane_departure(
        sensed.stamp_ns,
        sensed.stamp_ns,
        predict_paths_from_observer(track, CAR),
        LaneBoundaries(sensed.left_body, sensed.right_body, CAR.camera_forward_m),
        track.speed_mps,
        host=FrontAxle(CAR.width_m, CAR.front_axle_m),
    )


@pytest.mark.parametrize("name", ROADS)
def test_100_drifts_are_warned_between_isos_lines(name: str) -> None:
    road = ROADS[name]
    rates = np.tile(np.concatenate([np.linspace(0.1, 0.8, 25), -np.linspace(0.1, 0.8, 25)]), 2)
    runs = LaneRuns(np.full(100, 25.0), rates, np.full(100, DRIFT_START_S), 0.0, 20.0)
    truth = simulate_lane_runs(road, CAR, runs, seed=11)
    for run, rate in enumerate(rates.tolist()):
        events = warn(truth, run, road, seed=11).events.rows_as_dicts()
        gap_m = (truth.left_gap_m if rate > 0.0 else truth.right_gap_m)[:, run]
        assert gap_m.min() < -0.3, "the car does leave the lane"
        assert [event["side"] for event in events[:1]] == ["left" if rate > 0.0 else "right"]
        at = events[0]["raised_stamp_ns"] // NS_PER_STEP
        speed_mps = np.sign(rate) * truth.approach_mps[at, run]
        assert -0.3 <= gap_m[at] <= float(earliest_warning_line_m(np.array([speed_mps]))[0])


def test_30_minutes_without_a_departure_are_silent() -> None:
    n_events = 0
    for seed, road in enumerate(ROADS.values()):
        runs = LaneRuns(np.full(15, 25.0), np.zeros(15), np.full(15, np.inf), 0.0, 60.0)
        truth = simulate_lane_runs(road, CAR, runs, seed=seed)
        assert min(truth.left_gap_m.min(), truth.right_gap_m.min()) > 0.1
        n_events += sum(len(warn(truth, run, road, seed).events) for run in range(15))
    assert n_events == 0
