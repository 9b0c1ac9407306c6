"""The camera's mounting from transforms, in logs that the official writers made."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer as McapWriter
from mcap_protobuf.writer import Writer as ProtobufWriter
from mcap_ros2.writer import Writer as Ros2Writer
from scipy.spatial.transform import Rotation

from cwcli.logs.read.reader import Log
from cwcli.signals.transforms import Transform, camera_pose_from_matrix, find_body_frame_and_transform
from cwcli.simulate.road_log import CAMERA_FRAME_ID, parse_road_log_config, plan_configured_drive, write_road_log
from cwcli.stages.inputs.camera import find_camera_mounting
from cwcli.vision.camera import Camera, Mounting
from cwcli.vision.mounting import MountingChoice

TF_MESSAGE = """geometry_msgs/TransformStamped[] transforms
================================================================================
MSG: geometry_msgs/TransformStamped
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: geometry_msgs/Transform
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
================================================================================
MSG: geometry_msgs/Quaternion
float64 x 0
float64 y 0
float64 z 0
float64 w 1
"""
ATOL = 1e-12
MOUNTED = Mounting(height_m=1.45, pitch_rad=0.05, yaw_rad=-0.02, roll_rad=0.01, lateral_offset_m=0.3)
OPTICAL = Rotation.from_matrix([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""REP-103: body axes of an optical frame that looks ahead."""


def body_rotation(mounting: Mounting = MOUNTED) -> Rotation:
    """Of the camera's body-like frame; SciPy's intrinsic yaw, pitch, roll is REP-103's Rz Ry Rx."""
    return Rotation.from_euler("ZYX", [mounting.yaw_rad, mounting.pitch_rad, mounting.roll_rad])


def edge(parent: str, child: str, xyz: tuple[float, float, float], turn: Rotation | None = None) -> Transform:
    quaternion = (turn or Rotation.identity()).as_quat()
    return Transform(parent, child, xyz, tuple(quaternion.tolist()))


TREE = (
    edge("map", "base_footprint", (100.0, 50.0, 3.0), Rotation.from_euler("z", 1.0)),
    edge("base_footprint", "base_link", (0.0, 0.0, 0.35)),
    edge("base_link", "camera_link", (1.8, 0.3, 1.1), body_rotation()),
    edge("camera_link", "camera_optical_frame", (0.0, 0.0, 0.0), OPTICAL),
)


def ros_message(transforms: tuple[Transform, ...]) -> dict[str, Any]:
    return {
        "transforms": [
            {
                "header": {"stamp": {"sec": 5, "nanosec": 6}, "frame_id": each.parent},
                "child_frame_id": each.child,
                "transform": {
                    "translation": dict(zip("xyz", each.translation_m, strict=True)),
                    "rotation": dict(zip("xyzw", each.rotation, strict=True)),
                },
            }
            for each in transforms
        ]
    }


def ros2_log(path: Path, messages: list[tuple[str, tuple[Transform, ...]]]) -> Path:
    with path.open("wb") as stream:
        writer = Ros2Writer(stream)
        schema = writer.register_msgdef("tf2_msgs/msg/TFMessage", TF_MESSAGE)
        for k, (topic, transforms) in enumerate(messages):
            writer.write_message(topic, schema, ros_message(transforms), k + 1, k + 1)
        writer.finish()
    return path


def foxglove_message(kind: Any, transform: Transform) -> Any:
    made = kind(parent_frame_id=transform.parent, child_frame_id=transform.child)
    made.translation.x, made.translation.y, made.translation.z = transform.translation_m
    made.rotation.x, made.rotation.y, made.rotation.z, made.rotation.w = transform.rotation
    return made


def protobuf_log(path: Path, *, as_list: bool) -> Path:
    from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
    from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms

    with path.open("wb") as stream, ProtobufWriter(stream) as writer:
        messages = [foxglove_message(FrameTransform, each) for each in TREE]
        for k, message in enumerate([FrameTransforms(transforms=messages)] if as_list else messages):
            writer.write_message("/tf", message, k + 1, k + 1)
    return path


