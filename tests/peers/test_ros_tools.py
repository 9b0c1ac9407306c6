"""ROS tools: what rosbags, evo and the official reader make of annotated logs, and of the ROS logs made of them."""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer as McapWriter
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.highlevel.anyreader import AnyReaderError

from cwcli.errors import EXIT_MISSING_SIGNAL, EXIT_USAGE
from cwcli.export.ros.messages import ROS_CONVERSIONS
from cwcli.logs.read.reader import Log
from cwcli.logs.write.writer import LogWriter
from cwcli.signals.columns import OutputChannel, Repeated, encode_strings
from cwcli.stages import STAGES
from tests.cli.conftest import SAMPLES, Run

ROS_TOPICS = {"/gps/fix", "/gps/heading", "/vehicle/velocity", "/imu/data"}
Messages = dict[str, list[tuple[int, bytes]]]


def run_once(*arguments: str | Path) -> None:
    from cwcli.cli.main import run_command_line

    assert run_command_line([*map(str, arguments), "--quiet"]) == 0


@pytest.fixture(scope="module")
def everything(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The intersection with all results."""
    target = tmp_path_factory.mktemp("ros") / "everything.mcap"
    run_once("run", SAMPLES / "intersection.mcap", "-o", target)
    return target


@pytest.fixture(scope="module")
def exported(everything: Path) -> Path:
    """The same for ROS tools."""
    target = everything.with_name("ros.mcap")
    run_once("export", everything, "--format", "ros2", "-o", target)
    return target


@pytest.fixture
def recorded(cwcli: Run, intersection: Path, tmp_path: Path) -> Path:
    """A log of profile ros2 that holds recorded ROS messages and a truth."""
    done = cwcli("export", intersection, "--format", "ros2", "-o", tmp_path / "recorded.mcap")
    assert done.returncode == 0, done.stderr.decode()
    return tmp_path / "recorded.mcap"


@pytest.fixture
def annotated(cwcli: Run, recorded: Path, tmp_path: Path) -> Path:
    done = cwcli("estimate", recorded, "-o", tmp_path / "annotated.mcap")
    assert done.returncode == 0
    assert b"does not have the profile ros2" in b" ".join(done.stderr.split())
    return tmp_path / "annotated.mcap"


def messages_of(path: Path, topics: set[str]) -> Messages:
    """Topic -> (log time, payload), by the official reader."""
    found: Messages = defaultdict(list)
    with path.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages(topics=topics):
            found[channel.topic].append((message.log_time, message.data))
    return found


def messages_by_rosbags(path: Path) -> Messages:
    """The same by rosbags, each message decoded too."""
    found: Messages = defaultdict(list)
    with AnyReader([path]) as reader:
        for connection, time_ns, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
            found[connection.topic].append((time_ns, bytes(data)))
    return found


def test_annotated_log_does_not_promise_ros_messages_alone(annotated: Path) -> None:
    """rosbags refuses such a log in one line, where it broke on the bytes of a protobuf schema before."""
    with pytest.raises(AnyReaderError, match=r"^Profile is not ros2\.$"), AnyReader([annotated]):
        pass


def test_official_ros_reader_reads_the_ros_channels_of_an_annotated_log(recorded: Path, annotated: Path) -> None:
    read: list[list[tuple[str, int, str]]] = []
    for path in (recorded, annotated):
        with path.open("rb") as stream:
            messages = make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages(ROS_TOPICS)
            read.append([(each.channel.topic, each.message.log_time, repr(each.decoded_message)) for each in messages])
    before, after = read
    assert len(before) == 4 * 201
    assert after == before


def test_recorded_messages_are_in_the_ros_log_byte_for_byte(exported: Path) -> None:
    found = messages_by_rosbags(exported)
    assert {len(found[topic]) for topic in ROS_TOPICS} == {201}
    assert {topic: found[topic] for topic in ROS_TOPICS} == messages_of(SAMPLES / "intersection.mcap", ROS_TOPICS)


def test_every_message_of_the_ros_log_is_read_by_both(exported: Path) -> None:
    """rosbags and the official reader, which share no code, see the same numbers of messages, times and values."""
    by_rosbags: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    with AnyReader([exported]) as reader:
        for connection, time_ns, data in reader.messages():
            by_rosbags[connection.topic].append((time_ns, reader.deserialize(data, connection.msgtype)))
    with exported.open("rb") as stream:
        official: dict[str, list[tuple[int, Any]]] = defaultdict(list)
        for each in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            official[each.channel.topic].append((each.message.log_time, each.decoded_message))
    assert {topic: [t for t, _ in each] for topic, each in by_rosbags.items()} == {
        topic: [t for t, _ in each] for topic, each in official.items()
    }
    for topic in ("/cwcli/ros/ego/state", "/cwcli/ros/remote/online", "/cwcli/ros/truth/ego"):
        for (_, one), (_, other) in zip(by_rosbags[topic], official[topic], strict=True):
            assert one.pose.covariance.tolist() == list(other.pose.covariance)
            assert one.twist.twist.linear.x == other.twist.twist.linear.x
    made = {topic.removeprefix("/cwcli/ros/") for topic in by_rosbags} - ROS_TOPICS
    assert made == {
        "ego/state", "ego/online", "ego/fix", "ego/pose", "ego/path", "remote/state", "remote/online", "remote/path",
        "tf", "warnings", "log", "rejected", "truth/ego", "simulation/vehicles",
    }  # fmt: skip


def test_evo_finds_the_error_that_cwcli_tells(cwcli: Run, everything: Path, exported: Path, tmp_path: Path) -> None:
    scores = json.loads(cwcli("evaluate", everything, "--json").stdout)
    rmse_m = scores["logs"][0]["metrics"]["ego.position_rmse_m"]["value"]
    topics = ["/cwcli/ros/truth/ego", "/cwcli/ros/ego/state"]
    evo: list[str | Path] = [Path(sys.executable).parent / "evo_ape", "mcap", exported, *topics]
    home = {**os.environ, "HOME": str(tmp_path)}  # where it keeps its settings
    done = subprocess.run(evo, capture_output=True, text=True, check=True, env=home)
    [found] = re.findall(r"rmse\s+([\d.]+)", done.stdout)
    assert float(found) == pytest.approx(rmse_m, rel=1e-3)


def rows_of(path: Path, topic: str) -> list[Any]:
    with AnyReader([path]) as reader:
        connections = [each for each in reader.connections if each.topic == topic]
        return [reader.deserialize(data, each.msgtype) for each, _, data in reader.messages(connections)]


def test_an_odometry_is_the_state(everything: Path, exported: Path) -> None:
    with Log.open(str(everything)) as log:
        columns = log.columns("/cwcli/ego/state")
    sigma = np.asarray(columns.fields["sigma"])
    correlation = np.asarray(columns.fields["correlation"])
    odometry = rows_of(exported, "/cwcli/ros/ego/state")
    assert len(odometry) == len(columns) == 201
    for k in (0, 77, 200):
        message = odometry[k]
        stamp = message.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == np.asarray(columns.fields["stamp_ns"])[k]
        assert (message.header.frame_id, message.child_frame_id) == ("map", "base_link")
        turn = message.pose.pose.orientation
        assert 2 * math.atan2(turn.z, turn.w) == pytest.approx(np.asarray(columns.fields["heading_rad"])[k])
        covariance = message.pose.covariance.reshape(6, 6)
        np.testing.assert_allclose(np.sqrt(covariance.diagonal()), [*sigma[k, :2], 0, 0, 0, sigma[k, 3]], rtol=1e-6)
        # Of the eight states above the diagonal, row by row: 0-1, 0-2, 0-3.
        assert covariance[0, 5] == covariance[5, 0]
        assert covariance[0, 5] == pytest.approx(correlation[k, 2] * sigma[k, 0] * sigma[k, 3])
        assert math.sqrt(message.twist.covariance[0]) == pytest.approx(sigma[k, 2])
        assert math.sqrt(message.twist.covariance[35]) == pytest.approx(sigma[k, 5])


def test_the_truth_is_in_the_map_of_the_log(exported: Path) -> None:
    """Its own map has another origin, 67 m away: in the ROS log both have the frame `map`."""
    ours, truth = (rows_of(exported, f"/cwcli/ros/{name}") for name in ("ego/state", "truth/ego"))
    for one, other in zip(ours, truth, strict=True):
        a, b = one.pose.pose.position, other.pose.pose.position
        assert math.hypot(a.x - b.x, a.y - b.y) < 0.2


def test_a_path_tells_where_the_vehicle_is_to_be_and_when(everything: Path, exported: Path) -> None:
    with Log.open(str(everything)) as log:
        columns = log.columns("/cwcli/remote/path")
    x_m = np.asarray(columns.fields["x_m"])
    path = rows_of(exported, "/cwcli/ros/remote/path")[3]
    assert [each.pose.position.x for each in path.poses] == x_m[3].tolist()
    times = [each.header.stamp.sec * 10**9 + each.header.stamp.nanosec for each in path.poses]
    assert np.diff(times).tolist() == [250_000_000] * (len(times) - 1)
    assert times[0] == np.asarray(columns.fields["stamp_ns"])[3]


def test_a_warning_stands_until_it_is_cleared(exported: Path) -> None:
    statuses = [each.status[0] for each in rows_of(exported, "/cwcli/ros/warnings")]
    assert [status.level for status in statuses] == [1] * (len(statuses) - 1) + [0]
    values = {each.key: each.value for each in statuses[0].values}
    assert statuses[0].hardware_id == "d9583520"
    assert float(values["time_to_event_s"]) == pytest.approx(2.32, abs=0.01)


def test_every_type_that_stages_write_is_known_or_a_picture() -> None:
    from cwcli.channels.published import PUBLISHED_CHANNELS

    assert {each.stage for each in PUBLISHED_CHANNELS} <= set(STAGES)
    assert {each.schema for each in PUBLISHED_CHANNELS} - set(ROS_CONVERSIONS) == {
        "foxglove.SceneUpdate",
        "foxglove.ImageAnnotations",
    }


def test_topics_of_control_are_names_of_ros(cwcli: Run, everything: Path, tmp_path: Path) -> None:
    assert cwcli("control", everything, "-o", tmp_path / "control.mcap").returncode == 0
    cwcli("export", tmp_path / "control.mcap", "--format", "ros2", "-o", tmp_path / "ros.mcap")
    with AnyReader([tmp_path / "ros.mcap"]) as reader:
        topics = {each.topic: each.msgtype for each in reader.connections}
    assert {kind for topic, kind in topics.items() if topic.endswith("/step")} == {"cwcli_msgs/msg/ControlStep"}
    assert all(re.fullmatch("[A-Za-z0-9_/]+", topic) for topic in topics)


def test_a_target_moves_where_its_odometry_points(cwcli: Run, tmp_path: Path) -> None:
    """By hand: 3 m/s east and 4 m/s north are 5 m/s at atan2(4, 3); variances 1 east and 9 north, turned to it."""
    along = np.array([0.6, 0.8])
    covariance = np.diag([0.25, 1.0, 1.0, 9.0])
    fields: dict[str, Any] = {
        "stamp_ns": np.array([10**9]),
        "id": encode_strings(["7"]),
        **{
            name: np.array([value])
            for name, value in zip(("x_m", "y_m", "vx_mps", "vy_mps"), (1, 2, 3, 4), strict=True)
        },
        "covariance": covariance.reshape(1, 16),
        "frame_id": encode_strings(["base_link"]),
        "yaw_rate_radps": np.array([np.nan]),
    }
    with LogWriter(tmp_path / "targets.mcap") as log:
        log.write_columns(OutputChannel("/cwcli/targets", "cwcli.v1.Target", np.array([10**9]), fields))
    done = cwcli("export", tmp_path / "targets.mcap", "--format", "ros2", "-o", tmp_path / "ros.mcap")
    assert done.returncode == 0, done.stderr.decode()
    [message] = rows_of(tmp_path / "ros.mcap", "/cwcli/ros/targets")
    assert (message.header.frame_id, message.child_frame_id) == ("base_link", "7")
    assert (message.twist.twist.linear.x, message.twist.twist.angular.z) == (5.0, 0.0)
    assert message.twist.covariance[0] == pytest.approx(along @ covariance[2:, 2:] @ along)
    assert message.pose.covariance[7] == 1.0


def test_what_has_no_ros_message_is_named(cwcli: Run, everything: Path, tmp_path: Path) -> None:
    done = cwcli("export", everything, "--format", "ros2", "-o", tmp_path / "ros.mcap", "--json")
    said = json.loads(done.stdout)
    assert said["left_out"] == {"/v2x/bsm": "BasicSafetyMessage", "/cwcli/paths/scene": "foxglove.SceneUpdate"}
    assert said["rows_copied"] == 4 * 201
    assert b"/v2x/bsm and /cwcli/paths/scene" in b" ".join(done.stderr.split())


def test_a_ros_log_is_one_that_was_recorded(cwcli: Run, exported: Path, tmp_path: Path) -> None:
    """What cwcli wrote for others is no measurement and no result: the fixes stay the only position."""
    info = json.loads(cwcli("info", exported, "--json").stdout)
    roles = {each["topic"]: each["roles"] for each in info["channels"]}
    assert [topic for topic, role in roles.items() if role] == sorted(ROS_TOPICS, key=list(roles).index)
    done = cwcli("estimate", exported, "-o", tmp_path / "again.mcap")
    assert done.returncode == 0, done.stderr.decode()


def test_hostile_names_become_topics_and_texts(cwcli: Run, tmp_path: Path) -> None:
    state = np.zeros(1)
    fields: dict[str, Any] = {
        "stamp_ns": np.array([10**9]),
        "id": encode_strings(["</x>\x1b[31m'\""]),
        **dict.fromkeys(("x_m", "y_m", "speed_mps", "heading_rad", "accel_mps2", "yaw_rate_radps"), state),
        **dict.fromkeys(("jerk_mps3", "yaw_accel_radps2", "length_m", "width_m"), state),
    }
    with LogWriter(tmp_path / "evil.mcap") as log:
        log.write_columns(OutputChannel("/a b/\x1b[31m<é", "cwcli.v1.VehicleState", np.array([10**9]), fields))
    done = cwcli("export", tmp_path / "evil.mcap", "--format", "ros2", "-o", tmp_path / "ros.mcap")
    assert done.returncode == 0, done.stderr.decode()
    [message] = rows_of(tmp_path / "ros.mcap", "/cwcli/ros/a_b/__31m__")
    assert message.child_frame_id == "</x>\x1b[31m'\""


def test_a_recorders_channel_that_lacks_a_field_is_named_and_the_rest_is_there(cwcli: Run, tmp_path: Path) -> None:
    with (tmp_path / "mixed.mcap").open("wb") as file:
        log = McapWriter(file)
        log.start()
        for topic, more in (("/bare", {}), ("/odd", {"frame_id": "gps", "position_covariance_type": 300})):
            schema = log.register_schema("foxglove.LocationFix", "jsonschema", b"{}")
            channel = log.register_channel(topic, "json", schema)
            fix = {"timestamp": {"sec": 5, "nsec": 0}, "latitude": 50.0, "longitude": 8.0, "altitude": 0.0, **more}
            fix["position_covariance"] = [1.0] * 9
            log.add_message(channel, 5 * 10**9, json.dumps(fix).encode(), 5 * 10**9)
        log.finish()
    done = cwcli("export", tmp_path / "mixed.mcap", "--format", "ros2", "-o", tmp_path / "ros.mcap")
    assert done.returncode == 0, done.stderr.decode()
    assert "left out, because no ROS message fits: /bare" in done.stderr.decode()
    [message] = rows_of(tmp_path / "ros.mcap", "/cwcli/ros/odd")
    assert (message.latitude, message.position_covariance_type) == (50.0, 0)


def test_no_two_topics_become_one(cwcli: Run, tmp_path: Path) -> None:
    names = ("stamp_ns", "x_m", "y_m", "speed_mps", "heading_rad", "accel_mps2", "yaw_rate_radps")
    more = ("jerk_mps3", "yaw_accel_radps2", "length_m", "width_m")
    fields: dict[str, Any] = {
        **dict.fromkeys((*names[1:], *more), np.zeros(1)),
        "stamp_ns": np.array([10**9]),
        "id": encode_strings("a"),
    }
    with LogWriter(tmp_path / "alike.mcap") as log:
        for topic in ("/a b", "/a_b", "/a_b_2", "/"):
            log.write_columns(OutputChannel(topic, "cwcli.v1.VehicleState", np.array([10**9]), fields))
    done = cwcli("export", tmp_path / "alike.mcap", "--format", "ros2", "-o", tmp_path / "ros.mcap")
    assert done.returncode == 0, done.stderr.decode()
    for name in ("a_b", "a_b_2", "a_b_2_2", "_"):
        assert len(rows_of(tmp_path / "ros.mcap", f"/cwcli/ros/{name}")) == 1


@pytest.mark.parametrize(
    ("more", "said"),
    [(["--what", "ego"], "--what: --format ros2 writes the whole log"), (["--id", "7"], "--id: --format ros2 writes")],
)
def test_the_whole_log_alone_is_written(cwcli: Run, intersection: Path, more: list[str], said: str) -> None:
    done = cwcli("export", intersection, "--format", "ros2", "-o", "ros.mcap", *more)
    assert (done.returncode, said in done.stderr.decode()) == (EXIT_USAGE, True)


def test_a_log_without_anything_for_ros(cwcli: Run, tmp_path: Path) -> None:
    with LogWriter(tmp_path / "scene.mcap") as log:
        scene = {"entities": Repeated(np.zeros(2, np.int64), {})}
        log.write_columns(OutputChannel("/scene", "foxglove.SceneUpdate", np.array([10**9]), scene))
    done = cwcli("export", tmp_path / "scene.mcap", "--format", "ros2", "-o", tmp_path / "ros.mcap")
    assert done.returncode == EXIT_MISSING_SIGNAL
    assert not (tmp_path / "ros.mcap").exists()
