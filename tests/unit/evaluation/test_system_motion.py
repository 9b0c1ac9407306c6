"""Another system's state and path of the ego, scored: expected values by construction."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cwcli.channels.published import EGO_STATE
from cwcli.channels.vehicle_state import VehicleStates, make_vehicle_state_channel
from cwcli.errors import DataError, MissingSignalError, UsageError
from cwcli.evaluation.evaluate_log import evaluate_log
from cwcli.evaluation.system.placing import fit_frame_placement
from cwcli.evaluation.system_topics import parse_other_system_options
from cwcli.logs.read.reader import Log
from cwcli.metrics.pooling import MetricRow, metric_rows_by_name, notes_from_metadata
from cwcli.signals.columns import OutputChannel
from tests.laws.input_logs import definition
from tests.unit.evaluation.small_logs import T0_NS
from tests.unit.evaluation.system_logs import STEP_NS, at_ns, json_log, ros_log

END_S, SPEED_MPS, RADIUS_M = 20.0, 10.0, 50.0
YAW_RATE = SPEED_MPS / RADIUS_M
TURN_RAD, SHIFT_M = math.radians(40.0), np.array([100.0, -30.0])


def circle(seconds: float) -> np.ndarray:
    """x, y, heading of the ego in the map: 10 m/s on a circle of 50 m."""
    angle = YAW_RATE * seconds
    return np.array([RADIUS_M * math.sin(angle), RADIUS_M * (1.0 - math.cos(angle)), angle])


def straight(seconds: float) -> np.ndarray:
    return np.array([SPEED_MPS * seconds, 0.0, 0.0])


Motion = Callable[[float], np.ndarray]


def ego_states(motion: Motion, topic: str = EGO_STATE.topic) -> OutputChannel:
    stamp_ns = T0_NS + STEP_NS * np.arange(round(END_S * 1e9) // STEP_NS + 1)
    state = np.zeros((len(stamp_ns), 8))
    for k, at in enumerate(stamp_ns):
        x, y, heading = motion((at - T0_NS) / 1e9)
        state[k, [0, 1, 2, 3, 5]] = x, y, SPEED_MPS, heading, YAW_RATE if motion is circle else 0.0
    covariance = np.tile(np.eye(8), (len(state), 1, 1))
    return make_vehicle_state_channel(
        EGO_STATE._replace(topic=topic), VehicleStates.from_ego_states(stamp_ns, state, covariance), None
    )


def header(seconds: float, frame: str) -> dict[str, Any]:
    sec, nanosec = divmod(at_ns(seconds), 10**9)
    return {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame}


def odometry(seconds: float, *, off_m: float, frame: str = "odom", turn_rad: float = TURN_RAD) -> dict[str, Any]:
    """The circle in a frame of its own, `off_m` to the left, 0.2 m/s and 0.01 rad/s too fast."""
    x, y, heading = circle(seconds)
    place = np.array([x - off_m * math.sin(heading), y + off_m * math.cos(heading)])
    cosine, sine = math.cos(-turn_rad), math.sin(-turn_rad)
    own = np.array([[cosine, -sine], [sine, cosine]]) @ (place - SHIFT_M)
    yaw = heading - turn_rad
    pose = {
        "position": {"x": float(own[0]), "y": float(own[1]), "z": 0.0},
        "orientation": {"x": 0.0, "y": 0.0, "z": math.sin(yaw / 2), "w": math.cos(yaw / 2)},
    }
    linear = {"x": SPEED_MPS + 0.2, "y": 0.0, "z": 0.0}
    twist = {"linear": linear, "angular": {"x": 0.0, "y": 0.0, "z": YAW_RATE + 0.01}}
    return {
        "header": header(seconds, frame),
        "child_frame_id": "base_link",
        "pose": {"pose": pose, "covariance": [0.0] * 36},
        "twist": {"twist": twist, "covariance": [0.0] * 36},
    }


def written(path: Path, schema: str, messages: Iterable[tuple[float, dict[str, Any]]], topic: str) -> Path:
    messages = list(messages)
    return ros_log(path, schema, definition(messages[0][1]), messages, topic)


def scored(path: Path, motion: Motion, *options: str, truth: bool = False) -> tuple[dict[str, MetricRow], str]:
    channels = [ego_states(motion)] + [ego_states(motion, "/truth/ego")] * truth
    with Log.open(path) as log:
        table = evaluate_log(log.with_channels(channels), system=parse_other_system_options(options))
    rows = {name: row for name, row in metric_rows_by_name(table).items() if name.startswith("system.")}
    return rows, " ".join(notes_from_metadata(table))


@pytest.mark.parametrize("truth", [False, True])
def test_an_odometry_in_its_own_frame(tmp_path: Path, truth: bool) -> None:
    """20 Hz; 0.3 m to the left and to the right in turn, so that no placing can take the error away."""
    messages = [(k / 20, odometry(k / 20, off_m=0.3 * (-1) ** k)) for k in range(401)]
    path = written(tmp_path / "a.mcap", "nav_msgs/msg/Odometry", messages, "/odometry")
    rows, notes = scored(path, circle, "ego_state=/odometry", truth=truth)
    found = {name: row.value for name, row in rows.items()}
    assert found == pytest.approx(
        {
            "system.ego.position_rmse_m": 0.3,
            "system.ego.along_rmse_m": 0.0,
            "system.ego.cross_rmse_m": 0.3,
            "system.ego.position_max_m": 0.3,
            "system.ego.speed_rmse_mps": 0.2,
            "system.ego.heading_rmse_deg": 0.0,
            "system.ego.yaw_rate_rmse_degps": math.degrees(0.01),
        },
        abs=0.01,
    )
    assert {row.states for row in rows.values()} == {"system vs truth" if truth else "system vs hindsight"}
    assert "its frame odom was aligned with the track by a rotation of 40.0" in notes


def test_an_odometry_of_another_time(tmp_path: Path) -> None:
    messages = [(100.0 + k / 20, odometry(100.0 + k / 20, off_m=0.0)) for k in range(50)]
    path = written(tmp_path / "a.mcap", "nav_msgs/msg/Odometry", messages, "/odometry")
    with pytest.raises(DataError, match="of a time at which the ego is known"):
        scored(path, circle, "ego_state=/odometry")


def point(x: float, y: float) -> dict[str, Any]:
    return {
        "position": {"x": float(x), "y": float(y), "z": 0.0},
        "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
    }


def trajectory(
    seconds: float, *, frame: str = "map", timed: bool = True, speed_mps: float = SPEED_MPS + 1.0, behind_m: float = 0.0
) -> dict[str, Any]:
    """Straight on at 11 m/s from where the car (or a point behind it) is, 4 s long."""
    begin_m = -behind_m + (0.0 if frame == "base_link" else straight(seconds)[0])
    points = []
    for k in range(41):
        at_s = 0.1 * k
        sec, nanosec = divmod(round(at_s * 1e9), 10**9) if timed else (0, 0)
        points.append(
            {
                "time_from_start": {"sec": sec, "nanosec": nanosec},
                "pose": point(begin_m + (SPEED_MPS + 1.0) * at_s, 0.0),
                "longitudinal_velocity_mps": speed_mps,
            }
        )
    return {"header": header(seconds, frame), "points": points}


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"timed": False},
        {"timed": False, "behind_m": 7.0, "frame": "base_link"},
        {"frame": "base_link"},
    ],
)
@pytest.mark.parametrize("encoding", ["cdr", "json"])
def test_a_trajectory_that_is_a_metre_per_second_too_fast(tmp_path: Path, encoding: str, settings: Any) -> None:
    messages = [(k / 10, trajectory(k / 10, **settings)) for k in range(151)]
    if encoding == "cdr":
        schema = "autoware_planning_msgs/msg/Trajectory"
        path = written(tmp_path / "a.mcap", schema, messages, "/planning/trajectory")
    else:
        path = json_log(tmp_path / "a.mcap", messages, "/planning/trajectory", "autoware_planning_msgs/msg/Trajectory")
    rows, notes = scored(path, straight, "ego_path=/planning/trajectory", truth=True)
    for horizon_s in (0.5, 1.0, 1.5, 2.0, 2.5):
        for prefix, states in (("", "hindsight"), ("truth_", "truth")):
            row = rows[f"system.prediction.ego.{prefix}fde_{horizon_s:.1f}s_m"]
            assert row.value == pytest.approx(horizon_s, abs=1e-6)
            assert row.n == 151
            assert row.states == f"system vs {states}"
    assert rows["system.prediction.ego.ade_2.5s_m"].value == pytest.approx(np.mean(0.1 * np.arange(1, 26)), abs=1e-6)
    assert ("151 of 151 paths have no times: computed from the speeds they give" in notes) is not settings.get(
        "timed", True
    )


def nav_path(seconds: float, *, stamped: bool) -> dict[str, Any]:
    poses = []
    for k in range(41):
        at_s = 0.1 * k
        stamp = header(seconds + at_s if stamped else seconds, "map")
        poses.append({"header": stamp, "pose": point(straight(seconds)[0] + SPEED_MPS * at_s, 0.5 * at_s)})
    return {"header": header(seconds, "map"), "poses": poses}


@pytest.mark.parametrize("stamped", [True, False])
def test_a_path_with_and_without_stamps(tmp_path: Path, stamped: bool) -> None:
    """It goes 0.5 m to the side in a second; without stamps, the car goes along it at its own 10 m/s."""
    messages = [(k / 10, nav_path(k / 10, stamped=stamped)) for k in range(151)]
    path = written(tmp_path / "a.mcap", "nav_msgs/msg/Path", messages, "/path")
    rows, notes = scored(path, straight, "ego_path=/path")
    assert rows["system.prediction.ego.fde_2.0s_m"].value == pytest.approx(1.0, abs=0.03)
    assert ("computed from the car's own speed" in notes) is not stamped


def test_the_frame_of_an_odometry_places_the_path(tmp_path: Path) -> None:
    """The planner's paths begin 3 m to the left: only the odometry in their frame tells that this is an error."""
    messages = []
    for k in range(201):
        at = k / 10
        message = trajectory(at, timed=True, speed_mps=SPEED_MPS)
        for each in message["points"]:
            each["pose"]["position"]["y"] += 3.0
        messages.append((at, "/planning/trajectory", "autoware_planning_msgs/msg/Trajectory", message))
        x, _, _ = straight(at)
        pose = {"pose": point(float(x), 0.0), "covariance": [0.0] * 36}
        linear = {"x": 10.0, "y": 0.0, "z": 0.0}
        twist = {"twist": {"linear": linear, "angular": {"x": 0.0, "y": 0.0, "z": 0.0}}, "covariance": [0.0] * 36}
        odom = {"header": header(at, "map"), "child_frame_id": "base_link", "pose": pose, "twist": twist}
        messages.append((at, "/odometry", "nav_msgs/msg/Odometry", odom))
    path = json_logs(tmp_path / "a.mcap", messages)
    option = "ego_path=/planning/trajectory"
    alone, notes = scored(path, straight, option)
    assert alone["system.prediction.ego.fde_1.0s_m"].value == pytest.approx(1.0, abs=1e-6)
    assert "an odometry in that frame" in notes
    both, _ = scored(path, straight, option, "ego_state=/odometry")
    assert both["system.prediction.ego.fde_1.0s_m"].value == pytest.approx(math.hypot(1.0, 3.0), abs=1e-6)


