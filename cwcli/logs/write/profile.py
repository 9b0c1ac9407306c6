"""What a log's profile promises of its channels.

Source: https://mcap.dev/spec/registry, "Well-known profiles".
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from cwcli.logs.format.records import Channel, Schema

ROS_ENCODINGS = {"ros1": ("ros1", ("ros1msg",)), "ros2": ("cdr", ("ros2msg", "ros2idl"))}
"""Profile -> the messages' encoding, and those of their schemas."""


def kept_profile(profile: str, channels: Iterable[Channel], schemas: Mapping[int, Schema]) -> str:
    """The profile, or none where it is a ROS one and a channel is not of ROS: tools that go by it fail on it."""
    if profile not in ROS_ENCODINGS:
        return profile
    message_encoding, schema_encodings = ROS_ENCODINGS[profile]
    for channel in channels:
        schema = schemas.get(channel.schema_id)  # none: recorders that did not find the definition
        if channel.message_encoding != message_encoding or (schema and schema.encoding not in schema_encodings):
            return ""
    return profile
