"""Frames -> lanes -> observer -> path -> warning on rendered drives: a small part of `studies/rendered_motion.py`."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from cwcli.dynamics.observer import observe_lateral_motion
from cwcli.reproduction.zhang2011.drives import (
    DRIVE_BY_FIGURE,
    FRAME_RATE_HZ,
    N_SETTLING_FRAMES,
    NAME_OF_SHARE_OF_TRUTH_IN_90_PERCENT_BAND,
    WINDING_ROAD,
    compute_drive_errors,
)
from cwcli.reproduction.zhang2011.rendered import RenderedDrive, RenderSettings, sense_rendered_drive
from cwcli.signals.units import MPS_PER_KMH
from cwcli.simulation.lane_drive import LaneDriveTruth, LaneRuns, simulate_lane_runs
from tests.studies.rendered_motion import (
    CAR,
    OVERLAY_PX,
    RAMP_LOOK,
    SENSORS,
    SPEED_MPS,
    Setting,
    departure,
    gentle_road,
    main,
    observed,
    overlay_error,
    ramp_departure,
    ramp_undisturbed,
    warned,
)

DURATION_S = 14.0
BOUNDS = {
    "camera and speed": {"yaw rate, RMSE": 1.0, "v_y, RMSE": 0.10, "path at 2 s, median error": 0.6},
    "with a gyroscope": {"yaw rate, RMSE": 0.2, "v_y, RMSE": 0.08, "path at 2 s, median error": 0.35},
}
"""In deg/s, m/s and m."""
SEED = 4


@cache
def drive() -> tuple[LaneDriveTruth, RenderedDrive]:
    """14 s on a gently winding road, 20 frames a second, without a drift."""
    road = gentle_road(SEED)
    truth = simulate_lane_runs(
        road, CAR, LaneRuns(np.full(1, SPEED_MPS), np.zeros(1), np.full(1, np.inf), 0.0, DURATION_S), seed=SEED
    )
    return truth, sense_rendered_drive(truth, 0, road, CAR, seed=SEED)


@pytest.mark.parametrize("sensors", SENSORS)
def test_motion_and_path_are_within_the_bounds(sensors: str) -> None:
    truth, seen = drive()
    track, paths = observed(seen, with_gyro=SENSORS[sensors])
    xy = (paths.x_m, paths.y_m)
    errors = compute_drive_errors(truth, 0, seen.sensed, track, xy, paths.position_covariance_m2)
    for what, bound in BOUNDS[sensors].items():
        assert errors[what] <= bound, what
    assert (
        errors[NAME_OF_SHARE_OF_TRUTH_IN_90_PERCENT_BAND] > 0.75
    )  # of one short drive; over all drives of the study: see docs/observer.md


def test_noise_does_not_move_a_horizon_that_the_mounting_tells() -> None:
    """A drive of zhang2011's figure 18: with other pitches tried first the yaw rate was wrong by 0.87 deg/s."""
    drive, run = DRIVE_BY_FIGURE["fig 18"], 2
    start = np.full(10, drive.start_kmh * MPS_PER_KMH)
    runs = LaneRuns(start, np.zeros(10), np.full(10, np.inf), drive.accel_mps2, drive.duration_s)
    truth = simulate_lane_runs(WINDING_ROAD, CAR.with_load(drive.load), runs, seed=0)
    sensed = sense_rendered_drive(
        truth, run, WINDING_ROAD, CAR, settings=RenderSettings(rate_hz=FRAME_RATE_HZ), seed=run
    ).sensed
    track = observe_lateral_motion(sensed.lanes, sensed.speed, CAR)
    errors = np.degrees(track.state[:, 1] - truth.yaw_rate_radps[sensed.index, run])[N_SETTLING_FRAMES:]
    assert np.sqrt(np.mean(errors**2)) <= 0.35


def test_drawn_path_lies_on_the_true_one() -> None:
    truth, seen = drive()
    _, paths = observed(seen, with_gyro=True)
    error = overlay_error(seen, paths, truth)
    assert np.nanmedian(error.path_px[N_SETTLING_FRAMES:]) <= OVERLAY_PX
    assert np.nanmax(error.geometry_px) <= OVERLAY_PX


def test_drive_without_a_drift_is_silent() -> None:
    _, seen = drive()
    assert len(warned(seen).events) == 0


@pytest.mark.parametrize("number", [120, 121, 178, 199])
def test_drifts_are_warned_of_between_isos_lines(number: int) -> None:
    """Of the study's 200: about 0.5 and 0.8 m/s to both sides, straight and in the bend, at 10 frames a second."""
    found = departure(number, Setting(look=RenderSettings(rate_hz=10.0)), 200)
    assert found.is_in_time, found
    assert found.wrong_events == 0


@pytest.mark.parametrize("number", [6, 15])
def test_drifts_on_a_ramp_are_warned_of_between_isos_lines(number: int) -> None:
    """Of the study's 20, in bends of 23 m: 0.275 m/s outwards in a left one, 0.625 m/s inwards in a right one."""
    found = ramp_departure(number, Setting(look=RAMP_LOOK), 20)
    assert found.is_in_time, found
    assert found.wrong_events == 0


def test_the_ramps_have_a_look_of_their_own_and_another_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["rendered_motion", "ramps", "--weather", "rain"])
    with pytest.raises(SystemExit):
        main()
    assert "the ramps have a look of their own" in capsys.readouterr().err


@pytest.mark.parametrize("number", [0, 1])
def test_ramps_without_a_drift_are_silent(number: int) -> None:
    assert ramp_undisturbed(number, Setting(look=RAMP_LOOK)) == 0