def json_logs(path: Path, messages: list[tuple[float, str, str, dict[str, Any]]]) -> Path:
    from mcap.writer import Writer

    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channels: dict[str, int] = {}
        for at, topic, schema, message in messages:
            if topic not in channels:
                number = writer.register_schema(schema, "jsonschema", b"{}")
                channels[topic] = writer.register_channel(topic, "json", number)
            data = json.dumps(message).encode()
            writer.add_message(channels[topic], at_ns(at), data, at_ns(at))
        writer.finish()
    return path


def test_a_path_that_ends_in_a_stop_and_one_that_just_ends(tmp_path: Path) -> None:
    """Points up to 11 m ahead: behind them the place is known only where the car stands there."""
    for last_mps, is_known in ((0.0, True), (11.0, False)):
        messages = []
        for k in range(151):
            message = trajectory(k / 10)
            del message["points"][11:]
            message["points"][-1]["longitudinal_velocity_mps"] = last_mps
            messages.append((k / 10, message))
        path = written(tmp_path / "a.mcap", "autoware_planning_msgs/msg/Trajectory", messages, "/plan")
        rows, _ = scored(path, straight, "ego_path=/plan")
        assert rows["system.prediction.ego.fde_1.0s_m"].value == pytest.approx(1.0, abs=1e-6)
        assert ("system.prediction.ego.fde_2.0s_m" in rows) is is_known
        if is_known:
            assert rows["system.prediction.ego.fde_2.0s_m"].value == pytest.approx(20.0 - 11.0, abs=1e-6)


