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

from cwcli.logs.codecs.ros2msg import short_name
from cwcli.logs.codecs.unpacked import unpacked_message
from cwcli.logs.read.channels import ChannelInfo
from cwcli.logs.read.message_reader import MessageReader
from cwcli.signals.transforms import Transform

LISTS = frozenset({"tf2_msgs/TFMessage", "tf/tfMessage", "foxglove_msgs/FrameTransforms", "foxglove.FrameTransforms"})
"""The message types with a list of transforms."""
SINGLE = frozenset({"foxglove_msgs/FrameTransform", "foxglove.FrameTransform"})
"""The message types with one transform."""
MAX_MESSAGES = 2000
"""The number of messages that are read of each topic. Chosen by hand."""
MAX_LIST = 10_000
"""The greatest number of transforms in a message. Chosen by hand."""


class BadTransform(ValueError):
    """A message that can't be read."""


def is_transforms(channel: ChannelInfo) -> bool:
    """Tell whether a channel holds transforms that can be read."""
    return _name(channel) in LISTS | SINGLE and channel.message_encoding in _DECODERS


def stream_transforms(reader: MessageReader, channel: ChannelInfo) -> Iterator[tuple[Transform, ...] | None]:
    """Yield the transforms of each of the first `MAX_MESSAGES` messages; None for one that can't be read."""
    decode = _DECODERS[channel.message_encoding]
    name = _name(channel)
    reader.check_indexes([channel.id])
    payloads = (
        payload
        for _, _, batches in reader.in_time_order([channel.id])
        for batch in batches
        for _, payload in batch.messages()
    )
    for payload in islice(payloads, MAX_MESSAGES):
        try:
            yield tuple(decode(bytes(payload), name))
        except BadTransform:
            yield None


def _name(channel: ChannelInfo) -> str:
    return short_name(channel.schema_name) if "/" in channel.schema_name else channel.schema_name


def _cdr(payload: bytes, name: str) -> list[Transform]:
    """Decode XCDR1. TransformStamped and FrameTransform agree: time, parent, child, translation, rotation.

    Raises:
        BadTransform: The message can't be read.
    """
    payload = unpacked_message(payload)
    if len(payload) < 4 or payload[0] != 0 or payload[1] > 1:
        raise BadTransform("not plain CDR")
    order = "<" if payload[1] else ">"
    body, at = memoryview(payload)[4:], 0

    def read_numbers(code: str, size: int) -> tuple[Any, ...]:
        nonlocal at
        at += -at % size
        numbers = struct.unpack_from(order + code, body, at)
        at += struct.calcsize(order + code)
        return numbers

    def read_text() -> str:
        nonlocal at
        (length,) = read_numbers("I", 4)
        if length > len(body) - at:
            raise BadTransform("cut short")
        octets = bytes(body[at : at + length])
        at += length
        return octets.rstrip(b"\0").decode("utf-8", "replace")

    try:
        (n,) = read_numbers("I", 4) if name in LISTS else (1,)
        if n > MAX_LIST:
            raise BadTransform("too many transforms")
        transforms = []
        for _ in range(n):
            read_numbers("iI", 4)
            parent, child = read_text(), read_text()
            values = read_numbers("7d", 8)
            transforms.append(_transform(parent, child, values[:3], values[3:]))
    except struct.error as error:
        raise BadTransform("cut short") from error
    return transforms


def _protobuf(payload: bytes, name: str) -> list[Transform]:
    from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
    from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
    from google.protobuf.message import DecodeError

    try:
        messages = (
            FrameTransforms.FromString(payload).transforms if name in LISTS else [FrameTransform.FromString(payload)]
        )
    except DecodeError as error:
        raise BadTransform("damaged") from error
    return [
        _transform(
            each.parent_frame_id,
            each.child_frame_id,
            (each.translation.x, each.translation.y, each.translation.z),
            (each.rotation.x, each.rotation.y, each.rotation.z, each.rotation.w),
        )
        for each in messages
    ]


def _json(payload: bytes, name: str) -> list[Transform]:
    """Decode JSON with the field names of Foxglove or of ROS.

    Raises:
        BadTransform: The message can't be read.
    """
    try:
        document = json.loads(payload)
        messages = document["transforms"] if name in LISTS else [document]
        transforms = []
        for each in messages:
            pose: Mapping[str, Any] = each.get("transform", each)
            parent = each.get("parent_frame_id") or each.get("header", {}).get("frame_id", "")
            translation, rotation = pose["translation"], pose["rotation"]
            transforms.append(
                _transform(
                    str(parent),
                    str(each["child_frame_id"]),
                    tuple(float(translation[axis]) for axis in "xyz"),
                    tuple(float(rotation[axis]) for axis in "xyzw"),
                )
            )
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError) as error:
        raise BadTransform("not a transform") from error
    return transforms


def _transform(parent: str, child: str, translation: tuple[float, ...], rotation: tuple[float, ...]) -> Transform:
    x, y, z = translation
    qx, qy, qz, qw = rotation
    return Transform(parent.lstrip("/"), child.lstrip("/"), (x, y, z), (qx, qy, qz, qw))


_DECODERS: dict[str, Callable[[bytes, str], list[Transform]]] = {"cdr": _cdr, "protobuf": _protobuf, "json": _json}
