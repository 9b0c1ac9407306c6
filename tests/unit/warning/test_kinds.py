"""Who can avoid a collision is warned: followers and cars in lanes of their own are kinds that the host turns on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.prediction.rollout import RolloutSettings, roll_out_paths
from cwcli.warning.evaluate import FoundWarnings, find_warnings
from cwcli.warning.kinds import WarningKind, kind_of_each_warning
from cwcli.warning.measures import PairStates
from cwcli.warning.types import VehicleTrack, WarningConfig
from tests.unit.warning.vehicles import seconds, straight

CAR = (4.5, 1.8)


def _classify(**other: float) -> WarningKind:
    """The kind of a warning of a host at the origin, eastward at 15 m/s (or as `host_*` says)."""
    host = np.zeros((1, 8))
    host[0, 2], host[0, 5] = other.pop("host_speed", 15.0), other.pop("host_yaw_rate", 0.0)
    host[0, 4] = other.pop("host_accel", 0.0)
    theirs = np.array([[other.get(name, 0.0) for name in ("x", "y", "v", "heading", "a", "w", "j")]])
    return WarningKind(kind_of_each_warning(PairStates(host, theirs, np.zeros(1, np.bool_), (CAR, CAR)))[0])


@pytest.mark.parametrize(
    ("other", "kind"),
    [
        pytest.param({"x": -10.0, "v": 25.0}, WarningKind.FROM_BEHIND, id="follower"),
        pytest.param({"x": -10.0, "y": 1.5, "v": 25.0}, WarningKind.FROM_BEHIND, id="follower, partly beside"),
        pytest.param({"x": -10.0, "v": 25.0, "host_speed": 0.0}, WarningKind.FROM_BEHIND, id="host stands"),
        pytest.param({"x": -10.0, "v": 0.0, "host_speed": -3.0}, WarningKind.COLLISION, id="host reverses"),
        pytest.param({"x": 10.0, "v": 5.0}, WarningKind.COLLISION, id="slower car ahead"),
        pytest.param({"x": -10.0, "y": 3.5, "v": 25.0, "host_yaw_rate": 0.1}, WarningKind.COLLISION, id="host cuts in"),
        pytest.param({"x": -4.0, "y": 1.9, "v": 25.0}, WarningKind.COLLISION, id="side by side, too near for lanes"),
        pytest.param({"x": -20.0, "y": -20.0, "v": 15.0, "heading": np.pi / 2}, WarningKind.COLLISION, id="crossing"),
        pytest.param({"x": 60.0, "y": 3.8, "v": 15.0, "heading": np.pi}, WarningKind.BESIDE_LANE, id="oncoming"),
        pytest.param({"x": 60.0, "y": 2.7, "v": 15.0, "heading": np.pi}, WarningKind.COLLISION, id="oncoming, near"),
        # sin(4 deg) 15 m/s is 1.05 m/s towards the host's lane
        pytest.param(
            {"x": 60.0, "y": 3.8, "v": 15.0, "heading": np.pi + np.radians(4.0)}, WarningKind.COLLISION, id="drifts in"
        ),
        pytest.param({"x": 60.0, "y": 3.8, "v": 8.0, "heading": np.pi, "w": 0.3}, WarningKind.COLLISION, id="turns"),
        pytest.param({"x": 30.0, "y": -3.5, "v": 0.0}, WarningKind.BESIDE_LANE, id="parked in the next lane"),
        pytest.param({"x": 30.0, "v": 15.0, "heading": np.pi}, WarningKind.COLLISION, id="head-on"),
        pytest.param({"x": 30.0, "v": 15.0, "heading": np.pi, "host_speed": 0.0}, WarningKind.HOST_STANDS, id="stands"),
        pytest.param(
            {"x": 5.0, "y": -20.0, "v": 15.0, "heading": 1.6, "host_speed": 0.0, "host_accel": 1.0},
            WarningKind.COLLISION,
            id="host drives off",
        ),
        pytest.param(
            {"x": 5.0, "y": -20.0, "v": 15.0, "heading": 1.6, "host_speed": 0.6},
            WarningKind.COLLISION,
            id="host creeps",
        ),
        pytest.param(
            {"x": 5.0, "y": -20.0, "v": 15.0, "heading": 1.6, "host_speed": 0.4, "host_accel": -1.0},
            WarningKind.HOST_STANDS,
            id="host comes to a stand",
        ),
    ],
)
def test_the_kind_follows_from_the_states_of_both(other: dict[str, float], kind: WarningKind) -> None:
    assert _classify(**other) is kind


def _warnings(host: VehicleTrack, other: VehicleTrack, **options: bool) -> FoundWarnings:
    return find_warnings(host, [other], WarningConfig(**options))  # type: ignore[arg-type]


def test_a_follower_is_counted_and_warned_of_on_request_alone() -> None:
    """60 m behind at 20 m/s more: 55.5 m apart, contact at 2.775 s, so 2.5 s before it from 0.275 s on."""
    host = straight("host", speed_mps=10.0, duration_s=2.7)
    other = straight("car", x_m=-60.0, speed_mps=30.0, duration_s=2.7)
    found = _warnings(host, other)
    assert len(found.events_table.columns["kind"]) == 0
    assert found.n_left_out == {WarningKind.FROM_BEHIND: 1, WarningKind.BESIDE_LANE: 0, WarningKind.HOST_STANDS: 0}
    asked = _warnings(host, other, from_behind=True)
    assert list(np.asarray(asked.events_table.columns["kind"])) == ["from behind"]
    assert seconds(np.asarray(asked.events_table.columns["raised_stamp_ns"])) == [0.3]
    assert asked.n_left_out == {WarningKind.BESIDE_LANE: 0, WarningKind.HOST_STANDS: 0}
    assert "collision with car from behind, in" in asked.rows.message.values[0]


def test_the_follower_itself_is_warned() -> None:
    host, other = straight("host", speed_mps=30.0), straight("car", x_m=50.0, speed_mps=10.0)
    found = _warnings(host, other)
    assert list(np.asarray(found.events_table.columns["kind"])) == ["collision"]
    assert set(found.n_left_out.values()) == {0}


def _oncoming_with_noisy_yaw_rate() -> VehicleTrack:
    """Oncoming at 15 m/s, 3.8 m to the left, whose yaw rate says that it turns into the host's lane: 0.06 rad/s.

    At a distance of 75 m, 2.5 s ahead, this leads 2.8 m to its left, and the outlines touch.
    """
    car = straight("car", x_m=120.0, y_m=3.8, speed_mps=15.0, heading_rad=np.pi, duration_s=4.0)
    state = car.state.copy()
    state[:, 5] = 0.06
    covariance = np.tile(np.diag([1e-4, 1e-4, *[0.0] * 6]), (len(state), 1, 1))
    return replace(
        car, state=state, paths=roll_out_paths("ctrv", state, covariance, settings=RolloutSettings(horizon_s=2.5))
    )


def test_an_oncoming_car_beside_the_lane_is_counted_and_warned_of_on_request_alone() -> None:
    host, other = straight("host", speed_mps=15.0, duration_s=4.0), _oncoming_with_noisy_yaw_rate()
    found = _warnings(host, other)
    assert len(found.events_table.columns["kind"]) == 0
    assert found.n_left_out[WarningKind.BESIDE_LANE] == 1
    assert list(np.asarray(_warnings(host, other, beside_lane=True).events_table.columns["kind"])) == ["beside lane"]


def test_a_host_that_stands_is_warned_on_request_alone() -> None:
    """50 m before the standing host at 10 m/s: 45.5 m apart, so contact is less than 2.5 s ahead after 2.05 s."""
    host = straight("host", speed_mps=0.0, duration_s=4.0)
    other = straight("car", x_m=50.0, speed_mps=10.0, heading_rad=np.pi, duration_s=4.0)
    found = _warnings(host, other)
    assert len(found.events_table.columns["kind"]) == 0
    assert found.n_left_out[WarningKind.HOST_STANDS] == 1
    asked = _warnings(host, other, while_standing=True)
    assert list(np.asarray(asked.events_table.columns["kind"])) == ["host stands"]
    assert seconds(np.asarray(asked.events_table.columns["raised_stamp_ns"])) == [2.1]


@pytest.mark.parametrize("rule", ["song2016", "ttc", "path-ttc"])
def test_the_rules_of_papers_have_no_kinds(rule: str) -> None:
    host, other = straight("host", speed_mps=10.0), straight("car", x_m=-50.0, speed_mps=30.0)
    found = find_warnings(host, [other], WarningConfig(rule=rule))
    assert list(np.asarray(found.events_table.columns["kind"])) == ["collision"]
    assert found.n_left_out == {}
