"""The parts of the tables of inputs: leaf fields of ROS and foxglove messages, and builders imported when used."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

from cwcli.registry import import_module_attribute
from cwcli.signals.builders.base import Build, Fields, Input, Reading
from cwcli.signals.role import Role
from cwcli.signals.stamp_fields import (
    CDR_FOXGLOVE_STAMP_FIELDS,
    HEADER_STAMP_FIELDS,
    JSON_STAMP_FIELDS,
    PROTOBUF_STAMP_FIELDS,
)

if TYPE_CHECKING:
    from cwcli.signals.canonical import Signal
    from cwcli.signals.columns import Columns
    from cwcli.signals.quality import Quality

# How far back an input stands among those of its role, see `Input.rank`: 0 is a sensor's own message in a common form.
RECEIVER_SUMMARY_RANK, RECEIVER_RANK, NMEA_SENTENCE_RANK, FUSED_INS_RANK, OWN_V2X_RANK, ODOMETRY_RANK = 1, 2, 3, 4, 5, 6
"""The ranks of inputs for one role (see `Input.rank`): a receiver's summary message, its own messages, NMEA, its fusion
with an IMU, the ego's V2X messages, an odometry. Rank 0 is a sensor's own message in a common form."""

CAN_FRAME_SCHEMAS = frozenset({"can_msgs/Frame", "ros2_socketcan_msgs/FdFrame"})
"""The schemas of CAN frames; a DBC file says what they mean, and the user which role they fill."""
CAN_FRAME_FIELDS = (
    *HEADER_STAMP_FIELDS,
    *JSON_STAMP_FIELDS,
    "id",
    "is_rtr",
    "is_error",
    "is_extended",
    "dlc",
    "len",
    "data",
)
"""The leaf fields of CAN frames."""

TARGET_TOPIC_WORDS = frozenset({"target", "targets", "object", "objects", "obstacle", "obstacles"})
"""The words in a topic's name that mean other road users."""
COMMANDED_POSE_TOPIC_WORDS = frozenset(
    {"initialpose", "initialpose3d", "goal", "checkpoint", "checkpoints", "waypoint"}
)
"""The words in a topic's name that mean a pose that was commanded and not measured."""
GNSS_TOPIC_WORDS = frozenset({"gps", "gnss", "ins", "navsat", "ublox", "novatel", "septentrio", "enu", "map"})
"""The words in a topic's name that mean a receiver, whose twist is a velocity over ground."""


def load_attribute_of_signals(name: str) -> Any:
    """Import and return `module.name` of this package."""
    return import_module_attribute(":".join(f"cwcli.signals.{name}".rsplit(".", 1)))


def builder_imported_at_first_call(*builder_and_first_arguments: str) -> Build:
    """Return the builder at the first place, `module.name` of this package, which takes what is at the others first.

    All are imported when a channel is built, because binding (`cwcli info`) needs no NumPy.
    """

    def call_builder(columns: Columns, reading: Reading) -> tuple[Signal, Quality]:
        function, *first_arguments = map(load_attribute_of_signals, builder_and_first_arguments)
        built: tuple[Signal, Quality] = function(*first_arguments, columns, reading)
        return built

    return call_builder


def inputs_of_message(fields: Fields, rank: int | None = 0, **builder_by_role: str) -> tuple[Input, ...]:
    """Return the registry rows of a message; `builder_by_role` has each role's function of `builders`."""
    return tuple(
        Input(Role[role.upper()], fields, builder_imported_at_first_call(f"builders.{name}"), rank=rank)
        for role, name in builder_by_role.items()
    )


def inputs_of_receiver_message(fields: Fields, rank: int | None, reader: str, *roles: Role) -> tuple[Input, ...]:
    """Return the registry rows of a message that `builders.<reader>` reads as a `GnssFix`: one for each role."""
    build = builder_imported_at_first_call("builders.gnss.build_signal_of_fix", f"builders.{reader}")
    return tuple(Input(role, fields, build, rank=rank) for role in roles)


class LazyFields(Mapping[str, tuple[str, ...]]):
    """The leaf fields of a V2X message in CDR and JSON, which stand in its codec's module and are imported when they
    are first needed."""

    def __init__(self, name: str, encodings: tuple[str, ...] = ("cdr", "json")) -> None:
        self._name, self._encodings = name, encodings

    @cached_property
    def _leaf_fields(self) -> tuple[str, ...]:
        leaves: tuple[str, ...] = load_attribute_of_signals(self._name)
        return leaves

    def __getitem__(self, encoding: str) -> tuple[str, ...]:
        if encoding not in self._encodings:
            raise KeyError(encoding)
        return self._leaf_fields

    def __iter__(self) -> Iterator[str]:
        return iter(self._encodings)

    def __len__(self) -> int:
        return len(self._encodings)


def does_topic_name_receiver(topic: str) -> bool:
    """Return whether a topic's twist is taken for a velocity over ground before its frame_id is known."""
    return not GNSS_TOPIC_WORDS.isdisjoint(re.split(r"[/_]+", topic.lower()))


def is_measured_pose_topic(topic: str) -> bool:
    """Return whether a topic's pose is measured, and not a commanded or wanted one."""
    return COMMANDED_POSE_TOPIC_WORDS.isdisjoint(re.split(r"[/_]+", topic.lower()))


def is_body_twist_topic(topic: str) -> bool:
    """Return whether a topic's twist is taken for a body twist before its frame_id is known."""
    return not does_topic_name_receiver(topic)


def is_target_truth_topic(topic: str) -> bool:
    """Return whether a truth topic is about other road users."""
    return not TARGET_TOPIC_WORDS.isdisjoint(re.split(r"[/_]+", topic.lower()))


def is_ego_truth_topic(topic: str) -> bool:
    """Return whether a truth topic is about the ego."""
    return not is_target_truth_topic(topic)


def ros_leaf_fields(*leaves: str) -> Fields:
    """Return the leaf fields of a ROS message with a header, by encoding: CDR, and JSON with the same names."""
    leaf_names = (*HEADER_STAMP_FIELDS, "header.frame_id", *leaves)
    return {"cdr": leaf_names, "json": (*leaf_names, *JSON_STAMP_FIELDS)}


def header_free_leaf_fields(*leaves: str) -> Fields:
    """Return the leaf fields of a ROS message without a header, by encoding."""
    return {"cdr": leaves, "json": leaves}


def foxglove_leaf_fields(*leaves: str) -> Fields:
    """Return the leaf fields of a foxglove message, by encoding: protobuf, JSON and CDR (`foxglove_msgs`)."""
    return {
        "protobuf": (*PROTOBUF_STAMP_FIELDS, "frame_id", *leaves),
        "json": (*JSON_STAMP_FIELDS, "frame_id", *leaves),
        "cdr": (*CDR_FOXGLOVE_STAMP_FIELDS, "frame_id", *leaves),
    }


def xyz_leaf_paths(path: str) -> tuple[str, ...]:
    return tuple(f"{path}.{axis}" for axis in "xyz")


def quaternion_leaf_paths(path: str) -> tuple[str, ...]:
    return tuple(f"{path}.{axis}" for axis in "xyzw")
