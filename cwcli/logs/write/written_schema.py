"""Schemas of messages that cwcli writes, with their encoders: CDR for names of ROS 2 messages, else protobuf."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial

from cwcli.logs.write.byte_rows import ByteRows
from cwcli.logs.write.ros_schemas import is_ros, ros_schema
from cwcli.signals.columns import OutputField

MESSAGE_ENCODING = "protobuf"
"""The message encoding of protobuf channels (MCAP registry)."""
SCHEMA_ENCODING = "protobuf"
"""The schema encoding of protobuf channels (MCAP registry)."""
ROS_MESSAGE_ENCODING, ROS_SCHEMA_ENCODING = "cdr", "ros2msg"
"""The message and schema encoding of ROS 2 channels (MCAP registry)."""


@dataclass(frozen=True)
class WrittenSchema:
    """A schema and its encoder.

    Attributes:
        name, encoding, data: The schema record.
        message_encoding: The message encoding of its channels.
        encode: Columns and their number of rows -> that many messages; raises `ColumnError` if they don't fit.
    """

    name: str
    encoding: str
    data: bytes
    message_encoding: str
    encode: Callable[[Mapping[str, OutputField], int], ByteRows]


@cache
def written_schema(name: str) -> WrittenSchema:
    """Return the schema of a message by its full name: `cwcli.v1.VehicleState`, `nav_msgs/msg/Odometry`.

    Raises:
        KeyError: There is no such message.
    """
    if is_ros(name):
        from cwcli.logs.write.cdr_encoder import encode_cdr

        text = ros_schema(name).encode()
        return WrittenSchema(name, ROS_SCHEMA_ENCODING, text, ROS_MESSAGE_ENCODING, partial(encode_cdr, name))
    from cwcli.logs.write.protobuf_encoder import encode_columns
    from cwcli.logs.write.schemas import message_schema

    schema = message_schema(name)
    return WrittenSchema(
        name, SCHEMA_ENCODING, schema.data, MESSAGE_ENCODING, partial(encode_columns, schema.descriptor)
    )
