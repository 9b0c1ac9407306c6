"""Encodes columns as protobuf messages, without a Python object per message.

A message is a row of pieces: tags and numbers of fixed width, and strings, packed sequences and lengths whose size
differs from row to row. Every field that the channel names is written in each message, zero or not, in order of field
number, so messages whose strings and sequences are equally long are equally long themselves.

Wire format: https://protobuf.dev/programming-guides/encoding/
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from cwcli.logs.codecs.protobuf_tables import is_repeated_field
from cwcli.logs.encoders.byte_rows import ByteRows, encode_varint, encode_varints, join_rows
from cwcli.logs.encoders.column_tree import ColumnError, Tree, build_column_tree, repeated_from_ragged_leaves
from cwcli.logs.encoders.row_assembly import (
    FixedPiece,
    Piece,
    VaryingPiece,
    assemble_rows,
    encode_total_size_of_pieces,
    encode_varint_piece,
    piece_of_same_bytes_in_every_row,
)
from cwcli.signals.columns import Int64Array, NumericArray, OutputField, Ragged, Repeated, Strings
from cwcli.signals.units import NS_PER_S
from cwcli.text import escape_surrogates

if TYPE_CHECKING:
    from google.protobuf.descriptor import Descriptor, FieldDescriptor

WIRE_VARINT, WIRE_64_BIT, WIRE_LENGTH, WIRE_32_BIT = 0, 1, 2, 5
"""The wire types of protobuf: varint, 8 bytes, bytes after their length, 4 bytes (protobuf encoding guide)."""

FIXED_WIDTH_DTYPES = {1: "<f8", 2: "<f4", 6: "<u8", 7: "<u4", 15: "<i4", 16: "<i8"}
"""Field type (`google.protobuf.FieldDescriptorProto.Type`) of a number of fixed width -> NumPy type."""
VARINT_TYPES = frozenset({3, 4, 5, 8, 13, 14})
"""The field types (`FieldDescriptorProto.Type`) that are plain varints."""
ZIGZAG_TYPES = frozenset({17, 18})
"""The field types (`FieldDescriptorProto.Type`) sint32 and sint64, which are zigzag varints."""
TYPE_STRING, TYPE_MESSAGE, TYPE_BYTES, TYPE_ENUM = 9, 11, 12, 14
"""The field types (`FieldDescriptorProto.Type`) string, message, bytes and enum."""


def encode_protobuf(message: Descriptor, fields: Mapping[str, OutputField], n: int) -> ByteRows:
    """Encode n messages.

    Args:
        fields: Dotted field path -> n rows. A `google.protobuf.Timestamp` or `Duration` may be given as int64 ns under
            its own name, an enum as numbers or as the names of its values (`raised` for `STATE_RAISED`, in any case), a
            repeated message as `Repeated` or as `Ragged` leaves (`poses.position.x`), bytes as `Ragged` uint8.

    Returns:
        n rows, each a message.

    Raises:
        ColumnError: A path names no field of the message, or a column has the wrong kind or length for it.
    """
    return assemble_rows(_encode_message_pieces(message, build_column_tree(fields), n), n)


def _encode_message_pieces(message: Descriptor, tree: Tree, n: int) -> list[Piece]:
    unknown = sorted(set(tree) - set(message.fields_by_name))
    if unknown:
        raise ColumnError(f"{message.full_name} has no field {', '.join(unknown)}")
    pieces: list[Piece] = []
    for name, descriptor in _fields_by_number(message):
        if name in tree:
            try:
                pieces += _encode_field_pieces(descriptor, tree[name], n)
            except ColumnError as error:
                raise ColumnError(f"{descriptor.full_name}: {error}") from error
    return pieces


@lru_cache(maxsize=256)
def _fields_by_number(message: Descriptor) -> tuple[tuple[str, FieldDescriptor], ...]:
    """Return name and descriptor of each field, in order of field number."""
    return tuple((each.name, each) for each in sorted(message.fields, key=lambda each: each.number))


def _encode_field_pieces(descriptor: FieldDescriptor, column: OutputField | Tree, n: int) -> list[Piece]:
    if not isinstance(column, Mapping) and len(column) != n:
        raise ColumnError(f"{len(column)} rows instead of {n}")
    if descriptor.type == TYPE_MESSAGE:
        return _encode_submessage_pieces(descriptor, column, n)
    if isinstance(column, Mapping | Repeated):
        raise ColumnError("it is not a message")
    if is_repeated_field(descriptor):
        return _encode_packed_pieces(descriptor, column)
    if descriptor.type == TYPE_BYTES and isinstance(column, Ragged):
        return _encode_bytes_pieces(descriptor, column)
    if descriptor.type in (TYPE_STRING, TYPE_BYTES):
        if not isinstance(column, Strings):
            raise ColumnError("it needs strings")
        return _encode_string_pieces(descriptor, column)
    if isinstance(column, Strings):
        column = _enum_numbers_from_names(descriptor, column)
    if isinstance(column, Ragged) or column.ndim != 1:
        raise ColumnError("it holds one number, not a sequence")
    tag = _encode_tag_piece(descriptor, _wire_type_of_number(descriptor))
    return [tag, _encode_number_piece(descriptor, column)]


def _encode_submessage_pieces(descriptor: FieldDescriptor, column: OutputField | Tree, n: int) -> list[Piece]:
    message = descriptor.message_type
    tag = _encode_tag_piece(descriptor, WIRE_LENGTH)
    if is_repeated_field(descriptor):
        repeated = column if isinstance(column, Repeated) else repeated_from_ragged_leaves(column)
        total = int(repeated.offsets[-1])
        inner = _encode_message_pieces(message, build_column_tree(repeated.fields), total)
        rows = assemble_rows([tag, *encode_total_size_of_pieces(inner, total), *inner], total)
        bounds = rows.offsets[repeated.offsets]
        return [VaryingPiece(rows.data, bounds[:-1], np.diff(bounds))]
    if isinstance(column, np.ndarray) and message.full_name in (
        "google.protobuf.Timestamp",
        "google.protobuf.Duration",
    ):
        seconds, nanos = np.divmod(column, NS_PER_S)
        column = {"seconds": seconds, "nanos": nanos}
    if not isinstance(column, Mapping):
        raise ColumnError("it is a message: name the fields inside")
    inner = _encode_message_pieces(message, column, n)
    return [tag, *encode_total_size_of_pieces(inner, n), *inner]


def _encode_string_pieces(descriptor: FieldDescriptor, column: Strings) -> list[Piece]:
    """Return tag, length and text; no bytes where the string is absent."""
    prefix = _encode_tag(descriptor, WIRE_LENGTH)
    texts = [escape_surrogates(text).encode() for text in column.values]
    entries = join_rows([prefix + encode_varint(len(text)) + text for text in texts] + [b""])
    codes = np.where(column.codes < 0, len(texts), column.codes)
    if len(codes) and (codes == codes[0]).all():
        return [
            piece_of_same_bytes_in_every_row(
                entries.data[entries.offsets[codes[0]] : entries.offsets[codes[0] + 1]].tobytes()
            )
        ]
    return [VaryingPiece(entries.data, entries.offsets[codes], entries.sizes[codes])]


def _encode_bytes_pieces(descriptor: FieldDescriptor, column: Ragged) -> list[Piece]:
    """Return tag, length and bytes."""
    if column.values.dtype != np.uint8:
        raise ColumnError("it holds bytes: it needs ragged uint8")
    sizes = np.diff(column.offsets)
    content = VaryingPiece(np.ascontiguousarray(column.values, np.uint8), column.offsets[:-1], sizes)
    return [_encode_tag_piece(descriptor, WIRE_LENGTH), *encode_total_size_of_pieces([content], len(column)), content]


def _encode_packed_pieces(descriptor: FieldDescriptor, column: NumericArray | Ragged | Strings) -> list[Piece]:
    """Return tag, length and all numbers of a repeated numeric field."""
    if isinstance(column, Strings) or descriptor.type in (TYPE_STRING, TYPE_BYTES):
        raise ColumnError("repeated strings are not supported")
    if isinstance(column, np.ndarray) and column.ndim != 2:
        raise ColumnError("it is repeated: it needs an (n, k) array or a ragged column")
    tag = _encode_tag_piece(descriptor, WIRE_LENGTH)
    dtype = FIXED_WIDTH_DTYPES.get(descriptor.type)
    if dtype is not None and isinstance(column, np.ndarray):
        values = np.ascontiguousarray(column, dtype)
        return [
            tag,
            piece_of_same_bytes_in_every_row(encode_varint(values.shape[1] * values.itemsize)),
            FixedPiece(values),
        ]
    if isinstance(column, np.ndarray):
        column = Ragged(column.ravel(), np.arange(len(column) + 1, dtype=np.int64) * column.shape[1])
    if dtype is not None:
        values = np.ascontiguousarray(column.values, dtype)
        rows = ByteRows(values.view(np.uint8), column.offsets * values.itemsize)
    else:
        numbers = encode_varints(_unsigned_varint_values(descriptor, column.values))
        rows = ByteRows(numbers.data, numbers.offsets[column.offsets])
    packed = VaryingPiece(rows.data, rows.offsets[:-1], rows.sizes)
    return [tag, *encode_total_size_of_pieces([packed], len(rows)), packed]


def _encode_number_piece(descriptor: FieldDescriptor, column: NumericArray) -> Piece:
    dtype = FIXED_WIDTH_DTYPES.get(descriptor.type)
    if dtype is not None:
        return FixedPiece(np.ascontiguousarray(column, dtype))
    return encode_varint_piece(_unsigned_varint_values(descriptor, column))


def _unsigned_varint_values(descriptor: FieldDescriptor, values: NumericArray) -> npt.NDArray[np.uint64]:
    """Return the unsigned values for the varints of numbers: negative ones in two's complement or zigzag."""
    if values.dtype == np.uint64:
        return np.ascontiguousarray(values, np.uint64)
    signed = values.astype(np.int64)
    if descriptor.type in ZIGZAG_TYPES:
        return ((signed << 1) ^ (signed >> 63)).view(np.uint64)
    return signed.view(np.uint64)


