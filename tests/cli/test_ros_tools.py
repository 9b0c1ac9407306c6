"""docs/viewers.md on ROS tools: what rosbags, which evo reads by, makes of annotated logs and of the page's script."""

from __future__ import annotations

import re
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.highlevel.anyreader import AnyReaderError

from tests.cli.conftest import ROOT, Run

ROS_TOPICS = {"/gps/fix", "/gps/heading", "/vehicle/velocity", "/imu/data"}
Messages = dict[str, list[tuple[int, bytes]]]


def ros_log_of(source: Path, target: Path) -> Path:
    """What the page's script makes of a log."""
    page = (ROOT / "docs" / "viewers.md").read_text(encoding="utf-8")
    [script] = re.findall(r"<!-- ros2 -->\n```python\n(.*?)```", page, re.DOTALL)
    subprocess.run([sys.executable, "-c", script, str(source), str(target)], check=True)
    return target


@pytest.fixture
def recorded(intersection: Path, tmp_path: Path) -> Path:
    """A log of profile ros2 that holds ROS messages alone."""
    return ros_log_of(intersection, tmp_path / "recorded.mcap")


@pytest.fixture
def annotated(cwcli: Run, recorded: Path, tmp_path: Path) -> Path:
    done = cwcli("estimate", recorded, "-o", tmp_path / "annotated.mcap")
    assert done.returncode == 0
    assert b"profile is no longer ros2" in b" ".join(done.stderr.split())
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


def test_script_of_the_page_makes_a_log_for_ros_tools(recorded: Path, annotated: Path, tmp_path: Path) -> None:
    found = messages_by_rosbags(ros_log_of(annotated, tmp_path / "ros.mcap"))
    assert set(found) == ROS_TOPICS
    assert {len(each) for each in found.values()} == {201}
    assert found == messages_of(annotated, ROS_TOPICS) == messages_by_rosbags(recorded)