def json_log(path: Path, schema_name: str, documents: list[Any]) -> Path:
    with path.open("wb") as stream:
        writer = McapWriter(stream)
        writer.start()
        schema = writer.register_schema(schema_name, "jsonschema", b'{"type":"object"}')
        channel = writer.register_channel("/tf_static", "json", schema)
        for k, document in enumerate(documents):
            writer.add_message(channel, k + 1, json.dumps(document).encode(), k + 1)
        writer.finish()
    return path


def json_foxglove(path: Path) -> Path:
    documents = [
        {
            "timestamp": {"sec": 1, "nsec": 0},
            "parent_frame_id": each.parent,
            "child_frame_id": each.child,
            "translation": dict(zip("xyz", each.translation_m, strict=True)),
            "rotation": dict(zip("xyzw", each.rotation, strict=True)),
        }
        for each in TREE
    ]
    return json_log(path, "foxglove.FrameTransform", documents)


LOGS = {
    "ROS 2, static": lambda path: ros2_log(path, [("/tf", TREE[:1]), ("/tf_static", TREE[1:])]),
    "ROS 2, one by one, moving": lambda path: ros2_log(path, [("/tf", (each,)) for each in TREE * 3]),
    "foxglove protobuf": lambda path: protobuf_log(path, as_list=False),
    "foxglove protobuf, list": lambda path: protobuf_log(path, as_list=True),
    "foxglove JSON": json_foxglove,
    "ROS JSON": lambda path: json_log(path, "tf2_msgs/msg/TFMessage", [ros_message(TREE)]),
}


@pytest.mark.parametrize("make", LOGS.values(), ids=LOGS.keys())
@pytest.mark.parametrize("frame_id", ["camera_optical_frame", "camera_link", "/camera_link"])
def test_mounting_from_transforms(make: Any, frame_id: str, tmp_path: Path) -> None:
    with Log.open(make(tmp_path / "tf.mcap")) as log:
        found = find_camera_mounting(log, frame_id, MountingChoice())
    for name in ("height_m", "pitch_rad", "yaw_rad", "roll_rad", "lateral_offset_m"):
        assert getattr(found.mounting, name) == pytest.approx(getattr(MOUNTED, name), abs=ATOL), name
    assert found.is_pitch_known
    assert "base_footprint" in found.notes[0]
    assert sum(count.read for count in found.counts) >= 1


def test_the_angles_are_those_of_the_camera_model() -> None:
    # body_from_optical of the camera model is the rotation of the optical frame in the body.
    camera = Camera(320, 240, 800.0, 800.0, 159.5, 119.5, mounting=MOUNTED)
    pose = camera_pose_from_matrix(
        np.block([[camera.body_from_optical_rotation(), np.array([[0.0], [0.3], [1.45]])], [np.eye(4)[3:]]])
    )
    assert pose is not None
    assert (pose.pitch_rad, pose.yaw_rad, pose.roll_rad) == pytest.approx((0.05, -0.02, 0.01), abs=ATOL)


def test_mounting_of_a_rendered_road(tmp_path: Path) -> None:
    # Written by cwcli: 1.65 m high, atan(1.65 / 33.5) nose down, straight ahead.
    path = tmp_path / "road.mcap"
    config = parse_road_log_config("clear", 1, ("duration_s=0.2", "size=64x48"))
    write_road_log(plan_configured_drive(config), config, path)
    with Log.open(path) as log:
        found = find_camera_mounting(log, CAMERA_FRAME_ID, MountingChoice())
    assert found.mounting.height_m == pytest.approx(1.65)
    assert found.mounting.pitch_rad == pytest.approx(math.atan(1.65 / 33.5), abs=1e-9)
    assert (found.mounting.yaw_rad, found.mounting.roll_rad) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert "assumed to be on the road" in found.notes[0]


