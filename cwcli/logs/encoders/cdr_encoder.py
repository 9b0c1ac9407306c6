"""Encodes columns as ROS 2 messages in CDR, without a Python object per message.

Each number is aligned to its own size, counted from the end of the four-byte header. Fields after a text or a sequence
therefore have another offset in every row: the encoder keeps the length of each row.

Source: DDS-XTYPES 1.3, 7.4.3 (plain CDR, version 1), little-endian, as `rmw` implementations write it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache

import numpy as np

from cwcli.logs.codecs.ros2msg import (
    PRIMITIVE_DTYPES,
    STRING_TYPE,
    Definitions,
    MessageField,
    find_message_fields,
    parse_message_definitions,
)
from cwcli.logs.encoders.byte_rows import ByteRows, join_rows
from cwcli.logs.encoders.cdr_fit import SECONDS_TYPE, TIME_TYPES, unrepresentable_mask
from cwcli.logs.encoders.column_tree import ColumnError, Tree, build_column_tree, repeated_from_ragged_leaves
from cwcli.logs.encoders.ros_schemas import ros2msg_schema_text
from cwcli.logs.encoders.row_assembly import (
    FixedPiece,
    Piece,
    VaryingPiece,
    assemble_rows,
    piece_of_same_bytes_in_every_row,
)
from cwcli.signals.columns import Int64Array, NumericArray, OutputField, Ragged, Repeated, Strings, absent_strings
from cwcli.signals.units import NS_PER_S

CDR_LITTLE_ENDIAN_HEADER = b"\x00\x01\x00\x00"
"""The encapsulation header of plain little-endian CDR (DDSI-RTPS 2.5, 10)."""
MAX_ALIGNMENT_BYTES = 8
"""The largest alignment of a number in bytes (CDR version 1)."""
PADDING_BYTES = np.zeros(MAX_ALIGNMENT_BYTES, np.uint8)
"""The zero bytes from which the padding in front of aligned numbers is taken."""


def encode_cdr(schema_name: str, fields: Mapping[str, OutputField], n: int) -> ByteRows:
    """Encode n messages.

    Args:
        schema_name: A message of `cwcli.logs.encoders.ros_schemas`.
        fields: Dotted field path -> n rows; a missing field is zero, empty or false. A time may be given as int64 ns
            under its own name, a sequence of messages as `Repeated` or as `Ragged` leaves.

    Returns:
        n rows, each a message with its encapsulation header.

    Raises:
        KeyError: There is no such message.
        ColumnError: A path names no field, or a column has the wrong kind for it or holds a number that does not fit
            (`unrepresentable_row_masks` finds such rows).
    """
    root, definitions = _parse_cached_definitions(schema_name)
    body = _CdrRows(np.zeros(n, np.int64))
    _append_message(body, definitions, root, build_column_tree(fields))
    return assemble_rows([piece_of_same_bytes_in_every_row(CDR_LITTLE_ENDIAN_HEADER), *body.pieces], n)


@lru_cache(maxsize=64)
def _parse_cached_definitions(schema_name: str) -> tuple[str, Definitions]:
    """Return short name of the root message and all message definitions of a schema that cwcli writes."""
    return parse_message_definitions(schema_name, ros2msg_schema_text(schema_name))


class _CdrRows:
    """Rows that grow piece by piece.

    Attributes:
        place: Shape (n,): bytes of each row after the encapsulation header.
    """

    def __init__(self, place: Int64Array) -> None:
        self.pieces: list[Piece] = []
        self.place = place

    def __len__(self) -> int:
        return len(self.place)

    def append_piece(self, piece: Piece) -> None:
        self.pieces.append(piece)
        self.place = self.place + (piece.bytes_per_row if isinstance(piece, FixedPiece) else piece.sizes)

    def append_padding(self, size: int, where: np.ndarray[tuple[int, ...], np.dtype[np.bool_]] | None = None) -> None:
        """Append zeros up to a multiple of the size, in the rows of the mask `where`."""
        gap = -self.place % size
        if where is not None:
            gap[~where] = 0
        if not gap.any():
            return
        if (gap == gap[0]).all():
            self.append_piece(piece_of_same_bytes_in_every_row(bytes(int(gap[0]))))
        else:
            self.append_piece(VaryingPiece(PADDING_BYTES, np.zeros(len(gap), np.int64), gap))

    def append_numbers(self, code: str, values: NumericArray) -> None:
        """Append the same number of values to each row, aligned; `code` is a NumPy type without byte order."""
        dtype = np.dtype(f"<{code}")
        self.append_padding(dtype.itemsize)
        self.append_piece(FixedPiece(np.ascontiguousarray(values, dtype)))

    def append_counts(self, counts: Int64Array) -> None:
        """Append a 32-bit length to each row."""
        self.append_numbers("u4", counts)


def _append_message(rows: _CdrRows, definitions: Definitions, name: str, tree: Tree) -> None:
    fields = find_message_fields(definitions, name)
    unknown = sorted(set(tree) - {field.name for field in fields})
    if unknown:
        raise ColumnError(f"{name} has no field {', '.join(unknown)}")
    for field in fields:
        try:
            _append_field(rows, definitions, field, tree.get(field.name))
        except ColumnError as error:
            raise ColumnError(f"{name}.{field.name}: {error}") from error


def _append_field(
    rows: _CdrRows, definitions: Definitions, field: MessageField, column: OutputField | Tree | None
) -> None:
    if column is not None and not isinstance(column, Mapping) and len(column) != len(rows):
        raise ColumnError(f"{len(column)} rows instead of {len(rows)}")
    is_array = field.is_sequence or field.length is not None
    if field.type in PRIMITIVE_DTYPES:
        if is_array:
            _append_array(rows, field, column)
        else:
            _append_number(rows, field, column)
    elif field.type == STRING_TYPE and not is_array:
        _append_text(rows, column)
    elif field.type == STRING_TYPE or field.length is not None:
        raise ColumnError("arrays of texts and of messages are not supported")
    elif field.is_sequence:
        _append_sequence(rows, definitions, field.type, column)
    else:
        _append_message(rows, definitions, field.type, _fields_of_nested_message(field.type, column))


def _fields_of_nested_message(name: str, column: OutputField | Tree | None) -> Tree:
    """Return the column tree of a message inside a message.

    Raises:
        ColumnError: The column is neither a tree nor a time.
    """
    if column is None:
        return {}
    if isinstance(column, Mapping):
        return column
    if name in TIME_TYPES and isinstance(column, np.ndarray):
        seconds, nanos = np.divmod(column, NS_PER_S)
        return {"sec": _require_numbers_that_fit_type(SECONDS_TYPE, seconds), "nanosec": nanos}
    raise ColumnError("it is a message: name the fields inside")


def _require_numbers_that_fit_type(type_name: str, values: NumericArray) -> NumericArray:
    """Return the numbers unchanged.

    Raises:
        ColumnError: The primitive type can't represent some of them.
    """
    n_unfit = int(np.count_nonzero(unrepresentable_mask(type_name, values)))
    if n_unfit:
        raise ColumnError(f"{n_unfit} of {values.size} numbers do not fit in {type_name}")
    return values


def _append_number(rows: _CdrRows, field: MessageField, column: OutputField | Tree | None) -> None:
    if column is None:
        column = np.zeros(len(rows))
    if not isinstance(column, np.ndarray) or column.ndim != 1:
        raise ColumnError("it holds one number")
    rows.append_numbers(PRIMITIVE_DTYPES[field.type], _require_numbers_that_fit_type(field.type, column))


def _append_array(rows: _CdrRows, field: MessageField, column: OutputField | Tree | None) -> None:
    code = PRIMITIVE_DTYPES[field.type]
    if column is None:
        column = np.zeros((len(rows), field.length or 0))
    if field.length is not None:
        if not isinstance(column, np.ndarray) or column.shape != (len(rows), field.length):
            raise ColumnError(f"it holds {field.length} numbers")
        rows.append_numbers(code, _require_numbers_that_fit_type(field.type, column))
        return
    if isinstance(column, np.ndarray) and column.ndim == 2:
        column = Ragged(column.ravel(), np.arange(len(column) + 1, dtype=np.int64) * column.shape[1])
    if not isinstance(column, Ragged):
        raise ColumnError("it needs an (n, k) array or a ragged column")
    values = np.ascontiguousarray(_require_numbers_that_fit_type(field.type, column.values), f"<{code}")
    counts = np.diff(column.offsets)
    rows.append_counts(counts)
    rows.append_padding(values.itemsize, counts > 0)  # nothing is aligned for numbers that are not there
    rows.append_piece(
        VaryingPiece(values.view(np.uint8), column.offsets[:-1] * values.itemsize, counts * values.itemsize)
    )


def _append_text(rows: _CdrRows, column: OutputField | Tree | None) -> None:
    """Append texts: the length with the final zero, and the text. Absent texts are empty; a zero inside is replaced."""
    if column is None:
        column = absent_strings(len(rows))
    if not isinstance(column, Strings):
        raise ColumnError("it needs strings")
    texts = [value.replace("\0", "\N{REPLACEMENT CHARACTER}").encode(errors="replace") for value in column.values]
    entries = join_rows([text + b"\0" for text in (*texts, b"")])
    codes = np.where(column.codes < 0, len(texts), column.codes)
    rows.append_counts(entries.sizes[codes])
    rows.append_piece(VaryingPiece(entries.data, entries.offsets[codes], entries.sizes[codes]))


def _append_sequence(rows: _CdrRows, definitions: Definitions, name: str, column: OutputField | Tree | None) -> None:
    """Append a sequence of messages. The size of an element depends on its start modulo eight."""
    if column is None:
        rows.append_counts(np.zeros(len(rows), np.int64))
        return
    repeated = column if isinstance(column, Repeated) else repeated_from_ragged_leaves(column)
    tree = build_column_tree(repeated.fields)
    rows.append_counts(np.diff(repeated.offsets))

    def encode_elements_at(place: Int64Array) -> _CdrRows:
        each = _CdrRows(place)
        _append_message(each, definitions, name, tree)
        return each

    place = _element_starts_modulo_eight(rows.place, repeated.offsets, encode_elements_at)
    encoded = assemble_rows(encode_elements_at(place).pieces, len(place))
    bounds = encoded.offsets[repeated.offsets]
    rows.append_piece(VaryingPiece(encoded.data, bounds[:-1], np.diff(bounds)))


def _element_starts_modulo_eight(
    row_place: Int64Array, offsets: Int64Array, encode_elements_at: Callable[[Int64Array], _CdrRows]
) -> Int64Array:
    """Return the start of each element modulo eight, which is the end of the element before it in its row.

    Args:
        row_place: Shape (n,): start of the first element of each row.
        offsets: Shape (n + 1,): number of elements before each row.
        encode_elements_at: Encodes all elements for given starts.
    """
    total, counts = int(offsets[-1]), np.diff(offsets)
    ends: dict[int, list[int]] = {}
    open_places = set((row_place[counts > 0] % MAX_ALIGNMENT_BYTES).tolist())
    while open_places:
        place = open_places.pop()
        end = encode_elements_at(np.full(total, place, np.int64)).place % MAX_ALIGNMENT_BYTES
        ends[place] = end.tolist()
        open_places |= set(np.unique(end).tolist()) - set(ends)
    places: list[int] = []
    for row in np.flatnonzero(counts).tolist():
        place = int(row_place[row]) % MAX_ALIGNMENT_BYTES
        for k in range(int(offsets[row]), int(offsets[row + 1])):
            places.append(place)
            place = ends[place][k]
    return np.array(places, np.int64)