def test_broken_paths_are_counted_and_none_is_left(tmp_path: Path) -> None:
    messages = [(k / 10, trajectory(k / 10)) for k in range(151)]
    messages[3][1]["points"][5]["pose"]["position"]["x"] = math.nan
    del messages[4][1]["points"][1:]
    messages[5][1]["points"][7]["pose"]["position"]["y"] = 1e12
    path = written(tmp_path / "a.mcap", "autoware_planning_msgs/msg/Trajectory", messages, "/plan")
    rows, notes = scored(path, straight, "ego_path=/plan")
    assert rows["system.prediction.ego.fde_1.0s_m"].n == 148
    for reason in ("1 fewer than two points", "1 value not a number", "1 value out of range"):
        assert reason in notes
    for _, message in messages:
        message["points"][0]["pose"]["position"]["x"] = math.nan
    path = written(tmp_path / "b.mcap", "autoware_planning_msgs/msg/Trajectory", messages, "/plan")
    with pytest.raises(DataError, match="none of its 151 messages can be used as planned_path"):
        scored(path, straight, "ego_path=/plan")
    messages = [(100.0 + k / 10, trajectory(100.0 + k / 10)) for k in range(20)]
    path = written(tmp_path / "c.mcap", "autoware_planning_msgs/msg/Trajectory", messages, "/plan")
    with pytest.raises(DataError, match="of no time at which the ego is known"):
        scored(path, straight, "ego_path=/plan")


