"""Detections from every message type, against numbers by hand and messages that the official classes encode."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from cwcli.channels.binding import bind_roles
from cwcli.logs.read.reader import Log
from cwcli.signals.canonical import DetectionSignal, TargetTruthSignal
from cwcli.signals.columns import Ragged
from cwcli.signals.inputs import find_input_for_role
from cwcli.signals.role import Role
from tests.unit.signals.signal_columns import T0_NS, columns_of, development_log, stamp_fields
from tests.unit.signals.signal_columns import build_known_signal as build_signal

NAN = float("nan")


def ragged(*rows):
    values = np.array([value for row in rows for value in row], dtype=float)
    return Ragged(values, np.concatenate([[0], np.cumsum([len(row) for row in rows])]).astype(np.int64))


def detected(schema_name, fields, **more):
    n = len(next(iter(fields.values())))
    stamped = {**stamp_fields(T0_NS + 100_000_000 * np.arange(n)), "header.frame_id": ["radar"] * n, **fields}
    signal, quality = build_signal(Role.DETECTIONS, columns_of(schema_name, stamped, **more))
    assert isinstance(signal, DetectionSignal)
    assert quality.read == quality.used + sum(quality.rejected.values())
    assert len(signal.offsets) == len(signal.stamp_ns) + 1 == len(signal.frame) + 1
    return signal, quality


def test_radar_scan_keeps_empty_scans_and_projects_by_the_elevation() -> None:
    signal, quality = detected(
        "radar_msgs/msg/RadarScan",
        {
            "returns.range": ragged([10.0, 20.0], [], [5.0]),
            "returns.azimuth": ragged([0.1, -0.2], [], [3.0]),
            "returns.elevation": ragged([0.0, math.pi / 3], [], [NAN]),
            "returns.doppler_velocity": ragged([1.0, 2.0], [], [-3.0]),
        },
    )
    assert signal.kind == "radar"
    np.testing.assert_array_equal(signal.offsets, [0, 2, 2, 3])
    np.testing.assert_allclose(signal.values, [[10.0, 0.1, 1.0], [10.0, -0.2, 4.0], [5.0, 3.0, -3.0]])
    assert np.isnan(signal.covariance).all()
    assert signal.frame.values == ("radar",)
    assert (quality.read, quality.used) == (3, 3)


def test_radar_scan_whose_rate_is_never_filled() -> None:
    fields = {
        "returns.range": ragged([1.0], [2.0]),
        "returns.azimuth": ragged([0.0], [0.0]),
        "returns.doppler_velocity": ragged([0.0], [0.0]),
    }
    signal, quality = detected("radar_msgs/RadarScan", fields)
    assert np.isnan(signal.values[:, 2]).all()
    assert "not measured" in quality.notes[0]


def test_a_message_whose_elements_differ_is_rejected_and_counted() -> None:
    fields = {"returns.range": ragged([1.0, 2.0], [3.0]), "returns.azimuth": ragged([0.0], [0.5])}
    signal, quality = detected("radar_msgs/RadarScan", fields)
    np.testing.assert_array_equal(signal.values[:, :2], [[3.0, 0.5]])
    assert quality.rejected == {"its elements do not all have the same fields": 1}


def test_messages_out_of_order_take_their_elements_along() -> None:
    stamp = T0_NS + 100_000_000 * np.array([0, 2, 1])
    columns = columns_of(
        "radar_msgs/RadarScan",
        {
            **stamp_fields(stamp),
            "returns.range": ragged([1.0], [3.0, 4.0], [2.0]),
            "returns.azimuth": ragged([0.0], [0.0, 0.0], [0.0]),
        },
    )
    signal, quality = build_signal(Role.DETECTIONS, columns)
    np.testing.assert_array_equal(signal.values[:, 0], [1.0, 2.0, 3.0, 4.0])
    np.testing.assert_array_equal(signal.offsets, [0, 1, 2, 4])
    np.testing.assert_array_equal(signal.log_time_ns, columns.log_time_ns[[0, 2, 1]])
    assert quality.repaired == {"out of order, sorted": 1}


def test_radar_tracks_with_their_covariances() -> None:
    signal, _ = detected(
        "radar_msgs/msg/RadarTracks",
        {
            "tracks.position.x": ragged([3.0], [1.0]),
            "tracks.position.y": ragged([4.0], [0.0]),
            "tracks.velocity.x": ragged([5.0], [1.0]),
            "tracks.velocity.y": ragged([0.5], [0.0]),
            "tracks.position_covariance": ragged([1.0, 0.2, 9.0, 2.0, 9.0, 9.0], []),
            "tracks.velocity_covariance": ragged([3.0, 0.3, 9.0, 4.0, 9.0, 9.0], []),
        },
    )
    assert signal.kind == "radar_track"
    np.testing.assert_array_equal(signal.values[0], [3.0, 4.0, 5.0, 0.5])
    expected = [[1.0, 0.2, 0, 0], [0.2, 2.0, 0, 0], [0, 0, 3.0, 0.3], [0, 0, 0.3, 4.0]]
    np.testing.assert_array_equal(signal.covariance[0], expected)
    assert np.isnan(signal.covariance[1, :2, :2]).all()


def test_boxes_take_the_covariance_of_the_only_hypothesis() -> None:
    matrix = np.zeros(36)
    matrix[[0, 1, 6, 7]] = 0.5, 0.1, 0.1, 0.7
    signal, _ = detected(
        "vision_msgs/msg/Detection3DArray",
        {
            "detections.bbox.center.position.x": ragged([1.0, 2.0], [3.0]),
            "detections.bbox.center.position.y": ragged([-1.0, -2.0], [-3.0]),
            "detections.results.pose.covariance": ragged([*matrix, *(2 * matrix)], []),
        },
    )
    assert signal.kind == "position"
    np.testing.assert_array_equal(signal.values, [[1.0, -1.0], [2.0, -2.0], [3.0, -3.0]])
    np.testing.assert_allclose(signal.covariance[1], [[1.0, 0.2], [0.2, 1.4]])
    assert np.isnan(signal.covariance[2]).all()


def test_empty_boxes_give_way_to_the_poses_of_the_hypotheses() -> None:
    signal, quality = detected(
        "vision_msgs/Detection3DArray",
        {
            "detections.bbox.center.position.x": ragged([0.0], [0.0]),
            "detections.bbox.center.position.y": ragged([0.0], [0.0]),
            "detections.results.pose.pose.position.x": ragged([5.0], [6.0]),
            "detections.results.pose.pose.position.y": ragged([7.0], [8.0]),
        },
    )
    np.testing.assert_array_equal(signal.values, [[5.0, 7.0], [6.0, 8.0]])
    assert "hypotheses" in quality.notes[0]


def write(path, schema_name, encoding, schema_encoding, schema, messages, topic="/sensor"):
    from mcap.writer import Writer

    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel(topic, encoding, writer.register_schema(schema_name, schema_encoding, schema))
        for k, message in enumerate(messages):
            at = T0_NS + 100_000_000 * k + 5_000_000
            writer.add_message(channel, at, message, at)
        writer.finish()
    return path


def read(path):
    with Log.open(path) as log:
        bound = bind_roles(log.channels, {}, required=(Role.DETECTIONS,))
        return build_signal(Role.DETECTIONS, log.load_topics(bound.fields_to_load())["/sensor"])


def scene(k):
    message = SceneUpdate()
    for x in range(k):
        entity = message.entities.add(frame_id="lidar", id=str(x))
        entity.timestamp.FromNanoseconds(T0_NS + 100_000_000 * k)
        entity.cubes.add().pose.position.x = x
    return message


@pytest.mark.parametrize("encoding", ["protobuf", "json"])
def test_cubes_of_a_scene_written_by_the_official_classes(tmp_path: Path, encoding) -> None:
    from google.protobuf.descriptor_pb2 import FileDescriptorSet

    scenes = [scene(k) for k in (1, 2, 3)]
    if encoding == "protobuf":
        files, seen = FileDescriptorSet(), set()

        def add(file):
            for other in file.dependencies:
                add(other)
            if file.name not in seen:
                seen.add(file.name)
                file.CopyToProto(files.file.add())

        add(SceneUpdate.DESCRIPTOR.file)
        schema, messages = files.SerializeToString(), [one.SerializeToString() for one in scenes]
    else:
        schema = b"{}"
        messages = [
            json.dumps(
                {
                    "entities": [
                        {
                            "timestamp": {"sec": e.timestamp.seconds, "nsec": e.timestamp.nanos},
                            "cubes": [{"pose": {"position": {"x": c.pose.position.x, "y": 0.0}}} for c in e.cubes],
                        }
                        for e in one.entities
                    ]
                }
            ).encode()
            for one in scenes
        ]
    kind = "protobuf" if encoding == "protobuf" else "jsonschema"
    signal, quality = read(write(tmp_path / "a.mcap", "foxglove.SceneUpdate", encoding, kind, schema, messages))
    np.testing.assert_array_equal(signal.offsets, [0, 1, 3, 6])
    np.testing.assert_array_equal(signal.values, [[x, 0.0] for k in (1, 2, 3) for x in range(k)])
    np.testing.assert_array_equal(signal.stamp_ns, T0_NS + 100_000_000 * np.array([1, 2, 3]))
    assert quality.repaired == {}


def json_log(tmp_path: Path, messages):
    lines = [json.dumps(message).encode() for message in messages]
    return read(write(tmp_path / "a.mcap", "cwcli.Detections", "json", "jsonschema", b"{}", lines))


def stamp(k):
    stamp_ns = T0_NS + 100_000_000 * k
    return {"sec": stamp_ns // 10**9, "nsec": stamp_ns % 10**9}


def test_json_positions_with_and_without_covariance(tmp_path: Path) -> None:
    full = {"x_m": 1.0, "y_m": 2.0, "covariance_xx_m2": 0.1, "covariance_xy_m2": 0.02, "covariance_yy_m2": 0.3}
    signal, quality = json_log(
        tmp_path,
        [
            {"timestamp": stamp(0), "frame_id": "lidar", "detections": [full, full]},
            {"timestamp": stamp(1), "frame_id": "lidar", "detections": []},
            {"timestamp": stamp(2), "frame_id": "lidar", "detections": [{"x_m": 3, "y_m": 4}]},
        ],
    )
    assert signal.kind == "position"
    np.testing.assert_array_equal(signal.offsets, [0, 2, 2, 3])
    np.testing.assert_array_equal(signal.values, [[1, 2], [1, 2], [3, 4]])
    np.testing.assert_allclose(signal.covariance[0], [[0.1, 0.02], [0.02, 0.3]])
    assert np.isnan(signal.covariance[2]).all()
    assert (quality.used, quality.rejected) == (3, {})
    np.testing.assert_array_equal(signal.stamp_ns, T0_NS + 100_000_000 * np.arange(3))


def test_json_ranges_with_null_for_what_is_not_measured(tmp_path: Path) -> None:
    one = {"range_m": 5.0, "azimuth_rad": 0.1, "range_rate_mps": -1.0}
    two = {"range_m": 6.0, "azimuth_rad": 0.2, "range_rate_mps": None}
    sigma = {"range_sigma_m": 0.2, "azimuth_sigma_rad": 0.01}
    messages = [
        {"timestamp": stamp(k), "detections": [{**one, **sigma, "range_rate_sigma_mps": 0.3}, {**two, **sigma,
         "range_rate_sigma_mps": None}]} for k in range(2)
    ]  # fmt: skip
    signal, _ = json_log(tmp_path, messages)
    assert signal.kind == "radar"
    np.testing.assert_array_equal(signal.values[:2], [[5.0, 0.1, -1.0], [6.0, 0.2, NAN]])
    np.testing.assert_allclose(np.diagonal(signal.covariance[0]), [0.04, 0.0001, 0.09])
    np.testing.assert_allclose(np.diagonal(signal.covariance[1])[:2], [0.04, 0.0001])


def test_the_lidar_radar_log_is_read_as_it_is_and_its_truth_has_the_map_s_velocity() -> None:
    with Log.open(development_log("udacity-obj-pose.ros2.mcap")) as log:
        bound = bind_roles(log.channels, {}, required=(Role.DETECTIONS, Role.TARGET_TRUTH))
        assert {one.topic for one in bound.channels_of_role(Role.DETECTIONS)} == {"/lidar/objects", "/radar/scan"}
        loaded = log.load_topics(bound.fields_to_load())
        lidar, _ = build_signal(Role.DETECTIONS, loaded["/lidar/objects"])
        radar, _ = build_signal(Role.DETECTIONS, loaded["/radar/scan"])
        truth, _ = build_signal(Role.TARGET_TRUTH, loaded["/truth/target"])
        twist: Mapping[str, Any] = log.columns("/truth/target", ["twist.twist.linear.x", "twist.twist.linear.y"]).fields
    assert (lidar.kind, len(lidar.values), radar.kind, len(radar.values)) == ("position", 250, "radar", 250)
    np.testing.assert_allclose(lidar.values[0], [0.3122427, 0.5803398])
    np.testing.assert_allclose(radar.values[0], [1.014892, 0.5543292, 4.892807], rtol=1e-6)
    assert isinstance(truth, TargetTruthSignal)
    assert truth.frame_id == "map"
    np.testing.assert_allclose(truth.vx_mps, twist["twist.twist.linear.x"], atol=2e-3)
    np.testing.assert_allclose(truth.vy_mps, twist["twist.twist.linear.y"], atol=2e-3)


def test_states_of_many_targets_are_kept_apart_by_their_ids() -> None:
    n = 4
    fields = {
        "stamp_ns": T0_NS + 100_000_000 * np.array([0, 0, 1, 1]),
        "id": ["a", "b", "a", "b"],
        **{name: np.arange(n, dtype=float) for name in ("x_m", "y_m", "vx_mps", "vy_mps")},
        "frame_id": ["map"] * n,
    }
    columns = columns_of("cwcli.v1.Target", fields, message_encoding="protobuf", topic="/truth/targets")
    signal, quality = build_signal(Role.TARGET_TRUTH, columns)
    assert (quality.used, signal.frame_id) == (4, "map")
    assert [signal.id.values[k] for k in signal.id.codes] == ["a", "b", "a", "b"]


def test_drawn_cubes_count_only_where_no_sensor_reports() -> None:
    class Found:
        def __init__(self, topic, schema_name, message_encoding="cdr"):
            self.topic, self.schema_name, self.message_encoding = topic, schema_name, message_encoding

    scan, drawn = Found("/radar", "radar_msgs/msg/RadarScan"), Found("/markers", "foxglove.SceneUpdate", "protobuf")
    own = Found("/cwcli/targets/scene", "foxglove.SceneUpdate", "protobuf")
    assert [
        b.topic
        for b in bind_roles([scan, drawn, own], {}, required=(Role.DETECTIONS,)).channels_of_role(Role.DETECTIONS)
    ] == ["/radar"]
    assert [
        b.topic for b in bind_roles([drawn, own], {}, required=(Role.DETECTIONS,)).channels_of_role(Role.DETECTIONS)
    ] == ["/markers"]


@pytest.mark.parametrize(
    ("schema", "encoding"),
    [
        ("radar_msgs/msg/RadarScan", "cdr"),
        ("radar_msgs/msg/RadarTracks", "json"),
        ("vision_msgs/msg/Detection3DArray", "cdr"),
        ("foxglove.SceneUpdate", "protobuf"),
        ("cwcli.Detections", "json"),
    ],
)
def test_every_schema_names_its_fields(schema, encoding) -> None:
    entry = find_input_for_role(Role.DETECTIONS, schema)
    assert entry is not None and entry.fields[encoding]
