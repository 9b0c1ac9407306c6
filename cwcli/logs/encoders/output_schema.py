"""Schemas of messages that cwcli writes, with their encoders: CDR for names of ROS 2 messages, else protobuf."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache, partial

from cwcli.lazy_dataclass import dataclass
from cwcli.logs.encoders.byte_rows import ByteRows
from cwcli.logs.encoders.ros_schemas import is_ros2_message_name, ros2msg_schema_text
from cwcli.signals.columns import OutputField

PROTOBUF_MESSAGE_ENCODING = "protobuf"
"""The message encoding of protobuf channels (MCAP registry)."""
PROTOBUF_SCHEMA_ENCODING = "protobuf"
"""The schema encoding of protobuf channels (MCAP registry)."""
ROS_MESSAGE_ENCODING, ROS_SCHEMA_ENCODING = "cdr", "ros2msg"
"""The message and schema encoding of ROS 2 channels (MCAP registry)."""


@dataclass(frozen=True)
class OutputSchema:
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
def find_output_schema(name: str) -> OutputSchema:
    """Return the schema of a message by its full name: `cwcli.v1.VehicleState`, `nav_msgs/msg/Odometry`.

    Raises:
        KeyError: There is no such message.
    """
    if is_ros2_message_name(name):
        from cwcli.logs.encoders.cdr_encoder import encode_cdr

        text = ros2msg_schema_text(name).encode()
        return OutputSchema(name, ROS_SCHEMA_ENCODING, text, ROS_MESSAGE_ENCODING, partial(encode_cdr, name))
    from cwcli.logs.encoders.protobuf_encoder import encode_protobuf
    from cwcli.logs.encoders.schemas import find_message_schema

    schema = find_message_schema(name)
    return OutputSchema(
        name,
        PROTOBUF_SCHEMA_ENCODING,
        schema.data,
        PROTOBUF_MESSAGE_ENCODING,
        partial(encode_protobuf, schema.descriptor),
    )
