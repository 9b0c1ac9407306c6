"""Lanes over time on roads with defects, bends, lane changes and junctions: a part of `studies/lane_drives.py`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.simulation.road.car import YAW_RATE
from cwcli.simulation.road.drive import RoadDrive
from cwcli.simulation.road.scene import Marking
from tests.studies.lane_drives import Counts, counted, planned, watched
from tests.studies.lane_motion import observed, yaw_rate_error_degps

SECONDS = 14.0
SEED = 7


def counts_of(kind: str) -> Counts:
    drive = planned(kind, SEED, SECONDS)
    return counted(watched(drive, drive.iter_rendered_frames()))


@pytest.mark.parametrize("kind", ["bridges", "joints", "mountain-glare", "exit", "merge"])
def test_lanes_are_right_and_steady_and_nothing_is_warned_of(kind: str) -> None:
    counts = counts_of(kind)
    assert counts.right >= 0.97 * counts.frames
    assert counts.wrong <= 0.01 * counts.found
    assert counts.jumps == 0
    assert counts.untrue == 0
    assert counts.departures == 0


def test_a_lane_change_is_told_within_a_second_and_nothing_jumps() -> None:
    counts = counts_of("change")
    assert counts.changes == 1
    assert counts.told == counts.changes
    assert counts.untrue == 0
    assert counts.jumps == 0
    assert counts.right >= 0.97 * counts.frames


def test_a_ramp_is_followed_and_tells_the_yaw_rate() -> None:
    """25 deg/s at 10 m/s: a radius of 23 m; camera and speed alone. docs/lanes.md and docs/observer.md have more."""
    drive = planned("ramp", SEED, SECONDS)
    seen = watched(drive, drive.iter_rendered_frames(), with_yaw_rate=False)
    counts = counted(seen)
    assert counts.right >= 0.97 * counts.frames
    assert counts.untrue == 0
    assert np.isnan(seen.geometry.heading_deviation_rad).any()  # no lane 33.5 m ahead
    for name, rmse_degps in (("camera and speed", 2.0), ("with a gyroscope", 0.6)):
        errors = yaw_rate_error_degps(seen, observed(seen, name))
        assert np.isfinite(errors).all()
        assert np.sqrt(np.mean(errors**2)) <= rmse_degps


def without_paint_in_bends(drive: RoadDrive) -> RoadDrive:
    """The same drive, as through a junction: no marking is painted where the road bends by more than 0.004 1/m."""
    straight = np.concatenate([[False], np.abs(drive.curvature_1pm) <= 0.004, [False]])
    first_and_last = np.flatnonzero(np.diff(straight.astype(np.int8))).reshape(-1, 2) - [0, 1]
    painted = tuple((float(a), float(b)) for a, b in drive.knots_m[first_and_last])

    def partly(marking: Marking) -> Marking:
        return replace(marking, painted_stretches_m=painted)

    scene = drive.scene
    others = tuple(map(partly, scene.others))
    return replace(drive, scene=replace(scene, left=partly(scene.left), right=partly(scene.right), others=others))


def test_in_a_turn_without_paint_the_lane_is_lost_and_the_observer_says_nothing_or_that_it_does_not_know() -> None:
    """25 deg/s at 10 m/s, camera and speed alone."""
    drive = without_paint_in_bends(planned("ramp", SEED, SECONDS))
    seen = watched(drive, drive.iter_rendered_frames(), with_yaw_rate=False)
    track = observed(seen, "camera and speed")
    true_radps = drive.states_at(drive.time_s)[:, YAW_RATE]
    turns = np.abs(true_radps) > np.radians(8.0)
    assert turns.sum() >= 30
    assert seen.fits.found[turns].mean() < 0.2
    error, sigma = track.state[:, 1] - true_radps, np.sqrt(track.covariance[:, 1, 1])
    has_state = np.isfinite(error)
    assert has_state[turns].mean() < 0.6
    assert (np.abs(error) <= np.maximum(np.radians(2.0), 3.0 * sigma))[has_state].all()
