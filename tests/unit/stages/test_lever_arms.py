"""Where sensors stand, from the transforms of a log that the official writer made."""

from __future__ import annotations

from pathlib import Path

import pytest
from mcap_ros2.writer import Writer as Ros2Writer

from cwcli.channels.transforms import read_lever_arms_transform_counts_and_notes
from cwcli.errors import UsageError
from cwcli.logs.read.reader import Log
from cwcli.signals.transforms import Transform, find_carrying_body_frame_and_transform
from tests.unit.stages.test_lanes_mounting import TF_MESSAGE, edge, ros_message

POINT = """std_msgs/Header header
float64 x
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
"""
TREE = (
    edge("map", "base_link", (100.0, 50.0, 3.0)),
    edge("base_link", "roof", (1.0, 0.0, 1.4)),
    edge("roof", "antenna", (0.25, -0.5, 0.1)),
    edge("base_link", "imu_link", (-0.5, 0.0, 0.2)),
)
FRAMES = {"/gps/fix": "antenna", "/gps/vel": "map", "/wheels": "base_link", "/imu": "imu_link", "/none": ""}
TOPICS = list(FRAMES)


def tree(*edges: Transform) -> dict[str, Transform]:
    return {each.child: each for each in edges}


def log_of(path: Path, edges: tuple[Transform, ...]) -> Path:
    with path.open("wb") as stream:
        writer = Ros2Writer(stream)
        point = writer.register_msgdef("test_msgs/msg/Point", POINT)
        for topic, frame in FRAMES.items():
            header = {"stamp": {"sec": 1, "nanosec": 0}, "frame_id": frame}
            for k in range(3):
                writer.write_message(topic, point, {"header": header, "x": 1.0}, k + 1, k + 1)
        if edges:
            schema = writer.register_msgdef("tf2_msgs/msg/TFMessage", TF_MESSAGE)
            writer.write_message("/tf", schema, ros_message(edges[:1]), 1, 1)
            writer.write_message("/tf_static", schema, ros_message(edges[1:]), 1, 1)
            writer.write_message("/tf_static", schema, ros_message(edges[1:]), 2, 2)
        writer.finish()
    return path


def test_a_frame_that_the_body_carries_has_a_place_on_it() -> None:
    found = find_carrying_body_frame_and_transform(tree(*TREE), "antenna")
    assert found is not None
    assert found[0] == "base_link"
    assert found[1][:3, 3] == pytest.approx([1.25, -0.5, 1.5])


@pytest.mark.parametrize("frame", ["map", "elsewhere", "base_link", "base_footprint", ""])
def test_a_frame_that_the_body_does_not_carry_has_none(frame: str) -> None:
    assert find_carrying_body_frame_and_transform(tree(*TREE), frame) is None


def test_places_come_from_the_transforms(tmp_path: Path) -> None:
    with Log.open(log_of(tmp_path / "drive.mcap", TREE)) as log:
        places, counts, notes = read_lever_arms_transform_counts_and_notes(log, TOPICS, {})
    assert places == {"/gps/fix": pytest.approx((1.25, -0.5)), "/imu": pytest.approx((-0.5, 0.0))}
    assert [(c.topic, c.read, c.used) for c in counts] == [("/tf_static", 2, 1), ("/tf", 1, 1)]
    assert notes[0] == "/gps/fix is mounted 1.25 m ahead and -0.50 m to the left of base_link (antenna)"
    assert len(notes) == 2


def test_what_the_user_says_counts_before_the_transforms(tmp_path: Path) -> None:
    with Log.open(log_of(tmp_path / "drive.mcap", TREE)) as log:
        places, _, notes = read_lever_arms_transform_counts_and_notes(log, TOPICS, {"/gps/fix": (2.0, 0.0)})
    assert places == {"/gps/fix": (2.0, 0.0), "/imu": pytest.approx((-0.5, 0.0))}
    assert len(notes) == 1


def test_a_place_that_is_not_on_the_car_is_not_used_and_told(tmp_path: Path) -> None:
    far = (*TREE[:2], edge("roof", "antenna", (40.0, 0.0, 0.0)), TREE[3])
    with Log.open(log_of(tmp_path / "drive.mcap", far)) as log:
        places, _, notes = read_lever_arms_transform_counts_and_notes(log, TOPICS, {})
    assert list(places) == ["/imu"]
    assert notes[0].startswith(
        "/gps/fix: 41.00 m ahead and 0.00 m to the left of base_link (antenna) is not on the car"
    )


def test_a_log_without_transforms_is_not_read_again(tmp_path: Path) -> None:
    with Log.open(log_of(tmp_path / "drive.mcap", ())) as log:
        assert read_lever_arms_transform_counts_and_notes(log, TOPICS, {}) == ({}, (), ())


def test_a_topic_that_is_no_sensor_of_the_ego_is_refused(tmp_path: Path) -> None:
    with Log.open(log_of(tmp_path / "drive.mcap", ())) as log, pytest.raises(UsageError, match="no sensor of the ego"):
        read_lever_arms_transform_counts_and_notes(log, TOPICS, {"/other": (1.0, 0.0)})
