"""ROS logs of channels that another version or another program wrote."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from cwcli.errors import DataError
from cwcli.export.ros.convert import RosLogReport, write_ros_log
from cwcli.export.ros.messages import _copy_fields_of_same_name, names_of_fields_left_out_of_ros
from cwcli.logs.read.reader import Log
from cwcli.logs.write.writer import LogWriter
from cwcli.signals.columns import Columns, OutputChannel, Ragged, encode_strings
from tests.cli.conftest import Run

STAMP_NS = np.array([10**9])


def ragged(*rows: int) -> Ragged:
    """0, 1, ... in rows of so many numbers."""
    return Ragged(np.arange(float(sum(rows))), np.concatenate([[0], np.cumsum(rows)]).astype(np.int64))


def path_channel(**fields: Any) -> OutputChannel:
    points = {"x_m": ragged(3), "y_m": ragged(3), "heading_rad": ragged(3), "step_s": np.array([0.25])}
    of_path = {"stamp_ns": STAMP_NS, "frame_id": encode_strings(["map"]), **points, **fields}
    return OutputChannel("/p", "cwcli.v1.PredictedPath", np.arange(len(of_path["stamp_ns"])) + 1, of_path)


def ros_log(folder: Path, *channels: OutputChannel) -> RosLogReport:
    with LogWriter(folder / "log.mcap") as log:
        for channel in channels:
            log.write_columns(channel)
    with Log.open(str(folder / "log.mcap")) as opened:
        return write_ros_log(opened, folder / "ros.mcap")


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"heading_rad": ragged(2)}, "heading_rad has not as many points as x_m"),
        ({"heading_rad": ragged(0)}, "heading_rad has not as many points as x_m"),
        ({"y_m": ragged(4)}, "y_m has not as many points as x_m"),
        ({"step_s": np.array([np.nan])}, "step_s is not a time between points"),
        ({"step_s": np.array([1e300])}, "step_s is not a time between points"),
    ],
)
def test_points_of_a_path_that_do_not_fit(tmp_path: Path, fields: dict[str, Any], said: str) -> None:
    with pytest.raises(DataError, match=said):
        ros_log(tmp_path, path_channel(**fields))
    assert not (tmp_path / "ros.mcap").exists()


def test_paths_of_equal_total_and_other_rows(tmp_path: Path) -> None:
    two = {"stamp_ns": np.array([1, 2]), "frame_id": encode_strings(["map", "map"]), "step_s": np.ones(2)}
    with pytest.raises(DataError, match="y_m has not as many points"):
        ros_log(tmp_path, path_channel(**two, x_m=ragged(1, 2), y_m=ragged(2, 1), heading_rad=ragged(1, 2)))


def test_times_beyond_those_of_ros_are_left_out_and_counted(tmp_path: Path) -> None:
    """2^31 s is the first that an int32 can't hold; the last path has a point there."""
    last_ns = (2**31 - 1) * 10**9
    stamps = np.array([last_ns, last_ns + 10**9, 2**63 - 5, last_ns])
    many = {"stamp_ns": stamps, "frame_id": encode_strings(["map"] * 4), "step_s": np.array([0.0, 0.0, 0.0, 1.0])}
    points = {name: ragged(2, 2, 2, 2) for name in ("x_m", "y_m", "heading_rad")}
    made = ros_log(tmp_path, path_channel(**many, **points))
    assert (made.n_messages_made, made.left_messages) == (
        1,
        {"/p": {"header.stamp": 2, "poses.header.stamp": 1}},
    )
    with AnyReader([tmp_path / "ros.mcap"]) as reader:
        message: Any
        [message] = [reader.deserialize(data, each.msgtype) for each, _, data in reader.messages()]
    assert [each.header.stamp.sec for each in message.poses] == [2**31 - 1] * 2
    assert [each.pose.position.x for each in message.poses] == [0.0, 1.0]


def lateral_state(**fields: Any) -> Columns:
    times = np.array([1, 2])
    of_state = {"stamp_ns": times, **fields}
    return Columns("/x", "cwcli.v1.LateralState", "protobuf", times, times, np.zeros(2, np.uint32), of_state)


def test_fields_of_another_version_are_left_out_and_named() -> None:
    columns = lateral_state(new_m=np.ones(2), inner_new=encode_strings(["a", "b"]))
    assert set(_copy_fields_of_same_name(columns, None)) == {"stamp_ns"}
    assert names_of_fields_left_out_of_ros(columns) == ["new_m", "inner_new"]


@pytest.mark.parametrize("path", ["stamp_ns", "stamp_ns.sec"])
def test_a_field_of_another_kind_is_an_error(path: str) -> None:
    columns = lateral_state()
    of_state = {path: encode_strings(["a", "b"])}
    wrong = Columns(**{**vars(columns), "fields": of_state})
    with pytest.raises(DataError, match=f"no usable field `{path}`"):
        _copy_fields_of_same_name(wrong, None)


def test_what_is_replaced_is_told(cwcli: Run, tmp_path: Path) -> None:
    ros_log(tmp_path, path_channel())
    recorded, both = tmp_path / "ros.mcap", tmp_path / "both.mcap"
    with Log.open(str(recorded)) as log:
        from cwcli.logs.write.annotate import annotate_log

        annotate_log(log, [path_channel()], {}, both)
    done = cwcli("export", both, "--format", "ros2", "-o", tmp_path / "again.mcap", "--json")
    assert json.loads(done.stdout)["replaced"] == ["/cwcli/ros/p"]
    assert b"/cwcli/ros/p: the recorded channel is replaced" in b" ".join(done.stderr.split())


def test_numbers_that_a_ros_message_cannot_hold_are_left_out_and_counted(cwcli: Run, tmp_path: Path) -> None:
    """By a version that wrote whole numbers as doubles: no image is 2^32 wide, and half a state is none."""
    times = np.arange(5) + 1
    states = [{"stamp_ns": int(each), "search_width_px": 640.0, "state": 1.0} for each in times]
    states[1]["search_width_px"] = 2.0**32
    states[2]["search_width_px"] = -1.0
    states[3]["state"] = 1.5
    with (tmp_path / "log.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("cwcli.v1.Lanes", "jsonschema", b"{}")
        channel = writer.register_channel("/lanes", "json", schema)
        for each in states:
            writer.add_message(channel, int(each["stamp_ns"]), json.dumps(each).encode(), int(each["stamp_ns"]))
        writer.finish()
    done = cwcli("export", tmp_path / "log.mcap", "--format", "ros2", "-o", tmp_path / "ros.mcap", "--json")
    assert done.returncode == 0
    told = json.loads(done.stdout)
    assert told["rows"] == 2
    assert told["left_messages"] == {"/lanes": {"search_width_px": 2, "state": 1}}
    assert b"2 whose search_width_px it can't hold" in b" ".join(done.stderr.split())
    assert read_ros(tmp_path / "ros.mcap", "state") == [1, 1]


def read_ros(path: Path, field: str) -> list[Any]:
    """One field of the messages, by the official reader."""
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        return [getattr(message, field) for *_, message in reader.iter_decoded_messages()]
