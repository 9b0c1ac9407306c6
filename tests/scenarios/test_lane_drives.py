"""Lanes over time on roads with defects, bends, lane changes and junctions: a part of `studies/lane_drives.py`."""

from __future__ import annotations

import numpy as np
import pytest

from tests.studies.lane_drives import Counts, counted, planned, watched
from tests.studies.lane_motion import observed, yaw_rate_error_degps

SECONDS = 14.0
SEED = 7


def counts_of(kind: str) -> Counts:
    drive = planned(kind, SEED, SECONDS)
    return counted(watched(drive, drive.iter_rendered_frames()))


@pytest.mark.parametrize("kind", ["bridges", "joints", "mountain", "exit", "merge"])
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
