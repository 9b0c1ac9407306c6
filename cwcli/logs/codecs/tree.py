"""Decodes single messages to trees: dictionaries, lists, numbers, truth values, texts, None for absent fields.

Columns have no texts inside lists and do not say to which element of a list a value belongs; a tree does. Decoding a
tree takes some hundred times longer, so it is for the few channels that need it.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from typing import Any

from cwcli.logs.codecs.cdr_program import MAX_MESSAGE_NESTING
from cwcli.logs.codecs.compressed_messages import decompress_message
from cwcli.logs.codecs.protobuf import find_message_descriptor, make_message_class
from cwcli.logs.codecs.protobuf_tables import is_repeated_field
from cwcli.logs.codecs.registry import ChannelLike
from cwcli.logs.codecs.ros2msg import (
    PRIMITIVE_DTYPES,
    STRING_TYPE,
    WSTRING_TYPE,
    Definitions,
    MessageField,
    SchemaError,
    find_message_fields,
    parse_message_definitions,
)

STRUCT_FORMAT_BY_DTYPE = {
    "i1": "b",
    "u1": "B",
    "i2": "h",
    "u2": "H",
    "i4": "i",
    "u4": "I",
    "i8": "q",
    "u8": "Q",
    "f4": "f",
    "f8": "d",
}
"""NumPy type -> format character of `struct`."""


class UndecodableMessage(ValueError):
    """A message that can't be decoded."""


Decode = Callable[[bytes], object]


def make_tree_decoder(channel: ChannelLike) -> Decode:
    """Return a function that decodes single messages of a channel, and raises `UndecodableMessage`.

    Raises:
        SchemaError: The encoding or the schema is unknown or unusable.
    """
    make = _DECODER_MAKERS.get(channel.message_encoding)
    if make is None:
        raise SchemaError(f"unknown message encoding {channel.message_encoding or '(none)'}")
    return make(channel)


def _make_json_decoder(channel: ChannelLike) -> Decode:
    return _decode_json


def _decode_json(payload: bytes) -> object:
    try:
        return json.loads(payload)
    except (ValueError, RecursionError) as error:
        raise UndecodableMessage("no JSON") from error


def make_protobuf_parser(channel: ChannelLike) -> Decode:
    """Return a function that decodes single messages of a protobuf channel to objects of their class.

    Raises:
        SchemaError: The schema can't be used.
    """
    message_class = make_message_class(find_message_descriptor(channel.schema_name, channel.schema_data))

    def parse_protobuf_message(payload: bytes) -> object:
        message = message_class()
        try:
            message.ParseFromString(payload)
        except Exception as error:  # the parser's own error class has changed its place between versions
            raise UndecodableMessage("damaged") from error
        return message

    return parse_protobuf_message


def _make_protobuf_decoder(channel: ChannelLike) -> Decode:
    parse = make_protobuf_parser(channel)
    return lambda payload: _protobuf_message_to_dict(parse(payload), 0)


def _protobuf_message_to_dict(message: Any, depth: int) -> dict[str, object]:
    """Return the fields of a protobuf message; None for absent fields, the default for scalars without presence."""
    if depth > MAX_MESSAGE_NESTING:
        raise UndecodableMessage("nested too deeply")
    found: dict[str, object] = {}
    for each in message.DESCRIPTOR.fields:
        if each.message_type is not None and each.message_type.GetOptions().map_entry:
            continue
        value = getattr(message, each.name)
        if is_repeated_field(each):
            inner = (
                [_protobuf_message_to_dict(one, depth + 1) for one in value]
                if each.message_type is not None
                else list(value)
            )
            found[each.name] = inner
        elif each.has_presence and not message.HasField(each.name):
            found[each.name] = None
        else:
            found[each.name] = _protobuf_message_to_dict(value, depth + 1) if each.message_type is not None else value
    return found


def _make_cdr_decoder(channel: ChannelLike) -> Decode:
    root, definitions = parse_message_definitions(channel.schema_name, channel.schema_data.decode(errors="replace"))
    _check_decodable(root, definitions, ())

    def decode_cdr_message(payload: bytes) -> object:
        payload = decompress_message(payload)
        if len(payload) < 4 or payload[0] != 0 or payload[1] > 1:
            raise UndecodableMessage("not plain CDR")
        try:
            return _CdrReader(payload, definitions).read_message(root)
        except struct.error as error:
            raise UndecodableMessage("cut short") from error

    return decode_cdr_message


def _check_decodable(name: str, definitions: Definitions, parents: tuple[str, ...]) -> None:
    """Check that messages of a schema can be decoded.

    Raises:
        SchemaError: A message contains itself or a wstring, or is not defined.
    """
    if name in parents or len(parents) > MAX_MESSAGE_NESTING:
        raise SchemaError(f"{name} contains itself")
    for each in find_message_fields(definitions, name):
        if each.type == WSTRING_TYPE:
            raise SchemaError(f"{each.name} is a wstring, which CDR encoders write in different ways")
        if each.type not in PRIMITIVE_DTYPES and each.type != STRING_TYPE:
            _check_decodable(each.type, definitions, (*parents, name))


class _CdrReader:
    """Reads one message in XCDR1: primitives are aligned to their size, counted from the end of the header."""

    def __init__(self, payload: bytes, definitions: Definitions) -> None:
        self._order = "<" if payload[1] else ">"
        self._data = memoryview(payload)[4:]
        self._definitions = definitions
        self._at = 0

    def read_message(self, name: str) -> dict[str, object]:
        """Read the fields of a message by its short name."""
        fields = find_message_fields(self._definitions, name)
        if not fields:
            self._read_numbers("u1", 1)  # an empty message has one octet
        return {each.name: self._read_field(each) for each in fields}

    def _read_field(self, field: MessageField) -> object:
        if not field.is_sequence and field.length is None:
            return self._read_element(field)
        n = int(self._read_numbers("u4", 1)[0]) if field.is_sequence else field.length or 0
        if n > len(self._data) - self._at:  # an element has an octet at least
            raise UndecodableMessage("cut short")
        if field.type in PRIMITIVE_DTYPES:
            values = self._read_numbers(PRIMITIVE_DTYPES[field.type], n)
            return [value != 0 for value in values] if field.type == "bool" else list(values)
        return [self._read_element(field) for _ in range(n)]

    def _read_element(self, field: MessageField) -> object:
        if field.type == STRING_TYPE:
            return self._read_text()
        if field.type not in PRIMITIVE_DTYPES:
            return self.read_message(field.type)
        (value,) = self._read_numbers(PRIMITIVE_DTYPES[field.type], 1)
        return value != 0 if field.type == "bool" else value

    def _read_numbers(self, dtype: str, n: int) -> tuple[Any, ...]:
        if not n:
            return ()
        size = int(dtype[1])
        self._at += -self._at % size
        values = struct.unpack_from(f"{self._order}{n}{STRUCT_FORMAT_BY_DTYPE[dtype]}", self._data, self._at)
        self._at += n * size
        return values

    def _read_text(self) -> str:
        (length,) = self._read_numbers("u4", 1)
        if length > len(self._data) - self._at:
            raise UndecodableMessage("cut short")
        octets = bytes(self._data[self._at : self._at + length])
        self._at += length
        return octets.rstrip(b"\0").decode("utf-8", "replace")


_DECODER_MAKERS: dict[str, Callable[[ChannelLike], Decode]] = {
    "cdr": _make_cdr_decoder,
    "protobuf": _make_protobuf_decoder,
    "json": _make_json_decoder,
}
"""Message encoding (MCAP registry) -> function that makes the decoder of a channel."""