def _enum_numbers_from_names(descriptor: FieldDescriptor, column: Strings) -> Int64Array:
    """Return the numbers of an enum's values from their names; an absent name is 0."""
    if descriptor.type != TYPE_ENUM:
        raise ColumnError("it holds numbers, not strings")
    numbers: dict[str, int] = {}
    prefix = f"{_to_upper_snake_case(descriptor.enum_type.name)}_"
    for value in descriptor.enum_type.values:
        numbers[value.name] = numbers[value.name.removeprefix(prefix)] = value.number
    unknown = [name for name in column.values if name.upper() not in numbers]
    if unknown:
        raise ColumnError(f"{descriptor.enum_type.full_name} has no value {unknown[0]}")
    by_code = np.array([*(numbers[name.upper()] for name in column.values), 0], np.int64)
    return by_code[column.codes]


def _to_upper_snake_case(name: str) -> str:
    return "".join(f"_{c}" if c.isupper() and i else c for i, c in enumerate(name)).upper()


def _wire_type_of_number(descriptor: FieldDescriptor) -> int:
    if descriptor.type in VARINT_TYPES or descriptor.type in ZIGZAG_TYPES:
        return WIRE_VARINT
    return WIRE_64_BIT if FIXED_WIDTH_DTYPES[descriptor.type].endswith("8") else WIRE_32_BIT


def _encode_tag(descriptor: FieldDescriptor, wire_type: int) -> bytes:
    return encode_varint(descriptor.number << 3 | wire_type)


def _encode_tag_piece(descriptor: FieldDescriptor, wire_type: int) -> FixedPiece:
    return _constant_varint_piece(descriptor.number << 3 | wire_type)


@lru_cache(maxsize=1024)
def _constant_varint_piece(value: int) -> FixedPiece:
    return piece_of_same_bytes_in_every_row(encode_varint(value))
