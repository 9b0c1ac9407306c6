"""Reads transforms between frames of reference: `tf2_msgs/TFMessage`, `foxglove.FrameTransform(s)`.

They hold texts inside lists of messages, which columns do not, and only the first messages matter: a camera stays where
it is mounted.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterator, Mapping
from itertools import islice
from typing import Any

from cwcli.logs.codecs.compressed_messages import decompress_message
from cwcli.logs.codecs.ros2msg import short_message_name
from cwcli.logs.read.channels import ChannelInfo
from cwcli.logs.read.message_reader import MessageReader
from cwcli.signals.transforms import Transform

LIST_SCHEMAS = frozenset(
    {"tf2_msgs/TFMessage", "tf/tfMessage", "foxglove_msgs/FrameTransforms", "foxglove.FrameTransforms"}
)
"""The message types with a list of transforms."""
SINGLE_TRANSFORM_SCHEMAS = frozenset({"foxglove_msgs/FrameTransform", "foxglove.FrameTransform"})
"""The message types with one transform."""
MAX_MESSAGES_PER_TOPIC = 2000
"""The number of messages that are read of each topic. Chosen by hand."""
MAX_TRANSFORMS_PER_MESSAGE = 10_000
"""The greatest number of transforms in a message. Chosen by hand."""


class UnreadableTransform(ValueError):
    """A message that can't be read."""


def is_transform_channel(channel: ChannelInfo) -> bool:
    """Tell whether a channel holds transforms that can be read."""
    return (
        _short_schema_name(channel) in LIST_SCHEMAS | SINGLE_TRANSFORM_SCHEMAS
        and channel.message_encoding in _DECODER_BY_ENCODING
    )


def iter_transforms(reader: MessageReader, channel: ChannelInfo) -> Iterator[tuple[Transform, ...] | None]:
    """Yield the transforms of each of the first `MAX_MESSAGES` messages; None for one that can't be read."""
    decode = _DECODER_BY_ENCODING[channel.message_encoding]
    name = _short_schema_name(channel)
    reader.distrust_indexes_if_miscounted([channel.id])
    payloads = (
        payload
        for _, _, batches in reader.iter_parts_in_time_order([channel.id])
        for batch in batches
        for _, payload in batch.iter_messages()
    )
    for payload in islice(payloads, MAX_MESSAGES_PER_TOPIC):
        try:
            yield tuple(decode(bytes(payload), name))
        except UnreadableTransform:
            yield None


def _short_schema_name(channel: ChannelInfo) -> str:
    return short_message_name(channel.schema_name) if "/" in channel.schema_name else channel.schema_name


def _decode_cdr(payload: bytes, name: str) -> list[Transform]:
    """Decode XCDR1. TransformStamped and FrameTransform agree: time, parent, child, translation, rotation.

    Raises:
        BadTransform: The message can't be read.
    """
    payload = decompress_message(payload)
    if len(payload) < 4 or payload[0] != 0 or payload[1] > 1:
        raise UnreadableTransform("not plain CDR")
    order = "<" if payload[1] else ">"
    body, at = memoryview(payload)[4:], 0

    def read_numbers(code: str, size: int) -> tuple[Any, ...]:
        nonlocal at
        at += -at % size
        numbers = struct.unpack_from(order + code, body, at)
        at += struct.calcsize(order + code)
        return numbers

    def read_string() -> str:
        nonlocal at
        (length,) = read_numbers("I", 4)
        if length > len(body) - at:
            raise UnreadableTransform("cut short")
        octets = bytes(body[at : at + length])
        at += length
        return octets.rstrip(b"\0").decode("utf-8", "replace")

    try:
        (n,) = read_numbers("I", 4) if name in LIST_SCHEMAS else (1,)
        if n > MAX_TRANSFORMS_PER_MESSAGE:
            raise UnreadableTransform("too many transforms")
        transforms = []
        for _ in range(n):
            read_numbers("iI", 4)
            parent, child = read_string(), read_string()
            values = read_numbers("7d", 8)
            transforms.append(_make_transform(parent, child, values[:3], values[3:]))
    except struct.error as error:
        raise UnreadableTransform("cut short") from error
    return transforms


def _decode_protobuf(payload: bytes, name: str) -> list[Transform]:
    from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
    from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
    from google.protobuf.message import DecodeError

    try:
        messages = (
            FrameTransforms.FromString(payload).transforms
            if name in LIST_SCHEMAS
            else [FrameTransform.FromString(payload)]
        )
    except DecodeError as error:
        raise UnreadableTransform("damaged") from error
    return [
        _make_transform(
            each.parent_frame_id,
            each.child_frame_id,
            (each.translation.x, each.translation.y, each.translation.z),
            (each.rotation.x, each.rotation.y, each.rotation.z, each.rotation.w),
        )
        for each in messages
    ]


def _decode_json(payload: bytes, name: str) -> list[Transform]:
    """Decode JSON with the field names of Foxglove or of ROS.

    Raises:
        BadTransform: The message can't be read.
    """
    try:
        document = json.loads(payload)
        messages = document["transforms"] if name in LIST_SCHEMAS else [document]
        transforms = []
        for each in messages:
            pose: Mapping[str, Any] = each.get("transform", each)
            parent = each.get("parent_frame_id") or each.get("header", {}).get("frame_id", "")
            translation, rotation = pose["translation"], pose["rotation"]
            transforms.append(
                _make_transform(
                    str(parent),
                    str(each["child_frame_id"]),
                    tuple(float(translation[axis]) for axis in "xyz"),
                    tuple(float(rotation[axis]) for axis in "xyzw"),
                )
            )
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError) as error:
        raise UnreadableTransform("not a transform") from error
    return transforms


def _make_transform(parent: str, child: str, translation: tuple[float, ...], rotation: tuple[float, ...]) -> Transform:
    x, y, z = translation
    qx, qy, qz, qw = rotation
    return Transform(parent.lstrip("/"), child.lstrip("/"), (x, y, z), (qx, qy, qz, qw))


_DECODER_BY_ENCODING: dict[str, Callable[[bytes, str], list[Transform]]] = {
    "cdr": _decode_cdr,
    "protobuf": _decode_protobuf,
    "json": _decode_json,
}