def test_messages_of_another_type_and_logs_without_states(tmp_path: Path) -> None:
    messages = [(k / 10, trajectory(k / 10)) for k in range(11)]
    path = written(tmp_path / "a.mcap", "autoware_planning_msgs/msg/Trajectory", messages, "/plan")
    with pytest.raises(UsageError, match="Trajectory can't be read as") as caught:
        scored(path, straight, "ego_state=/plan")
    assert caught.value.exit_code == 2
    with pytest.raises(UsageError, match="VehicleState can't be read as") as caught:
        scored(path, straight, "ego_path=/cwcli/ego/state")
    assert caught.value.found == ("/plan (autoware_planning_msgs/msg/Trajectory)",)
    with Log.open(path) as log, pytest.raises(MissingSignalError, match="holds no states of the ego"):
        evaluate_log(log, system=parse_other_system_options(["ego_path=/plan"]))


def test_placing_finds_a_turn_and_a_shift_and_no_turn_of_a_parked_car() -> None:
    rng = np.random.default_rng(1)
    points = rng.normal(0.0, 30.0, (50, 2))
    cosine, sine = math.cos(2.5), math.sin(2.5)
    onto = points @ np.array([[cosine, sine], [-sine, cosine]]) + [7.0, -9.0]
    onto[3] = np.nan
    found = fit_frame_placement(points, onto)
    assert found is not None
    np.testing.assert_allclose(found.points_in_map_m(points)[4:], onto[4:], atol=1e-9)
    assert found.turn_rad == pytest.approx(2.5)
    parked = fit_frame_placement(0.01 * points, 0.01 * points[::-1] + 5.0)
    assert parked is not None
    assert parked.turn_rad == 0.0
    assert fit_frame_placement(points[:2], onto[:2]) is None
