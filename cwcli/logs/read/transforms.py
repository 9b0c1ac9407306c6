"""Reads transforms between frames of reference: `tf2_msgs/TFMessage`, `foxglove.FrameTransform(s)`.

They hold texts inside lists of messages, which columns do not, and only the first messages matter: a camera stays where
it is mounted.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import islice
from typing import Any

from cwcli.logs.codecs.ros2msg import SchemaError, package_slash_message_name
from cwcli.logs.codecs.tree import UndecodableMessage, make_tree_decoder
from cwcli.logs.read.channels import ChannelInfo
from cwcli.logs.read.message_reader import MessageReader
from cwcli.signals.transforms import Transform

TRANSFORM_LIST_SCHEMAS = frozenset(
    {"tf2_msgs/TFMessage", "tf/tfMessage", "foxglove_msgs/FrameTransforms", "foxglove.FrameTransforms"}
)
"""The message types with a list of transforms."""
SINGLE_TRANSFORM_SCHEMAS = frozenset({"foxglove_msgs/FrameTransform", "foxglove.FrameTransform"})
"""The message types with one transform."""
READABLE_ENCODINGS = frozenset({"cdr", "protobuf", "json"})
"""The message encodings whose transforms can be read."""
MAX_TRANSFORM_MESSAGES_PER_TOPIC = 2000
"""The number of messages that are read of each topic. Chosen by hand."""
MAX_TRANSFORMS_PER_MESSAGE = 10_000
"""The greatest number of transforms in a message. Chosen by hand."""


def is_transform_channel(channel: ChannelInfo) -> bool:
    """Tell whether a channel holds transforms that can be read."""
    return (
        _short_schema_name(channel) in TRANSFORM_LIST_SCHEMAS | SINGLE_TRANSFORM_SCHEMAS
        and channel.message_encoding in READABLE_ENCODINGS
    )


def iter_transforms(reader: MessageReader, channel: ChannelInfo) -> Iterator[tuple[Transform, ...] | None]:
    """Yield the transforms of each message, at most `MAX_TRANSFORM_MESSAGES_PER_TOPIC`; None for an unreadable one."""
    reader.distrust_indexes_if_miscounted([channel.id])
    payloads = (
        payload
        for _, _, batches in reader.iter_log_times_offsets_and_batches_of_parts([channel.id])
        for batch in batches
        for _, payload in batch.iter_log_times_and_payloads()
    )
    is_list = _short_schema_name(channel) in TRANSFORM_LIST_SCHEMAS
    absent = dict.fromkeys("xyzw", 0.0) if channel.message_encoding == "protobuf" else None  # zeros are left out there
    try:
        decode = make_tree_decoder(channel)
    except SchemaError:
        decode = None
    for payload in islice(payloads, MAX_TRANSFORM_MESSAGES_PER_TOPIC):
        try:
            tree: Any = None if decode is None else decode(bytes(payload))
            messages = tree["transforms"] if is_list else [tree]
            is_readable = len(messages) <= MAX_TRANSFORMS_PER_MESSAGE
            yield tuple(_transform_of_tree(each, absent) for each in messages) if is_readable else None
        except (UndecodableMessage, ValueError, TypeError, KeyError, AttributeError, OverflowError):
            yield None


def _short_schema_name(channel: ChannelInfo) -> str:
    return package_slash_message_name(channel.schema_name) if "/" in channel.schema_name else channel.schema_name


def _transform_of_tree(tree: Mapping[str, Any], absent: Any) -> Transform:
    """Return the transform of a message with the field names of Foxglove or of ROS; `absent` replaces absent vectors.

    Raises:
        ValueError, TypeError, KeyError, AttributeError, OverflowError: It is no transform.
    """
    pose = tree.get("transform", tree)
    parent = tree.get("parent_frame_id") or tree.get("header", {}).get("frame_id", "")
    translation, rotation = (absent if pose[name] is None else pose[name] for name in ("translation", "rotation"))
    x, y, z = (float(translation[axis]) for axis in "xyz")
    qx, qy, qz, qw = (float(rotation[axis]) for axis in "xyzw")
    return Transform(str(parent).lstrip("/"), str(tree["child_frame_id"]).lstrip("/"), (x, y, z), (qx, qy, qz, qw))
