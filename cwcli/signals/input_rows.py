"""What the tables of inputs are made of: leaf fields of ROS and foxglove messages, builders imported when used."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

from cwcli.registry import named
from cwcli.signals.builders.base import Build, Fields, Reading
from cwcli.signals.stamp_fields import CDR_FOXGLOVE_STAMP, HEADER_STAMP, JSON_STAMPS, PROTOBUF_STAMP

if TYPE_CHECKING:
    from cwcli.signals.canonical import Signal
    from cwcli.signals.columns import Columns
    from cwcli.signals.quality import Quality

# How far back an input stands among those of its role, see `Input.rank`: 0 is a sensor's own message in a common form.
SUMMARY, RECEIVER, SENTENCE, FUSED, OWN_V2X, ODOMETRY = 1, 2, 3, 4, 5, 6
"""A receiver's summary for everybody, its own messages, NMEA, what it fused with an IMU; then other sources."""

CAN_SCHEMAS = frozenset({"can_msgs/Frame", "ros2_socketcan_msgs/FdFrame"})
CAN_FIELDS = (*HEADER_STAMP, *JSON_STAMPS, "id", "is_rtr", "is_error", "is_extended", "dlc", "len", "data")
"""Frames of a CAN bus: what they mean stands in a DBC file, and which role they fill says the user."""

TARGET_WORDS = frozenset({"target", "targets", "object", "objects", "obstacle", "obstacles"})
GIVEN_WORDS = frozenset({"initialpose", "initialpose3d", "goal", "checkpoint", "checkpoints", "waypoint"})
GNSS_WORDS = frozenset({"gps", "gnss", "ins", "navsat", "ublox", "novatel", "septentrio", "enu", "map"})


def in_signals(name: str) -> Any:
    """`module.name` of this package."""
    return named(":".join(f"cwcli.signals.{name}".rsplit(".", 1)))


def builder(name: str) -> Build:
    """The builder `module.name`, imported when a channel is built: binding (`cwcli info`) takes no numpy."""

    def build(columns: Columns, reading: Reading) -> tuple[Signal, Quality]:
        made: tuple[Signal, Quality] = in_signals(f"builders.{name}")(columns, reading)
        return made

    return build


def v2x_builder(maker: str, codec: str) -> Build:
    """The builder that `build_v2x.<maker>` makes for a codec, both imported when a channel is built."""

    def build(columns: Columns, reading: Reading) -> tuple[Signal, Quality]:
        made: tuple[Signal, Quality] = in_signals(f"builders.v2x.{maker}")(in_signals(codec))(columns, reading)
        return made

    return build


class LaterFields(Mapping[str, tuple[str, ...]]):
    """Leaf fields that are looked up in a codec's tables when they are needed."""

    def __init__(self, find: Callable[[], Fields]) -> None:
        self._find = find

    @cached_property
    def _found(self) -> Fields:
        return self._find()

    def __getitem__(self, encoding: str) -> tuple[str, ...]:
        return self._found[encoding]

    def __iter__(self) -> Iterator[str]:
        return iter(self._found)

    def __len__(self) -> int:
        return len(self._found)


def is_gnss_topic(topic: str) -> bool:
    """A topic whose twist is taken for a velocity over ground before its frame_id is known."""
    return not GNSS_WORDS.isdisjoint(re.split(r"[/_]+", topic.lower()))


def is_measured_topic(topic: str) -> bool:
    """A topic whose pose is one that the car had, not one that it was given or is to reach."""
    return GIVEN_WORDS.isdisjoint(re.split(r"[/_]+", topic.lower()))


def is_vehicle_topic(topic: str) -> bool:
    """A topic whose twist is taken for a body twist before its frame_id is known: every other one."""
    return not is_gnss_topic(topic)


def is_target_topic(topic: str) -> bool:
    """A truth topic that is about other road users."""
    return not TARGET_WORDS.isdisjoint(re.split(r"[/_]+", topic.lower()))


def is_ego_topic(topic: str) -> bool:
    """A truth topic that is about the ego: every other one."""
    return not is_target_topic(topic)


def ros(*leaves: str) -> Fields:
    """Leaf fields of a ROS message with a header: CDR, or JSON with the same names."""
    leaf_names = (*HEADER_STAMP, "header.frame_id", *leaves)
    return {"cdr": leaf_names, "json": (*leaf_names, *JSON_STAMPS)}


def foxglove(*leaves: str) -> Fields:
    """Leaf fields of a foxglove message: protobuf, JSON, or CDR (`foxglove_msgs`)."""
    return {
        "protobuf": (*PROTOBUF_STAMP, "frame_id", *leaves),
        "json": (*JSON_STAMPS, "frame_id", *leaves),
        "cdr": (*CDR_FOXGLOVE_STAMP, "frame_id", *leaves),
    }


def xyz(path: str) -> tuple[str, ...]:
    return tuple(f"{path}.{axis}" for axis in "xyz")


def quaternion(path: str) -> tuple[str, ...]:
    return tuple(f"{path}.{axis}" for axis in "xyzw")
