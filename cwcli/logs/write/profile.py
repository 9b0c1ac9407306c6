"""Checks the channels of a log against its MCAP profile.

Source: https://mcap.dev/spec/registry, "Well-known profiles".
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from cwcli.logs.format.records import Channel, Schema

MESSAGE_AND_SCHEMA_ENCODINGS_BY_ROS_PROFILE = {"ros1": ("ros1", ("ros1msg",)), "ros2": ("cdr", ("ros2msg", "ros2idl"))}
"""Profile -> message encoding, and the allowed schema encodings (MCAP registry, "Well-known profiles")."""


def matches_ros_profile(profile: str, message_encoding: str, schema_encoding: str) -> bool:
    """Tell whether a channel conforms to a ROS profile; it may lack a schema (""), if the recorder did not find one."""
    expected, schema_encodings = MESSAGE_AND_SCHEMA_ENCODINGS_BY_ROS_PROFILE[profile]
    return message_encoding == expected and schema_encoding in ("", *schema_encodings)


def profile_kept_by_channels_or_empty(profile: str, channels: Iterable[Channel], schemas: Mapping[int, Schema]) -> str:
    """Return the profile, or "" if it is a ROS profile and a channel does not conform, on which other tools fail."""
    if profile not in MESSAGE_AND_SCHEMA_ENCODINGS_BY_ROS_PROFILE:
        return profile
    for channel in channels:
        schema = schemas.get(channel.schema_id)
        if not matches_ros_profile(profile, channel.message_encoding, schema.encoding if schema else ""):
            return ""
    return profile
