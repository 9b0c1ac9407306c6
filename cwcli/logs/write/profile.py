"""What a log's profile promises of its channels.

Source: https://mcap.dev/spec/registry, "Well-known profiles".
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from cwcli.logs.format.records import Channel, Schema

ROS_ENCODINGS = {"ros1": ("ros1", ("ros1msg",)), "ros2": ("cdr", ("ros2msg", "ros2idl"))}
"""Profile -> the messages' encoding, and those of their schemas."""


def is_of_profile(profile: str, message_encoding: str, schema_encoding: str) -> bool:
    """Whether a ROS profile promises such a channel; "" is no schema: recorders that did not find the definition."""
    expected, schema_encodings = ROS_ENCODINGS[profile]
    return message_encoding == expected and schema_encoding in ("", *schema_encodings)


def kept_profile(profile: str, channels: Iterable[Channel], schemas: Mapping[int, Schema]) -> str:
    """The profile, or none where it is a ROS one and a channel is not of ROS: tools that go by it fail on it."""
    if profile not in ROS_ENCODINGS:
        return profile
    for channel in channels:
        schema = schemas.get(channel.schema_id)
        if not is_of_profile(profile, channel.message_encoding, schema.encoding if schema else ""):
            return ""
    return profile
