"""A car that turns at a crossing: into the lane beside the host it is no danger, into the host's own lane it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.prediction.plan import PathPlan, SelectedPaths
from cwcli.prediction.rollout import RolloutSettings, roll_out_paths
from cwcli.prediction.turn_end import TurnEndingPaths, left_turn_on_last_stretch_rad
from cwcli.warning.evaluate import find_warnings
from cwcli.warning.types import VehicleTrack
from tests.unit.warning.vehicles import stamps, straight

RADIUS_M = 9.0
SPEED_MPS = 6.0
SETTINGS = RolloutSettings(horizon_s=3.5)


def turner(lane_y_m: float) -> VehicleTrack:
    """A car that comes from the right, northward, and turns left by a right angle into the lane at y, westward."""
    time = np.arange(121) / 20.0
    turn = np.clip((time - 1.0) * SPEED_MPS / RADIUS_M, 0.0, np.pi / 2)
    after_m = np.maximum((time - 1.0) * SPEED_MPS - RADIUS_M * np.pi / 2, 0.0)
    before_m = np.minimum(time - 1.0, 0.0) * SPEED_MPS
    state = np.zeros((len(time), 8))
    state[:, 0] = 40.0 - RADIUS_M * (1.0 - np.cos(turn)) - after_m
    state[:, 1] = lane_y_m - RADIUS_M * (1.0 - np.sin(turn)) + before_m
    state[:, 2], state[:, 3] = SPEED_MPS, np.pi / 2 + turn
    state[:, 5] = np.where((turn > 0.0) & (turn < np.pi / 2), SPEED_MPS / RADIUS_M, 0.0)
    covariance = np.tile(np.diag([0.01, 0.01, *[0.0] * 6]), (len(time), 1, 1))
    stamp_ns = stamps(time)
    onset = SelectedPaths(PathPlan("onset", SETTINGS, state, covariance), np.arange(len(time)))
    return VehicleTrack(
        "turner", stamp_ns, stamp_ns, state, roll_out_paths("cv", state, covariance, SETTINGS),
        onset_paths=TurnEndingPaths(onset, left_turn_on_last_stretch_rad(stamp_ns, stamp_ns, state)),
    )  # fmt: skip


@pytest.mark.parametrize(("lane_y_m", "is_warned"), [(3.5, False), (0.0, True)])
def test_the_lane_into_which_a_car_turns_decides(lane_y_m: float, is_warned: bool) -> None:
    host, other = straight("host", speed_mps=4.0, duration_s=5.0), turner(lane_y_m)
    assert bool(find_warnings(host, [other]).pairs[0].spans) is is_warned
    assert isinstance(other.onset_paths, TurnEndingPaths)
    # a turn that never ends sweeps across the host's lane from the one beside it, too
    endless = replace(other, onset_paths=other.onset_paths.selected)
    assert find_warnings(host, [endless]).pairs[0].spans
