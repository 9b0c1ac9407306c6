"""Message definitions of ROS 1, parsed without generating code: their checksum, and the same in the language of ROS 2.

Language and checksum: http://wiki.ros.org/msg, http://wiki.ros.org/ROS/Technical%20Overview
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from cwcli.logs.codecs.ros2msg import (
    PRIMITIVE_DTYPES,
    STRING_TYPE,
    Definitions,
    MessageField,
    SchemaError,
    find_message_fields,
    parse_message_definitions,
    split_definitions,
)

MAX_DEFINITION_BYTES = 1 << 18
"""The greatest size of a definition with all that it uses, 256 KiB. Chosen by hand: the largest of ROS have 60 kB."""
MAX_TYPE_DEPTH = 64
"""The greatest depth of messages inside each other. Chosen by hand."""
TIME_TYPES = {"time": "builtin_interfaces/Time", "duration": "builtin_interfaces/Duration"}
"""Primitive types of ROS 1 that are messages in ROS 2, with the same bytes."""
HEADER_TYPE = "std_msgs/Header"
"""The message whose sequence number ROS 2 has dropped."""
SEQUENCE_NUMBER_FIELD_OF_ROS1_HEADER = MessageField("seq", "uint32", is_sequence=False, length=None)
"""The first field of ROS 1's header, which ROS 2's does not have."""
ROS1_HEADER_FIELDS = (
    SEQUENCE_NUMBER_FIELD_OF_ROS1_HEADER,
    MessageField("stamp", TIME_TYPES["time"], is_sequence=False, length=None),
    MessageField("frame_id", STRING_TYPE, is_sequence=False, length=None),
)
"""The fields of ROS 1's header (http://docs.ros.org/en/api/std_msgs/html/msg/Header.html)."""
DEFINITION_SEPARATOR_LINE = "=" * 80
"""The line between two message definitions in the text of a connection (rosbag format 2.0)."""
_CONSTANT_LINE_PATTERN = re.compile(r"^\s*(\w+)\s+(\w+)\s*=(.*)$")
"""The pattern of a line with a constant: type, name, value."""


class Constant(NamedTuple):
    """A constant of a message, as texts; `value` without spaces around it."""

    type: str
    name: str
    value: str


class Ros1Definition(NamedTuple):
    """A message type with all that it uses.

    Attributes:
        root: Short name `package/Name`.
        fields: Fields of each message by short name; times are messages of ROS 2.
        constants: Constants of each message by short name.
    """

    root: str
    fields: Definitions
    constants: Mapping[str, tuple[Constant, ...]]


def parse_ros1_definition(type_name: str, text: str) -> Ros1Definition:
    """Parse the definition of a connection.

    Raises:
        SchemaError: It is too long, can't be understood, or a message holds itself, is undefined or too deep.
    """
    if len(text) > MAX_DEFINITION_BYTES:
        raise SchemaError(f"the definition has {len(text):,} characters, more than {MAX_DEFINITION_BYTES:,}")
    root, fields = parse_message_definitions(type_name, text, TIME_TYPES)
    constants = {name: tuple(_iter_constants_of_message(body)) for name, body in split_definitions(root, text)}
    definition = Ros1Definition(root, fields, constants)
    list(message_names_by_first_use(definition))
    return definition


def _iter_constants_of_message(body: str) -> Iterator[Constant]:
    """Yield the constants of a message; a `#` in a text is part of it (http://wiki.ros.org/msg)."""
    for line in body.splitlines():
        found = _CONSTANT_LINE_PATTERN.match(line)
        if found is not None:
            kind, name, value = found.groups()
            yield Constant(kind, name, (value if kind == STRING_TYPE else value.partition("#")[0]).strip())


def message_names_by_first_use(definition: Ros1Definition) -> Iterator[str]:
    """Yield the messages that a type uses, itself first, each once, in the order of their first use.

    Raises:
        SchemaError: One holds itself, is not defined, or is too deep.
    """
    visited: set[str] = set()
    stack: list[tuple[str, Iterator[MessageField]]] = [
        (definition.root, iter(find_message_fields(definition.fields, definition.root)))
    ]
    yield definition.root
    while stack:
        name, fields = stack[-1]
        field = next(fields, None)
        if field is None:
            visited.add(name)
            stack.pop()
        elif not is_number_or_text_type(field.type) and field.type not in visited:
            if any(each == field.type for each, _ in stack):
                raise SchemaError(f"the message {field.type} holds itself")
            if len(stack) == MAX_TYPE_DEPTH:
                raise SchemaError(f"messages are more than {MAX_TYPE_DEPTH} deep inside each other")
            stack.append((field.type, iter(find_message_fields(definition.fields, field.type))))
            yield field.type


def is_number_or_text_type(name: str) -> bool:
    """Tell whether a type is a number or a text, no message."""
    return name in PRIMITIVE_DTYPES or name == STRING_TYPE


def has_ros1_header(definition: Ros1Definition) -> bool:
    """Tell whether the definition's header is that of ROS 1, with the sequence number that ROS 2 does not have."""
    return definition.fields.get(HEADER_TYPE) == ROS1_HEADER_FIELDS


def definition_checksum(definition: Ros1Definition) -> str:
    """Return the MD5 by which ROS 1 tells definitions apart, in hexadecimal."""
    names = list(message_names_by_first_use(definition))
    ros1_names = {ros2: ros1 for ros1, ros2 in TIME_TYPES.items()}
    sums: dict[str, str] = {}

    def checksum_line_of_field(field: MessageField) -> str:
        kind = ros1_names.get(field.type, field.type)
        if kind not in TIME_TYPES and not is_number_or_text_type(kind):
            return f"{sums[kind]} {field.name}"
        return f"{kind}{_array_brackets_of_field(field)} {field.name}"

    for name in _order_message_names_by_use(definition, names):
        lines = [f"{each.type} {each.name}={each.value}" for each in definition.constants.get(name, ())]
        lines += [checksum_line_of_field(field) for field in definition.fields[name]]
        sums[name] = hashlib.md5("\n".join(lines).encode(), usedforsecurity=False).hexdigest()
    return sums[definition.root]


def _order_message_names_by_use(definition: Ros1Definition, names: list[str]) -> list[str]:
    """Return the names such that each comes behind those that it uses."""
    ordered: dict[str, None] = {}

    def add_type_after_its_types(name: str) -> None:
        if name not in ordered:
            for field in definition.fields[name]:
                if not is_number_or_text_type(field.type):
                    add_type_after_its_types(field.type)
            ordered[name] = None

    for name in names:
        add_type_after_its_types(name)
    return list(ordered)


def _array_brackets_of_field(field: MessageField) -> str:
    if field.is_sequence:
        return "[]"
    return "" if field.length is None else f"[{field.length}]"


def ros2_definition_text(definition: Ros1Definition) -> str:
    """Return the definition in the language of ROS 2 (`ros2msg`), with ROS 2's header."""
    parts: list[str] = []
    drops_sequence = has_ros1_header(definition)
    for name in message_names_by_first_use(definition):
        lines = [f"{each.type} {each.name}={each.value}" for each in definition.constants.get(name, ())]
        fields = definition.fields[name][1 if drops_sequence and name == HEADER_TYPE else 0 :]
        lines += [f"{field.type}{_array_brackets_of_field(field)} {field.name}" for field in fields]
        head = f"{DEFINITION_SEPARATOR_LINE}\nMSG: {name}\n" if parts else ""
        parts.append(head + "".join(f"{line}\n" for line in lines))
    return "".join(parts)
