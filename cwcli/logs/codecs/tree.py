"""Decodes single messages to trees: dictionaries, lists, numbers, truth values, texts, None for absent fields.

Columns have no texts inside lists and do not say to which element of a list a value belongs; a tree does. Decoding a
tree takes some hundred times longer, so it is for the few channels that need it.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from typing import Any

from cwcli.logs.codecs.cdr_program import MAX_NESTING
from cwcli.logs.codecs.protobuf import find_message
from cwcli.logs.codecs.protobuf_tables import is_repeated
from cwcli.logs.codecs.registry import ChannelLike
from cwcli.logs.codecs.ros2msg import (
    PRIMITIVES,
    STRING,
    WSTRING,
    Definitions,
    MessageField,
    SchemaError,
    find_definition,
    parse_definitions,
)
from cwcli.logs.codecs.unpacked import unpacked_message

FORMATS = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "i8": "q", "u8": "Q", "f4": "f", "f8": "d"}
"""NumPy type -> format character of `struct`."""


class BadMessage(ValueError):
    """A message that can't be decoded."""


Decode = Callable[[bytes], object]


def tree_decoder(channel: ChannelLike) -> Decode:
    """Return a function that decodes single messages of a channel, and raises `BadMessage`.

    Raises:
        SchemaError: The encoding or the schema is unknown or unusable.
    """
    make = _MAKERS.get(channel.message_encoding)
    if make is None:
        raise SchemaError(f"unknown message encoding {channel.message_encoding or '(none)'}")
    return make(channel)


def _json(channel: ChannelLike) -> Decode:
    return _from_json


def _from_json(payload: bytes) -> object:
    try:
        return json.loads(payload)
    except (ValueError, RecursionError) as error:
        raise BadMessage("no JSON") from error


def _protobuf(channel: ChannelLike) -> Decode:
    from google.protobuf.message_factory import GetMessageClass

    kind = GetMessageClass(find_message(channel.schema_name, channel.schema_data))

    def decode(payload: bytes) -> object:
        message = kind()
        try:
            message.ParseFromString(payload)
        except Exception as error:  # the parser's own error class has changed its place between versions
            raise BadMessage("damaged") from error
        return _plain(message, 0)

    return decode


def _plain(message: Any, depth: int) -> dict[str, object]:
    """Return the fields of a protobuf message; None for absent fields, the default for scalars without presence."""
    if depth > MAX_NESTING:
        raise BadMessage("nested too deeply")
    found: dict[str, object] = {}
    for each in message.DESCRIPTOR.fields:
        if each.message_type is not None and each.message_type.GetOptions().map_entry:
            continue
        value = getattr(message, each.name)
        if is_repeated(each):
            inner = [_plain(one, depth + 1) for one in value] if each.message_type is not None else list(value)
            found[each.name] = inner
        elif each.has_presence and not message.HasField(each.name):
            found[each.name] = None
        else:
            found[each.name] = _plain(value, depth + 1) if each.message_type is not None else value
    return found


def _cdr(channel: ChannelLike) -> Decode:
    root, definitions = parse_definitions(channel.schema_name, channel.schema_data.decode(errors="replace"))
    _check(root, definitions, ())

    def decode(payload: bytes) -> object:
        payload = unpacked_message(payload)
        if len(payload) < 4 or payload[0] != 0 or payload[1] > 1:
            raise BadMessage("not plain CDR")
        try:
            return _Body(payload, definitions).message(root)
        except struct.error as error:
            raise BadMessage("cut short") from error

    return decode


def _check(name: str, definitions: Definitions, parents: tuple[str, ...]) -> None:
    """Check that messages of a schema can be decoded.

    Raises:
        SchemaError: A message contains itself or a wstring, or is not defined.
    """
    if name in parents or len(parents) > MAX_NESTING:
        raise SchemaError(f"{name} contains itself")
    for each in find_definition(definitions, name):
        if each.type == WSTRING:
            raise SchemaError(f"{each.name} is a wstring, which CDR encoders write in different ways")
        if each.type not in PRIMITIVES and each.type != STRING:
            _check(each.type, definitions, (*parents, name))


class _Body:
    """Reads one message in XCDR1: primitives are aligned to their size, counted from the end of the header."""

    def __init__(self, payload: bytes, definitions: Definitions) -> None:
        self._order = "<" if payload[1] else ">"
        self._data = memoryview(payload)[4:]
        self._definitions = definitions
        self._at = 0

    def message(self, name: str) -> dict[str, object]:
        """Read the fields of a message by its short name."""
        fields = find_definition(self._definitions, name)
        if not fields:
            self._numbers("u1", 1)  # an empty message has one octet
        return {each.name: self._field(each) for each in fields}

    def _field(self, each: MessageField) -> object:
        if not each.is_sequence and each.length is None:
            return self._element(each)
        n = int(self._numbers("u4", 1)[0]) if each.is_sequence else each.length or 0
        if n > len(self._data) - self._at:  # an element has an octet at least
            raise BadMessage("cut short")
        if each.type in PRIMITIVES:
            values = self._numbers(PRIMITIVES[each.type], n)
            return [value != 0 for value in values] if each.type == "bool" else list(values)
        return [self._element(each) for _ in range(n)]

    def _element(self, each: MessageField) -> object:
        if each.type == STRING:
            return self._text()
        if each.type not in PRIMITIVES:
            return self.message(each.type)
        (value,) = self._numbers(PRIMITIVES[each.type], 1)
        return value != 0 if each.type == "bool" else value

    def _numbers(self, dtype: str, n: int) -> tuple[Any, ...]:
        if not n:
            return ()
        size = int(dtype[1])
        self._at += -self._at % size
        values = struct.unpack_from(f"{self._order}{n}{FORMATS[dtype]}", self._data, self._at)
        self._at += n * size
        return values

    def _text(self) -> str:
        (length,) = self._numbers("u4", 1)
        if length > len(self._data) - self._at:
            raise BadMessage("cut short")
        octets = bytes(self._data[self._at : self._at + length])
        self._at += length
        return octets.rstrip(b"\0").decode("utf-8", "replace")


_MAKERS: dict[str, Callable[[ChannelLike], Decode]] = {"cdr": _cdr, "protobuf": _protobuf, "json": _json}
"""Message encoding (MCAP registry) -> function that makes the decoder of a channel."""
