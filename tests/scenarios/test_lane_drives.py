"""Lanes over time on bridges' shadows, joints, ramps and lane changes: a small part of `studies/lane_drives.py`."""

from __future__ import annotations

import pytest

from tests.studies.lane_drives import Counts, counted, planned, watched

SECONDS = 14.0
SEED = 7


def counts_of(kind: str) -> Counts:
    drive = planned(kind, SEED, SECONDS)
    return counted(watched(drive, drive.frames()))


@pytest.mark.parametrize("kind", ["bridges", "joints", "mountain"])
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


def test_a_ramp_is_followed() -> None:
    """25 deg/s at 10 m/s: a radius of 23 m. Far rows are off by more than 6 pixels; docs/lanes.md says how often."""
    counts = counts_of("ramp")
    assert counts.found >= 1.9 * counts.frames
    assert counts.right >= 0.5 * counts.frames
    assert counts.untrue == 0
