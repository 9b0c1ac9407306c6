"""Decoders of single messages for the reader of the official MCAP library."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from mcap.decoder import DecoderFactory
from mcap.records import Schema

from cwcli.errors import InputError
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.codecs.registry import ANY_SCHEMA_ENCODING, DECODER_MAKERS
from cwcli.logs.codecs.ros2msg import SchemaError
from cwcli.logs.codecs.tree import Decode, UndecodableMessage, make_protobuf_parser, make_tree_decoder


@dataclass(frozen=True)
class ChannelEncoding:
    """What the decoder of a channel depends on: the encoding of its messages, and its schema ("" without one)."""

    message_encoding: str
    schema_encoding: str = ""
    schema_name: str = ""
    schema_data: bytes = b""


class OfficialDecoderFactory(DecoderFactory):
    """Decodes the encodings that cwcli reads and writes; see `cwcli.decoder_factory`.

    Decoders are found by the content of a schema: its id means another schema in another file.
    """

    def __init__(self) -> None:
        self._decoders: dict[ChannelEncoding, Decode] = {}

    def decoder_for(self, message_encoding: str, schema: Schema | None) -> Callable[[bytes], Any] | None:
        """Return a decoder of messages, or None for an encoding that cwcli does not know.

        Raises:
            InputError: The schema can't be used.
        """
        channel = ChannelEncoding(message_encoding)
        if schema is not None:
            channel = ChannelEncoding(message_encoding, schema.encoding, schema.name, schema.data)
        accepted = {(message_encoding, channel.schema_encoding), (message_encoding, ANY_SCHEMA_ENCODING)}
        if accepted.isdisjoint(DECODER_MAKERS):
            return None
        if channel not in self._decoders:
            try:
                self._decoders[channel] = _make_decoder(channel)
            except SchemaError as error:
                raise InputError(f"the schema {channel.schema_name} can't be used: {error}") from error
        return self._decoders[channel]


def _make_decoder(channel: ChannelEncoding) -> Decode:
    """Return a function that decodes one message of a channel, and raises `InputError` for a damaged one."""
    decode = make_protobuf_parser(channel) if channel.message_encoding == "protobuf" else make_tree_decoder(channel)
    is_ros_message = channel.message_encoding == "cdr"

    def decode_or_raise(payload: bytes) -> object:
        try:
            value = decode(payload)
        except UndecodableMessage as error:
            what = f"a message of {channel.schema_name or channel.message_encoding} can't be decoded: {error}"
            raise InputError(what) from error
        return _dicts_to_attribute_objects(value) if is_ros_message else value

    return decode_or_raise


def _dicts_to_attribute_objects(value: object) -> object:
    """Return a tree of a ROS message with an object for each message in it, whose attributes are the fields."""
    if isinstance(value, dict):
        return SimpleNamespace(**{name: _dicts_to_attribute_objects(inner) for name, inner in value.items()})
    if isinstance(value, list):
        return [_dicts_to_attribute_objects(inner) for inner in value]
    return value