def test_option_before_transform_before_default(tmp_path: Path) -> None:
    with Log.open(ros2_log(tmp_path / "tf.mcap", [("/tf_static", TREE)])) as log:
        found = find_camera_mounting(log, "camera_link", MountingChoice(pitch_rad=0.2))
        whole = find_camera_mounting(log, "camera_link", Mounting(height_m=2.0))
        unknown = find_camera_mounting(log, "elsewhere", MountingChoice(height_m=2.0))
        nothing = find_camera_mounting(log, "elsewhere", MountingChoice())
    assert found.mounting.pitch_rad == 0.2
    assert found.mounting.height_m == pytest.approx(1.45)
    assert "--camera-pitch counts before the transform" in found.notes
    assert whole.mounting == Mounting(height_m=2.0)
    assert unknown.mounting == Mounting(height_m=2.0)
    assert "no transform leads from elsewhere" in unknown.notes[0]
    assert nothing.mounting == Mounting()
    assert not nothing.is_pitch_known


@pytest.mark.parametrize(
    ("edges", "says"),
    [
        ((edge("base_link", "cam", (1.0, 0.0, 1.4), Rotation.from_euler("z", math.pi)),), "does not look ahead"),
        ((edge("base_link", "cam", (1.0, 0.0, -1.4)),), "no height above the road"),
        ((edge("base_link", "cam", (1.0, 0.0, 14.0)),), "no height above the road"),
        ((edge("base_link", "cam", (1.0, 1e7, 1.4)),), "not on the car"),
        ((edge("base_link", "cam", (1.0, 1e308, 1.4)), edge("map", "base_link", (1e308, 0.0, 0.0))), "no transform"),
        ((edge("base_link", "cam", (1.0, 0.0, 1.4), Rotation.from_euler("x", math.pi)),), "not upright"),
        ((edge("base_link", "other", (1.0, 0.0, 1.4)),), "no transform leads from cam"),
        ((edge("a", "cam", (0.0, 0.0, 1.0)), edge("cam", "a", (0.0, 0.0, 1.0))), "no transform leads from cam"),
        ((Transform("base_link", "cam", (0.0, 0.0, 1.4), (0.0, 0.0, 0.0, 0.0)),), "no transform leads from cam"),
        ((Transform("base_link", "cam", (math.nan, 0.0, 1.4), (0.0, 0.0, 0.0, 1.0)),), "no transform leads from cam"),
    ],
)
def test_transforms_that_are_not_used(edges: tuple[Transform, ...], says: str, tmp_path: Path) -> None:
    with Log.open(ros2_log(tmp_path / "tf.mcap", [("/tf_static", edges)])) as log:
        found = find_camera_mounting(log, "cam", MountingChoice())
    assert says in found.notes[0]
    assert found.mounting == Mounting()


def test_base_footprint_below_base_link_counts() -> None:
    # Some cars publish base_link -> base_footprint.
    edges = (edge("base_link", "base_footprint", (0.0, 0.0, -0.3)), edge("base_link", "cam", (1.0, 0.0, 1.0)))
    tree = {each.child: each for each in edges}
    found = find_body_frame_and_transform(tree, "cam")
    assert found is not None
    assert found[0] == "base_footprint"
    assert found[1][2, 3] == pytest.approx(1.3)


def test_unreadable_transforms_are_counted(tmp_path: Path) -> None:
    huge = ros_message(TREE)
    huge["transforms"][0]["transform"]["translation"]["x"] = 10**400  # a whole number that no float can hold
    documents = [{"transforms": 3}, {"nothing": 1}, huge, ros_message(TREE)]
    with Log.open(json_log(tmp_path / "tf.mcap", "tf2_msgs/msg/TFMessage", documents)) as log:
        found = find_camera_mounting(log, "camera_link", MountingChoice())
    assert found.mounting.height_m == pytest.approx(1.45)
    (count,) = found.counts
    assert (count.read, count.used, dict(count.rejected)) == (4, 1, {"not a transform": 3})
