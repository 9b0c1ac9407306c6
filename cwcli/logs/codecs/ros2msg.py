"""Parses `ros2msg` schema texts: message definitions one after the other, as ROS 2 concatenates them.

Source: https://docs.ros.org/en/rolling/Concepts/Basic/About-Interfaces.html and the MCAP registry's `ros2msg`.
Constants, default values, bounds and comments do not change the bytes of a message and are skipped.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import NamedTuple

PRIMITIVE_DTYPES: dict[str, str] = {
    "bool": "u1",
    "byte": "u1",
    "char": "i1",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "int64": "i8",
    "uint64": "u8",
    "float32": "f4",
    "float64": "f8",
}
"""Primitive type -> NumPy type (ROS 2 interface definitions). `char` is signed, as the official decoder reads it."""

STRING_TYPE = "string"
"""The type name of texts in UTF-8."""
WSTRING_TYPE = "wstring"
"""The type name of texts in UTF-16, which cwcli does not decode."""
_DEFINITION_SEPARATOR = re.compile(r"^={3,}\s*$", re.MULTILINE)
"""The pattern of the line between two message definitions."""
_MESSAGE_NAME_LINE_PATTERN = re.compile(r"^MSG:\s+(\S+)\s*$", re.MULTILINE)
"""The pattern of the line that names the message of a definition."""
_FIELD_TYPE_PATTERN = re.compile(r"^([\w/]+)(<=\d+)?(?:\[(<=)?(\d*)\])?$")
"""The pattern of a field's type: name, bound of a string, bound and length of an array."""
_CONSTANT_ASSIGNMENT = re.compile(r"^\w+\s*=")
"""The pattern of a constant's name and equals sign."""


class SchemaError(ValueError):
    """A schema that can't be understood, or holds what cwcli does not decode."""


class MessageField(NamedTuple):
    """A field of a message.

    Attributes:
        type: A primitive, `string`, `wstring`, or a message by its short name `package/Name`.
        is_sequence: The number of elements is part of the message.
        length: Elements of a fixed array, or None.
    """

    name: str
    type: str
    is_sequence: bool
    length: int | None


MAX_SCHEMA_CHARS = 4_000_000
"""The greatest length of a schema. Chosen by hand: its lines take 20 times the memory; real ones have 0.1 million."""
MAX_ARRAY_ELEMENTS = 1 << 24
"""The greatest number of elements of a fixed array. Chosen by hand."""
MAX_DIGITS_OF_ARRAY_LENGTH = 18
"""The greatest number of digits in the length of an array: a number of that size fits in 64 bits."""

Definitions = dict[str, tuple[MessageField, ...]]
_PREDEFINED_MESSAGES: Definitions = dict.fromkeys(
    ("builtin_interfaces/Time", "builtin_interfaces/Duration"),
    tuple(
        MessageField(name, kind, is_sequence=False, length=None)
        for name, kind in (("sec", "int32"), ("nanosec", "uint32"))
    ),
)
"""The messages that a schema may use without a definition (builtin_interfaces)."""


NO_ALIASES: Mapping[str, str] = MappingProxyType({})
"""No type has another name."""


def parse_message_definitions(
    schema_name: str, text: str, aliases: Mapping[str, str] = NO_ALIASES
) -> tuple[str, Definitions]:
    """Parse the messages of a schema.

    Args:
        aliases: Name of a type as the fields have it -> short name of the message that it stands for.

    Returns:
        Short name of the root message, and the fields of each message by short name.

    Raises:
        SchemaError: The text can't be understood, or is too long.
    """
    if len(text) > MAX_SCHEMA_CHARS:
        raise SchemaError(f"the schema has {len(text):,} characters, more than {MAX_SCHEMA_CHARS:,}")
    root = package_slash_message_name(schema_name)
    definitions = dict(_PREDEFINED_MESSAGES)
    for name, body in split_definitions(root, text):
        definitions[name] = _parse_fields(name.split("/")[0], body, aliases)
    if root not in definitions:
        raise SchemaError(f"the schema does not define {schema_name}")
    return root, definitions


def split_definitions(root: str, text: str) -> Iterator[tuple[str, str]]:
    """Yield short name and text of each definition in a schema; the first one may have no name and is the root's.

    Raises:
        SchemaError: Another one has no name.
    """
    for k, part in enumerate(_DEFINITION_SEPARATOR.split(text.replace("\r\n", "\n"))):
        named = _MESSAGE_NAME_LINE_PATTERN.search(part)
        if named is None and k:
            raise SchemaError("a part of the schema has no `MSG:` line")
        name = package_slash_message_name(named.group(1)) if named else root
        yield name, part[: named.start()] + part[named.end() :] if named else part


def package_slash_message_name(name: str) -> str:
    """Return package and name of a message type: `sensor_msgs/msg/Imu` -> `sensor_msgs/Imu`."""
    parts = name.split("/")
    return f"{parts[0]}/{parts[-1]}"


def find_message_fields(definitions: Definitions, name: str) -> tuple[MessageField, ...]:
    """Return the fields of a message.

    Raises:
        SchemaError: It is not defined.
    """
    found = definitions.get(name)
    if found is None:
        raise SchemaError(f"the schema does not define {name}")
    return found


def _parse_fields(package: str, body: str, aliases: Mapping[str, str]) -> tuple[MessageField, ...]:
    """Parse the field lines of one definition.

    Raises:
        SchemaError: A line is not a field, or an array is too long.
    """
    fields = []
    for raw_line in body.replace("\t", " ").splitlines():
        line = raw_line.partition("#")[0].strip()
        if not line:
            continue
        type_text, _, rest = line.partition(" ")
        rest = rest.lstrip()
        if _CONSTANT_ASSIGNMENT.match(rest):
            continue
        name = rest.partition(" ")[0]
        matched = _FIELD_TYPE_PATTERN.match(type_text)
        if not name or not matched:
            raise SchemaError(f"a line of the schema is not a field: {line[:60]!r}")
        base, _, is_bounded, size = matched.groups()
        is_array = "[" in type_text
        if len(size or "") > MAX_DIGITS_OF_ARRAY_LENGTH:
            raise SchemaError(f"an array of the schema is too long: {line[:60]!r}")
        length = int(size) if is_array and size and not is_bounded else None
        if length == 0:
            raise SchemaError(f"a line of the schema is not a field: {line[:60]!r}")
        if length is not None and length > MAX_ARRAY_ELEMENTS:
            raise SchemaError(f"an array of the schema is too long: {line[:60]!r}")
        fields.append(
            MessageField(name, _resolve_type_name(base, package, aliases), is_array and length is None, length)
        )
    return tuple(fields)


def _resolve_type_name(base: str, package: str, aliases: Mapping[str, str]) -> str:
    """Return a primitive or the short name of a message type that a definition of `package` names."""
    if base in aliases:
        return aliases[base]
    if base in PRIMITIVE_DTYPES or base in (STRING_TYPE, WSTRING_TYPE):
        return base
    if base == "Header":
        return "std_msgs/Header"
    return package_slash_message_name(base) if "/" in base else f"{package}/{base}"
